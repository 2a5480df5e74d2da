"""The learners that the study compares: each gets simulated and measured rows, and predicts other rows."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pandas as pd

from models.baselines import BASELINES, train_baseline
from models.boosting import XGBOOST_II, BoostedTrees, Floats
from models.dataset import load_measurements
from models.diagnosis.diagnose import diagnose
from models.diagnosis.usable import TooFewPoints
from models.surrogate import (
    CALIBRATED,
    D2EA,
    EXPERIMENT_ONLY,
    SIMULATION_ONLY,
    SIMULATOR_FIRST,
    inputs_of,
    train_d2ea,
    train_experiment_only,
    train_simulation_only,
)
from sim.model import Model

SIMULATOR, SIMULATOR_GP = "simulator", "simulator_gp"
NAMES = {
    SIMULATION_ONLY: "simulation only (XGBoost-I)",
    SIMULATOR: "the simulator itself",
    EXPERIMENT_ONLY: "experiment only (XGBoost)",
    D2EA: "D²EA",
    "svr": "support vectors (SVR)",
    "br": "Bayesian regression (BR)",
    "rf": "random forest (RF)",
    "nn": "neural network (NN)",
    "gp": "Gaussian process",
    SIMULATOR_FIRST: "simulator first, then XGBoost-II",
    SIMULATOR_GP: "simulator first, then Gaussian process",
    CALIBRATED: "calibrated physics",
}
PAPERS = (D2EA, "svr", "br", "rf", "nn")
BEYOND = ("gp", SIMULATOR_FIRST, SIMULATOR_GP)


@dataclass(frozen=True, slots=True, kw_only=True)
class Lesson:
    """Rows to learn from and to predict.

    ``simulated`` are XGBoost-I's training rows, ``fitted`` and ``judged`` measured ones with the baseline's efficiency
    in the column ``simulated``, ``idle`` the campaign's rows without load and its references. ``baseline`` is the
    simulation of the converter, the prototype's by default.
    """

    simulated: pd.DataFrame
    fitted: pd.DataFrame
    judged: pd.DataFrame
    idle: pd.DataFrame
    seed: int
    baseline: Model | None = None


def learned(kind: str, lesson: Lesson) -> Floats:
    """What a learner predicts of the judged rows, efficiency (N,); all NaN where it had too little to learn from."""
    return _KINDS.get(kind, _baseline(kind))(lesson)


def _baseline(kind: str) -> Callable[[Lesson], Floats]:
    return lambda lesson: train_baseline(kind, lesson.fitted, seed=lesson.seed).predict(
        *inputs_of(lesson.judged)
    )


def _simulation_only(lesson: Lesson) -> Floats:
    return train_simulation_only(lesson.simulated).predict(*inputs_of(lesson.judged))


def _simulator(lesson: Lesson) -> Floats:
    return _column(lesson.judged, "simulated")


def _experiment_only(lesson: Lesson) -> Floats:
    return train_experiment_only(lesson.fitted).predict(*inputs_of(lesson.judged))


def _d2ea(lesson: Lesson) -> Floats:
    return train_d2ea(lesson.simulated, lesson.fitted).predict(*inputs_of(lesson.judged))


def _simulator_first(lesson: Lesson) -> Floats:
    trees = BoostedTrees.fit(inputs_of(lesson.fitted), _gap(lesson.fitted), XGBOOST_II)
    return _column(lesson.judged, "simulated") + trees.predict(*inputs_of(lesson.judged))


def _simulator_gp(lesson: Lesson) -> Floats:
    process = train_baseline("gp", lesson.fitted, seed=lesson.seed, target=_gap(lesson.fitted))
    return _column(lesson.judged, "simulated") + process.predict(*inputs_of(lesson.judged))


def _calibrated(lesson: Lesson) -> Floats:
    table = pd.concat([lesson.idle, lesson.fitted]).sort_values("time_s", ignore_index=True)
    try:
        found = diagnose(load_measurements(table), lesson.baseline, seed=lesson.seed)
    except TooFewPoints:
        return np.full(len(lesson.judged), np.nan)
    return found.calibrated.predict(*inputs_of(lesson.judged))


def _gap(table: pd.DataFrame) -> Floats:
    return _column(table, "efficiency") - _column(table, "simulated")


def _column(table: pd.DataFrame, name: str) -> Floats:
    return table[name].to_numpy(dtype=np.float64)


_KINDS: dict[str, Callable[[Lesson], Floats]] = {
    SIMULATION_ONLY: _simulation_only,
    SIMULATOR: _simulator,
    EXPERIMENT_ONLY: _experiment_only,
    D2EA: _d2ea,
    SIMULATOR_FIRST: _simulator_first,
    SIMULATOR_GP: _simulator_gp,
    CALIBRATED: _calibrated,
}
assert set(NAMES) == set(_KINDS) | set(BASELINES)
