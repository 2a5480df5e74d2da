r"""The harmonic method: square waves cut off after a few harmonics, the other knowledge-based way of the literature.

A square wave of +-1 that rises at 0 drives the link current along the triangle :math:`|x| - 1/2`, and two of them, x
half periods apart, exchange the power share :math:`x (1 - |x|)`, both periodic in 2. Their Fourier series over odd k

.. math::
    |x| - \tfrac12 = -\frac{4}{\pi^2} \sum_k \frac{\cos k \pi x}{k^2}, \qquad
    x (1 - |x|) = \frac{8}{\pi^3} \sum_k \frac{\sin k \pi x}{k^3}

are cut off after ``harmonics`` terms. What is left out is smooth corners of the current, and with them the currents at
the edges.
"""

import numpy as np
from numpy.typing import NDArray

from sim.parameters import ParameterError

Array = NDArray[np.float64]


def odd_orders(harmonics: int) -> NDArray[np.int_]:
    """The first so many odd orders.

    >>> odd_orders(3).tolist()
    [1, 3, 5]
    """
    if harmonics < 1:
        raise ParameterError(f"harmonics is {harmonics}; allowed: at least 1")
    return 2 * np.arange(harmonics) + 1


def triangle(x: Array, harmonics: int) -> Array:
    """Current shape of a square wave that rises at 0, over positions in half periods.

    >>> triangle(np.array([0.0, 0.25, 1.0]), 200).round(2).tolist()
    [-0.5, -0.25, 0.5]
    """
    terms = (np.cos(k * np.pi * x) / k**2 for k in odd_orders(harmonics).tolist())
    return np.asarray(-4.0 / np.pi**2 * sum(terms))


def share_of_pair(x: Array, harmonics: int) -> Array:
    """Power share of two square waves x half periods apart.

    >>> share_of_pair(np.array([0.25]), 50).round(4).tolist()
    [0.1875]
    """
    terms = (np.sin(k * np.pi * x) / k**3 for k in odd_orders(harmonics).tolist())
    return np.asarray(8.0 / np.pi**3 * sum(terms))
