"""Trials of the searches: on each lab's D²EA surrogate, every search against the exact optimum of its trees."""

import time
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

import drivers.mocks.lab
import experiments.study
import models
import sim
from experiments.harness.journal import Journal, code_hash
from experiments.harness.result import POINTS
from experiments.harness.settings import Settings
from experiments.harness.trials import perform
from experiments.study.labs import campaign_points, lab_numbers, true_efficiency
from experiments.study.optima import (
    FEW_LOADS_W,
    LOADS_W,
    calibrated,
    carried,
    exact_of,
    problems_of,
    trained,
)
from models.boosting import Floats
from models.lattice import optimise_on_lattice
from models.optimise import LoadProblems
from models.pso import OPTIMISERS, PSO_SAVL, PSO_SAVL_POLISHED, Optimiser, Optimum, ParticleSwarm, savl_limit
from models.surrogate import D2EA

SEEDS = 10
LONGER = replace(PSO_SAVL, name="PSO-SAVL, ten times the iterations", iterations=500)
RANDOM = ParticleSwarm(name="500 random points", limit=savl_limit, redraw=True, particles=500, iterations=1)
SEARCHES: tuple[Optimiser, ...] = (*OPTIMISERS, LONGER, RANDOM)
SMOOTH = "PSO-SAVL on a smooth surrogate (calibrated physics)"


@dataclass(frozen=True, slots=True, kw_only=True)
class SearchTrial:
    """One lab's surrogate, searched with so many seeds."""

    lab: int
    points: int
    seeds: int
    loads_W: tuple[float, ...]
    folder: Path = field(compare=False)

    @property
    def key(self) -> str:
        """All that the outcome depends on."""
        return f"lab {self.lab} of {self.points} points, {self.seeds} seeds at {len(self.loads_W)} loads"


@dataclass(frozen=True, slots=True, kw_only=True)
class Searched:
    """One search on all surrogates; regret and its cost on the true surface in points, (runs, loads)."""

    name: str
    evaluations: int
    regret: Floats
    cost: Floats
    cpu_s: float


def search(trial: SearchTrial) -> dict[str, Any]:
    """Every search on one lab's surrogate, its regrets and their cost, as plain data."""
    model = trained(trial.folder, trial.lab, trial.points)[D2EA]
    exact, problem = exact_of(model, trial.loads_W), problems_of(model, trial.loads_W)
    found: dict[str, list[tuple[Optimum, float]]] = {
        s.name: [_timed(s, problem, seed) for seed in range(1 if s is PSO_SAVL_POLISHED else trial.seeds)]
        for s in SEARCHES
    }
    places = [np.stack([exact.D1, exact.D2])] + [_place(problem, runs[0][0]) for runs in found.values()]
    true = _true(trial, places)
    record: dict[str, Any] = {
        name: {
            "evaluations": runs[0][0].evaluations,
            "cpu_s": float(np.mean([cpu_s for _, cpu_s in runs])),
            "regret": [_regret(exact.value, one).tolist() for one, _ in runs],
            "cost": [_or_none(POINTS * (true[0] - here))],
        }
        for (name, runs), here in zip(found.items(), true[1:], strict=True)
    }
    return record | {"near": exact.near_share.tolist()}


def _timed(searching: Optimiser, problem: LoadProblems, seed: int) -> tuple[Optimum, float]:
    start_s = time.process_time()
    return searching.maximise(problem, seed=seed), time.process_time() - start_s


def _regret(best: Floats, found: Optimum) -> Floats:
    """In points; a load at which no feasible point was met counts as an efficiency of 0."""
    return np.asarray(POINTS * (best - np.where(np.isfinite(found.value), found.value, 0.0)))


def _place(problem: LoadProblems, found: Optimum) -> Floats:
    D1, D2 = problem.feasible.snap(found.x[:, 0], found.x[:, 1])
    there = np.isfinite(found.value)
    return np.stack([np.where(there, D1, np.nan), np.where(there, D2, np.nan)])


def _true(trial: SearchTrial, places: Sequence[Floats]) -> Floats:
    """The lab's noise-free efficiency at places (2, loads) each: (places, loads), in one call."""
    D1, D2 = np.concatenate(places, axis=1)
    points = np.stack([D1, D2, np.tile(trial.loads_W, len(places))], axis=1)
    true, there = np.full(D1.size, np.nan), np.isfinite(D1)
    true[there] = true_efficiency(trial.lab, points[there])
    return true.reshape(len(places), -1)


def _or_none(values: Floats) -> list[float | None]:
    return [float(v) if np.isfinite(v) else None for v in values]


def searched(settings: Settings) -> tuple[list[Searched], Floats, tuple[float, ...]]:
    """All searches over all labs, the targets' shares of the square (labs, loads), and the loads."""
    loads = tuple(LOADS_W.tolist()) if settings.scale >= 0.1 else FEW_LOADS_W
    trials = [
        SearchTrial(
            lab=lab, points=campaign_points(settings), seeds=max(2, settings.thinned(SEEDS)), loads_W=loads,
            folder=settings.out,
        )
        for lab in lab_numbers(settings)
    ]  # fmt: skip
    code = code_hash(sim, models, drivers.mocks.lab, experiments.study)
    records = perform(search, trials, Journal(path=settings.out / "searches.jsonl", code=code), settings)
    made = [
        Searched(
            name=s.name,
            evaluations=records[0][s.name]["evaluations"],
            regret=np.concatenate([np.array(r[s.name]["regret"]) for r in records]),
            cost=np.array([r[s.name]["cost"][0] for r in records], dtype=np.float64),
            cpu_s=float(np.mean([r[s.name]["cpu_s"] for r in records])),
        )
        for s in SEARCHES
    ]
    return made, np.array([r["near"] for r in records]), loads


def smooth_search(settings: Settings) -> tuple[Searched, tuple[float, ...]]:
    """The published swarm on lab 0's calibrated physics, a smooth surface; its best known is a refined lattice's."""
    loads = tuple(LOADS_W.tolist()) if settings.scale >= 1 else FEW_LOADS_W
    model = calibrated(settings.out, 0, campaign_points(settings))
    lattice = optimise_on_lattice(model, np.array(loads))
    problem = LoadProblems(model=model, feasible=carried(loads), loads=tuple(range(len(loads))))
    found, cpu_s = _timed(PSO_SAVL, problem, 0)
    regret = _regret(np.fmax(lattice.predicted, found.value), found)
    made = Searched(
        name=SMOOTH, evaluations=found.evaluations, regret=regret[None], cost=np.full((1, len(loads)), np.nan),
        cpu_s=cpu_s,
    )  # fmt: skip
    return made, loads
