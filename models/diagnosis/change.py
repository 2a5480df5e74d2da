"""What changes in the course of a campaign and is no cause: a sensor, a condition that nobody read, something unknown.

A supply that was set anew, a thermocouple that fell off, a load that nobody knows of: from some row on readings move,
and of all causes there is one that they resemble most. As everywhere it has rivals: the sensors that may be off, the
conditions that nobody read, and the smooth leftovers at every place, each on that side of the moment only. The cause is
the answer where, with its value and its law open, it is clearly likelier than each of them.
"""

from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from models.diagnosis.geometry import Geometry
from models.diagnosis.leftover import Leftover, Leftovers, over_campaign
from models.diagnosis.refinery import Refinery
from models.diagnosis.sensors import SensorError, is_sensor, sensor_steps
from models.diagnosis.signatures import Signature
from models.diagnosis.triangular import root_solved
from models.diagnosis.whitener import Whitener

Array = NDArray[np.float64]

_CLEARLY = 3.0  # in log evidence
_CAUSE = "the cause"  # among places


@dataclass(frozen=True, slots=True, kw_only=True)
class Change:
    """What changes at a ``place`` on one side of a moment: ``columns`` (q, M) span how, each one sigma long.

    ``sensor`` is what is off there where it is a sensor. A condition that nobody read is at the place of its name.
    """

    place: str
    columns: Array
    sensor: SensorError | None = None

    def read(self, shift: Array) -> Self:
        """The same where it moves readings by a ``shift`` (M,): a sensor is off by a value then."""
        if self.sensor is None:
            return self
        (direction,) = self.columns
        times = float(shift @ direction / (direction @ direction))
        return replace(self, sensor=replace(self.sensor, value=times * self.sensor.value))

    def as_plain(self) -> dict[str, Any]:
        """For the JSON answer."""
        return {"place": self.place, "sensor": None if self.sensor is None else self.sensor.as_plain()}


@dataclass(frozen=True, slots=True, kw_only=True)
class Step:
    """A cause of ``signature`` at a ``distance`` from its value on the other side, which moves readings by a
    ``direction`` (M,); ``there`` (M,) are those of its side."""

    signature: Signature
    distance: float
    direction: Array
    there: NDArray[np.bool_]

    def columns(self, refinery: Refinery) -> Array:
        """The value, one sigma of its prior, and how its law may be off, (q, M)."""
        value = self.direction * (self.signature.entry.headline.prior / abs(self.distance))
        law = refinery.laws.directions(self.signature, self.distance)
        laws = [] if law is None else [law.factor * law.vectors * self.there]
        return np.concatenate([value[None], *laws])


def gains(whitener: Whitener, pulled: Array, leftovers: Leftovers) -> list[float]:
    """The log evidence that each leftover gains, from what is left, ``pulled`` (M,) through the covariance."""
    geometry = Geometry.of(whitener, np.empty((0, pulled.size)), leftovers)
    told, found = leftovers.basis @ pulled, list[float]()
    for c in leftovers.configurations:
        let_in = geometry.admitted[c.key]
        on = root_solved(let_in.root, (c.amplitude * told[c.columns])[:, None])
        found.append(0.5 * (float(np.sum(on**2)) - let_in.log_det))
    return found


def with_wandering_conditions(refinery: Refinery, leftovers: Leftovers) -> Leftovers:
    """The leftovers, and beside them each condition that nobody read, wandering in the course of the campaign."""
    maps = over_campaign(refinery.observations)
    for column in refinery.known.unread:
        leftovers = leftovers.and_also(f"{column} over time", maps * refinery.known.conditions[column], 1.0)
    return leftovers


def sensors_among(refinery: Refinery, leftovers: Leftovers) -> list[Change]:
    """Each sensor that may be off, as leftovers have it."""
    return [_change(refinery, leftovers, c) for c in leftovers.configurations if is_sensor(c.location)]


def likelier_change(
    refinery: Refinery, whitener: Whitener, left: Array, step: Step, leftovers: Leftovers
) -> Change | None:
    """What is likelier to change than a cause, or as likely, where ``left`` (M,) is left without both; else None."""
    rivals = leftovers.where(step.there)
    for column in refinery.known.unread:
        direction = refinery.known.conditions[column] * step.there
        rivals = rivals.and_also(column, direction[None], 1.0)
    with_cause = rivals.and_also(_CAUSE, step.columns(refinery), 1.0)
    *others, cause = gains(whitener, whitener.solve(left), with_cause)
    best = int(np.argmax(others))
    if cause >= others[best] + _CLEARLY:
        return None
    return _change(refinery, rivals, rivals.configurations[best])


def _change(refinery: Refinery, leftovers: Leftovers, chosen: Leftover) -> Change:
    """One of the leftovers as what changes."""
    columns = chosen.amplitude * leftovers.basis[chosen.columns]
    steps = sensor_steps(refinery.observations, refinery.known)
    error = next((s.error for s in steps if s.place == chosen.location), None)
    off = None if error is None else replace(error, value=chosen.amplitude * error.value)
    return Change(place=chosen.location, columns=columns, sensor=off)
