"""From a converter at given temperatures to the circuit that the waveform solver needs."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from sim.parameters import Capacitance, Converter, Quantity
from sim.soft_switching import swing_curve
from sim.steady_state import Circuit

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True)
class Temperatures:
    """What the losses heat, in degC; each broadcasts over the operating points."""

    heatsink_C: Quantity
    outer_C: Quantity
    inner_C: Quantity
    clamp_C: Quantity
    secondary_C: Quantity
    inductor_C: Quantity
    transformer_C: Quantity

    @classmethod
    def everywhere(cls, ambient_C: Quantity) -> "Temperatures":
        """Everything at ambient, in arrays of its own."""
        return cls(**{name: np.array(ambient_C, dtype=float) for name in cls.__slots__})


def winding_resistance(converter: Converter, temperatures: Temperatures) -> tuple[Quantity, Quantity]:
    """Resistance of inductor and transformer at the switching frequency, referred to the primary, in Ohm."""
    inductor, transformer = converter.inductor.winding, converter.transformer.winding
    return (
        inductor.resistance_Ohm
        * (1 + inductor.resistance_per_K * (temperatures.inductor_C - 25.0))
        * (1 + inductor.ac_extra),
        transformer.resistance_Ohm
        * (1 + transformer.resistance_per_K * (temperatures.transformer_C - 25.0))
        * (1 + transformer.ac_extra),
    )


def loop_drops(converter: Converter, t: Temperatures) -> tuple[Array, Array, Array]:
    """Threshold (V) and resistance (Ohm), stacked, of the ac loop: along vp, against it, zero state."""
    primary, n = converter.primary, converter.transformer.turns_ratio
    secondary_R = n**2 * 2 * converter.secondary.switch.on.at(t.secondary_C)[1]
    fixed_R = converter.link_resistance_Ohm + sum(winding_resistance(converter, t)) + secondary_R

    def path(*devices: tuple[Quantity, Quantity]) -> Array:
        threshold = 2 * sum(np.asarray(v) for v, _ in devices)
        resistance = 2 * sum(np.asarray(r) for _, r in devices) + fixed_R
        return np.stack(np.broadcast_arrays(threshold, resistance))

    outer, inner, clamp = primary.outer, primary.inner, primary.clamp
    return (
        path(outer.on.at(t.outer_C), inner.on.at(t.inner_C)),
        path(outer.backward.at(t.outer_C), inner.backward.at(t.inner_C)),
        path(inner.on.at(t.inner_C), clamp.on.at(t.clamp_C)),
    )


def _with_zero_bias(junction: Capacitance, value: float) -> Capacitance:
    return replace(junction, zero_bias_F=float(value))


def _curves(converter: Converter, size: int) -> tuple[Array, NDArray[np.intp]]:
    """Swing curves (4, G, 65) of the different sets of capacitances, and each point's set (N,)."""
    junctions = (
        converter.primary.outer.capacitance,
        converter.primary.inner.capacitance,
        converter.primary.clamp.capacitance,
        converter.secondary.switch.capacitance,
    )
    values = np.stack(np.broadcast_arrays(*(j.zero_bias_F for j in junctions), np.empty(1))[:4])
    sets, which = np.unique(values, axis=1, return_inverse=True)
    half_link, link = 0.5 * converter.V1_V, converter.V2_V
    tables = []
    for column in sets.T:
        outer, inner, clamp, low = (_with_zero_bias(j, v) for j, v in zip(junctions, column, strict=True))
        secondary = swing_curve([low], [low], link)
        tables.append(
            [
                swing_curve([inner, clamp], [outer], half_link),
                swing_curve([outer], [inner, clamp], half_link),
                secondary,
                secondary,
            ]
        )
    return np.stack(tables, axis=1), np.broadcast_to(which.ravel(), (size,)).astype(np.intp)


def build_circuit(converter: Converter, t: Temperatures, V1_V: Array, V2_V: Array) -> Circuit:
    """The circuit at N points, from voltages of shape (N,)."""
    size = V1_V.shape

    def wide(value: Quantity) -> Array:
        return np.array(
            np.broadcast_to(value, (*np.shape(value)[:-1], *size)) if np.ndim(value) else np.full(size, value)
        )

    primary, n = converter.primary, converter.transformer.turns_ratio
    swing = 0.5 * V1_V
    primary_Q = sum(
        np.asarray(d.capacitance.charge_C(swing)) for d in (primary.outer, primary.inner, primary.clamp)
    )
    secondary_Q = 2 * np.asarray(converter.secondary.switch.capacitance.charge_C(V2_V))
    forward, reverse, zero = loop_drops(converter, t)
    curves, curve = _curves(converter, V1_V.size)
    return Circuit(
        V1_V=V1_V,
        nV2_V=n * V2_V,
        turns_ratio=wide(n),
        inductance_H=wide(converter.inductor.inductance_H),
        magnetizing_H=wide(converter.transformer.magnetizing_H),
        half_period_s=wide(converter.half_period_s),
        dead_time_s=wide(converter.dead_time_s),
        forward=np.stack([wide(x) for x in forward]),
        reverse=np.stack([wide(x) for x in reverse]),
        zero=np.stack([wide(x) for x in zero]),
        charge_C=np.stack([wide(primary_Q), wide(primary_Q), wide(secondary_Q), wide(secondary_Q)]),
        curves=curves,
        curve=curve,
    )
