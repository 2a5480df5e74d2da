"""Modulation: from D0, D1, D2 to the four switching edges of a dual-active bridge.

Conventions, in one place. T = 1/fs, half period Th = T/2; D0, D1, D2 and every position are in units of
Th; t = 0 is the rising edge of S1, the start of vp's positive pulse. A bridge's voltage is the mean of two
square waves of +-V that flip once each half period, so a modulation is four *edges*: the positions where
each square wave rises::

    vp = V1 (p1 + p2) / 2     p1 rises at 0        p2 rises at D1 - 1
    vs = V2 (s1 + s2) / 2     s1 rises at D0       s2 rises at D0 + D2

vp is +V1 on [0, D1), 0 on [D1, 1) and the negative of that in the next half period; vs is +V2 on
[D0 + D2, D0 + 1), of width 1 - D2. The phase between the pulses' centres is
phi = D0 + (1 + D2 - D1)/2; transferred power rises on phi in [-1/2, 1/2], through 0 near phi = 0.

Five modulations make these waves. The *hybrid* one clamps both primary legs at the link's middle O in the zero state
(needs three levels). The others switch each leg between the rails only and shift the legs of a bridge against each
other; they differ in what is free (Zhao, Song, Liu and Sun, Overview of Dual-Active-Bridge Isolated Bidirectional
DC-DC Converter for High-Frequency-Link Power-Conversion System, 2014): SPS has no zero states, EPS one in one bridge,
DPS the same in both, TPS any.
"""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
EDGES = ("primary_rise", "primary_fall", "secondary_lead", "secondary_lag")
CLAMPED = ("hybrid",)  # zero state of the primary at the middle of the link
SHIFTED = ("tps", "eps", "dps", "sps")  # zero state by two legs at the same rail
_EQUAL = 1e-9  # of D1 and D2 that ought to be equal


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


def outside_modulation(modulation: str, D1: Array, D2: Array) -> NDArray[np.str_]:
    """Why a modulation does not have this pair of duty ratios, "" where it has, shape (N,).

    >>> outside_modulation("dps", np.array([0.8, 0.8]), np.array([0.2, 0.1])).tolist()
    ['', 'dps has one inner shift: D2 must be 1 - D1']
    """
    full_1, full_2 = np.abs(D1 - 1.0) <= _EQUAL, np.abs(D2) <= _EQUAL
    rules = {
        "sps": (full_1 & full_2, "sps has no zero states: D1 must be 1 and D2 0"),
        "dps": (np.abs(1.0 - D1 - D2) <= _EQUAL, "dps has one inner shift: D2 must be 1 - D1"),
        "eps": (full_1 | full_2, "eps has a zero state in one bridge only: D1 must be 1 or D2 0"),
    }
    allowed, reason = rules.get(modulation, (np.ones(np.shape(D1), dtype=bool), ""))
    return np.where(allowed, "", reason)


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
