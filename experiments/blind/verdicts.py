"""The parts that ask for a verdict: one effect, two, none, foreign ones, efficiency alone."""

import math
from collections import Counter
from collections.abc import Callable, Sequence

import numpy as np

from experiments.blind.draws import (
    HOW_MANY,
    SIZES,
    efficiency_only,
    foreign,
    foreign_alone,
    nothing,
    pairs,
    singles,
    sizes,
)
from experiments.blind.part import Outcome, Part, Run
from experiments.blind.reach import hideable
from experiments.blind.scoring import Scored, Share, judged, left_by_noise, share
from experiments.blind.sight import LEAST_SIGMA
from experiments.blind.trial import NOISES
from experiments.harness.result import Cell, Table

SINGLES, PAIRS, NOTHINGS, FOREIGNS, EFFICIENCY_ONLYS, OF_SIZES = 500, 300, 3000, 300, 300, 81
FOREIGNS_ALONE = 150
_OUTCOMES: dict[str, Callable[[Scored], bool]] = {
    "wrong": lambda s: s.wrong,
    "unknown": lambda s: s.unknown,
    "consistent": lambda s: s.consistent,
}
_BANDS = ((5.0, 10.0), (10.0, 30.0), (30.0, 100.0), (100.0, float("inf")))


def _single(run: Run) -> Outcome:
    scored = run.scored(singles, SINGLES)
    goals = (
        share(scored, lambda s: s.right_first).goal("single: right name first", 98.0, at_least=True),
        share(scored, lambda s: s.stated).goal("single: in the stated group", 99.0, at_least=True),
        share(scored, lambda s: s.wrong).goal("single: confidently wrong", 1.0, at_least=False),
        share(scored, lambda s: s.unknown).goal("single: unknown", 2.0, at_least=False),
    )
    tables = (_by_effect("One hidden effect, by effect", scored), _by_sigma(scored))
    return Outcome(
        goals=goals, tables=(*tables, misses("One", scored, _found)), notes=notes("single", scored)
    )


def _pairs(run: Run) -> Outcome:
    scored = run.scored(pairs, PAIRS)
    goal = share(scored, lambda s: s.exact).goal("pairs: exact pair", 90.0, at_least=True)
    wrong = share(scored, lambda s: s.wrong)
    either = share(scored, lambda s: bool(set(s.said.stated) & set(s.trial.names)))
    said = (
        f"pairs: at least one of the two is stated in {either.hits} of {either.trials}, something that is not "
        f"there in {wrong.hits}"
    )
    tables = (misses("Pairs", scored, lambda s: s.exact),)
    return Outcome(goals=(goal,), tables=tables, notes=(*notes("pairs", scored), said))


def _nothing(run: Run) -> Outcome:
    scored = run.scored(nothing, NOTHINGS)
    goals = (
        share(scored, lambda s: s.wrong).goal("nothing hidden: false names", 0.1, at_least=False),
        share(scored, lambda s: s.consistent).goal("nothing hidden: consistent", 90.0, at_least=True),
    )
    rows = [_noise_row(kind, [s for s in scored if s.trial.noise == kind]) for kind in NOISES]
    columns = ("noise", "trials", "consistent", "false names", "unknown", "no answer")
    table = Table(title="Nothing hidden, by noise", columns=columns, rows=tuple(rows))
    return Outcome(
        goals=goals,
        tables=(table, misses("Nothing", scored, lambda s: s.consistent)),
        notes=notes("nothing", scored),
    )


def _noise_row(kind: str, scored: Sequence[Scored]) -> tuple[Cell, ...]:
    verdicts = Counter(s.said.verdict for s in scored)
    wrong = sum(s.wrong for s in scored)
    return kind, len(scored), verdicts["consistent"], wrong, verdicts["unknown"], verdicts["no answer"]


def _foreign(run: Run) -> Outcome:
    scored = run.scored(foreign, FOREIGNS)
    goals = (
        share(scored, lambda s: s.unknown).goal("foreign: unknown", 95.0, at_least=True),
        share(scored, lambda s: s.wrong).goal("foreign: misnamed", 2.0, at_least=False),
    )
    return Outcome(
        goals=goals,
        tables=(
            _by_family("Not in the catalogue, by family", scored),
            misses("Foreign", scored, lambda s: s.unknown),
        ),
        notes=notes("foreign", scored),
    )


def _foreign_alone(run: Run) -> Outcome:
    """The same labs by efficiency alone; there is no bar for it."""
    scored = run.scored(foreign_alone, FOREIGNS_ALONE)
    counts = ((said, share(scored, holds)) for said, holds in _OUTCOMES.items())
    told = (f"{said} {s.hits} of {s.trials} ({s.per_cent:.3g} %)" for said, s in counts)
    return Outcome(
        tables=(
            _by_family("Not in the catalogue, efficiency alone, by family", scored),
            misses("Foreign, efficiency alone", scored, lambda s: not s.wrong),
        ),
        notes=(*notes("foreign alone", scored), f"foreign alone: {', '.join(told)}"),
    )


def _efficiency_only(run: Run) -> Outcome:
    scored = run.scored(efficiency_only, EFFICIENCY_ONLYS)
    stated = [s for s in judged(scored) if s.stated]
    goals = (
        share(scored, lambda s: s.stated).goal(
            "efficiency only: right cause in the stated group", 99.0, at_least=True
        ),
        Share.of(len(s.said.stated) <= len(s.tied) for s in stated).goal(
            "efficiency only: group no larger than the design's", 100.0, at_least=True
        ),
    )
    return Outcome(
        goals=goals,
        tables=(
            _by_effect("Efficiency only, by effect", scored),
            misses("Efficiency only", scored, _found),
        ),
        notes=(*notes("efficiency only", scored), _faint(judged(scored)), _by_chance(stated)),
    )


def _sizes(run: Run) -> Outcome:
    """Trials of other sizes than the table's hundred points; they have no bar, and none is left out as too faint."""
    scored = run.scored(sizes, OF_SIZES)
    rows = []
    for points in SIZES:
        own = [s for s in scored if s.trial.points == points]
        counts = (sum(map(holds, own)) for holds in (_found, *_OUTCOMES.values()))
        rows.append((points, len(own), *counts, max((s.said.cpu_s for s in own), default=None)))
    columns = ("points", "trials", "found, nothing else", *_OUTCOMES, "processor time at most, s")
    table = Table(
        title="One hidden effect, however faint, by the size of the table", columns=columns, rows=tuple(rows)
    )
    return Outcome(tables=(table, misses("Sizes", scored, _found)), notes=notes("sizes", scored))


def _faint(seen: Sequence[Scored]) -> str:
    """One cause of the catalogue has beforehand so much less probability than that nothing is wrong."""
    against = math.log(len(hideable()) / HOW_MANY[1])
    expected = left_by_noise((s.isolability for s in seen if s.isolability is not None), against)
    of_100 = 100 * left_by_noise([LEAST_SIGMA], against)
    return (
        f"efficiency only: noise alone leaves at least {expected:.1f} of {len(seen)} labs consistent, whoever judges "
        f"with odds of {math.exp(against):.0f} against each cause: of those that stand out by {LEAST_SIGMA:g} sigma "
        f"{of_100:.0f} in 100"
    )


def _by_chance(stated: Sequence[Scored]) -> str:
    expected = left_by_noise(s.nearest for s in stated if s.nearest is not None)
    return (
        f"efficiency only: noise alone leaves {expected:.1f} of {len(stated)} causes in one group with the next that "
        "the design can tell from them, whoever judges: those five sigma apart in 3 of 100 benches"
    )


def _found(s: Scored) -> bool:
    return s.stated and not s.wrong


def _by_effect(title: str, scored: Sequence[Scored]) -> Table:
    """Per hidden effect: how it went, and what it was most often taken for."""
    rows = []
    for name in dict.fromkeys(s.trial.names[0] for s in scored):
        own = [s for s in scored if s.trial.names[0] == name]
        seen = judged(own)
        taken = Counter(s.said.first or s.said.verdict for s in seen if not s.stated)
        rows.append((
            name, len(seen), len(own) - len(seen), sum(s.right_first for s in seen),
            sum(s.stated for s in seen), sum(s.wrong for s in seen), sum(s.unknown for s in seen),
            sum(s.consistent for s in seen), ", ".join(f"{n} {k}" for n, k in taken.most_common(2)) or None,
        ))  # fmt: skip
    columns = (
        "hidden", "trials", "excluded", "first", "stated", "wrong", "unknown", "consistent", "taken for",
    )  # fmt: skip
    return Table(title=title, columns=columns, rows=tuple(rows))


def _by_family(title: str, scored: Sequence[Scored]) -> Table:
    rows = []
    for name in dict.fromkeys(s.trial.names[0] for s in scored):
        own = [s for s in scored if s.trial.names[0] == name]
        seen = judged(own)
        verdicts = Counter(s.said.verdict for s in seen)
        taken = Counter(s.said.first for s in seen if s.wrong)
        rows.append((
            name, len(seen), len(own) - len(seen), verdicts["unknown"], sum(s.wrong for s in seen),
            verdicts["consistent"], ", ".join(f"{n} {k}" for n, k in taken.most_common(2)) or None,
        ))  # fmt: skip
    columns = ("family", "trials", "excluded", "unknown", "misnamed", "consistent", "taken for")
    return Table(title=title, columns=columns, rows=tuple(rows))


def _by_sigma(scored: Sequence[Scored]) -> Table:
    rows = []
    for low, high in _BANDS:
        own = [s for s in judged(scored) if s.isolability is not None and low <= s.isolability < high]
        label = f"{low:g} to {high:g}" if np.isfinite(high) else f"above {low:g}"
        counts = (len(own), sum(s.right_first for s in own), sum(s.stated for s in own))
        rows.append((label, *counts, sum(s.wrong for s in own), sum(s.unknown for s in own)))
    columns = ("isolability, sigma", "trials", "first", "stated", "wrong", "unknown")
    return Table(title="One hidden effect, by isolability", columns=columns, rows=tuple(rows))


def misses(title: str, scored: Sequence[Scored], right: Callable[[Scored], bool]) -> Table:
    """Every trial that did not go as it should."""
    rows = []
    for s in judged(scored):
        if right(s):
            continue
        hidden = " + ".join(f"{name} = {value:.3g}" for name, value in s.trial.hidden) or "nothing"
        probability = s.said.causes[0].probability if s.said.causes else None
        rows.append((
            hidden, s.trial.seed, s.trial.points, s.isolability, s.said.verdict, ", ".join(s.said.stated) or None,
            s.said.first, probability, s.said.unknown, s.said.refused or None,
        ))  # fmt: skip
    columns = (
        "hidden", "seed", "points", "isolability", "verdict", "stated", "first cause", "probability", "leftover",
        "refused",
    )  # fmt: skip
    return Table(title=f"{title}: all that went wrong", columns=columns, rows=tuple(rows))


def notes(name: str, scored: Sequence[Scored]) -> tuple[str, ...]:
    """Counts, seeds and processor time of a part."""
    seen = judged(scored)
    if not seen:
        return (f"{name}: all of {len(scored)} trials were excluded",)
    seeds, cpu_s = [s.trial.seed for s in scored], [s.said.cpu_s for s in seen]
    left_out = len(scored) - len(seen)
    return (
        f"{name}: {len(seen)} trials scored, {left_out} excluded below 5 sigma, seeds {min(seeds)} to {max(seeds)}; "
        f"a diagnosis took {np.median(cpu_s):.1f} s of processor time in the median, {max(cpu_s):.1f} s at most",
    )


VERDICT_PARTS = (
    Part(name="single", says="one hidden effect", run=_single),
    Part(name="pairs", says="two at once", run=_pairs),
    Part(name="nothing", says="nothing hidden, four kinds of noise", run=_nothing),
    Part(name="foreign", says="not in the catalogue", run=_foreign),
    Part(
        name="foreign_alone",
        says="not in the catalogue, efficiency alone; without a bar, by name only",
        run=_foreign_alone,
        beside=True,
    ),
    Part(name="efficiency_only", says="efficiency alone", run=_efficiency_only),
    Part(
        name="sizes",
        says="one hidden effect in short and long tables; without a bar, by name only",
        run=_sizes,
        beside=True,
    ),
)
