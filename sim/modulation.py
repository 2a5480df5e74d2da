"""Modulation: from D0, D1, D2 to the four switching edges of a dual-active bridge.

Conventions, in one place. T = 1/fs, half period Th = T/2; D0, D1, D2 and every position are in units of
Th; t = 0 is the rising edge of S1, the start of vp's positive pulse. A bridge's voltage is the mean of two
square waves of +-V that flip once each half period, so a modulation is four *edges*: the positions where
each square wave rises::

    vp = V1 (p1 + p2) / 2     p1 rises at 0        p2 rises at D1 - 1
    vs = V2 (s1 + s2) / 2     s1 rises at D0       s2 rises at D0 + D2

vp is +V1 on [0, D1), 0 on [D1, 1) and the negative of that in the next half period; vs is +V2 on
[D0 + D2, D0 + 1), of width 1 - D2. The phase between the pulses' centres is
phi = D0 + (1 + D2 - D1)/2; transferred power rises on phi in [0, 1/2].
"""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
EDGES = ("primary_rise", "primary_fall", "secondary_lead", "secondary_lag")


def hybrid_edges(D0: Array, D1: Array, D2: Array) -> Array:
    """Rising positions of p1, p2, s1, s2 in units of Th, shape (4, N), for the hybrid modulation.

    >>> hybrid_edges(np.array([0.25]), np.array([0.8]), np.array([0.1]))[:, 0].round(3).tolist()
    [0.0, -0.2, 0.25, 0.35]
    """
    D0, D1, D2 = np.broadcast_arrays(np.asarray(D0, dtype=float), D1, D2)
    return np.stack([np.zeros_like(D0), D1 - 1.0, D0, D0 + D2])


def centre_offset(D1: Array, D2: Array) -> Array:
    """phi - D0 = (1 + D2 - D1) / 2, the phase between the pulses' centres when D0 is 0.

    >>> centre_offset(np.array([1.0, 0.6]), np.array([0.0, 0.2])).tolist()
    [0.0, 0.3]
    """
    return (1.0 + D2 - D1) / 2.0


def paper_D0(D0: Array, D1: Array) -> Array:
    """D0 as the paper counts it, from S2's rising edge: D0 + 1 - D1 (Assumption: S2 complements S4).

    >>> paper_D0(np.array([-0.2]), np.array([0.75])).round(3).tolist()
    [0.05]
    """
    return D0 + 1.0 - D1


def infeasible_pulse(D1: Array, D2: Array, dead_time: Array | float) -> NDArray[np.str_]:
    """Why a pulse or zero state cannot be made, "" where it can, shape (N,); ``dead_time`` in units of Th.

    >>> infeasible_pulse(np.array([0.99, 1.0]), np.array([0.3, 0.3]), 0.016).tolist()
    ['primary zero state shorter than the dead time', '']
    """
    zero1, pulse2 = 1.0 - D1, 1.0 - D2
    rules = [
        ((D1 < 0) | (D1 > 1), "D1 outside [0, 1]"),
        ((D2 < 0) | (D2 > 1), "D2 outside [0, 1]"),
        (dead_time > D1, "primary pulse shorter than the dead time"),
        ((zero1 > 0) & (zero1 < dead_time), "primary zero state shorter than the dead time"),
        (pulse2 < dead_time, "secondary pulse shorter than the dead time"),
        ((D2 > 0) & (dead_time > D2), "secondary zero state shorter than the dead time"),
    ]
    return np.select([rule for rule, _ in rules], [reason for _, reason in rules], default="")
