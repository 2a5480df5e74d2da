"""What the diagnosis says of benches whose parts do not settle within their rows: virtual labs with slow heat.

Heatsink and windings of every lab have time constants of minutes to an hour, drawn anew, while a row takes three
minutes. One lab after the other hides one effect of a size that a lab draws, and as many hide nothing; these are
diagnosed with efficiency alone as well. What is hidden in a slow bench may be too small to be seen: that is not asked.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from drivers.mocks.lab.hidden import HIDDEN
from drivers.mocks.lab.laboratory import Inertia
from drivers.mocks.lab.survey import survey
from experiments.blind.answer import Answer
from experiments.blind.draws import log_uniform
from experiments.blind.reach import hideable
from experiments.blind.scoring import Share
from experiments.blind.trial import BlindTrial, answered, efficiency_table, laboratory
from experiments.converter_trials import ALL, ALONE, verdict_table
from experiments.harness.registry import Experiment
from experiments.harness.result import Cell, Result, Table
from experiments.harness.settings import Countdown, Settings

FIRST_SEED = 490_000  # those from 470,000 on were looked at while the diagnosis learned of slow benches
HEATSINK_S, WINDING_S = (120.0, 900.0), (300.0, 3600.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class Said:
    """The answer to one lab's readings of some channels."""

    trial: BlindTrial
    inertia: Inertia
    channels: str
    answer: Answer

    @property
    def found(self) -> bool:
        """What is hidden is stated, and nothing that is not there."""
        names = self.trial.names
        return bool(names) and set(names) <= set(self.answer.stated) and not self.answer.misnames(names)


def inertia_of(seed: int) -> Inertia:
    """The time constants of one lab."""
    rng = np.random.default_rng([seed, 12])
    heatsink_s, inductor_s, transformer_s = (
        log_uniform(drawn, rng) for drawn in (HEATSINK_S, WINDING_S, WINDING_S)
    )
    return Inertia(heatsink_s=heatsink_s, inductor_s=inductor_s, transformer_s=transformer_s)


def diagnosed(trial: BlindTrial) -> Iterator[Said]:
    """The answers to one lab: to all channels, and, where nothing is hidden, to efficiency alone."""
    inertia = inertia_of(trial.seed)
    table = survey(replace(laboratory(trial), inertia=inertia), trial.plan, seed=trial.seed)
    tables = {ALL: table} if trial.hidden else {ALL: table, ALONE: efficiency_table(table)}
    for channels, measured in tables.items():
        yield Said(trial=trial, inertia=inertia, channels=channels, answer=answered(measured))


def run(settings: Settings) -> Result:
    """Labs with nothing hidden first, then one effect after the other."""
    names = hideable()[: settings.thinned(len(hideable()))]
    trials = [BlindTrial(row="slow", seed=FIRST_SEED + k) for k in range(len(names))]
    for k, name in enumerate(names, start=len(names)):
        value = log_uniform(HIDDEN[name].drawn, np.random.default_rng([FIRST_SEED + k, 13]))
        trials.append(BlindTrial(row="slow", seed=FIRST_SEED + k, hidden=((name, value),)))
    countdown, said = Countdown(len(trials), settings), list[Said]()
    for trial in trials:
        said += diagnosed(trial)
        countdown.finished(f"{' and '.join(trial.names) or 'nothing'} hidden")
    quiet, loud = [s for s in said if not s.trial.hidden], [s for s in said if s.trial.hidden]
    consistent = Share.of(s.answer.verdict == "consistent" for s in quiet)
    misnamed = Share.of(s.answer.misnames(s.trial.names) for s in said)
    return Result(
        virtual=True,
        goals=(
            consistent.goal("nothing hidden: consistent", 99.0, at_least=True),
            misnamed.goal("confidently wrong", 1.0, at_least=False),
        ),
        tables=(verdict_table([(s.channels, s.answer) for s in quiet]), _effects(loud)),
        notes=(
            f"time constants of {HEATSINK_S[0]:.0f} to {HEATSINK_S[1]:.0f} s for the heatsink, {WINDING_S[0]:.0f} to "
            f"{WINDING_S[1]:.0f} s for the windings, rows every 180 s; seeds {FIRST_SEED} to "
            f"{FIRST_SEED + len(trials) - 1}",
        ),
    )


def _effects(loud: Sequence[Said]) -> Table:
    rows: list[tuple[Cell, ...]] = [
        (
            *(f"{name} = {value:.3g}" for name, value in s.trial.hidden), s.trial.seed, round(s.inertia.heatsink_s),
            round(s.inertia.inductor_s), round(s.inertia.transformer_s), s.answer.verdict,
            ", ".join(s.answer.stated), s.found,
        )
        for s in loud
    ]  # fmt: skip
    columns = ("hidden", "seed", "heatsink, s", "inductor, s", "transformer, s", "verdict", "stated", "found")
    return Table(title="One effect hidden, all channels", columns=columns, rows=tuple(rows))


EXPERIMENT = Experiment(title="The diagnosis of slow benches", run=run, apart=True)
