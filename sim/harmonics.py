r"""Harmonics of the voltage across the ac link's inductance: what its windings' eddy currents follow.

With lossless square waves (:mod:`sim.modulation`) harmonic k, odd, of the voltage is

.. math:: v_k \propto \frac{1}{k} \Bigl[ \frac{V_1}{2} \bigl(e^{-j\pi k p_1} + e^{-j\pi k p_2}\bigr)
          - \frac{n V_2}{2} \bigl(e^{-j\pi k s_1} + e^{-j\pi k s_2}\bigr) \Bigr]

and what a resistance that rises with the square of frequency loses is proportional to :math:`\sum_k |v_k|^2`.
"""

import numpy as np
from numpy.typing import NDArray

from sim.modulation import hybrid_edges
from sim.operating_points import Points
from sim.parameters import Converter

Array = NDArray[np.float64]

_HARMONICS = np.arange(1, 200, 2)  # beyond lies 0.2 % of a square wave's mean square


def eddy_share(converter: Converter, points: Points, D0: Array, corner: float) -> Array:
    """Of what eddy currents lose, the share (N,) that is left where their resistance flattens about a harmonic.

    Harmonic k then counts for 1 / (1 + (k/corner)^2) of what it does while resistance rises with the square of
    frequency: eddy currents that their own field keeps out of the copper. NaN where D0 is.

    >>> from sim.prototype import prototype
    >>> points = Points(D1=np.array([1.0, 0.6]), D2=np.array([0.0, 0.4]), power_W=1000.0)
    >>> points = points.with_voltages_of(prototype())
    >>> eddy_share(prototype(), points, np.array([0.1, 0.1]), 15.0).round(3).tolist()
    [0.8, 0.966]
    """
    edges = hybrid_edges(D0, np.asarray(points.D1), np.asarray(points.D2))
    turns = np.exp(-1j * np.pi * _HARMONICS[:, None, None] * edges)
    primary, secondary = turns[:, :2].sum(axis=1), turns[:, 2:].sum(axis=1)
    voltage = points.V1_V * primary - converter.transformer.turns_ratio * points.V2_V * secondary
    square = np.abs(voltage / _HARMONICS[:, None]) ** 2
    left = 1.0 / (1.0 + (_HARMONICS / corner) ** 2)
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.asarray(left @ square / square.sum(axis=0))
