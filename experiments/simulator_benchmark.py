"""Speed of the simulator and of the search, each against a peer in the same run.

The closed-loop grid (12,500 points: D0 solved for the demanded power, losses and temperatures at their fixed
point) against time stepping of the same circuit in NumPy and SciPy, a thousand of the grid's points at once.
The peer is given temperatures and switching losses, so it solves less: it finds D0 and the waveforms. Both are
counted per feasible point; that they reach the same state is checked by D0.

PSO-SAVL and its rivals for 19 loads, on a D²EA surrogate trained from the grid and 400 measured points of a
virtual lab, against the exact optimum of the same surrogate (every cell of its trees).

Seconds depend on the machine; ratios depend on it less.
"""

import os
from collections import defaultdict
from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from bench.training import feasible_of, simulated_table, train
from drivers.mocks.lab.laboratory import Laboratory
from experiments.harness.lab_data import measured_table
from experiments.harness.registry import Experiment
from experiments.harness.result import Cell, Goal, Result, Table
from experiments.harness.settings import Countdown, Settings
from experiments.peers.time_stepping import steady_phase
from models.dataset import load_measurements
from models.exhaustive import exact_optimum
from models.feasibility import FeasibleMap
from models.optimise import LoadProblems
from models.pso import OPTIMISERS, PSO_SAVL, PSO_SAVL_POLISHED
from models.surrogate import D2EA, StagedModel
from sim.circuit import Temperatures, build_circuit
from sim.model import Model
from sim.modulation import centre_offset, hybrid_edges
from sim.simulate import Result as Simulated
from sim.simulate import grid, simulate

Array = NDArray[np.float64]
T = TypeVar("T")

SEED = 20_500
LOADS_W = np.arange(200.0, 2001.0, 100.0)
MEASURED_POINTS, LEAST_MEASURED = 400, 40
PEER_POINTS, PEER_STEP_S = 1000, 10e-9
SECONDS_BAR, REGRET_BAR_POINTS = 2.0, 0.01
AGREEMENT_BAR = 4e-4  # of D0: one of the peer's steps of 10 ns in a half period of 25 us
_POINTS = 100.0
_STEPS = 4 + len(OPTIMISERS)


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
    """Both comparisons; ``scale`` thins the peer's points and the measured ones."""
    timed = _Timed(settings=settings, countdown=Countdown(_STEPS, settings))
    closed_loop, agreement = _grid(settings, timed)
    search, goals = _search(settings, timed)
    cores = os.cpu_count()
    return Result(
        virtual=True,
        goals=(agreement, *goals),
        tables=(closed_loop, search),
        notes=(
            f"{cores} cores; the simulator and its peer run on one of them, trees on two",
            f"lab and search of seed {SEED}; the measured points are a virtual lab's",
        ),
    )


def _grid(settings: Settings, timed: _Timed) -> tuple[Table, Goal]:
    """The grid against time stepping, and how well both agree."""
    model = Model.baseline()
    simulate(model, grid((5, 5, 4)))  # what is made once only is made before the clock starts
    solved, ours_s = timed("grid", lambda: simulate(model, grid()))
    feasible = np.flatnonzero(solved.feasible)
    rng = np.random.default_rng(SEED)
    rows = np.sort(rng.choice(feasible, settings.thinned(PEER_POINTS), replace=False))
    D0, peer_s = timed("time stepping", lambda: _stepped_D0(model, solved, rows))
    off = np.abs(D0 - solved["D0"][rows])
    found = int(np.isfinite(D0).sum())
    ours_ms, peer_ms = 1e3 * ours_s / feasible.size, 1e3 * peer_s / rows.size
    cells: tuple[tuple[Cell, ...], ...] = (
        ("simulate(): D0, waveforms, losses, temperatures", feasible.size, ours_s, ours_ms, 1.0, None),
        (
            "time stepping by 10 ns: D0, waveforms", int(rows.size), peer_s, peer_ms, peer_ms / ours_ms,
            f"{found} of {rows.size}",
        ),
    )  # fmt: skip
    columns = ("method", "feasible points", "s", "ms a point", "times as long", "D0 found")
    agreement = Goal(
        name="median difference of D0 between the two, half periods",
        value=float(np.nanmedian(off)), bar=AGREEMENT_BAR, at_least=False,
    )  # fmt: skip
    return Table(title="Closed-loop grid of 12,500 points", columns=columns, rows=cells), agreement


def _stepped_D0(model: Model, solved: Simulated, rows: NDArray[np.intp]) -> Array:
    """The peer's D0, at the solver's temperatures (junctions at that of the heatsink) and secondary losses."""
    points, heatsink_C = solved.points.take(rows), solved["T_heatsink_C"][rows]
    temperatures = Temperatures(
        heatsink_C=heatsink_C,
        junction_C=defaultdict(lambda: heatsink_C),
        inductor_C=solved["T_inductor_C"][rows],
        transformer_C=solved["T_transformer_C"][rows],
    )
    V1_V, V2_V, D1, D2 = (np.asarray(x) for x in (points.V1_V, points.V2_V, points.D1, points.D2))
    circuit = build_circuit(model.altered_converter(), temperatures, V1_V, V2_V)
    centred = centre_offset(D1, D2)
    output_W = np.asarray(points.power_W) + solved["loss_secondary_switching_W"][rows]
    phase = steady_phase(circuit, hybrid_edges(-centred, D1, D2), output_W, step_s=PEER_STEP_S)
    return np.asarray(phase - centred)


def _search(settings: Settings, timed: _Timed) -> tuple[Table, list[Goal]]:
    """Every search against the exact optimum of one surrogate."""
    model = Model.baseline()
    surrogate, _ = timed(
        "surrogate", lambda: _surrogate(model, max(settings.thinned(MEASURED_POINTS), LEAST_MEASURED))
    )
    converter = model.altered_converter()
    gap = float(2 * converter.dead_time_s * converter.frequency_Hz)
    mask = FeasibleMap.build(feasible_of(model), LOADS_W, edge_gap=gap)
    exact, exact_s = timed("exact optimum", lambda: exact_optimum(surrogate, mask))
    problems = LoadProblems(model=surrogate, feasible=mask, loads=tuple(range(LOADS_W.size)))
    cells = exact.cells // LOADS_W.size
    rows: list[tuple[Cell, ...]] = [("exact: every cell of the trees", cells, exact_s, 1.0, 0.0, 0.0)]
    goals: list[Goal] = []
    for search in OPTIMISERS:
        found, seconds = timed(search.name, lambda search=search: search.maximise(problems, seed=SEED))  # type: ignore[misc]
        regret = _POINTS * (exact.value - found.value)
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
    return train(D2EA, measured.loaded(), simulated_table(model), model, seed=SEED).model


EXPERIMENT = Experiment(title="Benchmark: simulator and search against peers", run=run)
