"""Foreign effects of firmware and gate drive: what is applied is not what was set."""

from dataclasses import dataclass, replace

import numpy as np

from drivers.mocks.lab.foreign.base import (
    D0,
    HEATSINK,
    LINK_1,
    LINK_2,
    POWER,
    RMS,
    Added,
    ForeignEffect,
    Moment,
    along_a_sine,
)
from drivers.mocks.lab.waveforms import Demand, Heat
from sim.steady_state import Circuit

_DIODE_V = 1.3
_MOST_D1 = 0.97
_CIRCUIT = frozenset({POWER, D0, RMS, LINK_1, LINK_2})


@dataclass(frozen=True, slots=True, kw_only=True)
class DutyJitter(ForeignEffect):
    """D1 wanders about its set point, slowly against the switching period and fast against the analyzer."""

    name = "duty_jitter"
    unit = "1"
    where = "the primary's gates"
    says = "D1 jitters about its set point: interference on the timer, or a limit cycle"
    drawn = (0.03, 0.1)
    touches = _CIRCUIT

    def excursions(self, demand: Demand) -> tuple[Demand, ...]:
        """Three duty ratios along the jitter, which stops short of the least zero state that there can be."""
        if self.size == 0.0:
            return (demand,)
        most = np.maximum(demand.D1, _MOST_D1)
        steps = along_a_sine(self.size)
        return tuple(replace(demand, D1=np.clip(demand.D1 + off, 0.0, most)) for off in steps)


@dataclass(frozen=True, slots=True, kw_only=True)
class AdaptiveDeadTime(ForeignEffect):
    """Firmware lengthens the dead time at light load and shortens it at full load."""

    name = "adaptive_dead_time"
    unit = "s"
    where = "all gates"
    says = "the firmware adapts the dead time to the load, which nobody entered"
    drawn = (60e-9, 200e-9)
    touches = _CIRCUIT

    def circuit(self, circuit: Circuit, demand: Demand, heat: Heat) -> Circuit:
        """Longer by the size at no load, shorter by it at 2 kW."""
        if self.size == 0.0:
            return circuit
        longer_s = self.size * (1 - demand.power_W / 1000.0)
        return replace(circuit, dead_time_s=circuit.dead_time_s + np.clip(longer_s, -self.size, self.size))


@dataclass(frozen=True, slots=True, kw_only=True)
class BlankedRectifier(ForeignEffect):
    """The secondary's gates stay off below a current: its body diodes conduct instead of the channels."""

    name = "blanked_rectifier"
    unit = "A"
    where = "behind P_link2, in the secondary switches"
    says = "synchronous rectification is blanked at light load: the secondary's body diodes conduct"
    drawn = (2.0, 4.0)
    touches = _CIRCUIT | {HEATSINK}

    def added(self, moment: Moment) -> Added:
        """Two diode drops less the channels', over the mean current."""
        n, on = moment.circuit.turns_ratio, moment.converter.secondary.switch.on
        mean_A = n * moment.mean(np.abs(moment.orbit.pieces.charge()))
        channel_W = 2 * on.resistance_Ohm * n**2 * moment.square_A2
        blanked = np.sqrt(moment.square_A2) < self.size
        return Added(secondary=np.where(blanked, np.maximum(2 * _DIODE_V * mean_A - channel_W, 0.0), 0.0))
