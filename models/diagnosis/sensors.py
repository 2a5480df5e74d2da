"""A sensor that is off beyond its specification: its gain or its offset. It loses no watt, and no catalogue has it.

A probe on the wrong ratio, a thermocouple of another type, a column in another unit: everything else then agrees. The
input power has its own causes of that kind in the catalogue (``analyzer_gain``, ``analyzer_offset``), and D0 goes with
the gates' skew.
"""

from collections.abc import Iterator
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from models.diagnosis.observations import Observations

Array = NDArray[np.float64]

GAIN, OFFSET = "gain of ", "offset of "
AMPLITUDES = (1.0, 5.0, 30.0)  # one sigma, in the steps below
_GAIN_STEP, _OFFSET_STEP = 0.01, 5.0  # of reading; times what a simulation of the channel is good to
_WITHOUT = ("efficiency", "D0")


@dataclass(frozen=True, slots=True, kw_only=True)
class SensorError:
    """How far a sensor is off: a ``gain`` as a share of its reading, or an offset in the column's ``unit``."""

    column: str
    kind: str
    value: float
    unit: str

    def as_plain(self) -> dict[str, Any]:
        """For the JSON answer."""
        return asdict(self)


def sensor_errors(observations: Observations, expected: Array) -> Iterator[tuple[str, tuple[str], Array]]:
    """By its place the channel and the direction (M,) of every sensor's gain and offset, a step each.

    ``expected`` (M,) is what the sensors would show.
    """
    for channel in observations.channels:
        if channel.name not in _WITHOUT:
            yield GAIN + channel.name, (channel.name,), _GAIN_STEP * np.nan_to_num(expected)
            step = _OFFSET_STEP * channel.accuracy
            yield OFFSET + channel.name, (channel.name,), np.full(expected.size, step)


def is_sensor(location: str) -> bool:
    """Whether a leftover's place is a sensor."""
    return location.startswith((GAIN, OFFSET))


def sensor_error(
    observations: Observations, location: str, shift: Array, expected: Array
) -> SensorError | None:
    """What a leftover at that place, a ``shift`` (M,) of what is ``expected`` (M,), says of a sensor; else None."""
    if not is_sensor(location):
        return None
    kind, name = location.split(" of ")
    channel = next(c for c in observations.channels if c.name == name)
    at = observations.of(name)
    share = kind == GAIN.split()[0]
    of = expected[at] if share else np.ones(np.count_nonzero(at))
    value = float(shift[at] @ of / (of @ of))
    return SensorError(column=channel.column, kind=kind, value=value, unit="1" if share else channel.unit)
