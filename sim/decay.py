r"""Integrals of a decay e^(-x s) over s in [0, 1], right to the last digits down to x = 0.

They are made of the first three of the functions of exponential integrators (Cox and Matthews, 2002)

.. math:: \varphi_k(x) = \int_0^1 e^{-x s} \frac{(1 - s)^{k-1}}{(k-1)!} ds, \qquad
          \varphi_k = \frac{1}{k!} - x \, \varphi_{k+1}

Where x is small, resistance small against inductance, the way down from the third's Taylor series subtracts nothing
that is nearly equal; from ``_SMALL`` on the way up from the first's closed form does not either.
"""

from dataclasses import dataclass
from math import factorial
from typing import Self

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_SMALL = 0.1
_TINY = 1e-300  # stands for x = 0
_TERMS = [(-1.0) ** k / factorial(k + 3) for k in range(8)]  # the first left out is below 1e-15 of the sum


def decay_integral(x: Array) -> Array:
    """(1 - e^-x) / x.

    >>> decay_integral(np.array([0.0, 1e-9, 1.0])).round(6).tolist()
    [1.0, 1.0, 0.632121]
    """
    safe = np.maximum(x, _TINY)
    return np.asarray(-np.expm1(-safe) / safe)


@dataclass(frozen=True, slots=True, kw_only=True)
class Decay:
    """Integrals for one x: ``first``, ``second`` and ``third`` are the functions above.

    >>> decay = Decay.of(np.array([0.0, 1e-9, 1.0]))
    >>> decay.first.round(6).tolist(), decay.second.round(6).tolist()
    ([1.0, 1.0, 0.632121], [0.5, 0.5, 0.367879])
    """

    x: Array
    first: Array
    second: Array
    third: Array

    @classmethod
    def of(cls, x: Array) -> Self:
        """From x >= 0 of any shape."""
        third = np.full_like(x, _TERMS[-1])
        for c in reversed(_TERMS[:-1]):
            third *= x
            third += c
        second = 0.5 - x * third
        first = 1.0 - x * second
        large = np.flatnonzero(x >= _SMALL)
        if large.size:
            y = x.flat[large]
            first.flat[large] = one = decay_integral(y)
            second.flat[large] = two = (1.0 - one) / y
            third.flat[large] = (0.5 - two) / y
        return cls(x=x, first=first, second=second, third=third)

    def twice(self) -> Array:
        """(1 - e^-2x) / 2x, the integral of e^(-2 x s).

        >>> Decay.of(np.array([0.0, 1e-9, 1.0])).twice().round(6).tolist()
        [1.0, 1.0, 0.432332]
        """
        return np.asarray(self.first * (1.0 - 0.5 * self.x * self.first))

    def ramp(self) -> Array:
        """Integral of s (1 - e^(-x s)) / x.

        >>> Decay.of(np.array([0.0, 1e-9, 1.0])).ramp().round(6).tolist()
        [0.333333, 0.333333, 0.235759]
        """
        return self.second - self.third

    def square(self) -> Array:
        """Integral of ((1 - e^(-x s)) / x)^2.

        >>> Decay.of(np.array([0.0, 1e-9, 1.0])).square().round(6).tolist()
        [0.333333, 0.333333, 0.168091]
        """
        return np.asarray(self.second - self.third - 0.5 * self.x * self.second**2)
