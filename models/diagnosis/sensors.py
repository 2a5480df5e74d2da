"""A sensor that is off beyond its specification: its gain or its offset. It loses no watt, and no catalogue has it.

A probe on the wrong ratio, a thermocouple of another type, a room that was read elsewhere, a voltage that is a supply's
display: everything else then agrees. The input power has its own causes of that kind in the catalogue
(``analyzer_gain``, ``analyzer_offset``), and D0 goes with the gates' skew. A condition that is read wrong is simulated
wrong: all readings move.
"""

from collections.abc import Iterable, Iterator
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from models.diagnosis.observations import VOLTAGES, Observations
from models.diagnosis.signatures import Signatures
from models.diagnosis.variants import sigma_unread

Array = NDArray[np.float64]

AMPLITUDE = 5.0  # one sigma, in steps: a hundredth is told, and a probe on the wrong ratio as well
_GAIN_STEP, _ROOM_STEP_K = 0.01, 1.0  # of reading
_OFFSET_STEP = 5.0  # times what a simulation of the channel is good to
_WITHOUT = ("efficiency", "D0")


@dataclass(frozen=True, slots=True, kw_only=True)
class SensorError:
    """How far a sensor is off: a ``gain`` as a share of its reading, or an ``offset`` in the column's ``unit``."""

    column: str
    kind: str
    value: float
    unit: str

    def as_plain(self) -> dict[str, Any]:
        """For the JSON answer."""
        return asdict(self)


@dataclass(frozen=True, slots=True, kw_only=True)
class SensorStep:
    """An error of a size that stands for others, and the ``direction`` (M,) in which it moves readings."""

    error: SensorError
    direction: Array

    @property
    def place(self) -> str:
        """A leftover's place, in words."""
        return f"{self.error.kind} of {self.error.column}"


def sensor_steps(observations: Observations, known: Signatures) -> Iterator[SensorStep]:
    """Every sensor's gain and offset, and those of conditions that were read."""
    expected = np.nan_to_num(known.baseline)
    for channel in observations.channels:
        if channel.name not in _WITHOUT:
            at = observations.of(channel.name)
            yield _step(channel.column, "gain", _GAIN_STEP, "1", np.where(at, _GAIN_STEP * expected, 0.0))
            offset = _OFFSET_STEP * channel.accuracy
            yield _step(channel.column, "offset", offset, channel.unit, np.where(at, offset, 0.0))
    for column in _conditions_read(observations, known):
        room = column == "T_ambient_C"
        size = _ROOM_STEP_K if room else _GAIN_STEP
        direction = -size / sigma_unread(column, 1.0) * known.conditions[column]  # what reads high is less
        yield _step(column, "offset" if room else "gain", size, "degC" if room else "1", direction)


def _conditions_read(observations: Observations, known: Signatures) -> list[str]:
    """The conditions whose sensors are asked of: of voltages both or none, as either bends what the other one does."""
    unread = set(observations.unread)
    if unread.intersection(VOLTAGES):
        unread.update(VOLTAGES)
    return [column for column in known.conditions if column not in unread]


def _step(column: str, kind: str, value: float, unit: str, direction: Array) -> SensorStep:
    return SensorStep(
        error=SensorError(column=column, kind=kind, value=value, unit=unit), direction=direction
    )


def is_sensor(location: str) -> bool:
    """Whether a leftover's place is a sensor."""
    return location.startswith(("gain of ", "offset of "))


def sensor_error(steps: Iterable[SensorStep], location: str, shift: Array) -> SensorError | None:
    """What a leftover at that place, a ``shift`` (M,) of readings, says of a sensor; None of what is none."""
    for step in steps:
        if step.place == location:
            return replace(step.error, value=times_in(step.direction, shift) * step.error.value)
    return None


def times_in(direction: Array, shift: Array) -> float:
    """How many times a direction (M,) is in a shift (M,), by least squares.

    >>> times_in(np.array([1.0, 1.0]), np.array([2.0, 4.0]))
    3.0
    """
    return float(shift @ direction / (direction @ direction))
