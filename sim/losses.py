"""Losses of the semiconductors and of the wiring, part by part, from a periodic orbit.

Conduction and copper are integrals over the waveform and close its energy balance; what happens at the
edges (turn-off, hard turn-on, missing charge, recovery, diodes in the dead time) is added at its node.
Every function takes arrays over N operating points and returns the same, in W.
"""

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from sim.circuit import Temperatures
from sim.parameters import Capacitance, Conduction, Converter, Quantity, Recovery, Switch
from sim.soft_switching import Commutation, residual_energy
from sim.steady_state import Orbit, Pieces

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True)
class PathIntegrals:
    """Means over a period of |i| (A) and i^2 (A^2) while a path conducts, each (N,)."""

    mean_A: Array
    square_A2: Array


def path_integrals(pieces: Pieces, V1_V: Array) -> tuple[PathIntegrals, PathIntegrals, PathIntegrals]:
    """The active state with the current along vp, against it, and the zero state."""
    half_period = np.sum(pieces.duration_s, axis=0)
    charge, square = np.abs(pieces.charge()), pieces.square()
    live = np.abs(pieces.vp_V) > 0.5 * V1_V
    along = pieces.vp_V * pieces.sign > 0

    def mean(chosen: NDArray[np.bool_]) -> PathIntegrals:
        return PathIntegrals(
            mean_A=np.sum(np.where(chosen, charge, 0.0), axis=0) / half_period,
            square_A2=np.sum(np.where(chosen, square, 0.0), axis=0) / half_period,
        )

    return mean(live & along), mean(live & ~along), mean(~live)


def _heat(conduction: Conduction, junction_C: Quantity, path: PathIntegrals) -> Array:
    """Conduction loss of one device in W: V0 mean|i| + r mean i^2."""
    threshold, resistance = conduction.at(junction_C)
    return np.asarray(threshold * path.mean_A + resistance * path.square_A2)


def conduction_losses(converter: Converter, t: Temperatures, pieces: Pieces, V1_V: Array) -> dict[str, Array]:
    """Conduction of both bridges by kind of device, two of each conducting at a time."""
    forward, reverse, zero = path_integrals(pieces, V1_V)
    outer, inner, clamp = converter.primary.outer, converter.primary.inner, converter.primary.clamp
    low, n = converter.secondary.switch, converter.transformer.turns_ratio
    square = forward.square_A2 + reverse.square_A2 + zero.square_A2
    return {
        "primary_outer_conduction": 2
        * (_heat(outer.on, t.outer_C, forward) + _heat(outer.backward, t.outer_C, reverse)),
        "primary_inner_conduction": 2
        * (
            _heat(inner.on, t.inner_C, forward)
            + _heat(inner.backward, t.inner_C, reverse)
            + _heat(inner.on, t.inner_C, zero)
        ),
        "primary_clamp_conduction": 2 * _heat(clamp.on, t.clamp_C, zero),
        "secondary_conduction": np.asarray(2 * n**2 * low.on.at(t.secondary_C)[1] * square),
    }


def _diode_extra(
    reverse: Conduction, on: Conduction, junction_C: Quantity, charge_C: Array, current_A: Array
) -> Array:
    """What a body diode loses in the dead time beyond the channel that the waveform counts, in J."""
    diode_V, diode_R = reverse.at(junction_C)
    channel_R = on.at(junction_C)[1]
    return np.asarray(charge_C * (diode_V + (diode_R - channel_R) * current_A))


@dataclass(frozen=True, slots=True, kw_only=True)
class _Edge:
    """What happens at one edge (or at several alike), at the voltage it switches."""

    turn_off_A: Array
    turn_on_A: Array
    missing: Array
    opposite_C: Array
    same_C: Array
    voltage_V: Array

    @classmethod
    def of(cls, commutation: Commutation, which: int | slice, voltage_V: Array) -> "_Edge":
        """The ``which``-th edge of a commutation."""
        return cls(
            voltage_V=voltage_V,
            **{f.name: getattr(commutation, f.name)[which] for f in fields(cls) if f.name != "voltage_V"},
        )

    def off_J(self, switch: Switch, junction_C: Quantity) -> Quantity:
        """Turn-off of a switch."""
        return switch.turn_off.at(current_A=self.turn_off_A, voltage_V=self.voltage_V, junction_C=junction_C)

    def on_J(self, switch: Switch, junction_C: Quantity) -> Quantity:
        """Turn-on of a switch, without what it has to discharge or to recover."""
        return switch.turn_on.at(current_A=self.turn_on_A, voltage_V=self.voltage_V, junction_C=junction_C)

    def recovered_J(self, recovery: Recovery, junction_C: Quantity) -> Quantity:
        """Recovery of the diode that carried the current before."""
        return recovery.at(current_A=self.turn_on_A, junction_C=junction_C) * self.voltage_V

    def missing_J(self, charging: list[Capacitance], discharging: list[Capacitance]) -> Quantity:
        """Hard switching of the rest of the swing."""
        return residual_energy(charging, discharging, self.voltage_V, self.missing)


def _into_active(converter: Converter, t: Temperatures, edge: _Edge) -> tuple[Quantity, ...]:
    """Outer, inner and clamp, in J: an inner switch opens, an outer one closes against the clamp if hard."""
    outer, inner, clamp = converter.primary.outer, converter.primary.inner, converter.primary.clamp
    shared_J = 0.5 * edge.recovered_J(clamp.recovery, t.clamp_C)
    outer_J = (
        edge.on_J(outer, t.outer_C)
        + edge.missing_J([inner.capacitance, clamp.capacitance], [outer.capacitance])
        + shared_J
        + _diode_extra(outer.reverse, outer.on, t.outer_C, edge.opposite_C, edge.turn_off_A)
    )
    return outer_J, edge.off_J(inner, t.inner_C), shared_J


def _into_zero(converter: Converter, t: Temperatures, edge: _Edge) -> tuple[Quantity, ...]:
    """Outer and inner, in J: an outer switch opens, an inner one closes against its body diode if hard."""
    outer, inner, clamp = converter.primary.outer, converter.primary.inner, converter.primary.clamp
    inner_J = (
        edge.on_J(inner, t.inner_C)
        + edge.missing_J([outer.capacitance], [inner.capacitance, clamp.capacitance])
        + edge.recovered_J(outer.recovery, t.outer_C)
        + _diode_extra(outer.reverse, outer.on, t.outer_C, edge.same_C, edge.turn_on_A)
    )
    return edge.off_J(outer, t.outer_C), inner_J


def _of_secondary(converter: Converter, t: Temperatures, edges: _Edge) -> Quantity:
    """A leg at each of its edges, in J, shape (2, N)."""
    low, junction_C = converter.secondary.switch, t.secondary_C
    return (
        edges.off_J(low, junction_C)
        + edges.on_J(low, junction_C)
        + edges.recovered_J(low.recovery, junction_C)
        + edges.missing_J([low.capacitance], [low.capacitance])
        + _diode_extra(low.reverse, low.on, junction_C, edges.opposite_C, edges.turn_off_A)
        + _diode_extra(low.reverse, low.on, junction_C, edges.same_C, edges.turn_on_A)
    )


def switching_losses(
    converter: Converter, t: Temperatures, orbit: Orbit, V1_V: Array, V2_V: Array
) -> dict[str, Array]:
    """Losses at the edges by kind of device; each edge comes twice a period, primary edges in both legs."""
    half_link, rate = 0.5 * V1_V, 2.0 * converter.frequency_Hz
    c = orbit.commutation
    outer_J, inner_J, clamp_J = _into_active(converter, t, _Edge.of(c, 0, half_link))
    outer_zero_J, inner_zero_J = _into_zero(converter, t, _Edge.of(c, 1, half_link))
    secondary_J = _of_secondary(converter, t, _Edge.of(c, slice(2, 4), V2_V))
    return {
        "primary_outer_switching": np.asarray(2 * rate * (outer_J + outer_zero_J)),
        "primary_inner_switching": np.asarray(2 * rate * (inner_J + inner_zero_J)),
        "primary_clamp_recovery": np.asarray(2 * rate * clamp_J),
        "secondary_switching": np.sum(rate * secondary_J, axis=0),
    }
