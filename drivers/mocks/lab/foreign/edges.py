"""Foreign losses at the switching edges: snubbers, ringing, the gate loop."""

from dataclasses import dataclass

import numpy as np

from drivers.mocks.lab.foreign.base import (
    D0,
    HEATSINK,
    LINK_1,
    LINK_2,
    POWER,
    RMS,
    TRANSFORMER,
    Added,
    Array,
    ForeignEffect,
    Moment,
)

_SNUBBER_S = 30e-9  # time constant of a snubber
_RING_HZ, _RING_S = 0.4e6, 4e-6  # a winding's ringing after an edge, and how long it lasts
_LEAST_A = 0.05


@dataclass(frozen=True, slots=True, kw_only=True)
class SnubberLoss(ForeignEffect):
    """RC snubbers over the outer switches; a slow swing loses less than a hard one.

    A capacitance C behind a resistance, driven by a ramp of length t, loses ``C V^2 x (1 - x (1 - exp(-1/x)))``
    with x = R C / t, and half of C V^2 when switched at once.
    """

    name = "snubber_loss"
    unit = "F"
    where = "before P_link1, on the circuit board"
    says = "RC snubbers over the outer switches, which nobody entered"
    drawn = (1.5e-9, 6e-9)
    touches = frozenset({POWER})

    def added(self, moment: Moment) -> Added:
        """Both edges of both legs, two snubbers an edge."""
        circuit, edges = moment.circuit, moment.orbit.commutation
        current = np.maximum(edges.turn_off_A[:2], _LEAST_A)
        swing_s = np.clip(circuit.charge_C[:2] / current, 5e-9, circuit.dead_time_s)
        x = _SNUBBER_S / swing_s
        soft = x * (1 - x * -np.expm1(-1 / x))
        share = soft * (1 - edges.missing[:2]) ** 2 + 0.5 * edges.missing[:2] ** 2
        joule = self.size * (0.5 * circuit.V1_V) ** 2 * np.sum(share, axis=0)
        return Added(input=8 * moment.converter.frequency_Hz * joule)


@dataclass(frozen=True, slots=True, kw_only=True)
class EdgeRinging(ForeignEffect):
    """The transformer's winding capacitance rings after both edges of the secondary, and the two interfere."""

    name = "edge_ringing"
    unit = "F"
    where = "between P_link1 and P_link2, in the transformer"
    says = "the transformer's winding capacitance rings after each edge of the secondary"
    drawn = (0.6e-9, 2.5e-9)
    touches = frozenset({POWER, LINK_1, TRANSFORMER})

    def added(self, moment: Moment) -> Added:
        """Energy of the two steps, with the second on the first one's ringing."""
        apart_s = moment.demand.D2 * moment.converter.half_period_s
        together = 1 + np.cos(2 * np.pi * _RING_HZ * apart_s) * np.exp(-apart_s / _RING_S)
        joule = self.size * moment.circuit.nV2_V**2 * together
        return Added(transformer=moment.converter.frequency_Hz * joule)


@dataclass(frozen=True, slots=True, kw_only=True)
class GateLoopTurnOff(ForeignEffect):
    """Common-source inductance of the secondary's gate loop: what is switched off grows with its third power."""

    name = "gate_loop"
    unit = "J/A3"
    where = "behind P_link2, in the secondary switches"
    says = (
        "source inductance in the secondary's gate loop slows turn-off down, the more the higher the current"
    )
    drawn = (8e-9, 4e-8)
    touches = frozenset({POWER, D0, LINK_1, LINK_2, HEATSINK, RMS})

    def added(self, moment: Moment) -> Added:
        """Every secondary edge, twice a period and leg."""
        off_A: Array = moment.orbit.commutation.turn_off_A[2:]
        return Added(secondary=2 * moment.converter.frequency_Hz * self.size * np.sum(off_A**3, axis=0))
