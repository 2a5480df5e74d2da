r"""Which of several hills is the highest: the points to measure where that is what decides the optimum.

At each load the best point a of the model stands against the tops j of its other hills. With :math:`\delta` by how much
the model sees j below a, and s the standard deviation of that difference, what is lost on average by taking a is

.. math:: s\,g(\delta / s), \quad g(z) = \varphi(z) - z\,\Phi(-z) ,

and rows that take the share t\ :sup:`2` of s\ :sup:`2` away are worth :math:`t\,g(\delta / t)` of it: what better
choices gain on average once they are measured. All rivals of all loads add up. Points are chosen one after the other,
each the one that is worth most together with those before it.

Where to measure is asked with a wider s: hills lie where devices just switch softly, and what a law of edges misses
there the model learns from few rows, while all others make it sure.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from models.calibrated import CalibratedPhysics
from models.lattice import Hills, hills_on_lattice

Array = NDArray[np.float64]

_NO_SPREAD = 1e-12  # of efficiency: two tops of one hill
_SAME = 0.03  # in D1 and D2: tops nearer to each other are one
_DOUBT = 2.0  # Assumption: differences between hills may be off by twice what the model says


@dataclass(frozen=True, slots=True, kw_only=True)
class RivalHills:
    """Tops (K,) in the order of their loads: where they are (K, 3), the model's efficiency and its covariance.

    ``load`` (K,) numbers the load of each; ``noise`` is the standard deviation of a reading of efficiency.
    """

    place: Array
    load: NDArray[np.intp]
    efficiency: Array
    covariance: Array
    noise: float

    @classmethod
    def of(cls, model: CalibratedPhysics, loads_W: Array) -> Self:
        """Those that a calibrated model has at each load (L,), where it vouches for them."""
        hills = hills_on_lattice(model.vouched(), loads_W)
        load, number = np.nonzero(_distinct(hills))
        place = np.stack([hills.D1[load, number], hills.D2[load, number], loads_W[load]], axis=1)
        read = model.leftover
        return cls(
            place=place,
            load=load,
            efficiency=hills.efficiency[load, number],
            covariance=_DOUBT**2 * model.left_open(place),
            noise=float(np.median(read.noise_W / read.place[:, 2])),
        )

    def lost(self) -> Array:
        """Efficiency that is lost on average at the best point of each load that has one, to all rivals."""
        own, best = np.diag(self.covariance), self._best
        variance = own + own[best] - 2 * self.covariance[np.arange(own.size), best]
        return self._over_rivals(_average_loss(self._below(), np.sqrt(np.maximum(variance, 0.0))))

    def worth_most(self, count: int, allowed: NDArray[np.bool_] | None = None) -> Iterator[tuple[int, float]]:
        """Which tops to measure, so many of the ``allowed`` (K,), and the loss that each takes away over all loads."""
        may = np.ones(self.load.size, dtype=bool) if allowed is None else allowed
        below, open_, gained = self._below(), self.covariance, 0.0
        told_before = np.zeros(self.load.size)  # of the variance of each difference
        for _ in range(count if np.any(may) else 0):
            shift = open_ / np.sqrt(np.diag(open_) + self.noise**2)  # one sigma of each reading, (K, reading)
            told = told_before[:, None] + (shift - shift[self._best]) ** 2
            total = _average_loss(below[:, None], np.sqrt(told)).sum(axis=0)
            row = int(np.argmax(np.where(may, total, -np.inf)))
            yield row, float(total[row]) - gained
            gained, told_before = float(total[row]), told[:, row]
            open_ = open_ - np.outer(shift[:, row], shift[:, row])

    @property
    def _best(self) -> NDArray[np.intp]:
        """The best top at the load of each, (K,)."""
        order = np.lexsort((-self.efficiency, self.load))
        _, first, own = np.unique(self.load, return_index=True, return_inverse=True)
        return np.asarray(order[first][own])

    def _below(self) -> Array:
        return np.asarray(self.efficiency[self._best] - self.efficiency)

    def _over_rivals(self, value: Array) -> Array:
        """The sum of (K,) at each load."""
        return np.asarray(np.bincount(np.unique(self.load, return_inverse=True)[1], weights=value))


def _distinct(hills: Hills) -> NDArray[np.bool_]:
    """Which tops (L, hills) are no second time a higher one, or an equal one before them."""
    value = hills.efficiency
    apart = np.maximum(*(np.abs(a[:, :, None] - a[:, None]) for a in (hills.D1, hills.D2)))
    before = np.arange(value.shape[1])[:, None] > np.arange(value.shape[1])
    higher = (value[:, None] > value[:, :, None]) | ((value[:, None] == value[:, :, None]) & before)
    return np.asarray(np.isfinite(value) & ~np.any((apart < _SAME) & higher, axis=2))


def _average_loss(below: Array, spread: Array) -> Array:
    """The mean of what a normal variable of mean ``-below`` is above zero."""
    z = below / np.maximum(spread, _NO_SPREAD)
    return np.asarray(spread * (np.exp(-0.5 * z**2) / np.sqrt(2 * np.pi) - z * ndtr(-z)))
