r"""Where an efficiency model is uncertain near its optimum: the points worth measuring for a better one.

A point's worth is the standard deviation of its predicted efficiency, less where the model sees it far below the best
of its neighbours in load,

.. math:: w = \sigma \exp(-(\eta^* - \eta) / \eta_0) .

Points are chosen one after the other; each is taken as measured before the next one is looked for.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from models.calibrated import CalibratedPhysics

Array = NDArray[np.float64]

_NEIGHBOURS = 24  # in load, among which a point may be the best
_BELOW = 3e-3  # of efficiency: so far below the best a point counts a third
_NOISE = 1e-4  # of efficiency, one averaged reading


@dataclass(frozen=True, slots=True, kw_only=True)
class LeastKnown:
    """Indices of the points to measure, in their order, and the largest worth before any of them is."""

    chosen: tuple[int, ...]
    sigma: float


def least_known(model: CalibratedPhysics, place: Array, count: int) -> LeastKnown:
    """The ``count`` points worth most among K places (K, 3) of D1, D2 and power in W, each of them once at most."""
    efficiency = model.predict(*place.T)
    known = np.flatnonzero(np.isfinite(efficiency))
    if not known.size:
        return LeastKnown(chosen=(), sigma=0.0)
    near = np.exp(-_short_of_best(efficiency[known], place[known, 2]) / _BELOW)
    open_, chosen, first = model.left_open(place[known]), list[int](), 0.0
    for turn in range(min(count, known.size)):
        worth = near * np.sqrt(np.maximum(np.diag(open_), 0.0))
        worth[np.isin(known, chosen)] = -1.0
        best = int(np.argmax(worth))
        first = first if turn else float(worth[best])
        chosen.append(int(known[best]))
        open_ = open_ - np.outer(open_[best], open_[best]) / (open_[best, best] + _NOISE**2)
    return LeastKnown(chosen=tuple(chosen), sigma=first)


def _short_of_best(efficiency: Array, power_W: Array) -> Array:
    """How far each point (K,) stays below the best of those next to it in load."""
    apart = np.abs(power_W[:, None] - power_W)
    nearest = np.argsort(apart, axis=1, kind="stable")[:, :_NEIGHBOURS]
    return np.asarray(np.max(efficiency[nearest], axis=1) - efficiency)
