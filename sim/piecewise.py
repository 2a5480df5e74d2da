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

from sim.stacking import own_rows

Array = NDArray[np.float64]

_TINY = 1e-300  # stands for a length or a slope that is none


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
    are counted backwards. Between the phases at which two edges meet the power is a parabola; it does not fall on
    [0, 1/2].
    """
    apart = way * (edges[2:, None] - edges[None, :2]).reshape(4, -1)
    meet = np.minimum(np.ceil(apart) - apart, 0.5)
    phase = np.sort(np.concatenate([np.zeros_like(meet[:1]), meet, np.full_like(meet[:1], 0.5)]), axis=0)
    moved = np.stack([np.zeros_like(phase)] * 2 + [way * phase] * 2)
    power, slope = power_share(edges[:, None] + moved)
    beyond = np.clip(np.sum(way * power < share, axis=0), 1, 5)
    x, P, rise = own_rows(beyond[None] - 1, phase, way * power, slope)
    end, last = own_rows(beyond[None], phase, slope)
    missing, bend = np.maximum(share - P, 0.0), (last - rise) / np.maximum(end - x, _TINY)
    root = np.sqrt(np.maximum(rise**2 + 2.0 * bend * missing, 0.0))
    return np.asarray(np.minimum(x + 2.0 * missing / np.maximum(rise + root, _TINY), end)[0])
