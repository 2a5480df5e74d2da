r"""The lossless closed form of a dual-active bridge, for any modulation at once.

Without resistance the link current is driven by four square waves (:mod:`sim.modulation`), so power is
bilinear in them. For one pair of square waves of +-V1 and +-n V2 whose edges are x half periods apart,
single phase shift gives :math:`P = n V_1 V_2 / (2 f_s L_k) \; g(x)` with :math:`g(x) = x (1 - |x|)` on
[-1, 1], periodic in 2 (De Doncker, Divan and Kheraluwala, 1991, eq. 10, in these units). Hence

.. math:: P = \frac{n V_1 V_2}{2 f_s L_k} \; \frac14 \sum_{a \in p} \sum_{b \in s} g(e_b - e_a)

and its derivative to D0 replaces g by :math:`g'(x) = 1 - 2|x|`.
"""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def _wrap(x: Array) -> Array:
    return x - 2.0 * np.floor(0.5 * x + 0.5)


def power_share(edges: Array) -> tuple[Array, Array]:
    """Power over n V1 V2 / (2 fs Lk), and its derivative to D0; ``edges`` of shape (4, N).

    >>> share, slope = power_share(np.array([[0.0], [0.0], [0.25], [0.25]]))
    >>> share.item(), slope.item()
    (0.1875, 0.5)
    """
    x = _wrap(edges[2:, None] - edges[None, :2])
    return np.mean(x * (1 - np.abs(x)), axis=(0, 1)), np.mean(1 - 2 * np.abs(x), axis=(0, 1))


def phase_for_share(share: Array, edges: Array, way: Array | float = 1.0) -> Array:
    """Smallest size in [0, 1/2] of the phase at which the lossless power reaches ``share``; 1/2 where it cannot.

    ``edges`` are those of phase 0, shape (4, N); the result has shape (N,). ``way`` is -1 where both phase and power
    are counted backwards. Bisection on a curve that does not fall on [0, 1/2].
    """
    low, high = np.zeros_like(share), np.full_like(share, 0.5)
    shift = np.array([0.0, 0.0, 1.0, 1.0])[:, None]
    for _ in range(45):
        middle = 0.5 * (low + high)
        below = way * power_share(edges + shift * (way * middle))[0] < share
        low, high = np.where(below, middle, low), np.where(below, high, middle)
    return high
