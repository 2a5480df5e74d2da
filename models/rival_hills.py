r"""Where the highest point may be: the points to measure where that is what decides the optimum.

At each load the best point a of the model stands against the tops j of its other hills, and against the points around
every top, which an edge that just switches softly may cut off from it. With :math:`\delta` by how much
the model sees j below a, and s the standard deviation of that difference, what is lost on average by taking a is

.. math:: s\,g(\delta / s), \quad g(z) = \varphi(z) - z\,\Phi(-z) ,

and rows that take the share t\ :sup:`2` of s\ :sup:`2` away are worth :math:`t\,g(\delta / t)` of it: what better
choices gain on average once they are measured. Of each load the rival that is worth most counts, since those of one
hill are nearly the same; loads add up. Points are chosen one after the other, each the one that is worth most together
with those before it.

Where to measure is asked with a wider s (:meth:`RivalHills.chosen`): hills lie where devices just switch softly, and
what a law of edges misses there the model learns from few rows, while all others make it sure. And what costs is the
rare hill that is much higher than the model sees it, of which a mean says little.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import product
from typing import Self

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from models.calibrated import CalibratedPhysics
from models.lattice import Hills, hills_on_lattice

Array = NDArray[np.float64]

_NO_SPREAD = 1e-12  # of efficiency: two tops of one hill
_SAME = 0.03  # in D1 and D2: tops nearer to each other are one
_STEPS = np.array(list(product((0, -1, 1), repeat=2)))  # to a top itself and around it
_STEP = 0.02  # in D1 and D2: across an edge that just switches softly, a little of the way over which laws are smooth
_BELOW = 1e-3  # of efficiency: what lies further below the best is no rival
_DOUBT = 2.0  # Assumption: differences between hills may be off by twice what the model says
_WIDER = 1.5  # times that, where to measure


@dataclass(frozen=True, slots=True, kw_only=True)
class RivalHills:
    """Points (K,) in the order of their loads: where they are (K, 3), the model's efficiency and its covariance.

    ``load`` (K,) numbers the load of each; ``noise`` is the standard deviation of a reading of efficiency.
    """

    place: Array
    load: NDArray[np.intp]
    efficiency: Array
    covariance: Array
    noise: float

    @classmethod
    def of(cls, model: CalibratedPhysics, loads_W: Array) -> Self:
        """The tops that a calibrated model has at each load (L,) and what is around them, where it vouches for them."""
        vouched = model.vouched()
        place, load = _around(hills_on_lattice(vouched, loads_W), loads_W)
        efficiency = np.asarray(vouched.predict(*place.T))
        best = np.full(len(loads_W), -np.inf)
        np.fmax.at(best, load, efficiency)
        near = efficiency >= best[load] - _BELOW  # NaN is not
        place, load, read = place[near], load[near], model.leftover
        return cls(
            place=place,
            load=load,
            efficiency=efficiency[near],
            covariance=_DOUBT**2 * model.left_open(place),
            noise=float(np.median(read.noise_W / read.place[:, 2])),
        )

    def lost(self) -> Array:
        """Efficiency that is lost on average at the best point of each load that has one, to its worst rival."""
        own, best = np.diag(self.covariance), self._best
        variance = own + own[best] - 2 * self.covariance[np.arange(own.size), best]
        return self._worst(_average_loss(self._below(), np.sqrt(np.maximum(variance, 0.0))))

    def worth_most(self, count: int, allowed: NDArray[np.bool_] | None = None) -> Iterator[tuple[int, float]]:
        """Points to measure, so many of the ``allowed`` (K,), and the loss that each takes away over all loads."""
        may = np.ones(self.load.size, dtype=bool) if allowed is None else allowed
        below, open_, gained = self._below(), self.covariance, 0.0
        told_before = np.zeros(self.load.size)  # of the variance of each difference
        for _ in range(count if np.any(may) else 0):
            shift = open_ / np.sqrt(np.diag(open_) + self.noise**2)  # one sigma of each reading, (K, reading)
            told = told_before[:, None] + (shift - shift[self._best]) ** 2
            total = self._worst(_average_loss(below[:, None], np.sqrt(told))).sum(axis=0)
            row = int(np.argmax(np.where(may, total, -np.inf)))
            yield row, float(total[row]) - gained
            gained, told_before = float(total[row]), told[:, row]
            open_ = open_ - np.outer(shift[:, row], shift[:, row])

    def chosen(self, count: int, allowed: NDArray[np.bool_] | None = None) -> list[int]:
        """Which points to measure, so many of the ``allowed`` (K,): worth most where hills are far less sure."""
        wider = replace(self, covariance=_WIDER**2 * self.covariance)
        return [row for row, _ in wider.worth_most(count, allowed)]

    @property
    def _best(self) -> NDArray[np.intp]:
        """The best point at the load of each, (K,)."""
        order = np.lexsort((-self.efficiency, self.load))
        _, first, own = np.unique(self.load, return_index=True, return_inverse=True)
        return np.asarray(order[first][own])

    def _below(self) -> Array:
        return np.asarray(self.efficiency[self._best] - self.efficiency)

    def _worst(self, value: Array) -> Array:
        """The largest of (K, ...) at each load that has one, (L, ...)."""
        first = np.unique(self.load, return_index=True)[1]
        return np.asarray(np.maximum.reduceat(value, first, axis=0)) if first.size else value


def _distinct(hills: Hills) -> NDArray[np.bool_]:
    """Which tops (L, hills) are no second time a higher one, or an equal one before them."""
    value = hills.efficiency
    apart = np.maximum(*(np.abs(a[:, :, None] - a[:, None]) for a in (hills.D1, hills.D2)))
    before = np.arange(value.shape[1])[:, None] > np.arange(value.shape[1])
    higher = (value[:, None] > value[:, :, None]) | ((value[:, None] == value[:, :, None]) & before)
    return np.asarray(np.isfinite(value) & ~np.any((apart < _SAME) & higher, axis=2))


def _around(hills: Hills, loads_W: Array) -> tuple[Array, NDArray[np.intp]]:
    """Every top and the points around it, (K, 3), and the number of their load, (K,), in the order of the loads."""
    load, number = np.nonzero(_distinct(hills))
    tops = np.stack([hills.D1[load, number], hills.D2[load, number]], axis=1)
    at = np.clip(tops[:, None] + _STEP * _STEPS, 0.0, 1.0).reshape(-1, 2)
    load = np.repeat(load, len(_STEPS))
    return np.column_stack([at, loads_W[load]]), load


def _average_loss(below: Array, spread: Array) -> Array:
    """The mean of what a normal variable of mean ``-below`` is above zero."""
    z = below / np.maximum(spread, _NO_SPREAD)
    return np.asarray(spread * (np.exp(-0.5 * z**2) / np.sqrt(2 * np.pi) - z * ndtr(-z)))
