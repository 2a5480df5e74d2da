r"""What nobody has thought of: a smooth loss, or a smooth error, at one place of the converter.

A leftover is a Gaussian process over (D1, D2, power) in watts at a location, shown to every channel as watts lost
there would be; temperatures follow by amounts of their own. It is written as :math:`F F^T` with few columns: levels
(always, with the bridges on, under load), straight trends, and the leading eigenvectors of a squared-exponential kernel
at the measured set points. Which location and how many watts it has is not known, so every configuration is a
rival of its own.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from models.diagnosis.covariance import kernel, locations
from models.diagnosis.observations import Observations

Array = NDArray[np.float64]

AMPLITUDES_W = (0.15, 0.5, 1.5, 5.0)
_COLUMNS = 40  # of one smooth map: more would be noise
_CAPTURED = 0.98  # of the kernel's trace
_TREND = 2.0  # of the amplitude: a level or a slope is likelier than a bump
_LENGTH_OF_TIME = 0.1  # of the campaign
_POWERS = ("efficiency", "P_link1_W", "P_link2_W")
_TEMPERATURES = ("T_heatsink_C", "T_transformer_C", "T_inductor_C")
# What one watt lost at a location moves: channels that follow it together, and channels by amounts of their own.
_LOCATIONS: dict[str, tuple[tuple[str, ...], tuple[str, ...]]] = {
    "input": (("efficiency",), ("T_heatsink_C",)),
    "ac link": (("efficiency", "P_link1_W"), ("T_transformer_C", "T_inductor_C")),
    "output": ((*_POWERS, "D0", "I_L_rms_A"), ("T_heatsink_C",)),
    "timing": ((), ("D0", "I_L_rms_A")),
    "everywhere": ((), (*_POWERS, "D0", "I_L_rms_A", *_TEMPERATURES)),
}
IN_TIME = "over time"


@dataclass(frozen=True, slots=True, kw_only=True)
class Leftover:
    """One configuration: where, how much (one sigma, W), and its columns in the basis."""

    location: str
    amplitude_W: float
    columns: NDArray[np.intp]

    @property
    def key(self) -> tuple[str, float]:
        """What tells it from the others."""
        return self.location, self.amplitude_W


@dataclass(frozen=True, slots=True, kw_only=True)
class Leftovers:
    """``basis`` (Q, M): columns of all maps at one watt; ``configurations`` that are rivals of each other."""

    basis: Array
    configurations: tuple[Leftover, ...]

    @classmethod
    def none(cls, readings: int) -> "Leftovers":
        """No leftover is thought possible."""
        return cls(basis=np.empty((0, readings)), configurations=())


def smooth_maps(place: Array) -> Array:
    """Leading maps of a unit squared-exponential kernel at places (N, d), scaled by their root eigenvalue, (r, N)."""
    values, vectors = np.linalg.eigh(kernel(place, place))
    values, vectors = np.maximum(values[::-1], 0.0), vectors[:, ::-1]
    enough = int(np.searchsorted(np.cumsum(values), _CAPTURED * values.sum())) + 1
    kept = min(enough, _COLUMNS)
    return np.asarray((vectors[:, :kept] * np.sqrt(values[:kept])).T)


def trends(place: Array) -> Array:
    """Straight trends over places (N, d), of mean square one each but for the factor, (at most d, N)."""
    apart = place - place.mean(axis=0)
    spread = apart.std(axis=0)
    moving = spread > 1e-9
    return np.asarray(_TREND * (apart[:, moving] / spread[moving]).T)


def leftovers(observations: Observations, per_watt: Array) -> Leftovers:
    """All configurations for some readings; ``per_watt`` (M,) is what one watt lost at the output moves."""
    row = observations.row
    used, place = np.unique(row, return_inverse=True)
    p = observations.points.take(used)
    levels = np.stack([np.ones(used.size), np.asarray(p.pwm), np.asarray(p.power_W) > 0]).astype(np.float64)
    where = locations(observations)[used]
    maps = np.concatenate([_TREND * levels, trends(where), smooth_maps(where)])[:, place]
    time_s = np.asarray(p.time_s)[:, None]
    moment = time_s / max(float(np.ptp(time_s)) * _LENGTH_OF_TIME, 1e-9)
    later = np.concatenate([_TREND * levels, trends(moment), smooth_maps(moment)])[:, place]
    watt = np.array([c.watt for c in observations.channels])[observations.channel]
    carried = np.asarray(observations.points.power_W)[row] > 0
    powers = np.any([observations.of(name) for name in _POWERS], axis=0)
    at_output = np.where(carried, per_watt, np.where(powers, 1.0, 0.0))
    present = {c.name for c in observations.channels}
    found: list[Array] = []
    known: dict[tuple[str, ...], NDArray[np.intp]] = {}

    def part(channels: tuple[str, ...], scale: Array, over: Array = maps) -> NDArray[np.intp]:
        """Columns of one map that these channels follow together."""
        key = (*channels, str(id(over)), str(id(scale)))
        if key not in known:
            of = np.any([observations.of(name) for name in channels], axis=0)
            size = sum(len(block) for block in found)
            found.append(over * np.where(of, scale, 0.0))
            known[key] = np.arange(size, size + len(over))
        return known[key]

    def places() -> Iterator[tuple[str, NDArray[np.intp]]]:
        seen = set()
        for name, (together, apart) in _LOCATIONS.items():
            shared = tuple(c for c in together if c in present)
            own = tuple(c for c in apart if c in present)
            key = (shared, own) if len(shared) > 1 else ((), (*shared, *own))  # one channel follows nobody
            if key in seen or not (shared or own):
                continue
            seen.add(key)
            scale = at_output if name == "output" and len(shared) > 1 else watt
            columns = [part(shared, scale)] if shared else []
            yield name, np.concatenate([*columns, *(part((c,), watt) for c in own)])
        if np.ptp(time_s) > 0.0 and "efficiency" in present:
            yield IN_TIME, part(("efficiency",), watt, later)

    configurations = tuple(
        Leftover(location=name, amplitude_W=amplitude, columns=columns)
        for name, columns in list(places())
        for amplitude in AMPLITUDES_W
    )
    return Leftovers(basis=np.concatenate(found), configurations=configurations)
