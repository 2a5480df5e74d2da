"""Rows and single readings that a diagnosis could not use, each with its reason: nothing is left out silently."""

from collections import Counter
from collections.abc import Iterable
from typing import Any

import numpy as np

from models.dataset import Measurements
from models.diagnosis.near_limit import LEAST_SPARE, margin
from models.diagnosis.observations import Observations
from models.diagnosis.setting import Setting

_OUTLIER = 6.0  # sigmas: one normal reading in a billion


def most_lost_before(measurements: Measurements) -> str:
    """What the table lost before, and why most of it."""
    if not measurements.rejected:
        return ""
    reason, count = Counter(row.reason for row in measurements.rejected).most_common(1)[0]
    return f". {len(measurements.rejected)} rows were left out, {count} of them because: {reason}"


def rows_left_out(measurements: Measurements, found: Iterable[dict[str, Any]]) -> list[dict[str, Any]]:
    """What was impossible, then what was ``found`` at places in the frame, all by their rows of the table."""
    impossible = [
        {"row": row.row, "column": row.column, "value": row.value, "reason": row.reason}
        for row in measurements.rejected
    ]
    return [*impossible, *(row | {"row": measurements.rows[row["row"]]} for row in found)]


def edge_rows(whole: Observations, first: Observations, kept: Observations) -> list[dict[str, Any]]:
    """Places in the frame of rows of which no reading can be used, with the reason.

    Of the ``whole``, the ``first`` are what the baseline carries with power to spare, and ``kept`` what the explanation
    that led then carries, too.
    """
    reasons = {int(row): _near(margin(whole)) for row in np.setdiff1d(whole.row, first.row)}
    reasons |= {
        int(row): _near(LEAST_SPARE, " beside the first explanation")
        for row in np.setdiff1d(first.row, kept.row)
    }
    return [
        {"row": row, "column": "P2_W", "value": float(whole.frame.iloc[row]["P2_W"]), "reason": reason}
        for row, reason in sorted(reasons.items())
    ]


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
        {
            "row": int(o.row[k]),
            "column": o.channels[o.channel[k]].column,
            "value": float(o.value[k]),
            "reason": f"{setting.far_off[k]:.0f} sigma from what explains the other rows: it counts for nothing",
        }
        for k in np.flatnonzero(setting.far_off > _OUTLIER)
    ]
