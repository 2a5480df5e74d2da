"""Conditions that nobody read: what was taken for them, and what they were where readings say that it was not that."""

from collections.abc import Iterable
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from models.diagnosis.extension import Z95
from models.diagnosis.hypotheses import Fit
from models.diagnosis.observations import nominal_conditions
from models.diagnosis.plausibility import allowed_for
from models.diagnosis.refinery import Refinery
from models.diagnosis.signatures import NOT_READ
from models.diagnosis.variants import sigma_unread

_STRAIGHT = 0.2  # of what a condition may be off by, one sigma: over which readings are straight lines of it


@dataclass(frozen=True, slots=True, kw_only=True)
class Condition:
    """A condition that the table does not have, what was ``taken`` for it, and the ``value`` that readings fit.

    Value and interval are None where readings do not doubt what was taken, or fit nothing that a bench could have.
    """

    column: str
    taken: float
    value: float | None = None
    ci95: tuple[float, float] | None = None

    def as_plain(self) -> dict[str, Any]:
        """For JSON."""
        return asdict(self) | {"ci95": None if self.ci95 is None else list(self.ci95)}


def unread_conditions(refinery: Refinery, fit: Fit) -> list[Condition]:
    """The conditions that nobody read, beside an explanation."""
    nominal, doubted = nominal_conditions(refinery.baseline.converter), refinery.known.doubted_conditions
    return [
        _doubted(refinery, fit, column, nominal[column])
        if column in doubted
        else Condition(column=column, taken=nominal[column])
        for column in refinery.observations.unread
    ]


def elsewhere(conditions: Iterable[Condition]) -> dict[str, float]:
    """What readings fit conditions to that nobody read, by column, where nominal ones are too far for a line."""
    return {
        c.column: c.value
        for c in conditions
        if c.value is not None and abs(c.value - c.taken) > _STRAIGHT * sigma_unread(c.column, c.taken)
    }


def _doubted(refinery: Refinery, fit: Fit, column: str, taken: float) -> Condition:
    """A condition that is a spread, with what the readings leave of it, if that can be."""
    shift = refinery.known.spreads[refinery.known.spread_names.index(column + NOT_READ)]
    told, off = refinery.solve(fit, np.stack([shift, refinery.residual - fit.shift])) @ shift
    sigma = sigma_unread(column, taken)
    begun = refinery.observations.found.get(column, taken)
    value, span = float(begun + sigma * off), Z95 * sigma * float(np.sqrt(max(1.0 - told, 0.0)))
    low, high = allowed_for(column, refinery.baseline.converter)
    if not low < value < high:  # made of something else
        return Condition(column=column, taken=taken)
    return Condition(column=column, taken=taken, value=value, ci95=(value - span, value + span))
