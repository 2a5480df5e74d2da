"""How far the simulation is off, before any cause; and how much of that a cause takes away."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from models.diagnosis.observations import Observations

Array = NDArray[np.float64]


def gap(observations: Observations, residual: Array) -> dict[str, Any]:
    """How far the simulation is off in efficiency and watts, and where it is worst."""
    judged = observations.of("efficiency") & observations.loaded[observations.row]
    row, watts = observations.row[judged], residual[judged]
    power = np.asarray(observations.points.power_W)[row]
    measured = observations.value[judged]
    efficiency = power / measured - power / (measured - watts)
    worst = int(np.argmax(np.abs(efficiency)))
    frame = observations.frame.iloc[row[worst]]
    return {
        "mean_abs_efficiency": float(np.mean(np.abs(efficiency))),
        "mean_loss_W": float(np.mean(watts)),
        "worst": {
            "efficiency": float(efficiency[worst]),
            "loss_W": float(watts[worst]),
            "D1": float(frame["D1"]),
            "D2": float(frame["D2"]),
            "P2_W": float(frame["P2_W"]),
        },
    }


def share_of_gap(observations: Observations, residual: Array, shift: Array) -> float:
    """How much of the mean absolute gap in watts a shift of the prediction takes away."""
    judged = observations.of("efficiency") & observations.loaded[observations.row]
    before = float(np.mean(np.abs(residual[judged])))
    after = float(np.mean(np.abs((residual - shift)[judged])))
    return float(np.clip(1 - after / before, 0.0, 1.0)) if before > 0 else 0.0
