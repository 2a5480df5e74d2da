"""The lab's primary bridges: what conducts in each state, and what an edge costs, by the lab's own formulas.

Three of them: three-level legs that are clamped at the link's middle in the zero state (hybrid modulation), the same
legs switched from rail to rail and shifted against each other (SPS, DPS, EPS, TPS), and two-level legs. Losses go to
the kinds ``outer``, ``inner`` and ``clamp``; the switches of two-level legs stand where the outer ones do.

Assumption: a three-level leg that goes from rail to rail passes the middle. Its outer and its inner switch open at the
same current and each swings half the link; what misses of the swing is missed by the second half first.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from drivers.mocks.lab.laws import Laws
from sim.modulation import CLAMPED
from sim.parameters import (
    Capacitance,
    Conduction,
    Converter,
    Diode,
    FullBridge,
    NpcBridge,
    Switch,
)
from sim.soft_switching import leg_curve

Array = NDArray[np.float64]
Drop = tuple[Array, Array]  # threshold in V and resistance in Ohm
KINDS = ("outer", "inner", "clamp")
_RISING = np.linspace(0.0, 1.0, 65) ** 2  # of a swing's voltage: denser where charge rises steeply


@dataclass(frozen=True, slots=True, kw_only=True)
class Path:
    """So many devices of one kind in series in a conducting path, and the drop of each."""

    kind: str
    count: int
    drop: Drop


@dataclass(frozen=True, slots=True, kw_only=True)
class Junctions:
    """Junction temperatures of the primary's devices in degC, each (N,)."""

    outer: Array
    inner: Array
    clamp: Array


@dataclass(frozen=True, slots=True, kw_only=True)
class Edges:
    """The primary's two edges (2, N): currents that are opened and taken over, missing swing, diodes' charges."""

    off_A: Array
    on_A: Array
    missing: Array
    opposite_C: Array
    same_C: Array


class PrimaryLegs(Protocol):
    """A primary bridge under its modulation."""

    def states(self, at: Junctions) -> tuple[tuple[Path, ...], ...]:
        """What conducts with the current along the bridge's voltage, against it, and in the zero state."""
        ...

    def charge_C(self, V1_V: Array) -> Array:
        """Charge that moves a leg through its swing at an edge."""
        ...

    def curves(self, V1_V: float) -> Array:
        """Voltage over charge of the swing at both edges, (2, 65)."""
        ...

    def energies_J(self, at: Junctions, V1_V: Array, edges: Edges, laws: Laws) -> dict[str, Array]:
        """Energy lost at the edges of a half period by kind, all legs."""
        ...

    def thermal_K_per_W(self) -> dict[str, float]:
        """Junction to heatsink, by kind."""
        ...


def channel_Ohm(conduction: Conduction, junction_C: Array) -> Array:
    """On-resistance of a channel: a parabola through 25 and 125 degC, as far off their line elsewhere as the die is."""
    rise, curve = junction_C - 25.0, conduction.resistance_bend_per_K2
    return np.asarray(
        conduction.resistance_Ohm
        * (1 + (conduction.resistance_per_K - 100.0 * curve) * rise + curve * rise**2)
    )


def bipolar_drop(conduction: Conduction, junction_C: Array) -> Drop:
    """A linear knee voltage and a resistance that follows T^k."""
    absolute = (junction_C + 273.15) / 298.15
    knee = conduction.threshold_V * (1 + conduction.threshold_per_K * (junction_C - 25.0))
    return np.asarray(knee), np.asarray(
        conduction.resistance_Ohm * absolute ** (298.15 * conduction.resistance_per_K)
    )


def _charge(junctions: Sequence[Capacitance], voltage_V: Array) -> Array:
    return np.asarray(sum(np.asarray(j.charge_C(voltage_V)) for j in junctions))


def _closing_J(charging: Sequence[Capacitance], discharging: Sequence[Capacitance], swing_V: Array) -> Array:
    """Energy in J that is lost where a switch closes on a whole swing (N,), by quadrature of charge over voltage.

    The rail drives the charging junctions at its full voltage, and what they do not store is lost; the discharging
    ones lose what they had stored. With unlike junctions the two edges of a leg differ.
    """
    reached_V = swing_V * _RISING[:, None]
    not_stored_J = np.trapezoid(_charge(charging, reached_V), reached_V, axis=0)
    still_held_C = _charge(discharging, swing_V) - _charge(discharging, reached_V)
    had_stored_J = np.trapezoid(still_held_C, reached_V, axis=0)
    return np.asarray(not_stored_J + had_stored_J)


def _channel(switch: Switch, junction_C: Array) -> tuple[Drop, Drop]:
    """Forward and backward drop of a switch with its gate on."""
    if not switch.synchronous:
        return bipolar_drop(switch.on, junction_C), bipolar_drop(switch.reverse, junction_C)
    drop = np.zeros_like(junction_C) + switch.on.threshold_V, channel_Ohm(switch.on, junction_C)
    return drop, drop


@dataclass(frozen=True, slots=True, kw_only=True)
class _ThreeLevel:
    outer: Switch
    inner: Switch
    clamp: Diode

    def _active(self, at: Junctions) -> tuple[tuple[Path, ...], tuple[Path, ...]]:
        channel = _channel(self.outer, at.outer)
        inner = bipolar_drop(self.inner.on, at.inner), bipolar_drop(self.inner.reverse, at.inner)
        along, against = (
            (Path(kind="outer", count=2, drop=channel[k]), Path(kind="inner", count=2, drop=inner[k]))
            for k in (0, 1)
        )
        return along, against

    def thermal_K_per_W(self) -> dict[str, float]:
        """Junction to heatsink, by kind."""
        return {kind: float(getattr(self, kind).thermal_K_per_W) for kind in KINDS}

    @property
    def _slow(self) -> list[Capacitance]:
        return [self.inner.capacitance, self.clamp.capacitance]

    @property
    def _fast(self) -> list[Capacitance]:
        return [self.outer.capacitance]

    def _half_charge(self, V1_V: Array) -> Array:
        return _charge([*self._slow, *self._fast], 0.5 * V1_V)

    def _outer_closes_J(self, V1_V: Array) -> Array:
        return _closing_J(self._slow, self._fast, 0.5 * V1_V)

    def _inner_closes_J(self, V1_V: Array) -> Array:
        return _closing_J(self._fast, self._slow, 0.5 * V1_V)


@dataclass(frozen=True, slots=True, kw_only=True)
class ClampedLegs(_ThreeLevel):
    """Both legs leave a rail for the middle, or the middle for a rail, at the same time."""

    def states(self, at: Junctions) -> tuple[tuple[Path, ...], ...]:
        """The zero state goes through an inner switch and a clamp diode of each leg."""
        zero = (
            Path(kind="inner", count=2, drop=bipolar_drop(self.inner.on, at.inner)),
            Path(kind="clamp", count=2, drop=bipolar_drop(self.clamp.on, at.clamp)),
        )
        return (*self._active(at), zero)

    def charge_C(self, V1_V: Array) -> Array:
        """Half a swing."""
        return self._half_charge(V1_V)

    def curves(self, V1_V: float) -> Array:
        """To a rail, and to the middle."""
        steps = ((self._slow, self._fast), (self._fast, self._slow))
        return np.stack([leg_curve([step], 0.5 * V1_V) for step in steps])

    def energies_J(self, at: Junctions, V1_V: Array, edges: Edges, laws: Laws) -> dict[str, Array]:
        """The first edge opens inner switches and closes outer ones, the second the other way round."""
        half, off, on = 0.5 * V1_V, edges.off_A, edges.on_A
        recovered = np.asarray(self.clamp.recovery.at(current_A=on[0], junction_C=at.clamp))
        outer_J = (
            laws.switching_J(self.outer.turn_on, on[0], half, at.outer)
            + laws.switching_J(self.outer.turn_off, off[1], half, at.outer)
            + self._outer_closes_J(V1_V) * edges.missing[0] ** 2
            + (1 - laws.diode_share) * recovered * half
            + (edges.opposite_C[0] + edges.same_C[1]) * self.outer.reverse.threshold_V
        )
        inner_J = (
            laws.switching_J(self.inner.turn_off, off[0], half, at.inner)
            + laws.switching_J(self.inner.turn_on, on[1], half, at.inner)
            + self._inner_closes_J(V1_V) * edges.missing[1] ** 2
            + np.asarray(self.outer.recovery.at(current_A=on[1], junction_C=at.outer)) * half
        )
        legs = 2.0
        clamp_J = laws.diode_share * recovered * half
        return {"outer": legs * outer_J, "inner": legs * inner_J, "clamp": legs * clamp_J}


@dataclass(frozen=True, slots=True, kw_only=True)
class ShiftedLegs(_ThreeLevel):
    """One leg at a time goes from rail to rail; the clamp diodes never conduct."""

    def states(self, at: Junctions) -> tuple[tuple[Path, ...], ...]:
        """The zero state goes forward through one leg's switches and backward through the other's."""
        along, against = self._active(at)
        zero = tuple(Path(kind=p.kind, count=1, drop=p.drop) for p in (*along, *against))
        return along, against, zero

    def charge_C(self, V1_V: Array) -> Array:
        """Two half swings, one after the other."""
        return 2.0 * self._half_charge(V1_V)

    def curves(self, V1_V: float) -> Array:
        """To the middle and on to the other rail, at both edges."""
        curve = leg_curve([(self._fast, self._slow), (self._slow, self._fast)], 0.5 * V1_V)
        return np.stack([curve, curve])

    def energies_J(self, at: Junctions, V1_V: Array, edges: Edges, laws: Laws) -> dict[str, Array]:
        """Both switches of a rail open at each edge, both of the other one close."""
        half, off, on = 0.5 * V1_V, edges.off_A, edges.on_A
        first, second = np.clip(2 * edges.missing - 1, 0.0, 1.0), np.clip(2 * edges.missing, 0.0, 1.0)
        diodes_C = edges.opposite_C + edges.same_C
        outer_J = (
            laws.switching_J(self.outer.turn_off, off, half, at.outer)
            + laws.switching_J(self.outer.turn_on, on * second, half, at.outer)
            + self._outer_closes_J(V1_V) * second**2
            + np.asarray(self.inner.recovery.at(current_A=on * second, junction_C=at.inner)) * half
            + diodes_C * self.outer.reverse.threshold_V
        )
        inner_J = (
            laws.switching_J(self.inner.turn_off, off, half, at.inner)
            + laws.switching_J(self.inner.turn_on, on * first, half, at.inner)
            + self._inner_closes_J(V1_V) * first**2
            + np.asarray(self.outer.recovery.at(current_A=on * first, junction_C=at.outer)) * half
        )
        return {
            "outer": np.sum(outer_J, axis=0),
            "inner": np.sum(inner_J, axis=0),
            "clamp": np.zeros_like(V1_V),
        }


@dataclass(frozen=True, slots=True, kw_only=True)
class TwoLevelLegs:
    """Two legs of two switches, each blocking the whole link."""

    switch: Switch

    def states(self, at: Junctions) -> tuple[tuple[Path, ...], ...]:
        """Two switches in every state."""
        on, back = _channel(self.switch, at.outer)
        zero = (Path(kind="outer", count=1, drop=on), Path(kind="outer", count=1, drop=back))
        return (Path(kind="outer", count=2, drop=on),), (Path(kind="outer", count=2, drop=back),), zero

    def charge_C(self, V1_V: Array) -> Array:
        """Both switches of a leg."""
        return 2.0 * _charge([self.switch.capacitance], V1_V)

    def curves(self, V1_V: float) -> Array:
        """One swing at both edges."""
        curve = leg_curve([([self.switch.capacitance], [self.switch.capacitance])], V1_V)
        return np.stack([curve, curve])

    def energies_J(self, at: Junctions, V1_V: Array, edges: Edges, laws: Laws) -> dict[str, Array]:
        """As the lab's secondary loses it."""
        return {"outer": two_level_J(self.switch, at.outer, V1_V, edges, laws), "inner": np.zeros_like(V1_V),
                "clamp": np.zeros_like(V1_V)}  # fmt: skip

    def thermal_K_per_W(self) -> dict[str, float]:
        """Junction to heatsink."""
        return {"outer": float(self.switch.thermal_K_per_W)}


def two_level_J(switch: Switch, junction_C: Array, link_V: Array, edges: Edges, laws: Laws) -> Array:
    """Energy of a two-level bridge's edges in a half period, (N,)."""
    lost = (
        laws.switching_J(switch.turn_off, edges.off_A, link_V, junction_C)
        + laws.switching_J(switch.turn_on, edges.on_A, link_V, junction_C)
        + _charge([switch.capacitance], link_V) * link_V * edges.missing**2
        + np.asarray(switch.recovery.at(current_A=edges.on_A, junction_C=junction_C)) * link_V
        + (edges.opposite_C + edges.same_C) * switch.reverse.threshold_V
    )
    return np.asarray(np.sum(lost, axis=0))


def primary_legs(converter: Converter) -> PrimaryLegs:
    """The primary of a converter under its modulation."""
    bridge = converter.primary
    if isinstance(bridge, FullBridge):
        return TwoLevelLegs(switch=bridge.switch)
    return _three_level(bridge, clamped=converter.modulation in CLAMPED)


def _three_level(bridge: NpcBridge, *, clamped: bool) -> PrimaryLegs:
    kind = ClampedLegs if clamped else ShiftedLegs
    return kind(outer=bridge.outer, inner=bridge.inner, clamp=bridge.clamp)
