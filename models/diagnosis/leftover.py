r"""What nobody has thought of: a smooth loss, or a smooth error, at one place of the converter.

A leftover is a Gaussian process over (D1, D2, power) in watts at a location, shown to every channel as watts lost
there would be; temperatures follow by amounts of their own. It is written as :math:`F F^T` with few columns: levels
(always, with the bridges on, under load), straight trends, and the leading eigenvectors of a squared-exponential kernel
at the measured set points. Some losses change faster than that, but go by one quantity alone: the heatsink's measured
temperature (a contact, a leakage current), or the power (a controller that changes its ways). Which location and how
many watts it has is not known, so every configuration is a rival of its own, and beside them a sensor that is off
(:mod:`models.diagnosis.sensors`), a property that goes by temperature (:mod:`models.diagnosis.over_temperature`), and a
cause that is not there all the time (:mod:`models.diagnosis.onset`). What stands still over all set points is a level
alone: columns that it does not need would count against it.
"""

from collections.abc import Collection, Iterable
from dataclasses import dataclass, replace
from typing import Protocol, Self

import numpy as np
from numpy.typing import NDArray

from models.diagnosis.covariance import kernel, locations
from models.diagnosis.observations import Observations
from models.diagnosis.sensors import AMPLITUDE

Array = NDArray[np.float64]

AMPLITUDES_W = (0.15, 0.5, 1.5, 5.0, 15.0)
_COLUMNS = 40  # of one smooth map: more would be noise
_CAPTURED = 0.98  # of the kernel's trace
_TREND = 2.0  # of the amplitude: a level or a slope is likelier than a bump
_STRAIGHT_W = (0.5, 1.5, 5.0)
_LENGTH_OF_TIME = 0.1  # of the campaign
_NEIGHBOURS = 2.5  # rows over which a gain that wanders has to stand still, to be told from noise
_POWERS = ("efficiency", "P_link1_W", "P_link2_W")
_TEMPERATURES = ("T_heatsink_C", "T_transformer_C", "T_inductor_C")
# What one watt lost at a location moves: channels that follow it together, and channels by amounts of their own.
_LOCATIONS: dict[str, tuple[tuple[str, ...], tuple[str, ...]]] = {
    "input": (("efficiency",), ("T_heatsink_C",)),
    "ac link": (("efficiency", "P_link1_W"), ("T_transformer_C", "T_inductor_C")),
    "ac link, in series": (
        ("efficiency", "P_link1_W"),
        ("D0", "I_L_rms_A", "T_transformer_C", "T_inductor_C"),
    ),
    "output": ((*_POWERS, "D0", "I_L_rms_A"), ("T_heatsink_C",)),
    "timing": ((), ("D0", "I_L_rms_A")),
    "ac elements": ((), ("P_link1_W", "P_link2_W")),
    "everywhere": ((), (*_POWERS, "D0", "I_L_rms_A", *_TEMPERATURES)),
}
# that follow a watt as they follow one at the output
_LIKE_OUTPUT = {"ac link, in series": ("D0", "I_L_rms_A")}
IN_TIME, GAIN_IN_TIME = "over time", "gain over time"
_LENGTH_OF_HEAT, _LENGTH_OF_POWER = 0.3, 0.08  # of the range of the one quantity that a loss goes by


class SingleDirection(Protocol):
    """What moves readings in one ``direction`` (M,), of a size that stands for others."""

    @property
    def place(self) -> str:
        """Where it is, in words."""
        ...

    @property
    def direction(self) -> Array:
        """The direction, one step long."""
        ...


@dataclass(frozen=True, slots=True, kw_only=True)
class Leftover:
    """One configuration: where, how much (one sigma, in W, or in times of one column), and its columns in the basis."""

    location: str
    amplitude: float
    columns: NDArray[np.intp]

    @property
    def key(self) -> tuple[str, float]:
        """What tells it from the others."""
        return self.location, self.amplitude


@dataclass(frozen=True, slots=True, kw_only=True)
class Leftovers:
    """``basis`` (Q, M): columns of all maps at one watt, or step; ``configurations`` that are rivals of each other.

    ``shared_by`` so many is what the prior leaves for them all.
    """

    basis: Array
    configurations: tuple[Leftover, ...]
    shared_by: int

    def among(self, keys: Collection[tuple[str, float]]) -> Self:
        """Some of the configurations, each as likely beforehand as among all."""
        chosen = [c for c in self.configurations if c.key in keys]
        used = np.unique(np.concatenate([np.empty(0, dtype=np.intp), *(c.columns for c in chosen)]))
        places = {id(c.columns): np.searchsorted(used, c.columns) for c in chosen}
        moved = tuple(replace(c, columns=places[id(c.columns)]) for c in chosen)
        return replace(self, basis=self.basis[used], configurations=moved)

    def and_also(self, location: str, columns: Array, amplitude: float) -> Self:
        """Beside them one more, of some ``columns`` (q, M)."""
        places = np.arange(len(self.basis), len(self.basis) + len(columns))
        more = Leftover(location=location, amplitude=amplitude, columns=places)
        return replace(
            self,
            basis=np.concatenate([self.basis, columns]),
            configurations=(*self.configurations, more),
            shared_by=self.shared_by + 1,
        )

    def where(self, there: NDArray[np.bool_]) -> Self:
        """All of them in some readings (M,) only."""
        return replace(self, basis=self.basis * there)

    def of(self, leftover: Leftover, pulled: Array) -> Array:
        """The most probable course (M,) of a leftover; ``pulled`` (M,) is C'^-1 of what was left with it in C'."""
        columns = leftover.amplitude * self.basis[leftover.columns]
        return np.asarray(columns.T @ (columns @ pulled))


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


def leftovers(
    observations: Observations, per_watt: Array, power: float = 1.0, steps: Iterable[SingleDirection] = ()
) -> Leftovers:
    """All configurations for some readings; ``per_watt`` (M,) is what one watt lost at the output moves.

    ``power`` is that of the converter against the prototype's, for which amplitudes are stated; beside them may be one
    of the ``steps``.
    """
    amplitudes_W, straight_W = (tuple(power * a for a in each) for each in (AMPLITUDES_W, _STRAIGHT_W))
    row, power_W = observations.row, np.asarray(observations.points.power_W)
    used, place = np.unique(row, return_inverse=True)
    where = locations(observations)[used]
    present = {c.name for c in observations.channels}
    watt = np.array([c.watt for c in observations.channels])[observations.channel]
    powers = np.any([observations.of(name) for name in _POWERS], axis=0)
    at_output = np.where(power_W[row] > 0, per_watt, np.where(powers, 1.0, 0.0))
    levels = _TREND * _levels(observations, used)
    straight = np.concatenate([levels, trends(where)])
    basis = _Basis(observations, np.concatenate([straight, smooth_maps(where)])[:, place])
    found: list[tuple[str, NDArray[np.intp], tuple[float, ...]]] = []
    seen = set()
    for name, (together, apart) in _LOCATIONS.items():
        shared = tuple(c for c in together if c in present)
        own = tuple(c for c in apart if c in present)
        key = (shared, own) if len(shared) > 1 else ((), (*shared, *own))  # one channel follows nobody
        if key in seen or not (shared or own):
            continue
        seen.add(key)
        scale = at_output if name == "output" and len(shared) > 1 else watt
        said = "at the output" if scale is at_output else "watts"
        parts = [basis.part(shared, said, scale)] if shared else []
        parts += [basis.part((c,), "watts", watt) for c in own]
        found.append((name, np.concatenate(parts), amplitudes_W))
        found.append((f"{name}, straight", np.concatenate([p[: len(straight)] for p in parts]), straight_W))
        if len(shared) > 1:  # at the input it is what an auxiliary supply takes
            found.append((f"{name}, level", np.concatenate([p[: len(levels)] for p in parts]), straight_W))
    if "efficiency" in present:
        gain = power_W[row] / np.sqrt(np.mean(power_W[row] ** 2))
        for name, maps in _over_time(observations, used):
            scale = gain if name == GAIN_IN_TIME else watt
            found.append((name, basis.add(("efficiency",), scale, maps[:, place]), amplitudes_W))
    for said, maps in _by_one_quantity(observations, used):
        for name, channels in _together(present).items():
            follows = np.any([observations.of(c) for c in _LIKE_OUTPUT.get(name, ())], axis=0)
            scale = at_output if name == "output" else np.where(follows, per_watt, watt)
            found.append((f"{name}, {said}", basis.add(channels, scale, maps[:, place]), straight_W))
    found += [(step.place, basis.direction(step.direction), (AMPLITUDE,)) for step in steps]
    return basis.leftovers(found)


def over_campaign(observations: Observations) -> Array:
    """Smooth maps (r, M) over the time of a campaign, at all readings; none where no time was noted."""
    used, place = np.unique(observations.row, return_inverse=True)
    maps = (maps for name, maps in _over_time(observations, used) if name == IN_TIME)
    return next(maps, np.empty((0, used.size)))[:, place]


def _over_time(observations: Observations, used: NDArray[np.intp]) -> Iterable[tuple[str, Array]]:
    """Maps (r, N) over time: of what drifts, and of a gain that wanders; none where no time was noted."""
    time_s = np.asarray(observations.points.time_s)[used][:, None]
    if np.ptp(time_s) > 0.0:
        slow = time_s / (np.ptp(time_s) * _LENGTH_OF_TIME)
        yield (
            IN_TIME,
            np.concatenate([_TREND * _levels(observations, used), trends(slow), smooth_maps(slow)]),
        )
        step_s = np.median(np.diff(np.unique(time_s)))
        yield GAIN_IN_TIME, smooth_maps(time_s / (step_s * _NEIGHBOURS))


def _together(present: Collection[str]) -> dict[str, tuple[str, ...]]:
    """The places at which channels follow a watt together, each set of channels at one place."""
    found: dict[tuple[str, ...], str] = {}
    for name, (together, _) in _LOCATIONS.items():
        channels = tuple(c for c in (*together, *_LIKE_OUTPUT.get(name, ())) if c in present)
        if channels:
            found.setdefault(channels, name)
    return {name: channels for channels, name in found.items()}


def _by_one_quantity(observations: Observations, used: NDArray[np.intp]) -> Iterable[tuple[str, Array]]:
    """Maps (r, N) that change over one quantity alone, each with what it says of the place.

    Efficiency alone has none by power: it is read to the edge of what can be carried (decision 90), where what any law
    misses is as narrow.
    """
    frame, p = observations.frame.iloc[used], observations.points.take(used)
    if not observations.efficiency_alone:
        yield "by power", _over(np.asarray(p.power_W), np.asarray(p.pwm) + 0.0, _LENGTH_OF_POWER)
    present = {c.name for c in observations.channels}
    if "T_heatsink_C" in present:
        current = frame["I_L_rms_A"] if "I_L_rms_A" in present else frame["P2_W"]
        heat, load = frame["T_heatsink_C"].to_numpy(dtype=float), current.to_numpy(dtype=float) ** 2
        weight = np.where(np.isfinite(heat) & np.isfinite(load), load, 0.0)
        if np.any(weight):
            yield "by temperature", _over(heat, weight, _LENGTH_OF_HEAT)


def _over(quantity: Array, weight: Array, length: float) -> Array:
    """A level and smooth maps over one quantity (N,), lengths a share of its range, times a weight (N,), (r, N)."""
    apart = np.where(weight > 0.0, quantity - np.mean(quantity[weight > 0.0]), 0.0)
    place = apart / (length * float(np.ptp(apart)) or 1.0)
    scaled = weight / np.sqrt(np.mean(weight**2))
    return np.asarray(np.concatenate([np.ones((1, place.size)), smooth_maps(place[:, None])]) * scaled)


def _levels(observations: Observations, used: NDArray[np.intp]) -> Array:
    """Always, with the bridges on, under load, (3, N)."""
    p = observations.points.take(used)
    return np.stack([np.ones(used.size), np.asarray(p.pwm), np.asarray(p.power_W) > 0]).astype(np.float64)


class _Basis:
    """Columns of all parts as they are found, each part once; ``maps`` (r, M) are those over the set points."""

    def __init__(self, observations: Observations, maps: Array) -> None:
        self._observations, self._maps = observations, maps
        self._blocks: list[Array] = []
        self._known: dict[tuple[str, ...], NDArray[np.intp]] = {}

    def add(self, channels: tuple[str, ...], scale: Array, over: Array) -> NDArray[np.intp]:
        """Columns of other maps (r, M) that these channels follow together."""
        of = np.any([self._observations.of(name) for name in channels], axis=0)
        return self._added(over * np.where(of, scale, 0.0))

    def direction(self, direction: Array) -> NDArray[np.intp]:
        """One column (M,), as it is."""
        return self._added(direction[None])

    def part(self, channels: tuple[str, ...], said: str, scale: Array) -> NDArray[np.intp]:
        """Columns of the maps that these channels follow together, by a scale (M,) of that name."""
        key = (*channels, said)
        if key not in self._known:
            self._known[key] = self.add(channels, scale, self._maps)
        return self._known[key]

    def _added(self, block: Array) -> NDArray[np.intp]:
        size = sum(len(each) for each in self._blocks)
        self._blocks.append(block)
        return np.arange(size, size + len(block))

    def leftovers(self, found: Iterable[tuple[str, NDArray[np.intp], tuple[float, ...]]]) -> Leftovers:
        """All configurations: places with their columns, at each amplitude."""
        configurations = tuple(
            Leftover(location=name, amplitude=amplitude, columns=columns)
            for name, columns, amplitudes in found
            for amplitude in amplitudes
        )
        return Leftovers(
            basis=np.concatenate(self._blocks), configurations=configurations, shared_by=len(configurations)
        )
