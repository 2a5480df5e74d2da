"""The dead time of each edge of an orbit: what drives it, and what the link makes of it.

Every edge is seen in the frame in which its square wave rises. The driving current of a primary leg is the link
current into it, that of a secondary leg n times the link current less the magnetizing one.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from sim.soft_switching import CURVE_POINTS, Commutation, Curves, Drive, commutate, steps_of
from sim.waveform import Circuit, Pieces, Steps, half_wave

Array = NDArray[np.float64]

_NARROWEST = 1e-5  # of a ramp, in Th: a quarter of a nanosecond at 20 kHz
_OTHERS = ~np.eye(4, dtype=bool)[:, :, None]


def wrapped(x: Array) -> Array:
    """A distance in Th within a period, from -1 to 1."""
    return x - 2.0 * np.floor(0.5 * x + 0.5)


@dataclass(frozen=True, slots=True, kw_only=True)
class EdgeView:
    """What the edges of N orbits see, edges along the last axis but one.

    ``stretch`` (4, N) is the one of the half period's five in which an edge lies, ``piece`` (4, N) the piece of all;
    ``link_slope_A`` (4, N) is the link current's slope at the edge per Th,
    ``turns`` (4, N) the driving current per link current.
    ``delay_per_flip`` (4, 4, N) is how a delay moves with a flip that falls into its dead time.
    """

    stretch: NDArray[np.intp]
    piece: NDArray[np.intp]
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
    link, piece = _current_at(pieces, stretch, place * circuit.half_period_s)
    link = parity * link
    of_secondary = n * (link[2:] - magnetizing_current(circuit, edges, edges[2:]))
    current = np.concatenate([-link[:2], of_secondary])
    drive, meeting = _drive(circuit, wrapped(flips[:, None] - edges[None, :]), flips - edges)
    current = current + meeting.current_A
    first = (np.arange(4)[:, None] * circuit.curves.shape[1] + circuit.curve) * CURVE_POINTS
    curves = Curves(values=circuit.curves.ravel(), first=first)
    commutation = commutate(current, drive, circuit.dead_time_s, circuit.charge_C, curves)
    across_V = np.take_along_axis(steps.vp_V - steps.nvs_V, stretch, axis=0)
    local_H = circuit.inductance_H * np.take_along_axis(pieces.relative_L, piece, axis=0)
    view = EdgeView(
        stretch=stretch,
        piece=piece,
        link_slope_A=across_V * (circuit.half_period_s / local_H),
        turns=np.concatenate([-parity[:2], n * parity[2:]]),
        delay_per_flip=meeting.per_flip_A * commutation.delay_per_A,
    )
    return commutation, view


def _current_at(pieces: Pieces, stretch: NDArray[np.intp], time_s: Array) -> tuple[Array, NDArray[np.intp]]:
    """Link current (4, N) at times in known stretches, and the pieces in which they lie."""
    each = pieces.start_s.shape[0] // 5
    piece = each * stretch
    for m in range(1, each):
        row = each * stretch + m
        starts, lengths = (np.take_along_axis(x, row, axis=0) for x in (pieces.start_s, pieces.duration_s))
        piece = np.where((lengths > 0) & (starts <= time_s), row, piece)
    begin, i, w, a = (
        np.take_along_axis(x, piece, axis=0)
        for x in (pieces.start_s, pieces.current_A, pieces.drive_A_per_s, pieces.decay_per_s)
    )
    t = time_s - begin
    x = np.maximum(a * t, 1e-300)
    return np.asarray(i + (w - a * i) * t * (-np.expm1(-x) / x)), piece


@dataclass(frozen=True, slots=True, kw_only=True)
class _Meeting:
    """What edges that meet do to the driving currents: at the edge (4, N), in A, and per Th that a flip comes later."""

    current_A: Array
    per_flip_A: Array


@dataclass(frozen=True, slots=True, kw_only=True)
class _Ramp:
    """The swing of another leg as a ramp: ``middle`` from the edge, ``half`` its half width, in Th.

    It carries the volt-seconds of the instant step, begins no earlier than its own edge and ends within its dead time:
    what an edge sees of it moves smoothly when the two pass each other.
    """

    middle: Array
    half: Array

    def passed(self, time: Array) -> Array:
        """Share of the swing that is done at a time."""
        return np.clip((time - self.middle + self.half) / (2.0 * self.half), 0.0, 1.0)

    def integral(self, time: Array) -> Array:
        """Integral of that share up to a time."""
        share = self.passed(time)
        return self.half * share**2 + np.maximum(time - self.middle - self.half, 0.0)


def _drive(circuit: Circuit, ahead: Array, delay: Array) -> tuple[Drive, _Meeting]:
    """What moves the driving currents of edges (second axis) whose legs' rises (first axis) lie ``ahead``."""
    half = 0.5 * np.stack([circuit.V1_V, circuit.V1_V, circuit.nV2_V, circuit.nV2_V])
    link = np.array([1.0, 1.0, -1.0, -1.0])[:, None] / circuit.inductance_H * half
    shunt = np.array([0.0, 0.0, -1.0, -1.0])[:, None] / circuit.magnetizing_H * half
    primary, secondary = -link, circuit.turns_ratio * (link + shunt)
    # d(driving current)/dt at edge e while leg l is up: of a primary edge, of a secondary edge
    gain = np.stack([primary, secondary])
    up = 1.0 - 2.0 * (ahead > 0)
    own = np.concatenate([primary[:2], secondary[2:]])
    base = np.stack([np.sum(gain[k // 2] * up[:, k], axis=0) - own[k] * up[k, k] for k in range(4)])
    dead = circuit.dead_time_s / circuit.half_period_s
    width = np.maximum(np.minimum(delay, dead - delay), _NARROWEST)
    # the nearest flip of each leg: its rise, or its fall half a period from there
    falls = np.abs(ahead) > 0.5
    middle = ahead - np.where(falls, np.sign(ahead), 0.0)
    meets = (middle < dead + width[:, None]) & (middle > -width[:, None]) & (dead > 0)
    chosen = np.nonzero(meets & _OTHERS)
    drive = Drive(outside_A_per_s=base, own_A_per_s=own)
    meeting = _Meeting(current_A=np.zeros_like(base), per_flip_A=np.zeros_like(ahead))
    if not chosen[0].size:
        return drive, meeting
    legs, targets, points = chosen
    ramp, before = _Ramp(middle=middle[chosen], half=width[legs, points]), middle[chosen] > 0
    kick = np.where(falls[chosen], -2.0, 2.0) * gain[targets // 2, legs, points]
    half_period_s = circuit.half_period_s[points]
    ends = steps_of(dead[points])
    mean = np.diff(ramp.integral(ends), axis=0) / np.diff(ends, axis=0) - ~before
    early = ramp.integral(np.zeros_like(half_period_s)) - np.maximum(-ramp.middle, 0.0)
    np.add.at(meeting.current_A, (targets, points), kick * half_period_s * early)
    done = ramp.passed(np.zeros_like(half_period_s))
    later = done + (1.0 - done) * np.clip(1.0 - ramp.middle / dead[points], 0.0, 1.0)
    meeting.per_flip_A[chosen] = kick * half_period_s * (~before - later)
    kicked, which = np.unique(targets * dead.size + points, return_inverse=True)
    kicks = np.zeros((mean.shape[0], kicked.size))
    for leg in range(4):  # of one leg, no place comes twice
        rows = legs == leg
        kicks[:, which[rows]] += (kick * mean)[:, rows]
    return replace(drive, kicked=kicked, kicks_A_per_s=kicks), meeting
