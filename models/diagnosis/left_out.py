"""Rows and single readings that a diagnosis could not use, each with its reason: nothing is left out silently."""

from collections.abc import Iterable
from typing import Any

import numpy as np
import pandas as pd

from models.dataset import Measurements
from models.diagnosis.near_limit import LEAST_SPARE
from models.diagnosis.observations import Observations
from models.diagnosis.setting import Setting
from models.diagnosis.usable import Usable

_NOT_PREDICTED = (
    "with some part within its spread, or some effect, it jumps or is not predicted at all: not used"
)


def rows_left_out(measurements: Measurements, found: Iterable[dict[str, Any]]) -> list[dict[str, Any]]:
    """What was impossible, then what was ``found`` at places in the frame, all by their rows of the table."""
    impossible = [
        {"row": row.row, "column": row.column, "value": row.value, "reason": row.reason}
        for row in measurements.rejected
    ]
    return [*impossible, *(row | {"row": measurements.rows[row["row"]]} for row in found)]


def not_usable(frame: pd.DataFrame, first: Usable, kept: Observations) -> list[dict[str, Any]]:
    """Places in the ``frame`` of rows and single readings that cannot be used, with the reason.

    The ``first`` is what the baseline carries with power to spare and every variant predicts, and ``kept`` what the
    explanation that led then carries, too.
    """
    reasons = {int(row): _near(first.margin) for row in np.unique(first.edge.row)}
    reasons |= {
        int(row): _near(LEAST_SPARE, " beside the first explanation")
        for row in np.setdiff1d(first.observations.row, kept.row)
    }
    rows = [
        {"row": row, "column": "P2_W", "value": _finite(frame.iloc[row]["P2_W"]), "reason": reason}
        for row, reason in sorted(reasons.items())
    ]
    o = first.unpredicted
    return rows + [_reading(o, k, _NOT_PREDICTED) for k in range(o.value.size)]


def _reading(observations: Observations, place: int, reason: str) -> dict[str, Any]:
    """A single reading by its place in the frame."""
    return {
        "row": int(observations.row[place]),
        "column": observations.channels[observations.channel[place]].column,
        "value": float(observations.value[place]),
        "reason": reason,
    }


def _finite(value: float) -> float | None:
    """A value for the JSON answer, which knows no NaN."""
    return float(value) if np.isfinite(value) else None


def _near(margin: float, beside: str = "") -> str:
    """Why a row within such a share of the power is left out."""
    return (
        f"within {100 * margin:.0f} % of the most that D1 and D2 can carry{beside}, or above it: readings answer there "
        "to everything at once, so nothing can be told apart"
    )


def outliers(setting: Setting) -> list[dict[str, Any]]:
    """Single readings, by their places in the frame, that nothing smooth explains: they count for next to nothing."""
    o = setting.refinery.observations
    return [
        _reading(
            o, k, f"{setting.far_off[k]:.0f} sigma from what explains the other rows: it counts for nothing"
        )
        for k in np.flatnonzero(setting.outliers).tolist()
    ]
