"""Conditions that nobody read, where all readings together say that they were others than nominal: what they were."""

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from models.diagnosis.extension import Z95
from models.diagnosis.hypotheses import Fit
from models.diagnosis.observations import nominal_conditions
from models.diagnosis.refinery import Refinery
from models.diagnosis.signatures import NOT_READ
from models.diagnosis.variants import sigma_unread


@dataclass(frozen=True, slots=True, kw_only=True)
class Condition:
    """A condition that the table does not have: what was ``taken`` for it, and the ``value`` that readings fit."""

    column: str
    taken: float
    value: float
    ci95: tuple[float, float]

    def as_plain(self) -> dict[str, Any]:
        """For JSON."""
        return asdict(self) | {"ci95": list(self.ci95)}


def doubted_conditions(refinery: Refinery, fit: Fit) -> list[Condition]:
    """The conditions that readings doubt, beside an explanation; none where nothing is doubted."""
    known, nominal = refinery.known, nominal_conditions(refinery.baseline.converter)
    found = []
    for column in known.doubted_conditions:
        shift = known.spreads[known.spread_names.index(column + NOT_READ)]
        solved = refinery.solve(fit, np.stack([shift, refinery.residual - fit.shift]))
        told, off = solved @ shift
        taken = nominal[column]
        sigma = sigma_unread(column, taken)
        value, span = taken + sigma * off, Z95 * sigma * np.sqrt(max(1.0 - told, 0.0))
        ci95 = float(value - span), float(value + span)
        found.append(Condition(column=column, taken=taken, value=float(value), ci95=ci95))
    return found
