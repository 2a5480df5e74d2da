r"""What a cause's own law gets wrong in shape: a smooth error in proportion to what the cause does.

A cause of value :math:`\theta` moves the readings by s as the simulator has it, and by :math:`s\,(1 + g)` in truth:
its formula has another exponent, another dependence on temperature or time. g is a Gaussian process, smooth over
(D1, D2, power) and over time, with a factor of its own for each channel but the first, whose factor is in the value:

.. math:: C' = C + \rho^2 \theta^2 \operatorname{diag}(s_1)\, K \operatorname{diag}(s_1),

:math:`s_1` being the slope and :math:`\rho` how well the effect's formula is known. Written as :math:`L L^T` with few
columns, it is added to the covariance of every hypothesis that holds the cause, so that errors of its formula are not
taken for a second cause. g has no level: that is in the value, whose interval is at least as wide as the law is
uncertain, with what g's shapes do to the value included. What a formula is known to leave out has shapes of its own
(:mod:`models.diagnosis.law_errors`), some with a level. A reading near a threshold may lie on either side of it.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Self

import numpy as np
from numpy.typing import NDArray

from models.diagnosis.covariance import locations
from models.diagnosis.geometry import Directions, Geometry
from models.diagnosis.heat_lag import own_lags
from models.diagnosis.law_errors import LawErrors, no_errors
from models.diagnosis.leftover import smooth_maps
from models.diagnosis.lines import Key
from models.diagnosis.observations import Observations
from models.diagnosis.signatures import Signature
from models.diagnosis.thresholds import State

Array = NDArray[np.float64]

_WIDER = 2.0  # than the correlation lengths of a map: exponents bend over the whole of it
_OF_TIME = 0.5  # of the campaign
_DECIDED = 0.07  # of a step: three sigmas from a threshold


def law_maps(observations: Observations) -> Array:
    """Relative errors of a law, one sigma each: smooth over the set points, over time, and one a channel, (r, M).

    A level is none of them, nor a factor of the first channel: that is another value of the cause.
    """
    row = observations.row
    time_s = np.asarray(observations.points.time_s)[:, None]
    moment = time_s / max(float(np.ptp(time_s)) * _OF_TIME, 1e-9)
    used, place = np.unique(row, return_inverse=True)
    smooth = np.concatenate([smooth_maps(locations(observations)[used] / _WIDER), smooth_maps(moment[used])])
    channels = np.arange(1, len(observations.channels))[:, None] == observations.channel
    return np.concatenate(
        [(smooth - smooth.mean(axis=1, keepdims=True))[:, place], channels.astype(np.float64)]
    )


def law_columns(
    signatures: Sequence[Signature],
    observations: Observations,
    state: State,
    errors: LawErrors = no_errors,
    *,
    slow: bool = False,
) -> Iterable[tuple[Signature, Array]]:
    """Every signature with the columns (r, M) of its error at a distance of one from off.

    ``state`` is of the frame's rows, for the thresholds; ``errors`` tells how an effect's formula is known to err. On a
    ``slow`` bench what a cause heats lags behind too.
    """
    maps = law_maps(observations)
    for s in signatures:
        columns = np.concatenate([s.entry.law * maps, *(own[None] for own in errors(s.entry))]) * s.slope
        if slow:
            columns = np.concatenate([columns, own_lags(s.slope, observations)])
        if s.entry.threshold:
            variants = [v for v in signatures if v.effect == s.effect]
            columns = np.concatenate([columns, _undecided(s, variants, observations, state)])
        yield s, columns


def _undecided(
    signature: Signature, variants: Iterable[Signature], observations: Observations, state: State
) -> Array:
    """One column for each reading that a threshold's effect may have or not, (u, M), at a distance of one from off.

    What it would be where no variant has it is what it is where it is largest: about the last threshold.
    """
    entry, points = signature.entry, observations.points
    off = signature.values(entry.headline.off)
    open_ = entry.undecided(points, state.value, state.sigma, off)[observations.row]
    there = np.max(np.abs([v.slope for v in variants]), axis=0)
    step = open_ * np.where(there > 0.0, there, _largest(np.abs(signature.slope), observations))
    touched = np.flatnonzero((open_ > _DECIDED) & (step > 0))
    columns = np.zeros((touched.size, step.size))
    columns[np.arange(touched.size), touched] = step[touched]
    return columns


def _largest(sizes: Array, observations: Observations) -> Array:
    """The largest of each channel, for all of its readings, (M,): what no variant has, beyond the last threshold."""
    most = np.zeros(len(observations.channels))
    np.maximum.at(most, observations.channel, sizes)
    return np.asarray(most[observations.channel])


@dataclass(frozen=True, slots=True, kw_only=True)
class Laws:
    """The error's columns of every signature at a distance of one from off; their products are found once asked for.

    They are doubted by a ``share`` of that. Where a threshold lies is as open as ever.
    """

    columns: Mapping[Key, Array] = field(default_factory=dict)
    geometry: Geometry | None = None
    share: float = 1.0
    _found: dict[Key, Directions] = field(default_factory=dict)

    @classmethod
    def none(cls) -> Self:
        """Every law is exact."""
        return cls()

    @classmethod
    def of(cls, columns: Iterable[tuple[Signature, Array]], geometry: Geometry) -> Self:
        """The laws of some signatures from their columns (r, M)."""
        return cls(columns={s.key: own for s, own in columns}, geometry=geometry)

    def in_geometry(self, geometry: Geometry) -> Self:
        """The same laws, as feared, seen from another geometry."""
        return type(self)(columns=self.columns, geometry=geometry)

    def without(self, signature: Signature) -> Self:
        """The same with one effect's law exact."""
        return replace(self, columns={key: own for key, own in self.columns.items() if key != signature.key})

    def directions(self, signature: Signature, distance: float) -> Directions | None:
        """The columns for a value at this distance from off; None for an exact law."""
        key = signature.key
        if distance == 0.0 or self.geometry is None or key not in self.columns:
            return None
        if key not in self._found:
            self.find([signature])
        return self._found[key].scaled(abs(distance) * (1.0 if signature.entry.threshold else self.share))

    def find(self, signatures: Iterable[Signature]) -> None:
        """Products of these signatures' columns, of all that are not known yet at once."""
        every = dict.fromkeys(s.key for s in signatures)
        keys = [key for key in every if key in self.columns and key not in self._found]
        if keys and self.geometry is not None:
            own = [self.columns[key] for key in keys]
            self._found.update(zip(keys, self.geometry.directions(own), strict=True))
