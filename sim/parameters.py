"""The parameter objects of a converter: what a careful engineer enters from datasheets.

Every number is a float, or an array that broadcasts over operating points, so that many variants of a
converter can be simulated in one call. All values are SI; resistances and drops are given at 25 degC.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, fields, is_dataclass

import numpy as np

from sim.checks import HOTTEST_C, REFERENCE_C, ParameterError, Quantity, check, not_negative, positive
from sim.modulation import CLAMPED, SHIFTED
from sim.wound_parts import Core, Inductor, Transformer, Winding

__all__ = [
    "REFERENCE_C", "Capacitance", "Conduction", "Converter", "Core", "Diode", "FullBridge", "Inductor", "NpcBridge",
    "ParameterError", "Quantity", "Recovery", "Switch", "SwitchingEnergy", "Transformer", "Winding", "leaves",
]  # fmt: skip

MOST_DEAD_TIME = 0.25  # of the half period
_LEAST_PER_K = -1.0 / (HOTTEST_C - REFERENCE_C)
_HOT_C = 125.0  # the hot end of datasheets' on-resistance
_LEAST_SHARE = 0.1  # of the cold resistance: a parabola far beyond where it was read leads to none


@dataclass(frozen=True, slots=True, kw_only=True)
class Conduction:
    """A drop ``threshold + resistance * i``; both parts move with junction temperature (relative, per K).

    ``resistance_per_K`` is the line from 25 to 125 degC, both of which datasheets give; ``resistance_bend_per_K2`` is
    how the resistance bends off it, ``b (T - 25) (T - 125)``, down to a tenth of the cold one at least.
    """

    threshold_V: Quantity
    resistance_Ohm: Quantity
    threshold_per_K: Quantity = 0.0
    resistance_per_K: Quantity = 0.0
    resistance_bend_per_K2: Quantity = 0.0

    def __post_init__(self) -> None:
        not_negative(self, "threshold_V", "resistance_Ohm")
        check(self, f"> {_LEAST_PER_K:.2g}, else none is left at {HOTTEST_C:.0f} degC", lambda x: x > _LEAST_PER_K,
              "threshold_per_K", "resistance_per_K")  # fmt: skip
        check(self, "a number", lambda x: x == x, "resistance_bend_per_K2")

    def at(self, junction_C: Quantity) -> tuple[Quantity, Quantity]:
        """Threshold in V and resistance in Ohm at a junction temperature.

        >>> threshold_V, resistance_Ohm = Conduction(
        ...     threshold_V=0.8, resistance_Ohm=0.027, threshold_per_K=-0.001, resistance_per_K=0.0036
        ... ).at(125.0)
        >>> round(threshold_V, 3), round(float(resistance_Ohm), 5)
        (0.72, 0.03672)
        """
        rise = junction_C - REFERENCE_C
        bent = self.resistance_bend_per_K2 * (junction_C - _HOT_C)
        return (
            self.threshold_V * (1 + self.threshold_per_K * rise),
            self.resistance_Ohm * np.maximum(1 + (self.resistance_per_K + bent) * rise, _LEAST_SHARE),
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class SwitchingEnergy:
    """Energy of one transition, ``E (i/I)^a (v/V)^b (1 + k (T - 25))``, from one datasheet point."""

    energy_J: Quantity
    reference_V: Quantity
    reference_A: Quantity
    current_exponent: Quantity
    voltage_exponent: Quantity
    energy_per_K: Quantity = 0.0

    def __post_init__(self) -> None:
        not_negative(self, "energy_J")
        positive(self, "reference_V", "reference_A", "current_exponent", "voltage_exponent")

    def at(self, *, current_A: Quantity, voltage_V: Quantity, junction_C: Quantity) -> Quantity:
        """Energy in J; zero for a current that is not positive.

        >>> energy = SwitchingEnergy(energy_J=75e-6, reference_V=400.0, reference_A=40.0,
        ...                          current_exponent=1.2, voltage_exponent=1.3)
        >>> f"{energy.at(current_A=10.0, voltage_V=140.0, junction_C=25.0) * 1e6:.2f} uJ"
        '3.63 uJ'
        """
        share = np.maximum(current_A, 0.0) / self.reference_A
        return (
            self.energy_J
            * share**self.current_exponent
            * (voltage_V / self.reference_V) ** self.voltage_exponent
            * (1 + self.energy_per_K * (junction_C - REFERENCE_C))
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class Recovery:
    """Reverse-recovery charge, ``Q sqrt(i/I) (1 + k (T - 25))``. Assumption: it grows with sqrt(i)."""

    charge_C: Quantity
    reference_A: Quantity
    charge_per_K: Quantity = 0.0

    def __post_init__(self) -> None:
        not_negative(self, "charge_C")
        positive(self, "reference_A")

    def at(self, *, current_A: Quantity, junction_C: Quantity) -> Quantity:
        """Charge in C; zero for a current that is not positive.

        >>> hot = Recovery(charge_C=75e-9, reference_A=30.0, charge_per_K=0.03)
        >>> f"{hot.at(current_A=30.0, junction_C=125.0) * 1e9:.0f} nC"
        '300 nC'
        """
        share = np.sqrt(np.maximum(current_A, 0.0) / self.reference_A)
        return self.charge_C * share * np.maximum(1 + self.charge_per_K * (junction_C - REFERENCE_C), 0.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class Capacitance:
    """A junction's capacitance ``C(v) = zero_bias / (1 + v/junction)^grading``, its charge and its energy."""

    zero_bias_F: Quantity
    junction_V: float
    grading: float

    def __post_init__(self) -> None:
        positive(self, "zero_bias_F", "junction_V")
        check(self, "in (0, 1)", lambda x: (x > 0) & (x < 1), "grading")

    def charge_C(self, voltage_V: Quantity) -> Quantity:
        """Charge from 0 to ``voltage_V`` (>= 0), in C.

        >>> round(Capacitance(zero_bias_F=4.24e-9, junction_V=1.0, grading=0.55).charge_C(140.0) * 1e9, 1)
        77.9
        """
        v, m = self.junction_V, 1 - self.grading
        return self.zero_bias_F * v / m * ((1 + voltage_V / v) ** m - 1)

    def energy_J(self, voltage_V: Quantity) -> Quantity:
        """Energy stored at ``voltage_V`` (>= 0), in J.

        >>> round(Capacitance(zero_bias_F=4.24e-9, junction_V=1.0, grading=0.55).energy_J(140.0) * 1e6, 2)
        3.74
        """
        v, m = self.junction_V, 1 - self.grading
        y = 1 + voltage_V / v
        return self.zero_bias_F * v**2 * ((y ** (m + 1) - 1) / (m + 1) - (y**m - 1) / m)


@dataclass(frozen=True, slots=True, kw_only=True)
class Switch:
    """A controlled switch with what conducts in reverse.

    ``synchronous`` switches carry reverse current in the channel while their gate is on; the others in
    their antiparallel diode. ``thermal_K_per_W`` is from junction to heatsink; ``tolerances`` are the everyday
    spreads of its values (relative, one sigma) by ``section.name``.
    """

    part: str
    synchronous: bool
    on: Conduction
    reverse: Conduction
    turn_off: SwitchingEnergy
    turn_on: SwitchingEnergy
    recovery: Recovery
    capacitance: Capacitance
    thermal_K_per_W: Quantity
    tolerances: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        positive(self, "thermal_K_per_W")

    @property
    def backward(self) -> Conduction:
        """What carries reverse current while the gate is on."""
        return self.on if self.synchronous else self.reverse


@dataclass(frozen=True, slots=True, kw_only=True)
class Diode:
    """A diode; ``thermal_K_per_W`` and ``tolerances`` as of a switch."""

    part: str
    on: Conduction
    recovery: Recovery
    capacitance: Capacitance
    thermal_K_per_W: Quantity
    tolerances: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        positive(self, "thermal_K_per_W")


@dataclass(frozen=True, slots=True, kw_only=True)
class NpcBridge:
    """Two three-level legs: outer and inner switches and clamp diodes, each blocking half the dc link."""

    outer: Switch
    inner: Switch
    clamp: Diode

    @property
    def modulations(self) -> tuple[str, ...]:
        """What this bridge can be driven by, its usual one first."""
        return (*CLAMPED, *SHIFTED)


@dataclass(frozen=True, slots=True, kw_only=True)
class FullBridge:
    """Two two-level legs of one kind of switch, each blocking the whole dc link."""

    switch: Switch

    @property
    def modulations(self) -> tuple[str, ...]:
        """What this bridge can be driven by: it has no middle to be clamped at."""
        return SHIFTED


@dataclass(frozen=True, slots=True, kw_only=True)
class Converter:
    """A dual-active-bridge converter: its primary, a two-level secondary, and how it is driven.

    ``modulation`` is one of the primary's (:mod:`sim.modulation`); ``auxiliary_power_W`` is
    what gate drivers, fan and control take from the input while the bridges switch;
    ``secondary_delay_s`` how much later the secondary's gates come than the primary's. ``tolerances`` are everyday
    spreads by dotted path, one sigma relative to the value, where they are others than usual (:mod:`sim.spread`).
    """

    name: str
    V1_V: float
    V2_V: float
    rated_power_W: float
    frequency_Hz: float
    dead_time_s: Quantity
    modulation: str
    primary: NpcBridge | FullBridge
    secondary: FullBridge
    inductor: Inductor
    transformer: Transformer
    link_resistance_Ohm: Quantity
    secondary_delay_s: Quantity
    auxiliary_power_W: Quantity
    input_cable_Ohm: Quantity
    output_cable_Ohm: Quantity
    heatsink_K_per_W: Quantity
    tolerances: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        positive(self, "V1_V", "V2_V", "rated_power_W", "frequency_Hz", "heatsink_K_per_W")
        check(self, "a number", lambda x: x == x, "secondary_delay_s")
        not_negative(self, "dead_time_s")
        not_negative(self, "link_resistance_Ohm", "auxiliary_power_W", "input_cable_Ohm", "output_cable_Ohm")
        if np.any(np.asarray(self.dead_time_s) > MOST_DEAD_TIME * self.half_period_s):
            raise ParameterError(
                f"Converter.dead_time_s is {self.dead_time_s}; allowed: up to a quarter of the half period, "
                f"{MOST_DEAD_TIME * self.half_period_s:.3g} s"
            )
        if self.modulation not in self.primary.modulations:
            raise ParameterError(
                f"Converter.modulation is {self.modulation!r}; a {type(self.primary).__name__} as primary allows: "
                f"{', '.join(self.primary.modulations)}"
            )

    @property
    def three_level(self) -> NpcBridge:
        """The primary, for those that know three-level bridges only; ParameterError where it is another."""
        if not isinstance(self.primary, NpcBridge):
            raise ParameterError(f"{self.name!r} has a two-level primary; a three-level one is needed here")
        return self.primary

    @property
    def half_period_s(self) -> float:
        """Half a switching period, the unit of D0, D1 and D2."""
        return 0.5 / self.frequency_Hz

    @property
    def dead_share(self) -> Quantity:
        """The dead time in half periods."""
        return self.dead_time_s / self.half_period_s


def leaves(parameters: object, path: str = "") -> dict[str, object]:
    """Every value of a nested parameter object by its dotted path."""
    found: dict[str, object] = {}
    for entry in fields(parameters):  # type: ignore[arg-type]
        value = getattr(parameters, entry.name)
        here = f"{path}{entry.name}"
        if not isinstance(value, Mapping):  # tolerances are about values
            found |= leaves(value, f"{here}.") if is_dataclass(value) else {here: value}
    return found
