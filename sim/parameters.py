"""The parameter objects of a converter: what a careful engineer enters from datasheets.

Every number is a float, or an array that broadcasts over operating points, so that many variants of a
converter can be simulated in one call. All values are SI; resistances and drops are given at 25 degC.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields, is_dataclass

import numpy as np
from numpy.typing import NDArray

from sim.modulation import CLAMPED, SHIFTED

Array = NDArray[np.float64]
Quantity = float | NDArray[np.float64]
REFERENCE_C = 25.0
_BENDS = np.linspace(0.0, 1.4, 8)  # of a saturating inductor's flux, over the current at which it is told


class ParameterError(ValueError):
    """A parameter outside what is physically possible; names the field, the value and the range."""


def _check(
    owner: object, allowed: str, holds: Callable[[NDArray[np.float64]], NDArray[np.bool_]], *names: str
) -> None:
    for name in names:
        value = np.asarray(getattr(owner, name), dtype=float)
        if not (np.all(np.isfinite(value)) and np.all(holds(value))):
            raise ParameterError(f"{type(owner).__name__}.{name} is {value}; allowed: finite and {allowed}")


def _positive(owner: object, *names: str) -> None:
    _check(owner, "> 0", lambda x: x > 0, *names)


def _not_negative(owner: object, *names: str) -> None:
    _check(owner, ">= 0", lambda x: x >= 0, *names)


@dataclass(frozen=True, slots=True, kw_only=True)
class Conduction:
    """A drop ``threshold + resistance * i``; both parts move with junction temperature (relative, per K)."""

    threshold_V: Quantity
    resistance_Ohm: Quantity
    threshold_per_K: Quantity = 0.0
    resistance_per_K: Quantity = 0.0

    def __post_init__(self) -> None:
        _not_negative(self, "threshold_V", "resistance_Ohm")

    def at(self, junction_C: Quantity) -> tuple[Quantity, Quantity]:
        """Threshold in V and resistance in Ohm at a junction temperature.

        >>> threshold_V, resistance_Ohm = Conduction(
        ...     threshold_V=0.8, resistance_Ohm=0.027, threshold_per_K=-0.001, resistance_per_K=0.0036
        ... ).at(125.0)
        >>> round(threshold_V, 3), round(resistance_Ohm, 5)
        (0.72, 0.03672)
        """
        rise = junction_C - REFERENCE_C
        return (
            self.threshold_V * (1 + self.threshold_per_K * rise),
            self.resistance_Ohm * (1 + self.resistance_per_K * rise),
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
        _not_negative(self, "energy_J")
        _positive(self, "reference_V", "reference_A", "current_exponent", "voltage_exponent")

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
        _not_negative(self, "charge_C")
        _positive(self, "reference_A")

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
        _positive(self, "zero_bias_F", "junction_V")
        _check(self, "in (0, 1)", lambda x: (x > 0) & (x < 1), "grading")

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
        _positive(self, "thermal_K_per_W")

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
        _positive(self, "thermal_K_per_W")


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
class Core:
    """A core with Steinmetz loss ``P = k f^alpha B^beta`` per volume (SI: W/m3, Hz, T)."""

    k: Quantity
    alpha: float
    beta: float
    area_m2: float
    volume_m3: float
    turns: float

    def __post_init__(self) -> None:
        _not_negative(self, "k")
        _positive(self, "alpha", "beta", "area_m2", "volume_m3", "turns")


@dataclass(frozen=True, slots=True, kw_only=True)
class Winding:
    """A winding: dc resistance at 25 degC, and the extra resistance at ``ac_frequency_Hz``, relative.

    The extra grows with frequency squared (the low-frequency branch of Dowell's equation, which litz
    wire keeps to well above the switching frequency).
    """

    resistance_Ohm: Quantity
    ac_extra: Quantity
    resistance_per_K: Quantity = 0.0039

    def __post_init__(self) -> None:
        _not_negative(self, "resistance_Ohm", "ac_extra")

    def at(self, temperature_C: Quantity) -> Quantity:
        """Dc resistance in Ohm at a temperature.

        >>> round(Winding(resistance_Ohm=0.1, ac_extra=0.0).at(125.0), 4)
        0.139
        """
        return self.resistance_Ohm * (1 + self.resistance_per_K * (temperature_C - REFERENCE_C))


@dataclass(frozen=True, slots=True, kw_only=True)
class Inductor:
    r"""The series inductor of the ac link, on the primary side.

    ``inductance_H`` is that of a small current; at ``saturation_A`` it is lower by ``saturation`` (relative):
    :math:`L(i) = L / (1 + s (i/I)^2)`, s = saturation / (1 - saturation), the slope of an arctangent.
    The flux is taken as straight lines, bent at fifths of ``saturation_A``.
    """

    inductance_H: Quantity
    winding: Winding
    core: Core
    thermal_K_per_W: Quantity
    saturation: Quantity = 0.0
    saturation_A: float = 15.0

    def __post_init__(self) -> None:
        _positive(self, "inductance_H", "thermal_K_per_W", "saturation_A")
        _check(self, "in [0, 0.9]", lambda x: (x >= 0) & (x <= 0.9), "saturation")

    @property
    def saturates(self) -> bool:
        """Whether the inductance depends on the current anywhere."""
        return bool(np.any(np.asarray(self.saturation) > 0))

    def bands(self) -> tuple[Array, Array]:
        """Where the flux bends, (B - 1,) in A, and the inductance between, (B, ...), over that of a small current.

        >>> core = Core(k=1.0, alpha=1.3, beta=2.5, area_m2=1e-4, volume_m3=1e-5, turns=10.0)
        >>> winding = Winding(resistance_Ohm=0.1, ac_extra=0.0)
        >>> coil = Inductor(inductance_H=1e-4, winding=winding, core=core, thermal_K_per_W=5.0, saturation=0.2)
        >>> [row.round(3).tolist() for row in coil.bands()]
        [[3.0, 6.0, 9.0, 12.0, 15.0, 18.0], [0.997, 0.977, 0.941, 0.89, 0.831, 0.768, 0.703]]
        """
        bends_A = self.saturation_A * _BENDS[1:-1]
        share = np.asarray(self.saturation, dtype=float)
        knee = np.sqrt(
            np.maximum(share, 1e-12) / (1.0 - share)
        )  # saturation_A over the arctangent's own scale
        at = _BENDS.reshape(-1, *(1,) * share.ndim)
        return bends_A, np.diff(np.arctan(knee * at) / knee, axis=0) / np.diff(at, axis=0)

    def flux_Vs(self, current_A: Array) -> Array:
        """Flux linkage in V s of a current above 0, (N,)."""
        if not self.saturates:
            return np.asarray(self.inductance_H * current_A)
        bends_A, relative = self.bands()
        begin, end = np.concatenate([[0.0], bends_A]), np.concatenate([bends_A, [np.inf]])
        parts = (r * np.clip(current_A - b, 0.0, e - b) for r, b, e in zip(relative, begin, end, strict=True))
        return np.asarray(self.inductance_H * sum(parts))


@dataclass(frozen=True, slots=True, kw_only=True)
class Transformer:
    """The transformer, n:1; the winding is both windings referred to the primary."""

    turns_ratio: float
    magnetizing_H: Quantity
    winding: Winding
    core: Core
    thermal_K_per_W: Quantity

    def __post_init__(self) -> None:
        _positive(self, "turns_ratio", "magnetizing_H", "thermal_K_per_W")


@dataclass(frozen=True, slots=True, kw_only=True)
class Converter:
    """A dual-active-bridge converter: its primary, a two-level secondary, and how it is driven.

    ``modulation`` is one of the primary's (:mod:`sim.modulation`); ``auxiliary_power_W`` is
    what gate drivers, fan and control take from the input while the bridges switch;
    ``secondary_delay_s`` how much later the secondary's gates come than the primary's.
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

    def __post_init__(self) -> None:
        _positive(self, "V1_V", "V2_V", "rated_power_W", "frequency_Hz", "heatsink_K_per_W")
        _check(self, "a number", lambda x: x == x, "secondary_delay_s")
        _not_negative(self, "dead_time_s")
        _not_negative(self, "link_resistance_Ohm", "auxiliary_power_W", "input_cable_Ohm", "output_cable_Ohm")
        if np.any(np.asarray(self.dead_time_s) > 0.25 * self.half_period_s):
            raise ParameterError(
                f"Converter.dead_time_s is {self.dead_time_s}; allowed: up to a quarter of the half period, "
                f"{0.25 * self.half_period_s:.3g} s"
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


def leaves(parameters: object, path: str = "") -> dict[str, object]:
    """Every value of a nested parameter object by its dotted path."""
    found: dict[str, object] = {}
    for entry in fields(parameters):  # type: ignore[arg-type]
        value = getattr(parameters, entry.name)
        here = f"{path}{entry.name}"
        if not isinstance(value, Mapping):  # a device's tolerances are about its values
            found |= leaves(value, f"{here}.") if is_dataclass(value) else {here: value}
    return found
