"""Losses of the semiconductors and of the wiring, part by part, from a periodic orbit.

Conduction and copper are integrals over the waveform and close its energy balance; what happens at the
edges (turn-off, hard turn-on, missing charge, recovery, diodes in the dead time) is added at its node.
Every function takes arrays over N operating points and returns the same, in W.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sim.circuit import Temperatures
from sim.parameters import Conduction, Converter, Quantity
from sim.soft_switching import residual_energy
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


def switching_losses(
    converter: Converter, t: Temperatures, orbit: Orbit, V1_V: Array, V2_V: Array
) -> dict[str, Array]:
    """Losses at the edges by kind of device; each edge comes twice a period, primary edges in both legs."""
    c = orbit.commutation
    outer, inner, clamp = converter.primary.outer, converter.primary.inner, converter.primary.clamp
    low = converter.secondary.switch
    half_link, rate = 0.5 * V1_V, 2.0 * converter.frequency_Hz
    rise, fall = 0, 1
    off_A, on_A, missing = c.turn_off_A, c.turn_on_A, c.missing

    # zero -> active: an inner switch opens, the outer one closes, against the clamp diode where hard
    inner_J = inner.turn_off.at(current_A=off_A[rise], voltage_V=half_link, junction_C=t.inner_C)
    recovered_C = clamp.recovery.at(current_A=on_A[rise], junction_C=t.clamp_C)
    outer_J = (
        outer.turn_on.at(current_A=on_A[rise], voltage_V=half_link, junction_C=t.outer_C)
        + residual_energy(
            [inner.capacitance, clamp.capacitance], [outer.capacitance], half_link, missing[rise]
        )
        + 0.5 * recovered_C * half_link
        + _diode_extra(outer.reverse, outer.on, t.outer_C, c.opposite_C[rise], off_A[rise])
    )
    clamp_J = 0.5 * recovered_C * half_link
    # active -> zero: the outer switch opens, an inner one closes, against the outer body diode where hard
    outer_J = outer_J + outer.turn_off.at(current_A=off_A[fall], voltage_V=half_link, junction_C=t.outer_C)
    inner_J = (
        inner_J
        + inner.turn_on.at(current_A=on_A[fall], voltage_V=half_link, junction_C=t.inner_C)
        + residual_energy(
            [outer.capacitance], [inner.capacitance, clamp.capacitance], half_link, missing[fall]
        )
        + outer.recovery.at(current_A=on_A[fall], junction_C=t.outer_C) * half_link
        + _diode_extra(outer.reverse, outer.on, t.outer_C, c.same_C[fall], on_A[fall])
    )
    junction = low.capacitance
    edges_J = (
        low.turn_off.at(current_A=off_A[2:], voltage_V=V2_V, junction_C=t.secondary_C)
        + low.turn_on.at(current_A=on_A[2:], voltage_V=V2_V, junction_C=t.secondary_C)
        + low.recovery.at(current_A=on_A[2:], junction_C=t.secondary_C) * V2_V
        + residual_energy([junction], [junction], V2_V, missing[2:])
        + _diode_extra(low.reverse, low.on, t.secondary_C, c.opposite_C[2:], off_A[2:])
        + _diode_extra(low.reverse, low.on, t.secondary_C, c.same_C[2:], on_A[2:])
    )
    return {
        "primary_outer_switching": np.asarray(2 * rate * outer_J),
        "primary_inner_switching": np.asarray(2 * rate * inner_J),
        "primary_clamp_recovery": np.asarray(2 * rate * clamp_J),
        "secondary_switching": np.sum(rate * edges_J, axis=0),
    }
