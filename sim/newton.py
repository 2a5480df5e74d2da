r"""Newton's rule for an orbit and the phase of its power, at all points at once.

For start current, four delays and, where a power is demanded, the phase, there are six equations

.. math:: i(T_h) + i(0) = 0, \qquad D_k(i(t_k)) - d_k = 0, \qquad \langle n v_s i \rangle - P = 0

The Jacobian is that of the lossless link, in which a later flip of a step of J volts takes J/L from the current
afterwards, with the derivatives that the dead times hand back; drops are small against voltages, so it is right to a
few per cent and the error falls by as much a step. Where dead times bend, steps are halved.
"""

from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from numpy.typing import NDArray

from sim.orbit import FINE, NEAR, SHIFT, Accuracy, Orbit, Sweep, bridge_power_W
from sim.stacking import own_rows
from sim.waveform import Circuit

Array = NDArray[np.float64]

_NEWTON = 14
_FURTHEST = 0.08  # Th that a phase may move in a step
_LEAST_W = 10.0  # scale of the tolerance for small powers
_LOST = 4  # steps in a row that came no nearer: a point whose power is out of reach, or one for a bracket
_ROOMY = 0.6  # of the points in work: with fewer left they move to arrays of their own


@dataclass(frozen=True, slots=True, kw_only=True)
class Demand:
    """A power into the ideal secondary bridge (N,), and the phases (N,) to look between."""

    power_W: Array
    lowest: Array
    highest: Array

    def take(self, chosen: NDArray[np.intp]) -> Self:
        """Some of the points."""
        return replace(
            self, power_W=self.power_W[chosen], lowest=self.lowest[chosen], highest=self.highest[chosen]
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class Effort:
    """Rounds of Newton's rule at most, and how many points may be left open sooner."""

    rounds: int = _NEWTON
    left_open: int = 0


@dataclass(frozen=True, slots=True, kw_only=True)
class _Response:
    """What a small change does to the rest of a half period: of the start by 1 A, then of each leg's flip by 1 Th.

    ``at_edges`` (5, 4, N) is the change of the current at each edge, ``at_end`` (5, N) that at the end, ``power_W``
    (5, N) that of the mean power.
    """

    at_edges: Array
    at_end: Array
    power_W: Array

    @classmethod
    def of(cls, circuit: Circuit, sweep: Sweep) -> "_Response":
        pieces, steps, Th = sweep.pieces, sweep.steps, circuit.half_period_s
        decay, length = pieces.decay_per_s, pieces.duration_s
        each = decay.shape[0] // 5
        # what passes a stretch decays, and is scaled by the slopes' ratio where a zero crossing or a bend moves
        slope = pieces.slope_A_per_s
        ends = pieces.slope_at(pieces.end_A, length)[:-1]
        scaled = np.ones_like(slope)
        used = (length[1:] > 0) & (np.arange(1, 5 * each) % each != 0)[:, None]
        before, behind = ends, slope[1:]
        if pieces.secondary_sign is not None:  # the magnetizing current that is met moves
            met = np.asarray(pieces.meets_A_per_s)[1:]
            before, behind = before - met, behind - met
        scaled[1:] = np.where(used, behind / np.where(used & (before != 0), before, 1.0), 1.0)
        passed = np.cumprod(scaled.reshape(5, each, -1), axis=1)
        kept = np.exp(-np.sum((decay * length).reshape(5, each, -1), axis=1)) * passed[:, -1]
        share = steps.nvs_V * (steps.duration_s / Th) * np.sqrt(np.abs(kept))
        after = (ends[each - 1 :: each] - slope[each::each]) * Th
        # changes (second axis) by flips in order, as they are when a stretch (first axis) begins
        there = np.zeros((5, 5, Th.size))
        there[0, 0], power = 1.0, np.zeros((5, Th.size))
        for k in range(5):
            if k:
                there[k, :k] = there[k - 1, :k] * kept[k - 1]
                there[k, k] = after[k - 1]
            power[: k + 1] += there[k, : k + 1] * share[k]
        view = sweep.view
        assert view is not None
        (within,) = own_rows(view.piece, passed.reshape(5 * each, -1))
        at_edges = np.take_along_axis(there, view.stretch[:, None], axis=0) * within[:, None]
        order = np.concatenate([np.zeros_like(steps.rank[:1]), steps.rank + 1])
        at_end, power = own_rows(order, there[4] * kept[4], power)
        return cls(
            at_edges=np.take_along_axis(np.swapaxes(at_edges, 0, 1), order[:, None], axis=0),
            at_end=at_end,
            power_W=power,
        )


def jacobian(circuit: Circuit, sweep: Sweep, *, regulated: bool) -> Array:
    """Derivatives of gap, delays and power (rows) to the state, shape (6, 6, N)."""
    steps, view, Th = sweep.steps, sweep.view, circuit.half_period_s
    assert view is not None
    matrix, response = np.zeros((6, 6, Th.size)), _Response.of(circuit, sweep)
    matrix[0, :5] = response.at_end
    matrix[0, 0] += 1.0
    delays = response.at_edges * (view.delay_per_A / Th)
    matrix[1:5, :5] = np.swapaxes(delays, 0, 1)
    matrix[1:5, 5] = delays[3] + delays[4] + view.delay_per_phase / Th
    for k in range(1, 5):
        matrix[k, k] -= 1.0
    if not regulated:
        matrix[5, 5] = 1.0
        return matrix
    each = sweep.pieces.current_A.shape[0] // 5
    (current,) = own_rows(steps.rank, sweep.pieces.current_A[each::each])
    matrix[0, 5] = response.at_end[3] + response.at_end[4]
    matrix[5, :5] = response.power_W
    matrix[5, 1:5] -= SHIFT * steps.jump_V * current
    matrix[5, 5] = matrix[5, 3] + matrix[5, 4]
    return matrix


@dataclass(slots=True, kw_only=True)
class _Work:
    """Points in work: their numbers, circuit, edges, demand, states, and how far each step is trusted.

    ``last`` and ``best`` are measures of what a sweep missed, ``off`` (6, N) is that itself; ``idle`` counts the steps
    since it became less.
    """

    rows: NDArray[np.intp]
    circuit: Circuit
    edges: Array
    demand: Demand | None
    accuracy: Accuracy
    state: Array
    trust: Array
    last: Array
    best: Array
    idle: Array
    off: Array
    done: NDArray[np.bool_]

    @classmethod
    def of(
        cls, circuit: Circuit, edges: Array, state: Array, demand: Demand | None, accuracy: Accuracy
    ) -> "_Work":
        """All points, before the first step."""
        size = state.shape[1]
        return cls(
            rows=np.arange(size), circuit=circuit, edges=edges, demand=demand, accuracy=accuracy, state=state.copy(),
            trust=np.ones(size), last=np.full(size, np.inf), best=np.full(size, np.inf), idle=np.zeros(size),
            off=np.zeros_like(state), done=np.zeros(size, dtype=bool),
        )  # fmt: skip

    def busy(self) -> NDArray[np.bool_]:
        """Points neither done nor lost; one without a demand is never lost."""
        return ~self.done if self.demand is None else ~self.done & (self.idle < _LOST)

    def narrowed(self) -> "_Work":
        """What is left, in arrays of its own."""
        left = np.flatnonzero(self.busy())
        return _Work(
            rows=self.rows[left], circuit=self.circuit.take(left), edges=self.edges.take(left, axis=1),
            demand=None if self.demand is None else self.demand.take(left), accuracy=self.accuracy,
            state=self.state.take(left, axis=1), trust=self.trust[left], last=self.last[left], best=self.best[left],
            idle=self.idle[left], off=self.off.take(left, axis=1), done=self.done[left],
        )  # fmt: skip

    def judge(self, sweep: Sweep) -> None:
        """Which points a sweep satisfies, and by what it misses the others."""
        circuit, demand = self.circuit, self.demand
        off = np.concatenate([sweep.gap_A[None], sweep.late, np.zeros((1, self.rows.size))])
        self.done = sweep.closes(self.state[0], self.accuracy)
        unit_A = circuit.V1_V * circuit.half_period_s / circuit.inductance_H
        size = np.abs(off[0]) / unit_A + np.sum(np.abs(sweep.late), axis=0)
        if demand is not None:
            off[5] = bridge_power_W(sweep.pieces) - demand.power_W
            scale_W = np.maximum(np.abs(demand.power_W), _LEAST_W)
            self.done &= np.abs(off[5]) <= self.accuracy.power * scale_W
            size = size + np.abs(off[5]) / (unit_A * circuit.nV2_V)
        self.trust = np.where(size > 0.7 * self.last, 0.5 * self.trust, np.minimum(2.0 * self.trust, 1.0))
        self.idle = np.where(size > 0.7 * self.best, self.idle + 1.0, 0.0)
        self.last, self.best, self.off = size, np.minimum(size, self.best), off

    def move(self, sweep: Sweep) -> None:
        """A step of the points that are not done."""
        circuit, demand = self.circuit, self.demand
        matrix = np.moveaxis(jacobian(circuit, sweep, regulated=demand is not None), 2, 0)
        change = -_solved(matrix, self.off.T).T
        change *= np.where(self.done, 0.0, self.trust)
        ahead = self.state + change
        longest = circuit.dead_share
        ahead[1:5] = np.where(self.done, ahead[1:5], np.clip(ahead[1:5], 0.0, longest))
        if demand is not None:
            near = self.state[5] + np.clip(change[5], -_FURTHEST, _FURTHEST)
            ahead[5] = np.where(self.done, ahead[5], np.clip(near, demand.lowest, demand.highest))
        self.state = ahead


def _solved(matrix: Array, right: Array) -> Array:
    """Solutions (N, 6) of N systems; a singular one gives no step."""
    try:
        return np.asarray(np.linalg.solve(matrix, right[..., None])[..., 0])
    except np.linalg.LinAlgError:
        nudged = matrix + 1e-9 * np.abs(matrix).max(axis=(1, 2), keepdims=True) * np.eye(6)
        return np.asarray(np.linalg.solve(nudged, right[..., None])[..., 0])


def step_once(
    circuit: Circuit, edges: Array, state: Array, demand: Demand
) -> tuple[Array, Orbit, NDArray[np.bool_]]:
    """One step of Newton's rule: the state (6, N) ahead, the half period from ``state``, where that nearly meets it."""
    work = _Work.of(circuit, edges, state, demand, NEAR)
    sweep = Sweep.of(circuit, edges, state)
    work.judge(sweep)
    work.move(sweep)
    return work.state, sweep.orbit(state, NEAR), work.done


def settle(
    circuit: Circuit,
    edges: Array,
    state: Array,
    demand: Demand | None,
    *,
    accuracy: Accuracy = FINE,
    effort: Effort = Effort(),
) -> tuple[Array, Orbit, NDArray[np.bool_]]:
    """Newton's rule from ``state`` (6, N): start current in A, delays and phase in Th.

    Returns the state, the orbit there, and where everything is met to the ``accuracy`` with no more than an ``effort``.
    ``edges`` (4, N) are those at phase 0; without a demand the phase stays.
    """
    size, work = state.shape[1], _Work.of(circuit, edges, state, demand, accuracy)
    whole, met, orbit = state.copy(), np.zeros(size, dtype=bool), None
    for turn in range(effort.rounds):
        last = turn == effort.rounds - 1
        sweep = Sweep.of(work.circuit, work.edges, work.state, sloped=not last)
        work.judge(sweep)
        whole[:, work.rows], met[work.rows] = work.state, work.done
        part = sweep.orbit(work.state, accuracy)
        orbit = part if orbit is None or work.rows.size == size else orbit.renewed(work.rows, part)
        busy = np.count_nonzero(work.busy())
        if last or busy <= effort.left_open:
            break
        work.move(sweep)
        if busy < _ROOMY * work.rows.size:
            work = work.narrowed()
    assert orbit is not None
    return whole, orbit, met
