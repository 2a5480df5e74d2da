"""Training efficiency models from a measurement table and a simulated grid.

Each kind is judged on set points that it was not fitted to (40/20/40 % of the measured set points, 10 % of
the feasible simulated ones, as in the paper), and is then fitted once more to all measured rows: that model
is kept, and the held-out error with it. Calibrated physics is what a diagnosis of the rows makes of the simulator; it
takes the rows without load as well.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike

from bench.diagnosing import NotDiagnosed, refused_in_words
from bench.errors import BenchError
from bench.training_data import Places, TrainingData
from models.accuracy import Accuracy, accuracy_of, half_width
from models.boosting import Floats
from models.dataset import load_measurements
from models.feasibility import Bools, FeasibleMap, edge_gap_of
from models.registry import data_hash
from models.splits import split_experiment, split_simulation
from models.surrogate import (
    CALIBRATED,
    D2EA,
    EXPERIMENT_ONLY,
    SIMULATION_ONLY,
    SIMULATOR_FIRST,
    StagedModel,
    inputs_of,
    train_d2ea,
    train_experiment_only,
    train_simulation_only,
    train_simulator_first,
)
from sim.model import Model
from sim.operating_points import Points, grid_of
from sim.simulate import can_run, simulate

KINDS = (SIMULATION_ONLY, EXPERIMENT_ONLY, D2EA, SIMULATOR_FIRST, CALIBRATED)
HELD_OUT = "held_out_mean_abs_efficiency"  # metrics of a kept model
HALF_WIDTH = "held_out_half_width95_efficiency"
LEAST_ROWS = 10  # fewer leave no held-out part to speak of


Say = Callable[[str], None]


class NotTrained(BenchError):
    """The measurements do not allow a model of this kind; says what is missing, or wrong with them."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Trained:
    """A model fitted to all rows, and the error of its like on rows that were not fitted."""

    model: StagedModel
    held_out: Accuracy
    # of the 95 % interval of a prediction; NaN where the held-out part is too small to tell
    half_width: float
    data_sha256: str


def efficiency_of(model: Model) -> Callable[[Floats, Floats, Floats], Floats]:
    """The simulator as a function for ``models``: efficiency (N,), NaN where infeasible."""
    return lambda D1, D2, power_W: simulate(model, Points(D1=D1, D2=D2, power_W=power_W))["efficiency"]


def feasible_of(model: Model) -> Callable[[Floats, Floats, Floats], Bools]:
    """The simulator as a mask for ``models``: whether points (N,) carry their power."""
    return partial(_carries, model)


def feasible_map(model: Model, loads_W: ArrayLike) -> FeasibleMap:
    """Where in (D1, D2) a simulated converter carries each load (loads,), asked once."""
    return FeasibleMap.build(feasible_of(model), loads_W, edge_gap=edge_gap_of(model))


def _carries(model: Model, D1: Floats, D2: Floats, power_W: Floats) -> Bools:
    return can_run(model, Points(D1=D1, D2=D2, power_W=power_W))


def simulated_table(model: Model, shape: tuple[int, int, int] = (25, 25, 20)) -> pd.DataFrame:
    """The feasible rows of a grid, by default the paper's, as ``models`` names its columns."""
    table = pd.DataFrame(simulate(model, grid_of(model.converter, shape)).columns())
    return table[table["feasible"].astype(bool)].rename(columns={"P_set_W": "power_W"}).reset_index(drop=True)


@dataclass(frozen=True, slots=True, kw_only=True)
class Trainer:
    """Fits any kind of model to measurements; it knows the simulator, and the simulated rows that it learns from."""

    simulator: Model
    simulated: pd.DataFrame
    say: Say = lambda said: None

    def judged(self, kind: str, data: TrainingData, *, seed: int) -> Trained:
        """A kind fitted to some rows and judged on others, then fitted to all; raises NotTrained."""
        rows = split_experiment(data.rows, seed=seed)
        judged = self.fit(kind, data, rows.train)
        unseen = data.rows.iloc[rows.validation]
        predicted, truth = judged.predict(*inputs_of(unseen)), unseen["efficiency"].to_numpy(dtype=float)
        if not np.isfinite(predicted).any():
            raise NotTrained(f"no {kind} model: it predicts none of the {len(unseen)} rows that judge it")
        return Trained(
            model=self.fit(kind, data, np.arange(len(data))),
            held_out=accuracy_of(predicted, truth),
            half_width=half_width(predicted, truth),
            data_sha256=data_hash(data.table, self.simulated),
        )

    def fit(self, kind: str, data: TrainingData, chosen: Places) -> StagedModel:
        """A kind fitted to some of the rows that carry power; raises NotTrained."""
        measured = data.rows.iloc[chosen]
        fits: dict[str, Callable[[], StagedModel]] = {
            SIMULATION_ONLY: lambda: train_simulation_only(self.simulated),
            EXPERIMENT_ONLY: lambda: train_experiment_only(measured),
            D2EA: lambda: train_d2ea(self.simulated, measured),
            SIMULATOR_FIRST: lambda: self._simulator_first(measured),
            CALIBRATED: lambda: self._calibrated(data.beside_idle(chosen)),
        }
        return fits[kind]()

    def _simulator_first(self, measured: pd.DataFrame) -> StagedModel:
        efficiency = efficiency_of(self.simulator)
        if not np.isfinite(efficiency(*inputs_of(measured))).any():
            said = f"the simulation predicts none of the {len(measured)} rows to fit"
            raise NotTrained(f"no {SIMULATOR_FIRST} model: {said}")
        return train_simulator_first(efficiency, measured)

    def _calibrated(self, measured: pd.DataFrame) -> StagedModel:
        from models.diagnosis.diagnose import diagnose  # here: it loads slowly

        def say(said: str) -> None:
            self.say(f"{CALIBRATED}: {said}")

        try:
            with refused_in_words():
                found = diagnose(load_measurements(measured), self.simulator, progress=say)
        except NotDiagnosed as why:
            raise NotTrained(f"no {CALIBRATED} model: {why}") from why
        return StagedModel(kind=CALIBRATED, stages=(found.calibrated,))


def tenth_of(simulated: pd.DataFrame, *, seed: int) -> pd.DataFrame:
    """The simulated rows that train, as in the paper."""
    return simulated.iloc[split_simulation(simulated, seed=seed).train]
