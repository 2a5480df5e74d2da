"""Foreign effects of transformer, contacts and leakage on the ac side."""

from dataclasses import dataclass, replace

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
from drivers.mocks.lab.waveforms import Demand, Heat
from sim.steady_state import Circuit

_SOFTENS_K, _CONTACT_C = 14.0, 40.0  # a contact's resistance grows by e in so many kelvin


@dataclass(frozen=True, slots=True, kw_only=True)
class ProximityLoss(ForeignEffect):
    """Copper loss of the transformer that rises with D2: windings whose currents no longer cancel."""

    name = "proximity_loss"
    unit = "1"
    where = "between P_link1 and P_link2, in the transformer's winding"
    says = "the transformer's copper loss rises with D2: its windings' fields cancel less in the zero state"
    drawn = (6.0, 20.0)
    touches = frozenset({POWER, LINK_1, TRANSFORMER})

    def added(self, moment: Moment) -> Added:
        """A share of the winding's resistance that grows with the square of D2."""
        winding = moment.converter.transformer.winding.resistance_Ohm
        return Added(transformer=self.size * moment.demand.D2**2 * winding * moment.square_A2)


@dataclass(frozen=True, slots=True, kw_only=True)
class ContactResistance(ForeignEffect):
    """A loose contact beside the heatsink in the ac link: its resistance grows steeply with temperature."""

    name = "contact_resistance"
    unit = "Ohm"
    where = "between P_link1 and P_link2, at a terminal near the heatsink"
    says = "a loose contact in the ac link, the worse the warmer the heatsink"
    drawn = (0.01, 0.04)
    touches = frozenset({POWER, LINK_1, D0, RMS})

    def _Ohm(self, heat: Heat) -> Array:
        return np.asarray(self.size * np.exp(np.minimum((heat.heatsink_C - _CONTACT_C) / _SOFTENS_K, 2.5)))

    def circuit(self, circuit: Circuit, demand: Demand, heat: Heat) -> Circuit:
        """In series with whatever conducts."""
        if self.size == 0.0:
            return circuit
        series = np.stack([np.zeros(demand.D1.size), self._Ohm(heat)])
        return replace(
            circuit,
            forward=circuit.forward + series,
            reverse=circuit.reverse + series,
            zero=circuit.zero + series,
        )

    def added(self, moment: Moment) -> Added:
        """What the contact loses."""
        return Added(link=self._Ohm(moment.heat) * moment.square_A2)


@dataclass(frozen=True, slots=True, kw_only=True)
class CoreDcBias(ForeignEffect):
    """Unequal legs leave a direct current in the transformer, in proportion to the link's: its core loses more."""

    name = "core_dc_bias"
    unit = "W/A"
    where = "between P_link1 and P_link2, in the transformer's core"
    says = "a direct current biases the transformer's core, the more the more current flows"
    drawn = (0.5, 2.0)
    touches = frozenset({POWER, LINK_1, TRANSFORMER})

    def added(self, moment: Moment) -> Added:
        """In proportion to the rms current and to the flux to the power 1.5."""
        flux = np.maximum(1 - moment.demand.D2, 0.0) ** 1.5
        return Added(transformer=self.size * np.sqrt(moment.square_A2) * flux)


@dataclass(frozen=True, slots=True, kw_only=True)
class MagnetizingSaturation(ForeignEffect):
    """The magnetizing inductance collapses at high flux: narrow zero states draw a large magnetizing current."""

    name = "magnetizing_saturation"
    unit = "1"
    where = "the transformer's magnetizing branch"
    says = "the transformer's core comes near saturation where the secondary's pulses are wide"
    drawn = (6.0, 20.0)
    touches = frozenset({POWER, D0, LINK_1, LINK_2, HEATSINK, TRANSFORMER, RMS})

    def _share(self, D2: Array) -> Array:
        """By how much the inductance is divided, at the flux of this D2."""
        return np.asarray(1 + self.size * np.maximum(1 - D2, 0.0) ** 8)

    def circuit(self, circuit: Circuit, demand: Demand, heat: Heat) -> Circuit:
        """The inductance at the flux of each point."""
        if self.size == 0.0:
            return circuit
        return replace(circuit, magnetizing_H=circuit.magnetizing_H / self._share(demand.D2))

    def added(self, moment: Moment) -> Added:
        """The primary winding carries the magnetizing current's triangle, of peak half its swing."""
        if self.size == 0.0:
            return Added()
        volt_seconds = moment.circuit.nV2_V * (1 - moment.demand.D2) * moment.circuit.half_period_s
        peak_A = 0.5 * volt_seconds / moment.circuit.magnetizing_H
        winding = moment.converter.transformer.winding.resistance_Ohm
        return Added(transformer=winding * peak_A**2 / 3)
