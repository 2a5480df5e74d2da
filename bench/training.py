"""Training efficiency models from a measurement table and a simulated grid.

Each kind is judged on set points that it was not fitted to (40/20/40 % of the measured set points, 10 % of
the feasible simulated ones, as in the paper), and is then fitted once more to all measured rows: that model
is kept, and the held-out error with it.
"""

from collections.abc import Callable
from dataclasses import dataclass

import pandas as pd

from models.accuracy import Accuracy, accuracy, half_width
from models.boosting import Floats
from models.feasibility import Bools
from models.registry import data_hash
from models.splits import split_experiment, split_simulation
from models.surrogate import (
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
from sim.simulate import Points, can_run, grid, simulate

KINDS = (SIMULATION_ONLY, EXPERIMENT_ONLY, D2EA, SIMULATOR_FIRST)
HELD_OUT = "held_out_mean_abs_efficiency"  # metrics of a kept model
HALF_WIDTH = "held_out_half_width95_efficiency"
LEAST_ROWS = 10  # fewer leave no held-out part to speak of


@dataclass(frozen=True, slots=True, kw_only=True)
class Trained:
    """A model fitted to all rows, and the error of its like on rows that were not fitted."""

    model: StagedModel
    held_out: Accuracy
    half_width: (
        float  # of the 95 % interval of a prediction; NaN where the held-out part is too small to tell
    )
    data_sha256: str


def efficiency_of(model: Model) -> Callable[[Floats, Floats, Floats], Floats]:
    """The simulator as a function for ``models``: efficiency (N,), NaN where infeasible."""
    return lambda D1, D2, power_W: simulate(model, Points(D1=D1, D2=D2, power_W=power_W))["efficiency"]


def feasible_of(model: Model) -> Callable[[Floats, Floats, Floats], Bools]:
    """The simulator as a mask for ``models``: whether points (N,) carry their power."""
    return lambda D1, D2, power_W: can_run(model, Points(D1=D1, D2=D2, power_W=power_W))


def simulated_table(model: Model, shape: tuple[int, int, int] = (25, 25, 20)) -> pd.DataFrame:
    """The feasible rows of a grid, by default the paper's, as ``models`` names its columns."""
    table = pd.DataFrame(simulate(model, grid(shape)).columns())
    return table[table["feasible"].astype(bool)].rename(columns={"P_set_W": "power_W"}).reset_index(drop=True)


def train(kind: str, measured: pd.DataFrame, simulated: pd.DataFrame, model: Model, *, seed: int) -> Trained:
    """Judge and fit one kind; ``measured`` holds loaded rows only."""
    rows = split_experiment(measured, seed=seed)
    chosen = simulated.iloc[split_simulation(simulated, seed=seed).train]
    judged = _fit(kind, measured.iloc[rows.train], chosen, model)
    unseen = measured.iloc[rows.validation]
    return Trained(
        model=_fit(kind, measured, chosen, model),
        held_out=accuracy(judged, unseen),
        half_width=half_width(judged.predict(*inputs_of(unseen)), unseen["efficiency"].to_numpy(dtype=float)),
        data_sha256=data_hash(measured, chosen),
    )


def _fit(kind: str, measured: pd.DataFrame, simulated: pd.DataFrame, model: Model) -> StagedModel:
    fits: dict[str, Callable[[], StagedModel]] = {
        SIMULATION_ONLY: lambda: train_simulation_only(simulated),
        EXPERIMENT_ONLY: lambda: train_experiment_only(measured),
        D2EA: lambda: train_d2ea(simulated, measured),
        SIMULATOR_FIRST: lambda: train_simulator_first(efficiency_of(model), measured),
    }
    return fits[kind]()
