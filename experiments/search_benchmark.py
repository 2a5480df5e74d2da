"""Speed and regret of the search for D1 and D2, against the exact optimum of the same surrogate.

PSO-SAVL and its rivals for 19 loads, on a D²EA surrogate trained from the grid and 400 measured points of a
virtual lab, against the exact optimum of the same surrogate (every cell of its trees).

Seconds depend on the machine; ratios depend on it less.
"""

import os
from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from bench.training import feasible_map, simulated_table, tenth_of
from drivers.mocks.lab.laboratory import Laboratory
from experiments.harness.lab_data import measured_table
from experiments.harness.registry import Experiment
from experiments.harness.result import POINTS, Cell, Goal, Result, Table
from experiments.harness.settings import Countdown, Settings
from models.dataset import load_measurements
from models.exhaustive import exact_optimum
from models.optimise import LoadProblems
from models.pso import OPTIMISERS, PSO_SAVL, PSO_SAVL_POLISHED
from models.surrogate import StagedModel, train_d2ea
from sim.model import Model

T = TypeVar("T")

SEED = 20_500
LOADS_W = np.arange(200.0, 2001.0, 100.0)
MEASURED_POINTS, LEAST_MEASURED = 400, 40
SECONDS_BAR, REGRET_BAR_POINTS = 2.0, 0.01
_STEPS = 2 + len(OPTIMISERS)


@dataclass(frozen=True, slots=True, kw_only=True)
class _Timed:
    """Runs things and takes their time."""

    settings: Settings
    countdown: Countdown

    def __call__(self, said: str, work: Callable[[], T]) -> tuple[T, float]:
        """What ``work`` returns, and its seconds."""
        start_s = self.settings.now()
        made = work()
        seconds = self.settings.now() - start_s
        self.countdown.finished(said)
        return made, seconds


def run(settings: Settings) -> Result:
    """The comparison; ``scale`` thins the measured points."""
    search, goals = _search(settings, _Timed(settings=settings, countdown=Countdown(_STEPS, settings)))
    return Result(
        virtual=True,
        goals=tuple(goals),
        tables=(search,),
        notes=(
            f"{os.cpu_count()} cores; trees on two of them",
            f"lab and search of seed {SEED}; the measured points are a virtual lab's",
        ),
    )


def _search(settings: Settings, timed: _Timed) -> tuple[Table, list[Goal]]:
    """Every search against the exact optimum of one surrogate."""
    model = Model.baseline()
    surrogate, _ = timed(
        "surrogate", lambda: _surrogate(model, max(settings.thinned(MEASURED_POINTS), LEAST_MEASURED))
    )
    mask = feasible_map(model, LOADS_W)
    exact, exact_s = timed("exact optimum", lambda: exact_optimum(surrogate, mask))
    problems = LoadProblems(model=surrogate, feasible=mask, loads=tuple(range(LOADS_W.size)))
    cells = exact.cells // LOADS_W.size
    rows: list[tuple[Cell, ...]] = [("exact: every cell of the trees", cells, exact_s, 1.0, 0.0, 0.0)]
    goals: list[Goal] = []
    for search in OPTIMISERS:
        found, seconds = timed(search.name, lambda search=search: search.maximise(problems, seed=SEED))  # type: ignore[misc]
        regret = POINTS * (exact.value - found.value)
        worst, mean = float(np.max(regret)), float(np.mean(regret))
        rows.append((search.name, found.evaluations, seconds, seconds / exact_s, worst, mean))
        if search in (PSO_SAVL, PSO_SAVL_POLISHED):
            goals += _search_goals(search.name, seconds, worst)
    columns = (
        "search", "evaluations a load", "s, all loads", "times exact", "worst regret, points", "mean",
    )  # fmt: skip
    return Table(title="D1 and D2 for 19 loads", columns=columns, rows=tuple(rows)), goals


def _search_goals(name: str, seconds: float, worst: float) -> list[Goal]:
    return [
        Goal(name=f"{name}, {LOADS_W.size} loads", value=seconds, bar=SECONDS_BAR, at_least=False, unit="s"),
        Goal(name=f"{name}, worst regret", value=worst, bar=REGRET_BAR_POINTS, at_least=False, unit="points"),
    ]


def _surrogate(model: Model, measured_points: int) -> StagedModel:
    measured = load_measurements(
        measured_table(
            Laboratory.draw(seed=SEED, hidden={"link_resistance": None}), measured_points, seed=SEED
        )
    )
    return train_d2ea(tenth_of(simulated_table(model), seed=SEED), measured.loaded())


EXPERIMENT = Experiment(
    title="Benchmark: the search for D1 and D2 against the exact optimum", run=run, apart=True
)
