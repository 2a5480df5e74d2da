"""First blind trials: every effect in three sizes and two labs each, and six labs that hide nothing.

A size is a log-uniform draw from a third of the range that a lab draws from, the large ones furthest from off. No
trial is left out for being hard to see; :mod:`experiments.blind_trials` asks the truth about that first, and has
pairs, foreign effects and other noise as well. Found: what is hidden is named, or in a stated group. False name:
something is stated that is not there.

Scored seeds start at 330000; no other trial and no tuning uses them.
"""

import math
from collections.abc import Sequence

import numpy as np

import drivers.mocks.lab
import experiments.blind
import experiments.harness.lab_data
import models
import sim
from drivers.mocks.lab.hidden import HIDDEN
from experiments.blind.reach import hideable
from experiments.blind.scoring import Scored, share
from experiments.blind.trial import BlindTrial, ask
from experiments.harness.journal import Journal, code_hash
from experiments.harness.registry import Experiment
from experiments.harness.result import Cell, Result, Table
from experiments.harness.settings import Settings
from experiments.harness.trials import perform
from sim.effects.catalogue import CATALOGUE

FIRST_SEED = 330_000
SIZES = ("small", "medium", "large")
LABS_A_SIZE = 2
LABS_WITH_NOTHING = 6
FOUND_BAR, FALSE_BAR = 90.0, 0.0


def plan(settings: Settings) -> list[BlindTrial]:
    """All trials, or a share of them in which every effect still is, and every size."""
    slots = [(size, lab) for lab in range(LABS_A_SIZE) for size in SIZES]
    trials = []
    for k, effect in enumerate(hideable()):
        for j in range(settings.thinned(len(slots))):
            slot = (j + k) % len(slots)  # thinned to one, effect after effect takes another size
            size, seed = slots[slot][0], FIRST_SEED + k * len(slots) + slot
            trials.append(BlindTrial(row=size, seed=seed, hidden=((effect, drawn(effect, size, seed)),)))
    first = FIRST_SEED + len(hideable()) * len(slots)
    nothing = range(first, first + settings.thinned(LABS_WITH_NOTHING))
    return trials + [BlindTrial(row="nothing", seed=seed) for seed in nothing]


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
    code = code_hash(sim, models, drivers.mocks.lab, experiments.harness.lab_data, experiments.blind)
    journal = Journal(path=settings.out / "first_trials.jsonl", code=code)
    records = perform(ask, trials, journal, settings)
    return scored_result([Scored.of(t, r) for t, r in zip(trials, records, strict=True)])


def scored_result(scored: Sequence[Scored]) -> Result:
    """Goals, every trial as a row, and the table by effect."""
    hiding = [s for s in scored if s.trial.hidden]
    nothing = [s for s in scored if not s.trial.hidden]
    goals = (
        share(hiding, lambda s: s.stated).goal("found", FOUND_BAR, at_least=True),
        share(scored, lambda s: s.wrong).goal("false names", FALSE_BAR, at_least=False),
    )
    seeds = [s.trial.seed for s in scored]
    consistent = share(nothing, lambda s: s.consistent)
    cpu_s = [s.said.cpu_s for s in scored]
    notes = (
        f"{len(scored)} trials, seeds {min(seeds)} to {max(seeds)}, each used once, none for tuning",
        f"nothing hidden: {consistent.hits} of {consistent.trials} consistent",
        f"a diagnosis took {np.median(cpu_s):.1f} s of processor time in the median, {max(cpu_s):.1f} s at most",
        *(f"no answer of seed {s.trial.seed}: {s.said.refused}" for s in scored if s.said.refused),
    )
    return Result(virtual=True, goals=goals, tables=(_by_effect(hiding), _every_trial(scored)), notes=notes)


def _by_effect(hiding: Sequence[Scored]) -> Table:
    rows: list[tuple[Cell, ...]] = []
    for name in dict.fromkeys(s.trial.names[0] for s in hiding):
        own = [s for s in hiding if s.trial.names[0] == name]
        sizes = [share([s for s in own if s.trial.row == size], lambda s: s.stated) for size in SIZES]
        found = [f"{size.hits} of {size.trials}" if size.trials else "–" for size in sizes]
        rows.append((name, *found, sum(s.wrong for s in own)))
    return Table(title="Found, by effect", columns=("hidden", *SIZES, "false names"), rows=tuple(rows))


def _every_trial(scored: Sequence[Scored]) -> Table:
    rows = []
    for s in scored:
        name, value = s.trial.hidden[0] if s.trial.hidden else ("nothing", None)
        cause = s.said.causes[0] if s.said.causes else None
        said = ", ".join(s.said.stated) or None
        rows.append((
            name, value, s.trial.row, s.trial.seed, s.said.verdict, said,
            None if cause is None else cause.probability, None if cause is None else cause.value,
            None if cause is None else cause.low, None if cause is None else cause.high,
            "yes" if s.wrong else "no",
        ))  # fmt: skip
    columns = (
        "hidden", "value", "size", "seed", "verdict", "states", "probability of the first", "its value", "from", "to",
        "false name",
    )  # fmt: skip
    return Table(title="All trials", columns=columns, rows=tuple(rows))


EXPERIMENT = Experiment(
    title="First blind trials: one hidden effect, 100 points, all channels", run=run, apart=True, spread=True
)
