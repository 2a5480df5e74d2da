"""The dead times of an orbit's edges: which of them meet, what drives each, and what the link makes of it.

Edges closer than a dead time meet: their legs swing in one circuit and are solved together (:mod:`sim.swings`), from
the current where the first of them opens. All is seen in the frame in which that leg's square wave rises.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from numpy.typing import NDArray

from sim.commutation import Commutation, Curves, Drops, Meeting
from sim.pieces import Pieces
from sim.soft_switching import CURVE_POINTS
from sim.stacking import own_rows
from sim.swings import commutate
from sim.waveform import Circuit, Steps, half_wave

Array = NDArray[np.float64]
Index = NDArray[np.intp]

_SECONDARY = np.array([False, False, True, True])
_FEW = 600  # pairs that cost no more as larger groups
_NUDGE_A, _NUDGE = 1e-6, 1e-7  # in current and in Th, to see what legs that meet make of it


def wrapped(x: Array) -> Array:
    """A distance in Th within a period, from -1 to 1."""
    return x - 2.0 * np.floor(0.5 * x + 0.5)


@dataclass(frozen=True, slots=True, kw_only=True)
class EdgeView:
    """What the edges of N orbits see, arrays (4, N).

    ``stretch`` is the one of the half period's five, ``piece`` the piece of all in which the first edge of those that
    meet lies; ``delay_per_A`` is how a delay in s moves with the link current there, ``delay_per_phase`` how it moves
    with a phase in Th while the rest of the orbit stays.
    """

    stretch: Index
    piece: Index
    delay_per_A: Array
    delay_per_phase: Array


def magnetizing_current(circuit: Circuit, flips: Array, time: Array) -> Array:
    """Triangle driven by n vs, in A, at ``time`` (..., N) in units of Th; zero mean by half-wave symmetry."""
    slope = circuit.nV2_V * circuit.half_period_s / (2 * circuit.magnetizing_H)
    total: Array = np.zeros_like(time)
    for flip in flips[2:]:
        # from -1/2 at the flip to 1/2 half a period later, and back
        total = total + (0.5 - np.abs(wrapped(time - flip + 1.0)))
    return slope * total


@dataclass(frozen=True, slots=True, kw_only=True)
class _Groups:
    """Edges that meet, arrays (4, N): the first of an edge's group, how far behind it the edge lies in Th.

    ``order`` sorts the edges by place; ``size`` is how many edges the group has that an edge is the first of, else 0.
    """

    order: Index
    first: Index
    behind: Array
    size: Index

    @classmethod
    def of(cls, place: Array, dead: Array) -> Self:
        """Groups of edges at places of the half period, with dead times (N,) in Th."""
        order = np.argsort(place, axis=0, kind="stable")
        (sorted_,) = own_rows(order, place)
        gap = sorted_ - np.roll(sorted_, 1, axis=0)
        gap[0] += 1.0
        joined = gap < dead
        first, behind = np.tile(np.arange(4)[:, None], place.shape[1:]), np.zeros_like(place)
        size = np.ones_like(first)
        some = np.flatnonzero(np.any(joined, axis=0))
        if some.size:
            joined, gap, own = (x.take(some, axis=1) for x in (joined, gap, order))
            joined[0] &= ~np.all(joined, axis=0)
            leads, lag = own.copy(), np.zeros_like(gap)
            for k in (*range(4), *range(4)):  # twice, for groups that span the half period's end
                leads[k] = np.where(joined[k], leads[k - 1], own[k])
                lag[k] = np.where(joined[k], lag[k - 1] + gap[k], 0.0)
            for values, part in ((first, leads), (behind, lag)):
                at = values.take(some, axis=1)
                np.put_along_axis(at, own, part, axis=0)
                values[:, some] = at
            size[:, some] = np.sum(first[None, :, some] == np.arange(4)[:, None, None], axis=1)
        return cls(order=order, first=first, behind=behind, size=size)

    def legs(self, least: int, most: int) -> tuple[Index, Index, NDArray[np.bool_]]:
        """Legs (most, K) of the groups of so many, the first to open first, their points (K,), and which there are.

        Where a group has fewer legs its first one stands for those that are missing.
        """
        lead, points = np.nonzero((self.size >= least) & (self.size <= most))
        if most == 1:
            return lead[None], points, np.ones((1, lead.size), dtype=bool)
        count = np.arange(most)[:, None]
        there = count < self.size[lead, points]
        place = np.argmax(self.order.take(points, axis=1) == lead, axis=0)
        return self.order[(place + np.where(there, count, 0)) % 4, points], points, there

    def batches(self) -> Iterator[tuple[int, int]]:
        """Least and most legs of groups that are solved at once: many pairs by themselves, few with larger groups."""
        yield 1, 1
        pairs = np.count_nonzero(self.size == 2)
        larger = int(np.max(self.size, initial=1))
        if pairs > _FEW or larger <= 2:
            yield 2, 2
        if larger > 2:
            yield (3 if pairs > _FEW else 2), larger


@dataclass(frozen=True, slots=True, kw_only=True)
class _Moment:
    """The rest of the circuit when each edge comes, in the frame in which it rises; (4, N), ``level`` (4, 4, N).

    ``level`` of a leg (first axis) is -1 or 1.
    """

    link_A: Array
    magnetizing_A: Array
    level: Array


def commutations(
    circuit: Circuit, edges: Array, flips: Array, steps: Steps, pieces: Pieces, *, sloped: bool
) -> tuple[Commutation, EdgeView | None]:
    """The dead times of the four edges (4, N), given the orbit's flips and pieces; how they move where ``sloped``."""
    place, parity = half_wave(edges)
    stretch = np.sum(steps.place[:, None] < place[None], axis=0)
    link, piece, slope = _current_at(pieces, stretch, place * circuit.half_period_s)
    moment = _Moment(
        link_A=parity * link,
        magnetizing_A=magnetizing_current(circuit, flips, edges),
        level=np.where(wrapped(flips[:, None] - edges[None, :]) > 0, -1.0, 1.0),
    )
    groups = _Groups.of(place, circuit.dead_share)
    found, per_phase = Commutation.empty(*edges.shape), np.zeros_like(edges)
    curves = Curves.of(circuit.curves)
    for least, most in groups.batches():
        legs, points, there = groups.legs(least, most)
        if points.size:
            meeting = _meeting(circuit, edges, groups, moment, (legs, points, there))
            half_period_s = circuit.half_period_s[points] if sloped else None
            part, change = _solved(meeting, _SECONDARY[legs], curves, half_period_s)
            if not np.all(there):
                leg, group = np.nonzero(there)
                part, change, legs, points = (
                    part.edge((leg, group)),
                    change[leg, group],
                    legs[leg, group],
                    points[group],
                )
            places = legs * edges.shape[1] + points
            found.put(places, part)
            per_phase.reshape(-1)[places] = change
    if not sloped:
        return found, None
    first = groups.first
    sign, slope, stretch, piece = own_rows(first, parity, slope * parity, stretch, piece)
    per_phase += np.where(_SECONDARY[first], found.delay_per_A * slope * circuit.half_period_s, 0.0)
    view = EdgeView(
        stretch=stretch,
        piece=piece,
        delay_per_A=found.delay_per_A * sign,
        delay_per_phase=per_phase,
    )
    return found, view


def _meeting(
    circuit: Circuit,
    edges: Array,
    groups: _Groups,
    moment: _Moment,
    members: tuple[Index, Index, NDArray[np.bool_]],
) -> Meeting:
    """What drives groups of legs (m, K) at points (K,); what only stands for a leg moves nothing."""
    legs, points, there = members
    lead, secondary, count = legs[0], _SECONDARY[legs], circuit.V1_V.size
    first, every = lead * count + points, legs * count + points  # places in arrays (4, N)
    V1, nV2, L, Lm = (
        x[points] for x in (circuit.V1_V, circuit.nV2_V, circuit.inductance_H, circuit.magnetizing_H)
    )
    apart = wrapped(edges.take(every) - edges.take(first))
    rises = np.where(np.abs(apart) < 0.5, 1.0, -1.0) * there
    level = moment.level.reshape(4, -1).take(first, axis=1)  # a copy: of the legs that move nothing stays
    level[legs, np.arange(points.size)] = 0.0
    vp, nvs = 0.5 * V1 * (level[0] + level[1]), 0.5 * nV2 * (level[2] + level[3])
    shunted = secondary / Lm
    push = rises * np.where(secondary, -0.5 * nV2, 0.5 * V1)
    link_A, magnetizing_A = moment.link_A.take(first), moment.magnetizing_A.take(first)
    drops, resistance, behind = _drops(circuit, points, level, secondary, rises, (link_A, magnetizing_A))
    return Meeting(
        current_A=link_A - secondary * magnetizing_A,
        per_current=rises * np.where(secondary, circuit.turns_ratio[points], -1.0),
        outside_A_per_s=(vp - nvs + behind * magnetizing_A) / L - shunted * nvs,
        coupling_A_per_s=push / L + shunted[:, None] * (secondary * push),
        drops=tuple(drops),
        magnetizing_A=secondary[0] * magnetizing_A,
        shunted_A=magnetizing_A,
        damping_per_s=resistance / L,
        eddy_s=np.broadcast_to(circuit.eddy_s, circuit.V1_V.shape)[points],
        charge_C=circuit.charge_C.take(every),
        curve=(legs * circuit.curves.shape[1] + circuit.curve[points]) * CURVE_POINTS,
        opens_s=groups.behind.take(every) * circuit.half_period_s[points],
        dead_time_s=circuit.dead_time_s[points],
    )


def _drops(
    circuit: Circuit,
    points: Index,
    level: Array,
    secondary: NDArray[np.bool_],
    rises: Array,
    currents: tuple[Array, Array],
) -> tuple[list[Drops], Array, Array]:
    """Thresholds of both bridges' states, all resistance and the secondary's (K,) before anything moves.

    ``currents`` are the link current and the magnetizing one.
    """  # fmt: skip
    bridges = [(~secondary, level[:2], 1.0, (circuit.forward, circuit.reverse, circuit.zero))]
    if circuit.secondary is not None:
        bridges.append((secondary, level[2:], -1.0, tuple(circuit.secondary)))
    link_A, magnetizing_A = currents
    drops, resistances, L = [], [], circuit.inductance_H[points]
    for (own, stand, sign, states), i in zip(bridges, (link_A, link_A - magnetizing_A), strict=False):
        per_leg, standing = 0.5 * sign * own * rises, 0.5 * sign * (stand[0] + stand[1])
        forward, reverse, zero = (x.take(points, axis=1) for x in states)
        drops.append(Drops.of(standing, per_leg, forward[0] / L, reverse[0] / L, zero[0] / L))
        before = standing - np.sum(per_leg, axis=0)
        live = np.where(before * i > 0, forward[1], reverse[1])
        resistances.append(zero[1] + np.abs(before) * (live - zero[1]))
    if circuit.secondary is None:
        return drops, resistances[0], np.broadcast_to(circuit.behind_Ohm, circuit.V1_V.shape)[points]
    return drops, resistances[0] + resistances[1], resistances[1]


def _solved(
    meeting: Meeting, secondary: NDArray[np.bool_], curves: Curves, half_period_s: Array | None
) -> tuple[Commutation, Array]:
    """The dead times (m, K) of groups, and how their delays in s move, per Th, as the bridges move apart.

    Without Th (K,) nothing is asked about what moves.

    Legs that meet are solved three times at once: as they are, at another current, and, where they are of both
    bridges, with those later that do not belong to the first one's.
    """
    if half_period_s is None or len(secondary) == 1:
        sloped = half_period_s is not None
        return commutate(meeting, curves, sloped=sloped), np.zeros_like(meeting.current_A)
    apart = secondary != secondary[0]
    size, mixed = half_period_s.size, np.flatnonzero(np.any(apart, axis=0))
    rows = np.concatenate([np.arange(size), np.arange(size), mixed])
    nudge_A = np.zeros(rows.size)
    nudge_A[size : 2 * size] = _NUDGE_A
    later_s = np.zeros((len(secondary), rows.size))
    later_s[:, 2 * size :] = apart.take(mixed, axis=1) * (_NUDGE * half_period_s[mixed])
    whole = commutate(meeting.take(rows).nudged(current_A=nudge_A, later_s=later_s), curves)
    found, (richer, later) = (
        whole.edge((slice(None), slice(size))),
        np.split(whole.delay_s[:, size:], [size], axis=1),
    )
    per_phase = np.zeros_like(richer)
    way = np.where(secondary[0, mixed], -1.0, 1.0)
    per_phase[:, mixed] = way * (later - found.delay_s[:, mixed]) / _NUDGE
    return replace(found, delay_per_A=(richer - found.delay_s) / _NUDGE_A), per_phase


def _current_at(pieces: Pieces, stretch: Index, time_s: Array) -> tuple[Array, Index, Array]:
    """Link current (4, N) at times in known stretches, the pieces in which they lie, and its slope in A/s."""
    each = pieces.start_s.shape[0] // 5
    piece = each * stretch
    for m in range(1, each):
        row = each * stretch + m
        starts, lengths = own_rows(row, pieces.start_s, pieces.duration_s)
        piece = np.where((lengths > 0) & (starts <= time_s), row, piece)
    begin, i, first, decay, share, rise = own_rows(
        piece, pieces.start_s, pieces.current_A, pieces.slope_A_per_s, pieces.decay_per_s, pieces.share,
        pieces.magnetizing_A_per_s,
    )  # fmt: skip
    line = share * rise
    t = time_s - begin
    x = np.maximum(decay * t, 1e-300)
    curved = (first - line) * t * (-np.expm1(-x) / x)
    return np.asarray(i + line * t + curved), piece, np.asarray(first - decay * curved)
