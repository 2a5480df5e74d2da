"""Trials of the optimum: per lab, the best D1 and D2 over load by every model and every search, then measured.

Models are trained on the lab's training set (Table III); the calibrated one on a hundred of its points. What the lab
itself would call best is found on its noise-free reading, which no model sees: the mark to reach.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike

import drivers.mocks.lab
import experiments.study
import models
import sim
from bench.training import feasible_map
from experiments.harness.journal import Journal, code_hash
from experiments.harness.settings import Settings
from experiments.harness.trials import perform
from experiments.study.labs import (
    Array,
    campaign,
    campaign_points,
    lab_numbers,
    loads_of,
    measured_at,
    seed_of,
    true_efficiency,
)
from experiments.study.lessons import training_rows
from models.boosting import Floats
from models.calibrated import CalibratedPhysics
from models.dataset import load_measurements
from models.diagnosis.diagnose import diagnose
from models.exhaustive import ExactOptimum, exact_optimum
from models.feasibility import FeasibleMap
from models.lattice import optimise_on_lattice
from models.optimise import LoadProblems, OptimumTable, optimise, optimise_exactly
from models.pso import PSO_SAVL
from models.splits import split_experiment
from models.surrogate import (
    CALIBRATED,
    D2EA,
    EXPERIMENT_ONLY,
    SIMULATION_ONLY,
    EfficiencyModel,
    StagedModel,
    train_d2ea,
    train_experiment_only,
    train_simulation_only,
)
from sim.model import Model
from sim.simulate import Points, can_run

LOADS_W = np.arange(200.0, 2001.0, 100.0)
FEW_LOADS_W = (200.0, 600.0, 1000.0, 1600.0)
THE_LAB, D2EA_EXACT = "lab", "d2ea_exact"
METHODS = (SIMULATION_ONLY, EXPERIMENT_ONLY, D2EA, D2EA_EXACT, CALIBRATED, THE_LAB)
SAID = {
    SIMULATION_ONLY: "simulation only", EXPERIMENT_ONLY: "experiment only", D2EA: "D²EA, PSO-SAVL",
    D2EA_EXACT: "D²EA, exact optimum of its trees", CALIBRATED: "calibrated physics",
    THE_LAB: "the lab's own best",
}  # fmt: skip
CALIBRATED_POINTS = 100
SEARCH_SEED = 7


@dataclass(frozen=True, slots=True, kw_only=True)
class OptimumTrial:
    """One lab, its campaign's size, and the loads."""

    lab: int
    points: int
    loads_W: tuple[float, ...]
    folder: Path = field(compare=False)

    @property
    def key(self) -> str:
        """All that the outcome depends on."""
        return f"lab {self.lab} of {self.points} points at {len(self.loads_W)} loads"


@dataclass(frozen=True, slots=True, kw_only=True)
class Optimum:
    """One method's best in one lab, arrays over the loads; NaN where nothing carries a load or it could not run."""

    lab: int
    method: str
    power_W: Floats
    D1: Floats
    D2: Floats
    predicted: Floats
    measured: Floats
    true: Floats


@dataclass(frozen=True, slots=True)
class LabItself:
    """The lab's noise-free reading under a modulation as an efficiency model: what no model of it can beat."""

    lab: int
    modulation: str = "hybrid"

    def predict(self, D1: ArrayLike, D2: ArrayLike, power_W: ArrayLike) -> Floats:
        """Efficiency of the inputs' broadcast shape; NaN where the simulation says that a point cannot run."""
        a, b, c = np.broadcast_arrays(*(np.asarray(x, dtype=np.float64) for x in (D1, D2, power_W)))
        points = np.stack([a.ravel(), b.ravel(), c.ravel()], axis=1)
        runs = can_run(
            Model.baseline(self.modulation), Points(D1=points[:, 0], D2=points[:, 1], power_W=points[:, 2])
        )
        shown = np.full(len(points), np.nan)
        if runs.any():
            shown[runs] = true_efficiency(self.lab, points[runs], modulation=self.modulation)
        return shown.reshape(a.shape)


@cache
def carried(loads_W: tuple[float, ...]) -> FeasibleMap:
    """Where the baseline carries the loads."""
    return feasible_map(Model.baseline(), loads_W)


def trained(folder: Path, lab: int, points: int) -> dict[str, StagedModel]:
    """The paper's three models of a lab, from the first split's training sets."""
    loads = loads_of(campaign(folder, lab, points))
    fitted = loads.iloc[split_experiment(loads, seed=seed_of(0)).train]
    simulated = training_rows(folder, 0)
    return {
        SIMULATION_ONLY: train_simulation_only(simulated),
        EXPERIMENT_ONLY: train_experiment_only(fitted),
        D2EA: train_d2ea(simulated, fitted),
    }


def calibrated(folder: Path, lab: int, points: int) -> CalibratedPhysics:
    """The calibrated physics of a lab, from a hundred training points and the campaign's idle and reference rows."""
    table = campaign(folder, lab, points)
    loads = loads_of(table)
    fitted = loads.iloc[split_experiment(loads, seed=seed_of(0)).train[:CALIBRATED_POINTS]]
    rows = pd.concat([table[table["kind"] != "load"], fitted]).sort_values("time_s", ignore_index=True)
    return diagnose(load_measurements(rows)).calibrated


def find(trial: OptimumTrial) -> dict[str, Any]:
    """Every method's optimum over load, measured; as plain data."""
    mask, loads = carried(trial.loads_W), np.array(trial.loads_W)
    staged = trained(trial.folder, trial.lab, trial.points)
    tables = {
        kind: optimise(model, loads, mask, seed=SEARCH_SEED, optimiser=PSO_SAVL)
        for kind, model in staged.items()
    }
    tables[D2EA_EXACT] = optimise_exactly(staged[D2EA], loads, mask)
    tables[CALIBRATED] = optimise_on_lattice(
        calibrated(trial.folder, trial.lab, trial.points).vouched(), loads
    )
    tables[THE_LAB] = optimise_on_lattice(LabItself(trial.lab), loads)
    return {method: measured(trial.lab, table) for method, table in tables.items()}


def measured(lab: int, table: OptimumTable, *, modulation: str = "hybrid") -> dict[str, list[float | None]]:
    """A table of optima with what the lab reads there, with noise and without, as plain data."""
    found = np.isfinite(table.D1)
    points = np.stack([table.D1, table.D2, table.power_W], axis=1)
    read, true = np.full(found.size, np.nan), np.full(found.size, np.nan)
    true[found] = true_efficiency(lab, points[found], modulation=modulation)
    runs = found & np.isfinite(true)
    if runs.any():
        read[runs] = measured_at(lab, points[runs], seed=seed_of(lab), modulation=modulation)["efficiency"]
    columns = {"D1": table.D1, "D2": table.D2, "predicted": table.predicted, "measured": read, "true": true}
    return {name: [float(v) if np.isfinite(v) else None for v in value] for name, value in columns.items()}


def optima(settings: Settings) -> list[Optimum]:
    """All optima of a run; trials that the journal holds are not run again."""
    loads = tuple(LOADS_W.tolist()) if settings.scale >= 0.1 else FEW_LOADS_W
    trials = [
        OptimumTrial(lab=lab, points=campaign_points(settings), loads_W=loads, folder=settings.out)
        for lab in lab_numbers(settings)
    ]
    code = code_hash(sim, models, drivers.mocks.lab, experiments.study)
    records = perform(find, trials, Journal(path=settings.out / "optima.jsonl", code=code), settings)
    return [
        Optimum(
            lab=trial.lab, method=method, power_W=np.array(trial.loads_W),
            **{name: np.array(record[method][name], dtype=np.float64) for name in record[method]},
        )
        for trial, record in zip(trials, records, strict=True)
        for method in METHODS
    ]  # fmt: skip


def of_method(found: Sequence[Optimum], method: str) -> list[Optimum]:
    """Those of one method, lab by lab."""
    return [one for one in found if one.method == method]


def gain(found: Sequence[Optimum], method: str, over: str, *, column: str = "measured") -> Array:
    """How much more efficient one method's optima are than another's, points, (labs, loads)."""
    pairs = zip(of_method(found, method), of_method(found, over), strict=True)
    return np.array([100 * (getattr(a, column) - getattr(b, column)) for a, b in pairs])


def problems_of(model: EfficiencyModel, loads_W: tuple[float, ...]) -> LoadProblems:
    """One problem per load for a search."""
    return LoadProblems(model=model, feasible=carried(loads_W), loads=tuple(range(len(loads_W))))


def exact_of(model: EfficiencyModel, loads_W: tuple[float, ...]) -> ExactOptimum:
    """The exact optimum of a sum of trees at those loads."""
    return exact_optimum(model, carried(loads_W))
