"""How far the simulation is off, before any cause; and what a cause adds to it."""

from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from models.diagnosis.observations import Observations

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]


@dataclass(frozen=True, slots=True, kw_only=True)
class Added:
    """What a cause adds to the input power of the rows with load in W, and its ``share`` of the gap.

    The share is of the mean absolute gap, 0 to 1, if nothing else were off: shares need not add up to one, and what
    works against the other causes has none.
    """

    mean_W: float
    lowest_W: float
    highest_W: float
    share: float

    @classmethod
    def by(cls, observations: Observations, residual: Array, shift: Array, counts: Mask) -> Self:
        """Of a cause whose ``shift`` (M,) is what it adds to the predictions, in the units of the ``residual`` (M,).

        Of the readings that ``counts`` (M,) has.
        """
        judged = _judged(observations) & counts
        before = float(np.mean(np.abs(residual[judged])))
        after = float(np.mean(np.abs((residual - shift)[judged])))
        return cls(
            mean_W=float(np.mean(shift[judged])),
            lowest_W=float(np.min(shift[judged])),
            highest_W=float(np.max(shift[judged])),
            share=float(np.clip(1 - after / before, 0.0, 1.0)) if before > 0 else 0.0,
        )

    def as_plain(self) -> dict[str, Any]:
        """As in the JSON answer."""
        added_W = {"mean": self.mean_W, "lowest": self.lowest_W, "highest": self.highest_W}
        return {"share_of_gap": self.share, "added_W": added_W}


def gap(observations: Observations, residual: Array, counts: Mask) -> dict[str, Any]:
    """How far the simulation is off in efficiency and watts, and where most, among the readings ``counts`` (M,)."""
    judged = _judged(observations) & counts
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


def _judged(observations: Observations) -> Mask:
    """Which readings are the input power of rows with load, (M,)."""
    return np.asarray(observations.of("efficiency") & observations.loaded[observations.row])
