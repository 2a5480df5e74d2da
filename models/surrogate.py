"""Efficiency models η(D1, D2, power): D²EA and the models it is compared with.

D²EA adds two boosted ensembles (Section II-C, eqs. (1) to (5), Table III):

    y_sim  trained on the simulated efficiency of feasible points          XGBoost-I
    y_gap  trained on measured efficiency - y_sim                          XGBoost-II
    η = y_sim + y_gap

The same two-stage sum serves the variant whose first stage is the simulator itself instead of trees
that imitate it. Simulation-only, experiment-only and calibrated physics (:mod:`models.calibrated`) have one stage.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike

from models.boosting import XGBOOST_I, XGBOOST_II, BoostedTrees, BoostSettings, Floats

SIMULATION_ONLY = "simulation_only"
EXPERIMENT_ONLY = "experiment_only"
D2EA = "d2ea"
SIMULATOR_FIRST = "simulator_first_stage"
CALIBRATED = "calibrated"

Simulator = Callable[[Floats, Floats, Floats], Floats]
"""Efficiency (N,) of the simulator at D1, D2, power_W (N,); NaN where a point is infeasible."""


class EfficiencyModel(Protocol):
    """Anything that predicts efficiency: a fraction, over inputs that broadcast; NaN where it cannot."""

    def predict(self, D1: ArrayLike, D2: ArrayLike, power_W: ArrayLike, /) -> Floats:
        """Efficiency as a fraction, of the inputs' broadcast shape."""
        ...


@dataclass(frozen=True, slots=True)
class SimulatorStage:
    """The simulator as a stage of a model."""

    efficiency: Simulator

    def predict(self, D1: ArrayLike, D2: ArrayLike, power_W: ArrayLike) -> Floats:
        """The simulator's efficiency; NaN where infeasible."""
        points = np.broadcast_arrays(*(np.asarray(x, dtype=np.float64) for x in (D1, D2, power_W)))
        out = self.efficiency(*(np.ascontiguousarray(p.ravel()) for p in points))
        return np.asarray(out, dtype=np.float64).reshape(points[0].shape)


@dataclass(frozen=True, slots=True, kw_only=True)
class StagedModel:
    """A sum of stages, each trained on what the ones before it left over (eq. (5))."""

    kind: str
    stages: tuple[EfficiencyModel, ...]

    def predict(self, D1: ArrayLike, D2: ArrayLike, power_W: ArrayLike) -> Floats:
        """Efficiency as a fraction: the sum of the stages."""
        total = np.sum([stage.predict(D1, D2, power_W) for stage in self.stages], axis=0)
        return np.asarray(total, dtype=np.float64)


def train_simulation_only(simulated: pd.DataFrame, settings: BoostSettings = XGBOOST_I) -> StagedModel:
    """XGBoost-I alone, on the feasible rows of ``simulated`` (D1 D2 P2_W efficiency [feasible])."""
    return StagedModel(kind=SIMULATION_ONLY, stages=(_first_stage(simulated, settings),))


def train_experiment_only(measured: pd.DataFrame, settings: BoostSettings = XGBOOST_I) -> StagedModel:
    """One ensemble on ``measured`` alone (columns D1 D2 P2_W efficiency).

    Assumption: Table III gives this comparator no settings of its own; it takes XGBoost-I's.
    """
    trees = BoostedTrees.fit(inputs_of(measured), measured["efficiency"], settings)
    return StagedModel(kind=EXPERIMENT_ONLY, stages=(trees,))


def train_d2ea(
    simulated: pd.DataFrame,
    measured: pd.DataFrame,
    first: BoostSettings = XGBOOST_I,
    second: BoostSettings = XGBOOST_II,
) -> StagedModel:
    """D²EA: XGBoost-I on the simulation, XGBoost-II on measured - XGBoost-I."""
    stage = _first_stage(simulated, first)
    return StagedModel(kind=D2EA, stages=(stage, fit_gap(stage, measured, second)))


def train_simulator_first(
    simulator: Simulator, measured: pd.DataFrame, second: BoostSettings = XGBOOST_II
) -> StagedModel:
    """The simulator itself as first stage, XGBoost-II on measured - simulator."""
    stage = SimulatorStage(simulator)
    return StagedModel(kind=SIMULATOR_FIRST, stages=(stage, fit_gap(stage, measured, second)))


def fit_gap(stage: EfficiencyModel, measured: pd.DataFrame, settings: BoostSettings) -> BoostedTrees:
    """Train on the gap measured - ``stage``; measured points that the stage calls infeasible are left out."""
    inputs = inputs_of(measured)
    gap = measured["efficiency"].to_numpy(dtype=np.float64) - stage.predict(*inputs)
    known = np.isfinite(gap)
    return BoostedTrees.fit((inputs[0][known], inputs[1][known], inputs[2][known]), gap[known], settings)


def inputs_of(table: pd.DataFrame) -> tuple[Floats, Floats, Floats]:
    """D1, D2 and the output power of a simulation or measurement table."""
    D1, D2, power_W = (table[name].to_numpy(dtype=np.float64) for name in ("D1", "D2", "P2_W"))
    return D1, D2, power_W


def _first_stage(simulated: pd.DataFrame, settings: BoostSettings) -> BoostedTrees:
    rows = simulated[simulated["feasible"].astype(bool)] if "feasible" in simulated else simulated
    return BoostedTrees.fit(inputs_of(rows), rows["efficiency"], settings)
