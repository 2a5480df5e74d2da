"""Readings that stand alone: so few rows, so far from what all others say, that nothing is to be explained by them."""

import numpy as np
from numpy.typing import NDArray

from models.diagnosis.whitener import Whitener

Array = NDArray[np.float64]

FAR = 6.0  # sigmas: one normal reading in a billion
LEAST_ROWS = 6  # fewer may be outliers


def lone_variance(whitener: Whitener, left: Array, row: NDArray[np.intp]) -> Array:
    """Variance (M,) with which readings that stand alone say next to nothing; 0 of all others.

    ``left`` (M,) is what an explanation leaves under the ``whitener``'s covariance, ``row`` (M,) which row a reading is
    of. The furthest is set aside and the others are asked again what they make of each other, until none is far off. If
    that takes :data:`LEAST_ROWS` rows, they are no outliers, and none is widened.

    >>> left, row = np.array([0.3, -1.0, 80.0, 0.5]), np.arange(4)
    >>> lone_variance(Whitener.of(np.eye(4)), left, row).tolist()
    [0.0, 0.0, 6400.0, 0.0]
    """
    pulled, told = whitener.solve(left), whitener.diagonal()
    aside: list[int] = []
    off = np.empty(0)
    while True:
        unit = np.zeros((left.size, len(aside)))
        unit[aside, np.arange(len(aside))] = 1.0
        own = whitener.solve(unit)
        spread = np.linalg.solve(own[aside], own.T)
        off = spread @ left
        remains = np.maximum(told - np.sum(own * spread.T, axis=1), np.finfo(float).tiny)
        far = np.abs(pulled - own @ off) / np.sqrt(remains)
        far[aside] = 0.0
        furthest = int(np.argmax(far))
        if far[furthest] <= FAR:
            break
        aside.append(furthest)
        if np.unique(row[aside]).size >= LEAST_ROWS:
            return np.zeros(left.size)
    found = np.zeros(left.size)
    found[aside] = off**2
    return found
