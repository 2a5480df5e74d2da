r"""Integrals of a decay e^(-x s) over s in [0, 1], right to the last digits down to x = 0.

Closed forms subtract nearly equal terms where resistance is small against inductance, so below ``_SMALL`` their Taylor
series take over.
"""

from collections.abc import Callable
from math import factorial

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_SMALL = 0.1
_TINY = 1e-300  # stands for x = 0
_TERMS = 8  # the first term left out is below 1e-14 of the sum


def _series(coefficients: list[float], x: Array) -> Array:
    total = np.full_like(x, coefficients[-1])
    for c in reversed(coefficients[:-1]):
        total *= x
        total += c
    return total


_MOMENT = [(-1.0) ** k / factorial(k + 2) for k in range(_TERMS)]
_RAMP = [(-1.0) ** k / factorial(k + 1) / (k + 3) for k in range(_TERMS)]
_SQUARE = [(-1.0) ** k * (2.0 ** (k + 2) - 2) / factorial(k + 2) / (k + 3) for k in range(_TERMS + 5)]


def _joined(coefficients: list[float], x: Array, closed: Callable[[Array], Array]) -> Array:
    """The power series near zero, where the closed form loses its digits, and that form elsewhere."""
    small = np.abs(x) < _SMALL
    if np.all(small):
        return _series(coefficients, x)
    away = closed(np.where(small, 1.0, x))
    return np.where(small, _series(coefficients, np.where(small, x, 0.0)), away)


def decay_integral(x: Array) -> Array:
    """(1 - e^-x) / x.

    >>> decay_integral(np.array([0.0, 1e-9, 1.0])).round(6).tolist()
    [1.0, 1.0, 0.632121]
    """
    safe = np.maximum(x, _TINY)
    return np.asarray(-np.expm1(-safe) / safe)


def decay_moment(x: Array) -> Array:
    """(1 - (1 - e^-x) / x) / x, the integral of (1 - e^(-x s)) / x.

    >>> decay_moment(np.array([0.0, 1e-9, 1.0])).round(6).tolist()
    [0.5, 0.5, 0.367879]
    """
    return _joined(_MOMENT, x, lambda x: (1.0 - decay_integral(x)) / x)


def decay_ramp(x: Array) -> Array:
    """Integral of s (1 - e^(-x s)) / x.

    >>> decay_ramp(np.array([0.0, 1e-9, 1.0])).round(6).tolist()
    [0.333333, 0.333333, 0.235759]
    """
    return _joined(_RAMP, x, lambda x: (0.5 - (decay_integral(x) - np.exp(-x)) / x) / x)


def decay_square(x: Array) -> Array:
    """Integral of ((1 - e^(-x s)) / x)^2.

    >>> decay_square(np.array([0.0, 1e-9, 1.0])).round(6).tolist()
    [0.333333, 0.333333, 0.168091]
    """
    return _joined(_SQUARE, x, lambda x: (decay_moment(x) - 0.5 * decay_integral(x) ** 2) / x)
