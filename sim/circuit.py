"""From a converter at given temperatures to the circuit that the waveform solver needs."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from sim.bridges import Carrier, Scheme, Transition, primary_scheme, secondary_scheme
from sim.parameters import Capacitance, Converter, Quantity, Switch
from sim.soft_switching import leg_curve
from sim.waveform import Circuit

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True)
class Temperatures:
    """What the losses heat, in degC: junctions by kind of device (:mod:`sim.bridges`), heatsink and windings."""

    heatsink_C: Quantity
    junction_C: Mapping[str, Quantity]
    inductor_C: Quantity
    transformer_C: Quantity

    @classmethod
    def everywhere(cls, converter: Converter, ambient_C: Quantity) -> "Temperatures":
        """Everything at ambient, in arrays of its own."""
        kinds = (*primary_scheme(converter).devices, *secondary_scheme(converter).devices)
        return cls(
            heatsink_C=np.array(ambient_C, dtype=float),
            junction_C={kind: np.array(ambient_C, dtype=float) for kind in kinds},
            inductor_C=np.array(ambient_C, dtype=float),
            transformer_C=np.array(ambient_C, dtype=float),
        )

    @classmethod
    def of(cls, by_place: Mapping[str, Array]) -> "Temperatures":
        """From every temperature by its place's name, as :meth:`by_place` gives them."""
        at = dict(by_place)
        heatsink, inductor, transformer = (at.pop(name) for name in ("heatsink", "inductor", "transformer"))
        return cls(heatsink_C=heatsink, junction_C=at, inductor_C=inductor, transformer_C=transformer)

    def by_place(self) -> dict[str, Array]:
        """Every temperature by a name of its place."""
        places = {"heatsink": self.heatsink_C, "inductor": self.inductor_C, "transformer": self.transformer_C}
        return {name: np.asarray(value) for name, value in {**places, **self.junction_C}.items()}


def winding_resistance(converter: Converter, t: Temperatures) -> tuple[Quantity, Quantity]:
    """Dc resistance of inductor and transformer, referred to the primary, in Ohm."""
    inductor, transformer = converter.inductor.winding, converter.transformer.winding
    return inductor.at(t.inductor_C), transformer.at(t.transformer_C)


def eddy_time_s(converter: Converter, t: Temperatures) -> Quantity:
    """L over the resistor parallel to it that makes the windings' rise of resistance with frequency, in s.

    Seen in series, L beside R_e is omega^2 L^2 / R_e more resistance: c R_dc at the switching frequency.
    """
    resistances = winding_resistance(converter, t)
    windings = converter.inductor.winding, converter.transformer.winding
    extra_Ohm = sum(R * w.ac_extra for R, w in zip(resistances, windings, strict=True))
    return extra_Ohm / ((2 * np.pi * converter.frequency_Hz) ** 2 * converter.inductor.inductance_H)


def path_drop(path: tuple[Carrier, ...], t: Temperatures) -> tuple[Quantity, Quantity]:
    """Threshold (V) and resistance (Ohm) of devices in series."""
    drops = [(c.count, c.law.at(t.junction_C[c.kind])) for c in path]
    return sum(n * V0 for n, (V0, _) in drops), sum(n * R for n, (_, R) in drops)


def ohmic(switch: Switch) -> bool:
    """Whether a switch that is on is a resistance, whatever flows."""
    return switch.synchronous and not np.any(switch.on.threshold_V)


def loop_drops(converter: Converter, t: Temperatures) -> tuple[Array, Array | None]:
    """Drops of the ac loop in V and Ohm, shape (3, 2, ...): current along a bridge's voltage, against it, zero state.

    First by the state of the primary, everything in series that does not depend on states included; then by that of
    the secondary, referred to the primary, or None where channels are plain resistances and are included in the first.
    """
    n, primary, secondary = (
        converter.transformer.turns_ratio,
        primary_scheme(converter),
        secondary_scheme(converter),
    )
    fixed_R = converter.link_resistance_Ohm + sum(winding_resistance(converter, t))
    beyond: Array | None = None
    if ohmic(converter.secondary.switch):
        _, R = path_drop(secondary.forward, t)
        fixed_R = fixed_R + n**2 * R
    else:
        beyond = _stacked([(n * V0, n**2 * R) for V0, R in _state_drops(secondary, t)])
    return _stacked([(V0, R + fixed_R) for V0, R in _state_drops(primary, t)]), beyond


def behind_magnetizing(converter: Converter, t: Temperatures) -> Quantity:
    """Resistance of the secondary's channels, referred to the primary; 0 where its drop depends on the state."""
    if not ohmic(converter.secondary.switch):
        return 0.0
    return converter.transformer.turns_ratio**2 * path_drop(secondary_scheme(converter).forward, t)[1]


def _state_drops(scheme: Scheme, t: Temperatures) -> list[tuple[Quantity, Quantity]]:
    return [path_drop(path, t) for path in (scheme.forward, scheme.reverse, scheme.zero)]


def _stacked(drops: list[tuple[Quantity, Quantity]]) -> Array:
    arrays = np.broadcast_arrays(*(np.asarray(value, dtype=float) for drop in drops for value in drop))
    return np.stack(arrays).reshape(3, 2, *arrays[0].shape)


def swing_charge(scheme: Scheme, transitions: tuple[Transition, ...], link_V: Array) -> Array:
    """Charge in C that moves a leg through its transitions."""
    step_V = scheme.step * link_V
    junctions = [scheme.devices[k].capacitance for t in transitions for k in (*t.charging, *t.discharging)]
    return np.asarray(sum(np.asarray(j.charge_C(step_V)) for j in junctions))


def _with_zero_bias(junction: Capacitance, value: float) -> Capacitance:
    return replace(junction, zero_bias_F=float(value))


@dataclass(frozen=True, slots=True, kw_only=True)
class SwingCurves:
    """Swing curves ``values`` (4, G, 65) of the different sets of capacitances, and each point's set ``which`` (N,)."""

    values: Array
    which: NDArray[np.intp]

    @classmethod
    def of(cls, converter: Converter, size: int) -> "SwingCurves":
        """Those of a converter at so many points; they depend on nothing that moves in operation."""
        primary, secondary = primary_scheme(converter), secondary_scheme(converter)
        junctions = {k: d.capacitance for s in (primary, secondary) for k, d in s.devices.items()}
        zero_bias = np.stack(
            np.broadcast_arrays(*(j.zero_bias_F for j in junctions.values()), np.empty(1))[:-1]
        )
        changes = np.any(zero_bias[:, 1:] != zero_bias[:, :-1], axis=0)
        heads = np.concatenate([[0], np.flatnonzero(changes) + 1])  # points of a variant follow each other
        sets, of_stretch = np.unique(zero_bias[:, heads], axis=1, return_inverse=True)
        which = np.repeat(of_stretch.ravel(), np.diff(heads, append=zero_bias.shape[1]))
        edges = (
            (primary, primary.first, converter.V1_V), (primary, primary.second, converter.V1_V),
            (secondary, secondary.first, converter.V2_V), (secondary, secondary.second, converter.V2_V),
        )  # fmt: skip
        tables = []
        for column in sets.T:
            own = {k: _with_zero_bias(j, v) for (k, j), v in zip(junctions.items(), column, strict=True)}
            known: dict[tuple[tuple[Transition, ...], float], Array] = {}
            for scheme, transitions, link_V in edges:
                if (transitions, link_V) not in known:
                    steps = [
                        ([own[k] for k in t.charging], [own[k] for k in t.discharging]) for t in transitions
                    ]
                    known[transitions, link_V] = leg_curve(steps, scheme.step * link_V)
            tables.append([known[transitions, link_V] for _, transitions, link_V in edges])
        return cls(
            values=np.stack([np.stack(table) for table in tables], axis=1),
            which=np.broadcast_to(which, (size,)).astype(np.intp),
        )

    def take(self, chosen: NDArray[np.intp]) -> "SwingCurves":
        """The same curves for some of the points."""
        return SwingCurves(values=self.values, which=self.which[chosen])


def build_circuit(
    converter: Converter, t: Temperatures, V1_V: Array, V2_V: Array, swings: SwingCurves | None = None
) -> Circuit:
    """The circuit at N points, from voltages of shape (N,); ``swings`` where the converter's are known already."""
    size = V1_V.shape

    def wide(value: Quantity) -> Array:
        return np.array(
            np.broadcast_to(value, (*np.shape(value)[:-1], *size)) if np.ndim(value) else np.full(size, value)
        )

    n, primary, secondary = (
        converter.transformer.turns_ratio,
        primary_scheme(converter),
        secondary_scheme(converter),
    )
    drops, beyond = loop_drops(converter, t)
    drops = np.broadcast_to(drops if drops.ndim == 3 else drops[..., None], (3, 2, *size))
    if beyond is not None:
        beyond = np.broadcast_to(beyond if beyond.ndim == 3 else beyond[..., None], (3, 2, *size))
    charges = (
        swing_charge(primary, primary.first, V1_V), swing_charge(primary, primary.second, V1_V),
        swing_charge(secondary, secondary.first, V2_V), swing_charge(secondary, secondary.second, V2_V),
    )  # fmt: skip
    swings = swings or SwingCurves.of(converter, V1_V.size)
    bends_A, relative = np.zeros(0), np.ones((1, *size))
    if converter.inductor.saturates:
        bends_A, relative = converter.inductor.bands()
        relative = np.broadcast_to(
            relative if relative.ndim == 2 else relative[:, None], (relative.shape[0], *size)
        )
    return Circuit(
        V1_V=V1_V,
        nV2_V=n * V2_V,
        turns_ratio=wide(n),
        inductance_H=wide(converter.inductor.inductance_H),
        magnetizing_H=wide(converter.transformer.magnetizing_H),
        half_period_s=wide(converter.half_period_s),
        dead_time_s=wide(converter.dead_time_s),
        forward=drops[0],
        reverse=drops[1],
        zero=drops[2],
        secondary=beyond,
        eddy_s=wide(eddy_time_s(converter, t)),
        behind_Ohm=wide(behind_magnetizing(converter, t)),
        bends_A=bends_A,
        relative_L=relative,
        charge_C=np.stack([wide(Q) for Q in charges]),
        curves=swings.values,
        curve=swings.which,
    )
