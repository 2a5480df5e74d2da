"""Foreign effects of the analyzer: the converter is as modelled, and is read wrongly."""

from dataclasses import dataclass

import numpy as np

from drivers.mocks.lab.foreign.base import LINK_1, LINK_2, POWER, AcReading, Array, ForeignEffect

_ROOM_S = 3000.0  # an air conditioner's period


@dataclass(frozen=True, slots=True, kw_only=True)
class AcPhaseError(ForeignEffect):
    """Voltage and current of the ac elements are shifted against each other: reactive power shows as active."""

    name = "ac_phase_error"
    unit = "rad"
    where = "analyzer elements 3 and 4"
    says = "the ac elements' current probes have a phase error at the switching frequency"
    drawn = (0.01, 0.04)
    touches = frozenset({LINK_1, LINK_2})

    def ac_watts(self, reading: AcReading) -> Array:
        """Active power turned by the error; the two elements' reactive powers have opposite signs."""
        if self.size == 0.0:
            return reading.watts
        apparent = np.abs(reading.volts * reading.amps)
        reactive = np.sqrt(np.maximum(apparent**2 - reading.watts**2, 0.0))
        sign = 1.0 if reading.element == 3 else -1.0
        return np.asarray(reading.watts * np.cos(self.size) + sign * reactive * np.sin(self.size))


@dataclass(frozen=True, slots=True, kw_only=True)
class GainWander(ForeignEffect):
    """The gain of port 1 follows the room's air conditioner up and down."""

    name = "gain_wander"
    unit = "1"
    where = "analyzer element 1"
    says = "the analyzer's input gain wanders with the room's air conditioner"
    drawn = (1.5e-3, 5e-3)
    touches = frozenset({POWER})

    def input_gain(self, time_s: Array | float) -> Array | float:
        """A sine of fifty minutes."""
        return np.asarray(self.size * np.sin(2 * np.pi * np.asarray(time_s) / _ROOM_S))
