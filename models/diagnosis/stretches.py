"""A campaign in which something changed on the way, in two stretches, each of one converter and with its own causes."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from models.dataset import Measurements
from models.diagnosis.diagnose import Diagnosis
from models.diagnosis.plausibility import ImplausibleTable
from models.diagnosis.usable import TooFewPoints

BEFORE, AFTER = "before", "after"
_KEPT = ("verdict", "points", "consistent", "causes", "named", "groups", "unknown", "conditions", "parts")


@dataclass(frozen=True, kw_only=True)
class Stretch:
    """The rows on one side of the moment that ``name`` says, and what is ``found`` in them alone.

    Where that is nothing, ``refused`` says why.
    """

    name: str
    measurements: Measurements
    found: Diagnosis | None
    refused: str

    def as_plain(self) -> dict[str, Any]:
        """For the JSON answer of all rows."""
        rows = self.measurements.rows
        answer = None if self.found is None else self.found.as_plain(ahead=False)
        return {
            "name": self.name,
            "rows": len(rows),
            "refused": self.refused or None,
            "answer": None if answer is None else {key: answer[key] for key in _KEPT},
        }


def stretches(
    found: Diagnosis,
    measurements: Measurements,
    diagnosed: Callable[[Measurements], Diagnosis],
    progress: Callable[[str], None] = lambda said: None,
) -> tuple[Stretch, ...]:
    """Before and after the moment at which a cause sets in or goes away, each ``diagnosed``; none where none does.

    ``found`` is the diagnosis of all the ``measurements``; ``progress`` is told what is worked on.
    """
    if found.unexplained is None or (onset := found.unexplained.onset) is None:
        return ()
    time_s = np.asarray(found.observations.points.time_s)
    behind, parts = time_s >= time_s[onset.row], list[Stretch]()
    for name, rows in ((BEFORE, ~behind), (AFTER, behind)):
        progress(f"diagnosing the rows {name} the change on their own")
        parts.append(_stretch(name, _among(measurements, rows), diagnosed))
    return tuple(parts)


def _stretch(name: str, rows: Measurements, diagnosed: Callable[[Measurements], Diagnosis]) -> Stretch:
    try:
        return Stretch(name=name, measurements=rows, found=diagnosed(rows), refused="")
    except (TooFewPoints, ImplausibleTable) as error:
        return Stretch(name=name, measurements=rows, found=None, refused=str(error))


def _among(measurements: Measurements, chosen: NDArray[np.bool_]) -> Measurements:
    """Some of the accepted rows; what was left out of the table is told with all of them."""
    rows = tuple(row for row, there in zip(measurements.rows, chosen, strict=True) if there)
    frame = measurements.frame[chosen].reset_index(drop=True)
    return replace(measurements, frame=frame, rows=rows, rejected=(), notes=())
