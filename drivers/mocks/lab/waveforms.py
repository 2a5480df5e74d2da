"""The lab's ac link: its own temperature laws, then the waveform solver."""

from collections.abc import Callable
from dataclasses import dataclass, fields, replace

import numpy as np
from numpy.typing import NDArray

from drivers.mocks.lab.choke import Choke
from drivers.mocks.lab.legs import Junctions, Path, channel_Ohm, primary_legs
from sim.modulation import centre_offset, hybrid_edges
from sim.parameters import Converter
from sim.regulation import Regulated, regulate
from sim.soft_switching import swing_curve
from sim.steady_state import FINE, Circuit

Array = NDArray[np.float64]

LAB_ACCURACY = replace(FINE, power=1e-5)
_BENT_ROUNDS = 2  # for a first run; the next ones go on from its solution
_SHARES = (-0.3, 0.5)  # of a way that a part asks for again when it has gone it


@dataclass(frozen=True, slots=True, kw_only=True)
class Heat:
    """Temperatures of the lab's parts in degC, each (N,)."""

    heatsink_C: Array
    outer_C: Array
    inner_C: Array
    clamp_C: Array
    secondary_C: Array
    inductor_C: Array
    transformer_C: Array

    def furthest_K(self, other: "Heat") -> Array:
        """The largest difference of a part, (N,)."""
        return np.asarray(
            np.max([np.abs(getattr(self, f.name) - getattr(other, f.name)) for f in fields(Heat)], axis=0)
        )

    def onward(self, asked: "Heat", before: "tuple[Heat, Heat] | None") -> "Heat":
        """Where to go on from here, whose losses ask for other temperatures, and what was asked ``before`` elsewhere.

        Each part's own way tells how far (Steffensen's rule).
        """
        if before is None:
            return asked
        ahead = {}
        for name in (f.name for f in fields(Heat)):
            x, g, last_x, last_g = (getattr(h, name) for h in (self, asked, *before))
            moved = x - last_x
            share = (g - last_g) / np.where(moved == 0.0, np.inf, moved)
            ahead[name] = x + (g - x) / (1.0 - np.clip(np.nan_to_num(share), *_SHARES))
        return Heat(**ahead)


@dataclass(frozen=True, slots=True, kw_only=True)
class Demand:
    """What is applied at N points: duty ratios, power at the output capacitors, dc voltages."""

    D1: Array
    D2: Array
    power_W: Array
    V1_V: Array
    V2_V: Array


def winding_Ohm(resistance_Ohm: Array | float, temperature_C: Array) -> Array:
    """Copper's own law, 234.5 K below zero."""
    return np.asarray(resistance_Ohm * (234.5 + temperature_C) / (234.5 + 25.0))


def series_Ohm(converter: Converter, heat: Heat) -> Array:
    """The ac loop's resistance outside the semiconductors, at the switching frequency, on the primary."""
    inductor, transformer = converter.inductor.winding, converter.transformer.winding
    return np.asarray(
        converter.link_resistance_Ohm
        + winding_Ohm(inductor.resistance_Ohm, heat.inductor_C) * (1 + inductor.ac_extra)
        + winding_Ohm(transformer.resistance_Ohm, heat.transformer_C) * (1 + transformer.ac_extra)
    )


def junctions(heat: Heat) -> Junctions:
    """The primary's junctions."""
    return Junctions(outer=heat.outer_C, inner=heat.inner_C, clamp=heat.clamp_C)


def _in_series(path: tuple[Path, ...], series: Array) -> Array:
    """Threshold and resistance (2, N) of a path with all that is in series in every state."""
    threshold = sum(p.count * p.drop[0] for p in path)
    resistance = sum(p.count * p.drop[1] for p in path)
    return np.stack([threshold + 0.0 * series, resistance + series])


def lab_circuit(converter: Converter, heat: Heat, demand: Demand) -> Circuit:
    """The solver's circuit for the lab's converter at its temperatures."""
    low, n = converter.secondary.switch, converter.transformer.turns_ratio
    ones, legs = np.ones_like(demand.D1), primary_legs(converter)
    behind = 2 * n**2 * channel_Ohm(low.on, heat.secondary_C)
    series = series_Ohm(converter, heat) + behind
    forward, reverse, zero = (_in_series(path, series) for path in legs.states(junctions(heat)))
    primary_C = legs.charge_C(demand.V1_V)
    secondary_C = 2 * np.asarray(low.capacitance.charge_C(demand.V2_V))
    curve = swing_curve([low.capacitance], [low.capacitance], converter.V2_V)
    curves = np.concatenate([legs.curves(converter.V1_V), np.stack([curve, curve])])
    return Circuit(
        V1_V=demand.V1_V,
        nV2_V=n * demand.V2_V,
        turns_ratio=n * ones,
        inductance_H=converter.inductor.inductance_H * ones,
        magnetizing_H=converter.transformer.magnetizing_H * ones,
        half_period_s=converter.half_period_s * ones,
        dead_time_s=converter.dead_time_s * ones,
        forward=forward,
        reverse=reverse,
        zero=zero,
        behind_Ohm=behind,
        charge_C=np.stack([primary_C, primary_C, secondary_C, secondary_C]),
        curves=curves[:, None, :],
        curve=np.zeros(demand.D1.size, dtype=np.intp),
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class Link:
    """A converter as the waveforms meet it: its choke, and what else changes the circuit."""

    converter: Converter
    choke: Choke
    adapt: Callable[[Circuit, Demand, Heat], Circuit]

    def solved(
        self, heat: Heat, demand: Demand, secondary_W: Array, warm: Regulated | None
    ) -> tuple[Circuit, Regulated]:
        """Regulate so that ``power_W`` arrives behind ``secondary_W`` of switching loss, at given heat.

        What saturation carries beyond a constant inductance is taken off the solver's target.
        """
        circuit = self.adapt(lab_circuit(self.converter, heat, demand), demand, heat)
        edges = hybrid_edges(-centre_offset(demand.D1, demand.D2), demand.D1, demand.D2)
        edges[2:] += self.converter.secondary_delay_s / self.converter.half_period_s
        target = demand.power_W + secondary_W
        for _ in range(1 if warm is not None or self.choke.drop == 0.0 else _BENT_ROUNDS):
            extra = 0.0 if warm is None else self.choke.extra_W(warm.orbit)
            goal = np.maximum(target - extra, 0.0)
            warm = regulate(circuit, edges, goal, warm=warm, rising=True, accuracy=LAB_ACCURACY)
        assert warm is not None
        return circuit, warm
