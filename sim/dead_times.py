"""The dead time of each edge of an orbit: what drives it, and what the link makes of it.

Every edge is seen in the frame in which its square wave rises. The driving current of a primary leg is the link
current into it, that of a secondary leg n times the link current less the magnetizing one.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sim.soft_switching import CURVE_POINTS, Commutation, Curves, Drive, commutate, steps_of
from sim.waveform import Circuit, Pieces, Steps, half_wave

Array = NDArray[np.float64]

_OTHERS = ~np.eye(4, dtype=bool)[:, :, None]


def wrapped(x: Array) -> Array:
    """A distance in Th within a period, from -1 to 1."""
    return x - 2.0 * np.floor(0.5 * x + 0.5)


@dataclass(frozen=True, slots=True, kw_only=True)
class EdgeView:
    """What the edges of N orbits see, edges along the last axis but one.

    ``stretch`` (4, N) is the one of the half period's five in which an edge lies, ``crossed`` (4, N) whether the
    current has crossed zero in it before; ``link_slope_A`` (4, N) is the link current's slope at the edge per Th,
    ``turns`` (4, N) the driving current per link current.
    ``delay_per_flip`` (4, 4, N) is how a delay moves with a flip that falls into its dead time.
    """

    stretch: NDArray[np.intp]
    crossed: NDArray[np.bool_]
    link_slope_A: Array
    turns: Array
    delay_per_flip: Array


def magnetizing_current(circuit: Circuit, edges: Array, time: Array) -> Array:
    """Triangle driven by n vs, in A, at ``time`` (..., N) in units of Th; zero mean by half-wave symmetry."""
    slope = circuit.nV2_V * circuit.half_period_s / (2 * circuit.magnetizing_H)
    total: Array = np.zeros_like(time)
    for edge in edges[2:]:
        # from -1/2 at the edge to 1/2 half a period later, and back
        total = total + (0.5 - np.abs(wrapped(time - edge + 1.0)))
    return slope * total


def commutations(
    circuit: Circuit, edges: Array, flips: Array, steps: Steps, pieces: Pieces
) -> tuple[Commutation, EdgeView]:
    """The dead times of the four edges (4, N), given the orbit's flips and pieces."""
    place, parity = half_wave(edges)
    stretch = np.sum(steps.place[:, None] < place[None], axis=0)
    n = circuit.turns_ratio
    link, crossed = _current_at(pieces, stretch, place * circuit.half_period_s)
    link = parity * link
    of_secondary = n * (link[2:] - magnetizing_current(circuit, edges, edges[2:]))
    current = np.concatenate([-link[:2], of_secondary])
    ahead = wrapped(flips[:, None] - edges[None, :])  # next rise of leg l seen from edge e
    drive, weight = _drive(circuit, ahead)
    first = (np.arange(4)[:, None] * circuit.curves.shape[1] + circuit.curve) * CURVE_POINTS
    curves = Curves(values=circuit.curves.ravel(), first=first)
    commutation = commutate(current, drive, circuit.dead_time_s, circuit.charge_C, curves)
    across_V = np.take_along_axis(steps.vp_V - steps.nvs_V, stretch, axis=0)
    view = EdgeView(
        stretch=stretch,
        crossed=crossed,
        link_slope_A=across_V * (circuit.half_period_s / circuit.inductance_H),
        turns=np.concatenate([-parity[:2], n * parity[2:]]),
        delay_per_flip=-weight * commutation.delay_per_A,
    )
    return commutation, view


def _current_at(pieces: Pieces, stretch: NDArray[np.intp], time_s: Array) -> tuple[Array, NDArray[np.bool_]]:
    """Link current (4, N) at times in known stretches, and whether it has crossed zero there before."""
    later = 2 * stretch + 1
    starts, lengths = (np.take_along_axis(x, later, axis=0) for x in (pieces.start_s, pieces.duration_s))
    crossed = (lengths > 0) & (starts <= time_s)
    piece = later - 1 + crossed
    begin, i, w, a = (
        np.take_along_axis(x, piece, axis=0)
        for x in (pieces.start_s, pieces.current_A, pieces.drive_A_per_s, pieces.decay_per_s)
    )
    t = time_s - begin
    x = np.maximum(a * t, 1e-300)
    return np.asarray(i + (w - a * i) * t * (-np.expm1(-x) / x)), crossed


def _drive(circuit: Circuit, ahead: Array) -> tuple[Drive, Array]:
    """What moves the driving currents, and by how much (A per Th) each flip does so when it comes later.

    The weight counts a flip by the share of the dead time that is left after it.
    """
    half = 0.5 * np.stack([circuit.V1_V, circuit.V1_V, circuit.nV2_V, circuit.nV2_V])
    link = np.array([1.0, 1.0, -1.0, -1.0])[:, None] / circuit.inductance_H * half
    shunt = np.array([0.0, 0.0, -1.0, -1.0])[:, None] / circuit.magnetizing_H * half
    primary, secondary = -link, circuit.turns_ratio * (link + shunt)
    # d(driving current)/dt at edge e while leg l is up: of a primary edge, of a secondary edge
    gain = np.stack([primary, secondary])
    down = ahead > 0
    up = 1.0 - 2.0 * down
    own = np.concatenate([primary[:2], secondary[2:]])
    base = np.stack([np.sum(gain[k // 2] * up[:, k], axis=0) - own[k] * up[k, k] for k in range(4)])
    # the next flip of another leg: up where it is down, down where it is up
    wait = ahead + ~down
    dead = circuit.dead_time_s / circuit.half_period_s
    chosen = np.nonzero((wait < dead) & _OTHERS)
    weight = np.zeros_like(ahead)
    if not chosen[0].size:
        return Drive(outside_A_per_s=base, own_A_per_s=own), weight
    legs, targets, points = chosen
    kick = -2.0 * up[chosen] * gain[targets // 2, legs, points]
    half_period_s = circuit.half_period_s[points]
    weight[chosen] = kick * half_period_s * (1.0 - wait[chosen] / dead[points])
    ends = steps_of(circuit.dead_time_s[points])
    after = np.clip((ends[1:] - wait[chosen] * half_period_s) / np.diff(ends, axis=0), 0.0, 1.0)
    kicked, which = np.unique(targets * dead.size + points, return_inverse=True)
    kicks = np.zeros((after.shape[0], kicked.size))
    for leg in range(4):  # of one leg, no place comes twice
        own_rows = legs == leg
        kicks[:, which[own_rows]] += (kick * after)[:, own_rows]
    return Drive(outside_A_per_s=base, own_A_per_s=own, kicked=kicked, kicks_A_per_s=kicks), weight
