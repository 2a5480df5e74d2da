r"""Harmonics of the voltage across the ac link's inductance: what its windings' eddy currents follow.

With lossless square waves (:mod:`sim.modulation`), each of amplitude a\ :sub:`i` and rising at e\ :sub:`i`, eddy
currents whose resistance rises with the square of frequency lose :math:`\sum |v_k|^2` over odd harmonics k of

.. math:: v_k \propto \frac1k \sum_i a_i e^{-j\pi k e_i}, \quad
          a = \Bigl(\frac{V_1}{2}, \frac{V_1}{2}, -\frac{n V_2}{2}, -\frac{n V_2}{2}\Bigr) .

Where resistance flattens about harmonic c, each counts for :math:`(1 + 1/c^2) / (1 + (k/c)^2)` of that: eddy currents
that their own field keeps out of the copper, a first-order low pass. Both sums have a closed form, with d the distance
of two edges in half periods:

.. math:: \sum_k \frac{\cos \pi k d}{k^2} = \frac{\pi^2}{8} (1 - 2 d), \quad \sum_k \frac{\cos \pi k d}{k^2 + c^2} =
          \frac{\pi}{4 c} \frac{\sinh \pi c (\tfrac12 - d)}{\cosh \pi c / 2} .
"""

import numpy as np
from numpy.typing import NDArray

from sim.checks import Quantity
from sim.modulation import hybrid_edges
from sim.operating_points import Points
from sim.parameters import Converter

Array = NDArray[np.float64]


def share_left(edges: Array, V1_V: Array, nV2_V: Array, corner: Quantity) -> Array:
    """Of what eddy currents lose, the share (N,) that is left where their resistance flattens about a harmonic.

    ``edges`` (4, N) are in half periods. It counts against a resistance that rises with the square of frequency and is
    the same at the switching frequency; where nothing drives a current it is of no account, and finite.
    """
    amplitude = np.stack(np.broadcast_arrays(V1_V, V1_V, -nV2_V, -nV2_V, edges[0])[:4])
    apart = np.abs((edges[:, None] - edges[None] + 1.0) % 2.0 - 1.0)
    square = 0.5 * np.pi * (1.0 - 2.0 * apart)
    # sinh over cosh, without overflow
    far, near = np.exp(-np.pi * corner * apart), np.exp(-np.pi * corner * (1.0 - apart))
    missing = (far - near) / (corner * (1.0 + np.exp(-np.pi * corner)))
    products = amplitude[:, None] * amplitude[None]
    whole, lost = np.sum(products * square, axis=(0, 1)), np.sum(products * missing, axis=(0, 1))
    left = 1.0 - np.divide(lost, whole, out=np.zeros_like(whole), where=whole != 0.0)
    return np.asarray((1.0 + 1.0 / np.square(corner)) * left)


def eddy_share(converter: Converter, points: Points, D0: Array) -> Array:
    """The same of a converter's inductor, at points with voltages and the phase that they run at; NaN where that is.

    >>> from sim.prototype import prototype
    >>> points = Points(D1=np.array([1.0, 0.6]), D2=np.array([0.0, 0.4]), power_W=1000.0)
    >>> points = points.with_voltages_of(prototype())
    >>> eddy_share(prototype(), points, np.array([0.1, 0.1])).round(3).tolist()
    [0.795, 0.969]
    """
    edges = hybrid_edges(D0, np.asarray(points.D1), np.asarray(points.D2))
    nV2_V = converter.transformer.turns_ratio * np.asarray(points.V2_V)
    return share_left(edges, np.asarray(points.V1_V), nV2_V, converter.inductor.winding.flattens_at_harmonic)
