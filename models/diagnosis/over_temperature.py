"""A property of a part that goes by the part's own temperature, where the simulation takes it as constant.

An inductance that falls as its core warms looks like one that saturates, since what carries more current is warmer. The
thermometer tells the two apart. Each is a leftover of one direction: what the effect does that changes the property,
times how much warmer than on average the part was.
"""

from collections.abc import Iterable, Iterator
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from models.diagnosis.observations import Observations
from models.diagnosis.sensors import times_in
from models.diagnosis.signatures import Signatures
from sim.effects.catalogue import CATALOGUE

Array = NDArray[np.float64]

_OVER = " over "  # in a place, between the effect and the thermometer's column
_STEP_K = 250.0  # Assumption: five steps, one sigma, change a property by what its effect's prior is, in 50 K


@dataclass(frozen=True, slots=True, kw_only=True)
class OverTemperature:
    """By how much a property changes for each kelvin of what ``column`` reads: ``per_K`` of its effect's ``parameter``.

    ``check`` is what to measure on the bench.
    """

    effect: str
    parameter: str
    unit: str
    column: str
    per_K: float
    check: str

    def as_plain(self) -> dict[str, Any]:
        """For the JSON answer."""
        return asdict(self)


@dataclass(frozen=True, slots=True, kw_only=True)
class TemperatureStep:
    """A change of a size that stands for others, and the ``direction`` (M,) in which it moves readings."""

    change: OverTemperature
    direction: Array

    @property
    def place(self) -> str:
        """A leftover's place, in words."""
        return f"{self.change.effect}{_OVER}{self.change.column}"


def temperature_steps(observations: Observations, known: Signatures) -> Iterator[TemperatureStep]:
    """Every property whose part has a thermometer, and may change with what that reads."""
    read, loaded = {c.column for c in observations.channels}, observations.loaded[observations.row]
    for s in known.effects:
        entry, column = s.entry, s.entry.thermometer
        if column not in read:
            continue
        part_C = observations.frame[column].to_numpy(dtype=float)[observations.row]
        known_there = loaded & np.isfinite(part_C)
        if not np.any(known_there):
            continue
        warmer_K = np.where(np.isfinite(part_C), part_C - np.mean(part_C[known_there]), 0.0)
        head = entry.headline
        per_K = head.prior / _STEP_K
        yield TemperatureStep(
            change=OverTemperature(
                effect=s.effect,
                parameter=head.name,
                unit=head.unit,
                column=column,
                per_K=per_K,
                check=entry.check_on_bench,
            ),
            direction=per_K * warmer_K * s.slope,
        )


def is_over_temperature(location: str) -> bool:
    """Whether a leftover's place is a property that goes by its part's temperature."""
    name, found, column = location.partition(_OVER)
    return bool(found) and name in CATALOGUE and CATALOGUE[name].thermometer == column


def over_temperature(steps: Iterable[TemperatureStep], location: str, shift: Array) -> OverTemperature | None:
    """What a leftover at that place, a ``shift`` (M,) of readings, says of a property; None of what is none."""
    for step in steps:
        if step.place == location:
            return replace(step.change, per_K=times_in(step.direction, shift) * step.change.per_K)
    return None
