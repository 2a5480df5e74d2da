"""Blind trials: what the diagnosis finds, and what it says that is not there.

Every trial is a virtual lab of its own: each part off by its everyday spread, instruments inside their
specification, everyday drifts, rows that start warm from the row before, and something hidden. The diagnosis gets
the measurement table and answers in JSON; truth is read only to score.

Trials of one, two or foreign effects count where the truth itself says that they can be seen: at least five sigma
of the hidden effect stand out of whatever could be mistaken for it, in what noise, tolerances and instruments
leave. What that excludes is counted. ``--only`` runs some of the parts, those without a bar too; finished trials are
kept and not repeated.

Seeds 5100000 to 5199999 are scored; 100000 to 199999 are for tuning a diagnosis and are run by `blind_tuning`.
"""

from collections.abc import Collection, Sequence
from dataclasses import replace

import bench.training
import drivers.mocks.lab
import experiments.blind
import experiments.harness.lab_data
import models
import sim
from experiments.blind.calibration import COVERAGE_PART, COVERAGES, RELIABILITY
from experiments.blind.draws import coverage, efficiency_only, singles
from experiments.blind.extension import EXTENSION_PART
from experiments.blind.part import Outcome, Part, Run
from experiments.blind.scoring import judged
from experiments.blind.seeds import SCORING, TUNING, Seeds
from experiments.blind.surrogates import SURROGATE_PART
from experiments.blind.tied import TIED_PART
from experiments.blind.verdicts import EFFICIENCY_ONLYS, SINGLES, VERDICT_PARTS
from experiments.harness.journal import Journal, code_hash
from experiments.harness.registry import Experiment
from experiments.harness.result import Goal, Picture, Result, Table
from experiments.harness.settings import Settings
from experiments.study.trial_pictures import by_isolability, confusion, credibility

PARTS: tuple[Part, ...] = (*VERDICT_PARTS, COVERAGE_PART, TIED_PART, EXTENSION_PART, SURROGATE_PART)
NAMES = tuple(part.name for part in PARTS)
_MOST_HOURS = 2.0  # on two cores


def run_with(seeds: Seeds, settings: Settings) -> Result:
    """Run the chosen parts with one range of seeds."""
    code = code_hash(
        sim, models, drivers.mocks.lab, experiments.harness.lab_data, experiments.blind, bench.training
    )
    journal = Journal(path=settings.out / f"blind_trials_{seeds.said}.jsonl", code=code)
    run = Run(settings=settings, seeds=seeds, journal=journal)
    chosen = [p for p in PARTS if (p.name in settings.only if settings.only else not p.beside)]
    in_one_run, begun_s = not journal.read(), settings.now()
    outcomes = [part.run(run) for part in chosen]
    result = _joined(outcomes)
    if in_one_run and settings.scale == 1.0 and not settings.only:
        result = replace(result, goals=(_time(settings.now() - begun_s), *result.goals))
    left = [part.name for part in PARTS if part not in chosen]
    said = (*result.notes, f"{SCORING}; {TUNING}", *([f"not run: {', '.join(left)}"] if left else []))
    return replace(result, notes=said, pictures=_pictures(run, {part.name for part in chosen}, result.tables))


def _time(spent_s: float) -> Goal:
    """How long the whole table took."""
    name = "the whole table with one command"
    return Goal(name=name, value=spent_s / 3600.0, bar=_MOST_HOURS, at_least=False, unit="h")


def _pictures(run: Run, names: Collection[str], tables: Sequence[Table]) -> tuple[Picture, ...]:
    """What there is to see of the parts that were run, from trials that the journal holds by now."""
    single = run.scored(singles, SINGLES) if "single" in names else []
    alone = run.scored(efficiency_only, EFFICIENCY_ONLYS) if "efficiency_only" in names else []
    kinds = {"all channels": single, "efficiency alone": alone}
    found = [confusion(single)] if judged(single) else []
    if seen := {kind: scored for kind, scored in kinds.items() if judged(scored)}:
        found.append(by_isolability(seen))
    if "coverage" in names:
        (reliability,) = (table for table in tables if table.title == RELIABILITY)
        found.append(credibility(run.scored(coverage, COVERAGES), reliability))
    return tuple(found)


def _joined(outcomes: list[Outcome]) -> Result:
    """All parts' goals, tables and notes in their order."""
    return Result(
        virtual=True,
        goals=tuple(goal for outcome in outcomes for goal in outcome.goals),
        tables=tuple(table for outcome in outcomes for table in outcome.tables),
        notes=(
            *(note for outcome in outcomes for note in outcome.notes),
            "intervals are 95 % of Clopper and Pearson unless told",
        ),
    )


def run(settings: Settings) -> Result:
    """The table, with the seeds that are scored."""
    return run_with(SCORING, settings)


EXPERIMENT = Experiment(title="Blind trials of the diagnosis", run=run, parts=NAMES, apart=True, spread=True)
