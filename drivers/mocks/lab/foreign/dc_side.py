"""Foreign effects at the two dc ports: capacitors, leakage, a bleeder, ripple of the supply."""

from dataclasses import dataclass, replace

import numpy as np

from drivers.mocks.lab.foreign.base import (
    D0,
    HEATSINK,
    INDUCTOR,
    LINK_1,
    LINK_2,
    POWER,
    RMS,
    Added,
    Array,
    ForeignEffect,
    Moment,
    along_a_sine,
)
from drivers.mocks.lab.waveforms import Demand

_DRIES_K, _COLD_C = 9.0, 25.0  # a damp board's leakage falls by e in so many kelvin
_NOMINAL_V = 300.0


@dataclass(frozen=True, slots=True, kw_only=True)
class DcLinkEsr(ForeignEffect):
    """Series resistance of the dc-link capacitors, which carry the ripple that the supply does not."""

    name = "dc_link_esr"
    unit = "Ohm"
    where = "before P_link1, in the dc link's capacitors"
    says = "the dc link's capacitors have a high series resistance, and carry the switching ripple"
    drawn = (0.15, 0.6)
    touches = frozenset({POWER})

    def added(self, moment: Moment) -> Added:
        """Mean square of the bridge's input current, less its mean squared."""
        pieces = moment.orbit.pieces
        through_A = moment.mean(pieces.vp_V * pieces.charge()) / moment.circuit.V1_V
        square_A2 = moment.mean(np.where(moment.live, pieces.square(), 0.0))
        return Added(input=self.size * np.maximum(square_A2 - through_A**2, 0.0))


@dataclass(frozen=True, slots=True, kw_only=True)
class OutputCapacitorEsr(ForeignEffect):
    """Series resistance of the output capacitors, which carry the ripple that the load does not."""

    name = "output_capacitor_esr"
    unit = "Ohm"
    where = "behind P_link2, in the output's capacitors"
    says = "the output's capacitors have a high series resistance, and carry the switching ripple"
    drawn = (0.04, 0.15)
    touches = frozenset({POWER, D0, LINK_1, LINK_2, RMS})

    def added(self, moment: Moment) -> Added:
        """As at the input, with the secondary's current."""
        pieces, n = moment.orbit.pieces, moment.circuit.turns_ratio
        live = np.abs(pieces.nvs_V) > 0.5 * moment.circuit.nV2_V
        through_A = n * moment.mean(pieces.nvs_V * pieces.charge()) / moment.circuit.nV2_V
        square_A2 = n**2 * moment.mean(np.where(live, pieces.square(), 0.0))
        return Added(output=self.size * np.maximum(square_A2 - through_A**2, 0.0))


@dataclass(frozen=True, slots=True, kw_only=True)
class LoadLeakage(ForeignEffect):
    """A bleeder over the output, between the converter and the analyzer."""

    name = "load_leakage"
    unit = "W"
    where = "behind P_link2, over the output"
    says = "something over the output draws constant power before the analyzer: a bleeder, a fan"
    drawn = (3.0, 12.0)
    touches = frozenset({POWER, D0, LINK_1, LINK_2, RMS})

    def added(self, moment: Moment) -> Added:
        """Constant while the output is up."""
        return Added(output=self.size + 0.0 * moment.demand.power_W)


@dataclass(frozen=True, slots=True, kw_only=True)
class BoardLeakage(ForeignEffect):
    """A damp circuit board leaks over the dc link until the heatsink has dried it."""

    name = "board_leakage"
    unit = "W"
    where = "before P_link1, over the dc link"
    says = "a damp or dirty circuit board leaks over the dc link while it is cold"
    drawn = (4.0, 15.0)
    touches = frozenset({POWER})

    def drawn_W(self, V1_V: Array, heatsink_C: Array, time_s: Array | float) -> Array | float:
        """Ohmic, and falling with temperature."""
        return self.size * (V1_V / _NOMINAL_V) ** 2 * np.exp(-(heatsink_C - _COLD_C) / _DRIES_K)


@dataclass(frozen=True, slots=True, kw_only=True)
class SupplyRipple(ForeignEffect):
    """The supply's voltage has a ripple of mains frequency; the analyzer shows its mean."""

    name = "supply_ripple"
    unit = "1"
    where = "the dc supply"
    says = "the supply's voltage has a large ripple of mains frequency"
    drawn = (0.05, 0.12)
    touches = frozenset({POWER, D0, RMS, LINK_1, LINK_2, HEATSINK, INDUCTOR})

    def excursions(self, demand: Demand) -> tuple[Demand, ...]:
        """Three voltages along the ripple."""
        if self.size == 0.0:
            return (demand,)
        return tuple(replace(demand, V1_V=demand.V1_V * (1 + off)) for off in along_a_sine(self.size))
