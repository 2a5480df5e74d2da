"""Blind trials of the diagnosis, one hidden effect each.

Every effect that a virtual lab can hide, in three sizes (a log-uniform draw from each third of the lab's
range) and two labs a size, and six labs that hide nothing. A lab draws all its parts and instruments inside
their tolerances, measures 100 random set points with a reference every eight, and hands over the table alone.
Found: the first named cause is the hidden effect, or the stated group holds it. False name: something is
stated and the hidden effect is not in it.

Every trial has a seed of its own, so that trials are independent. Scored seeds start at 110000; seeds below
that were looked at while the diagnosis was tuned.
"""

import math
from collections.abc import Sequence

import numpy as np

import drivers.mocks.lab
import experiments.blind.trial
import experiments.harness.lab_data
import models
import sim
from drivers.mocks.lab.hidden import HIDDEN
from experiments.blind.scoring import Scored, Share, covered_share, false_share, found_share
from experiments.blind.trial import Answer, BlindTrial, ask
from experiments.harness.journal import Journal, code_hash
from experiments.harness.registry import Experiment
from experiments.harness.result import Cell, Goal, Result, Table
from experiments.harness.settings import Settings
from experiments.harness.trials import perform
from sim.effects.catalogue import CATALOGUE

FIRST_SEED = 110_000
SIZES = ("small", "medium", "large")
LABS_A_SIZE = 2
LABS_WITH_NOTHING = 6
FOUND_BAR, FALSE_BAR = 90.0, 0.0


def hideable() -> list[str]:
    """Effects that are in the catalogue and that a lab can hide, in the catalogue's order."""
    return [name for name in CATALOGUE if name in HIDDEN]


def plan(settings: Settings) -> list[BlindTrial]:
    """All trials, or a share of them in which every effect still is, and every size."""
    slots = [(size, lab) for lab in range(LABS_A_SIZE) for size in SIZES]
    trials = []
    for k, effect in enumerate(hideable()):
        for j in range(settings.thinned(len(slots))):
            slot = (j + k) % len(slots)  # thinned to one, effect after effect takes another size
            seed = FIRST_SEED + k * len(slots) + slot
            size = slots[slot][0]
            trials.append(BlindTrial(effect=effect, value=drawn(effect, size, seed), size=size, seed=seed))
    first = FIRST_SEED + len(hideable()) * len(slots)
    nothing = range(first, first + settings.thinned(LABS_WITH_NOTHING))
    return trials + [BlindTrial(effect=None, value=None, size="–", seed=seed) for seed in nothing]


def drawn(effect: str, size: str, seed: int) -> float:
    """A value from a third of the lab's range, log-uniform; the large ones are those furthest from off."""
    off = CATALOGUE[effect].headline.off
    near, far = map(math.log, sorted(HIDDEN[effect].drawn, key=lambda value: abs(value - off)))
    third = (far - near) / len(SIZES)
    start = near + SIZES.index(size) * third
    return math.exp(start + third * float(np.random.default_rng([seed, 11]).uniform()))


def run(settings: Settings) -> Result:
    """Run what the journal in ``settings.out`` does not hold yet, and score everything."""
    trials = plan(settings)
    code = code_hash(sim, models, drivers.mocks.lab, experiments.harness.lab_data, experiments.blind.trial)
    journal = Journal(path=settings.out / "first_trials.jsonl", code=code)
    records = perform(ask, trials, journal, settings)
    return scored_result(
        [Scored(trial=t, answer=Answer.from_plain(r)) for t, r in zip(trials, records, strict=True)]
    )


def scored_result(scored: Sequence[Scored]) -> Result:
    """Goals and tables of scored trials."""
    found, false = found_share(scored), false_share(scored)
    wrong = [s for s in scored if s.outcome not in ("found", "rightly none")]
    return Result(
        virtual=True,
        goals=(
            _goal("hidden effects found", found, FOUND_BAR, at_least=True),
            _goal("false names", false, FALSE_BAR, at_least=False),
        ),
        tables=(
            _trial_table("All trials", scored),
            _effect_table(scored),
            _trial_table("Not found, or named falsely", wrong),
        ),
        notes=_notes(scored),
    )


def _goal(name: str, share: Share, bar: float, *, at_least: bool) -> Goal:
    said = f"{name} ({share.hits} of {share.trials})"
    return Goal(name=said, value=share.per_cent, bar=bar, at_least=at_least, unit="%", ci95=share.ci95)


def _trial_table(title: str, scored: Sequence[Scored]) -> Table:
    columns = (
        "hidden", "value", "unit", "size", "seed", "verdict", "first cause", "probability", "its value", "±",
        "holds the value", "leftover", "found", "false name",
    )  # fmt: skip
    return Table(title=title, columns=columns, rows=tuple(_trial_row(s) for s in scored))


def _trial_row(s: Scored) -> tuple[Cell, ...]:
    t, a = s.trial, s.answer
    verdict = a.verdict if len(a.stated) < 2 else f"group: {', '.join(a.stated)}"
    return (
        t.effect or "nothing", t.value, None if t.effect is None else CATALOGUE[t.effect].headline.unit,
        t.size, t.seed, verdict, a.first,
        a.probability, a.value, a.half_width, s.covered, a.leftover, s.found, s.false_name,
    )  # fmt: skip


def _effect_table(scored: Sequence[Scored]) -> Table:
    rows: list[tuple[Cell, ...]] = []
    for effect in hideable():
        own = [s for s in scored if s.trial.effect == effect]
        sizes = {size: found_share([s for s in own if s.trial.size == size]) for size in SIZES}
        cells = (f"{share.hits} of {share.trials}" if share.trials else None for share in sizes.values())
        rows.append((effect, *cells, sum(s.false_name for s in own)))
    nothing = [s for s in scored if s.trial.effect is None]
    right = sum(s.outcome == "rightly none" for s in nothing)
    none = f"nothing ({right} of {len(nothing)} consistent)"
    rows.append((none, *(None,) * len(SIZES), sum(s.false_name for s in nothing)))
    columns = ("hidden", *(f"found, {size}" for size in SIZES), "false names")
    return Table(title="By effect", columns=columns, rows=tuple(rows))


def _notes(scored: Sequence[Scored]) -> tuple[str, ...]:
    seeds = [s.trial.seed for s in scored]
    cpu_s = [s.answer.cpu_s for s in scored]
    covered = covered_share(scored)
    never = sorted(set(CATALOGUE) ^ set(HIDDEN))
    return (
        f"{len(scored)} trials, seeds {min(seeds)} to {max(seeds)}, each used once; seeds below {FIRST_SEED} were "
        "used for tuning and are in no table here",
        "intervals are 95 % of Clopper and Pearson; probability, value and ± (95 %) are of the first cause",
        f"where the first cause is the hidden effect, {covered.hits} of {covered.trials} intervals (±) hold the "
        "hidden value, to which the lab adds its own tolerances",
        f"a trial took {np.median(cpu_s):.1f} s of processor time in the median, {max(cpu_s):.1f} s at most",
        *(f"no answer of seed {s.trial.seed}: {s.answer.refused}" for s in scored if s.answer.refused),
        f"not tried, since catalogue and lab do not share them: {', '.join(never) or 'none'}",
    )


EXPERIMENT = Experiment(
    title="First blind trials: one hidden effect, 100 points, all channels", run=run, apart=True
)
