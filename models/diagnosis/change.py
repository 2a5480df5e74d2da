"""What changes in the course of a campaign and is no cause: a sensor, a condition that nobody read, something unknown.

A supply that was set anew, a thermocouple that fell off, a load that nobody knows of: from some row on readings move,
and of all causes there is one that they resemble most. As everywhere it has rivals: the sensors that may be off, the
conditions that nobody read, and the smooth leftovers at every place, each on that side of the moment only. The cause is
the answer where, with its value and its law open, it is clearly likelier than each of them.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from models.diagnosis.geometry import Geometry
from models.diagnosis.leftover import Leftover, Leftovers, over_campaign
from models.diagnosis.refinery import Refinery
from models.diagnosis.sensors import SensorError, is_sensor, sensor_steps, times_in
from models.diagnosis.signatures import Signature
from models.diagnosis.triangular import root_solved
from models.diagnosis.whitener import Whitener

Array = NDArray[np.float64]

_CLEARLY = 10.0  # in log evidence, as an onset has to be likelier than nothing
_OWN = "the step itself"  # among places


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
        value = times_in(direction, shift) * self.sensor.value
        return replace(self, sensor=replace(self.sensor, value=value))

    def as_plain(self) -> dict[str, Any]:
        """For the JSON answer."""
        return {"place": self.place, "sensor": None if self.sensor is None else self.sensor.as_plain()}


@dataclass(frozen=True, slots=True, kw_only=True)
class Step:
    """What moves readings by a ``shift`` (M,) on the side that is ``there`` (M,).

    One sigma of it, and of how its law may be off, are ``columns`` (q, M).
    """

    shift: Array
    there: NDArray[np.bool_]
    columns: Array

    @classmethod
    def of_a_cause(
        cls, refinery: Refinery, signature: Signature, distance: float, shift: Array, there: NDArray[np.bool_]
    ) -> Self:
        """Of a cause at a ``distance`` from its value on the other side."""
        value = shift * (signature.entry.headline.prior / abs(distance)) if distance else shift
        law = refinery.laws.directions(signature, distance)
        laws = [] if law is None else [law.factor * law.vectors * there]
        return cls(shift=shift, there=there, columns=np.concatenate([value[None], *laws]))


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
    sensors = [c for c in leftovers.configurations if is_sensor(c.location)]
    return _changes(refinery, leftovers, sensors)


def likelier_change(
    refinery: Refinery, left: Array, step: Step, whitener: Whitener, leftovers: Leftovers
) -> Change | None:
    """What is likelier to change than a step says, or as likely, of what is ``left`` (M,) without both; else None."""
    rivals = leftovers.where(step.there)
    for column in refinery.known.unread:
        direction = refinery.known.conditions[column] * step.there
        rivals = rivals.and_also(column, direction[None], 1.0)
    *others, own = gains(whitener, whitener.solve(left), rivals.and_also(_OWN, step.columns, 1.0))
    best = int(np.argmax(others))
    if own >= others[best] + _CLEARLY:
        return None
    (change,) = _changes(refinery, rivals, [rivals.configurations[best]])
    return change


def _changes(refinery: Refinery, leftovers: Leftovers, chosen: Sequence[Leftover]) -> list[Change]:
    """Some of the leftovers as what changes."""
    errors = {step.place: step.error for step in sensor_steps(refinery.observations, refinery.known)}
    found = []
    for leftover in chosen:
        error = errors.get(leftover.location)
        off = None if error is None else replace(error, value=leftover.amplitude * error.value)
        columns = leftover.amplitude * leftovers.basis[leftover.columns]
        found.append(Change(place=leftover.location, columns=columns, sensor=off))
    return found
