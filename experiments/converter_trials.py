"""What the diagnosis says of a converter that it was not tuned on: labs with nothing hidden, and with one effect.

Labs of the converter of the experiment second_converter, every part off by its everyday spread, are
measured at random points. Each table is diagnosed twice: with all channels, and with efficiency alone. The loss of
this converter is mostly that of its edges, so the laws of switching weigh here as they do not in the prototype.
"""

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from bench.model_file import read_model
from drivers.mocks.lab.laboratory import Laboratory
from experiments.blind.answer import Answer
from experiments.blind.reach import hideable
from experiments.blind.scoring import Share
from experiments.blind.trial import answered, efficiency_table
from experiments.harness.registry import Experiment
from experiments.harness.result import Cell, Result, Table
from experiments.harness.settings import Countdown, Settings
from experiments.second_converter import MODEL_FILE, Bench, absent_effects
from sim.effects.catalogue import CATALOGUE
from sim.model import Model

FIRST_SEED = 460_000
NOTHING, POINTS = 40, 110
ALL, ALONE = "all channels", "efficiency alone"
_A_GAIN_HERE = "analyzer_range_step"  # the input current never leaves the lower range, where a step is a gain


@dataclass(frozen=True, slots=True, kw_only=True)
class Said:
    """The answer to one lab's readings of some channels, with what it hides: one effect or none."""

    hidden: tuple[str, ...]
    seed: int
    channels: str
    answer: Answer

    @property
    def found(self) -> bool:
        """What is hidden is stated, and nothing that is not there."""
        stated = bool(self.hidden) and set(self.hidden) <= set(self.answer.stated)
        return stated and not self.answer.misnames(self.hidden)


def relative_effects(model: Model) -> list[str]:
    """Effects that such a lab can hide and whose sizes are shares; ohms and watts are drawn for the prototype."""
    absent = [*absent_effects(model), _A_GAIN_HERE]
    shares = [name for name in hideable() if CATALOGUE[name].headline.unit == "1" and name not in absent]
    return [name for name in shares if _can_hide(model, name)]


def _can_hide(model: Model, name: str) -> bool:
    """Whether the lab's own parts have it too: what it changes in the prototype's legs, these may not have."""
    try:
        Laboratory.draw(seed=FIRST_SEED, hidden={name: None}, converter=model.converter)
    except AttributeError:
        return False
    return True


def diagnosed(model: Model, hidden: tuple[str, ...], seed: int) -> Iterator[Said]:
    """The answers to one lab: to all channels, and to efficiency alone."""
    lab = Laboratory.draw(seed=seed, hidden=dict.fromkeys(hidden), converter=model.converter)
    table = Bench(model, lab, seed).campaign(POINTS).drop(columns=["simulated", "true"])
    alone = efficiency_table(table)
    for channels, measured in ((ALL, table), (ALONE, alone)):
        answer = answered(measured, model, without=absent_effects(model))
        yield Said(hidden=hidden, seed=seed, channels=channels, answer=answer)


def run(settings: Settings) -> Result:
    """Labs with nothing hidden first, then one effect after the other."""
    model = read_model(MODEL_FILE)
    relative = relative_effects(model)
    each: list[tuple[str, ...]] = [()] * settings.thinned(NOTHING)
    each += [(name,) for name in relative[: settings.thinned(len(relative))]]
    countdown, said = Countdown(len(each), settings), list[Said]()
    for number, hidden in enumerate(each):
        said += diagnosed(model, hidden, FIRST_SEED + number)
        countdown.finished(f"{' and '.join(hidden) or 'nothing'} hidden")
    quiet, loud = [s for s in said if not s.hidden], [s for s in said if s.hidden]
    wrong = Share.of(s.answer.misnames(s.hidden) for s in quiet)
    misnamed = Share.of(s.answer.misnames(s.hidden) for s in loud)
    return Result(
        virtual=True,
        goals=(
            wrong.goal("nothing hidden: false names", 0.1, at_least=False),
            misnamed.goal("one effect: confidently wrong", 1.0, at_least=False),
        ),
        tables=(verdict_table([(s.channels, s.answer) for s in quiet]), _effects(loud), _misses(said)),
        notes=(
            f"{POINTS} points in each lab of {model.converter.name}, through the instruments' model without the wire; "
            f"seeds {FIRST_SEED} to {FIRST_SEED + len(each) - 1}",
            "effects have the sizes that a lab of the prototype draws; whether they can be seen here was not asked",
        ),
        assumed=("everything about this converter: see its file",),
    )  # fmt: skip


def verdict_table(said: Sequence[tuple[str, Answer]]) -> Table:
    """What was said of labs with nothing hidden, by the channels it was said of."""
    rows: list[tuple[Cell, ...]] = []
    for channels, own in ((c, [answer for of, answer in said if of == c]) for c in (ALL, ALONE)):
        kinds = Counter(answer.verdict for answer in own)
        wrong = sum(answer.misnames(()) for answer in own)
        rows.append((channels, len(own), kinds["consistent"], wrong, kinds["unknown"]))
    columns = ("channels", "labs", "consistent", "false names", "unknown")
    return Table(title="Nothing hidden", columns=columns, rows=tuple(rows))


def _effects(loud: Sequence[Said]) -> Table:
    rows: list[tuple[Cell, ...]] = []
    for hidden in dict.fromkeys(s.hidden for s in loud):
        said = {s.channels: s for s in loud if s.hidden == hidden}
        verdicts = [said[channels].answer.verdict for channels in (ALL, ALONE)]
        rows.append((*hidden, verdicts[0], said[ALL].found, verdicts[1], said[ALONE].found))
    columns = ("hidden", ALL, "found", ALONE, "found alone")
    return Table(title="One effect hidden", columns=columns, rows=tuple(rows))


def _misses(said: Sequence[Said]) -> Table:
    """Everything that is stated and not there."""
    rows: list[tuple[Cell, ...]] = [
        (*(s.hidden or ("nothing",)), s.seed, s.channels, s.answer.verdict, ", ".join(s.answer.stated))
        for s in said
        if s.answer.misnames(s.hidden)
    ]
    columns = ("hidden", "seed", "channels", "verdict", "stated")
    return Table(title="Stated, and not there", columns=columns, rows=tuple(rows))


EXPERIMENT = Experiment(title="The diagnosis of a second converter", run=run, apart=True)
