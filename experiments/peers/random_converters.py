"""Dual-active bridges that nobody designed: two- and three-level, 48 to 800 V, 0.2 to 20 kW, 5 to 300 kHz.

Ranges are those of converters that are built: a link that carries 1.5 to 6 times the rated power, dead times of 0.3 to
5 % of half a period, drops of some per cent of the voltages, output capacitances that the rated current swings in a
fraction of the dead time to some of it. A draw is no design; what a solver gets right on all of them it got right in
general.
"""

from dataclasses import dataclass

import numpy as np

from sim.operating_points import Points
from sim.parameters import (
    Capacitance,
    Conduction,
    Converter,
    Core,
    Diode,
    FullBridge,
    Inductor,
    NpcBridge,
    Recovery,
    Switch,
    SwitchingEnergy,
    Transformer,
    Winding,
)

_CORE = Core(k=0.0, alpha=1.36, beta=2.6, area_m2=1e-3, volume_m3=1e-4, turns=20.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class _Side:
    """What one bridge works at: its voltage and current at rated power, frequency, dead time."""

    voltage_V: float
    current_A: float
    frequency_Hz: float
    dead_time_s: float


def random_converter(rng: np.random.Generator) -> Converter:
    """One converter."""
    V1_V, V2_V, power_W, frequency_Hz = (
        _between(rng, *r) for r in ((48, 800), (24, 800), (200, 20e3), (5e3, 300e3))
    )
    half_period_s = 0.5 / frequency_Hz
    dead_time_s = half_period_s * _between(rng, 0.003, 0.05)
    turns_ratio = V1_V / V2_V * rng.uniform(0.8, 1.25)
    inductance_H = V1_V * turns_ratio * V2_V * half_period_s / (4 * power_W * rng.uniform(1.5, 6.0))
    first, second = (
        _Side(voltage_V=V, current_A=power_W / V, frequency_Hz=frequency_Hz, dead_time_s=dead_time_s)
        for V in (V1_V, V2_V)
    )
    primary = _npc(rng, first) if rng.random() < 0.4 else FullBridge(switch=_switch(rng, first, "primary"))
    base_Ohm = V1_V**2 / power_W
    return Converter(
        name="drawn at random", V1_V=V1_V, V2_V=V2_V, rated_power_W=power_W, frequency_Hz=frequency_Hz,
        dead_time_s=dead_time_s, modulation=str(rng.choice(primary.modulations)), primary=primary,
        secondary=FullBridge(switch=_switch(rng, second, "secondary")),
        inductor=Inductor(
            inductance_H=inductance_H, winding=_winding(rng, base_Ohm), core=_CORE,
            thermal_K_per_W=1000.0 / power_W,
        ),
        transformer=Transformer(
            turns_ratio=turns_ratio, magnetizing_H=inductance_H * _between(rng, 8, 100),
            winding=_winding(rng, base_Ohm), core=_CORE, thermal_K_per_W=1000.0 / power_W,
        ),
        link_resistance_Ohm=0.001 * base_Ohm, secondary_delay_s=0.0, auxiliary_power_W=0.0, input_cable_Ohm=0.0,
        output_cable_Ohm=0.0, heatsink_K_per_W=300.0 / power_W,
    )  # fmt: skip


def random_points(converter: Converter, count: int, rng: np.random.Generator) -> Points:
    """Points within 15 % of its voltages, a quarter of them backward, in the converter's own modulation."""
    D1, D2 = rng.uniform(0.3, 1.0, count), rng.uniform(0.0, 0.7, count)
    if converter.modulation in ("sps", "eps"):
        D1[:] = 1.0
    if converter.modulation == "sps":
        D2[:] = 0.0
    if converter.modulation == "dps":
        D2 = 1.0 - D1
    power_W = converter.rated_power_W * rng.uniform(0.1, 1.0, count) * rng.choice([1, 1, 1, -1], count)
    V1_V, V2_V = (V * rng.uniform(0.85, 1.15, count) for V in (converter.V1_V, converter.V2_V))
    return Points(D1=D1, D2=D2, power_W=power_W, V1_V=V1_V, V2_V=V2_V)


def _between(rng: np.random.Generator, low: float, high: float) -> float:
    """Even in its logarithm."""
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def _winding(rng: np.random.Generator, base_Ohm: float) -> Winding:
    return Winding(resistance_Ohm=0.003 * base_Ohm, ac_extra=rng.uniform(0.0, 0.5))


def _npc(rng: np.random.Generator, side: _Side) -> NpcBridge:
    """Every device blocks half the link."""
    half = _Side(
        voltage_V=side.voltage_V / 2, current_A=side.current_A, frequency_Hz=side.frequency_Hz,
        dead_time_s=side.dead_time_s,
    )  # fmt: skip
    outer, inner = _switch(rng, half, "outer"), _switch(rng, half, "inner")
    clamp = Diode(
        part="clamp", on=outer.reverse, recovery=outer.recovery, capacitance=outer.capacitance,
        thermal_K_per_W=outer.thermal_K_per_W,
    )  # fmt: skip
    return NpcBridge(outer=outer, inner=inner, clamp=clamp)


def _switch(rng: np.random.Generator, side: _Side, part: str) -> Switch:
    """A transistor with a threshold or a synchronous channel, for 1 % of the power or so in losses."""
    V, current_A, synchronous = side.voltage_V, side.current_A, bool(rng.random() < 0.6)
    resistance_Ohm = rng.uniform(0.002, 0.015) * V / current_A
    # the channel keeps its diode from conducting
    beside_V = 3 * resistance_Ohm * current_A if synchronous else 0.0
    energy = SwitchingEnergy(
        energy_J=1e-4 * V * current_A / side.frequency_Hz, reference_V=V, reference_A=current_A,
        current_exponent=rng.uniform(0.8, 1.6), voltage_exponent=1.2,
    )  # fmt: skip
    return Switch(
        part=part, synchronous=synchronous,
        on=Conduction(
            threshold_V=0.0 if synchronous else 0.01 * V * rng.uniform(0.2, 1.0),
            resistance_Ohm=resistance_Ohm, resistance_per_K=0.005,
        ),
        reverse=Conduction(
            threshold_V=0.01 * V * rng.uniform(0.3, 1.5) + beside_V, resistance_Ohm=0.003 * V / current_A
        ),
        turn_off=energy, turn_on=energy,
        recovery=Recovery(charge_C=1e-3 * current_A / side.frequency_Hz, reference_A=current_A),
        capacitance=Capacitance(
            zero_bias_F=rng.uniform(0.05, 1.5) * current_A * side.dead_time_s / V, junction_V=0.02 * V,
            grading=float(rng.uniform(0.2, 0.5)),
        ),
        thermal_K_per_W=1000.0 / (V * current_A),
    )  # fmt: skip
