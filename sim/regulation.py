"""The controller's job: the phase at which a demanded power arrives, on the rising branch.

Newton's rule on orbit and phase together (:mod:`sim.steady_state`) finds it nearly everywhere, from the lossless phase
or from a solution nearby. What it does not settle, or settles where power does not clearly rise, is looked for again in
a bracket: close to the most that can flow, and beyond it. Power to the primary is the mirror image, of phase and
power: the search runs in forward terms for both.
"""

from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from numpy.typing import NDArray

from sim.bracket import Bracketed, lowest_phase
from sim.piecewise import phase_for_share, power_share
from sim.steady_state import COARSE, FINE, SHIFT, Accuracy, Demand, Effort, Orbit, settle, step_once
from sim.waveform import Circuit, lossless_start_A

Array = NDArray[np.float64]

_POLISH = 3  # rounds that close what a search ends with
_FLAT = 0.42  # where the lossless power is within 3 % of its most, Newton's rule is not asked
_FEW_MORE = 0.1  # of the points for a bracket: so few that Newton's rule has not settled yet go with them
_MAY_FALL = 0.35  # a phase beyond which the power may fall: losses move the peak from 1/2 to no less
_BACK = 1e-3  # from such a phase, to see whether it does
_BACK_ROUNDS = 2  # of Newton's rule: so short a way is all but straight


@dataclass(frozen=True, slots=True, kw_only=True)
class Regulated:
    """Phase (N,) in units of Th, the orbit there, whether the power is reached, and the most that can be.

    ``limit`` is the size of the phase at the end of the rising branch on this side; ``most_W``, the size of the power
    there, is NaN where the power was reached without looking there.
    """

    phase: Array
    limit: Array
    orbit: Orbit
    reached: NDArray[np.bool_]
    most_W: Array

    def state(self) -> Array:
        """Start current, delays and phase, shape (6, N)."""
        return np.concatenate([self.orbit.start_A[None], self.orbit.delay, self.phase[None]])

    def take(self, chosen: NDArray[np.intp]) -> Self:
        """Some of the points, to start from again."""
        return replace(
            self,
            phase=self.phase[chosen],
            limit=self.limit[chosen],
            orbit=self.orbit.start_of(chosen),
            reached=self.reached[chosen],
            most_W=self.most_W[chosen],
        )

    def put(self, rows: NDArray[np.intp], part: "Regulated") -> None:
        """Renew some of the points, but for their pieces and commutations."""
        self.phase[rows], self.limit[rows] = part.phase, part.limit
        self.reached[rows], self.most_W[rows] = part.reached, part.most_W
        self.orbit.start_A[rows], self.orbit.delay[:, rows] = part.orbit.start_A, part.orbit.delay


def lossless_scale_W(circuit: Circuit) -> Array:
    """n V1 V2 / (2 fs Lk) in W, the unit of the lossless power; a quarter of it is the most that can flow."""
    return circuit.V1_V * circuit.nV2_V * circuit.half_period_s / circuit.inductance_H


def follow(circuit: Circuit, edges: Array, target_W: Array, near: Regulated) -> tuple[Regulated, Regulated]:
    """One step of Newton's rule from a solution nearby: what is there now, and where to go on.

    ``reached`` of the first tells where it is nearly settled already. Arguments are those of :func:`regulate`.
    """
    demand = _demand(circuit, edges, target_W, near.limit)
    ahead, orbit, met = step_once(circuit, edges, near.state(), demand)
    now = replace(near, orbit=orbit, reached=met)
    return now, replace(near, phase=ahead[5], orbit=replace(orbit, start_A=ahead[0], delay=ahead[1:5]))


def _demand(circuit: Circuit, edges: Array, target_W: Array, limit: Array) -> Demand:
    """The target, within the rising branch."""
    way = np.where(target_W < 0, -1.0, 1.0)
    ends = np.sort(np.stack([way * lowest_phase(circuit, edges, way), way * limit]), axis=0)
    return Demand(power_W=target_W, lowest=ends[0], highest=ends[1])


def regulate(
    circuit: Circuit,
    edges: Array,
    target_W: Array,
    *,
    warm: Regulated | None = None,
    rising: bool = False,
    accuracy: Accuracy = FINE,
) -> Regulated:
    """Solve the phase of the rising branch for a power into the ideal secondary bridge, the smallest one.

    Parameters
    ----------
    circuit, edges : Circuit, array (4, N)
        The circuit, and the edges at phase 0 in units of Th.
    target_W : array (N,)
        Power to reach; negative where it flows to the primary.
    warm : Regulated, optional
        A solution nearby.
    rising : bool
        That it lies on the rising branch is known: points that hardly move from there are not asked again.
    accuracy : Accuracy
        How well orbit and power have to be met.
    """
    way = np.where(target_W < 0, -1.0, 1.0)
    limit = np.full(way.size, 0.5) if warm is None else warm.limit.copy()
    most_W = np.full(way.size, np.nan) if warm is None else warm.most_W.copy()
    demand = _demand(circuit, edges, target_W, limit)
    state, doubtful = _start(circuit, edges, target_W, warm)
    asked, met = np.flatnonzero(~doubtful), np.zeros(way.size, dtype=bool)
    orbit: Orbit | None = None
    if asked.size == way.size:
        state, orbit, met = settle(circuit, edges, state, demand, accuracy=accuracy)
    elif asked.size:
        state[:, asked], part, met[asked] = settle(
            circuit.take(asked),
            edges.take(asked, axis=1),
            state.take(asked, axis=1),
            demand.take(asked),
            accuracy=accuracy,
            effort=Effort(left_open=int(_FEW_MORE * (way.size - asked.size))),
        )
        orbit = part.among(way.size, asked)
    asked_again = met if warm is None or not rising else met & (np.abs(state[5] - warm.phase) > 0.5 * _BACK)
    met[_falling(circuit, edges, state, target_W, among=asked_again)] = False
    again = np.flatnonzero(~met)
    if again.size:
        search = Bracketed.of(
            circuit.take(again), edges.take(again, axis=1), way[again], state.take(again, axis=1), accuracy
        )
        found = search.solve(way[again] * target_W[again])
        state[:, again], met[again], limit[again] = found.state, found.reached, found.limit
        most_W[again] = found.most_W
        orbit = found.farthest if orbit is None else orbit.renewed(again, found.farthest)
        reached = again[found.reached]
        if reached.size:
            state[:, reached], part, _ = settle(
                circuit.take(reached),
                edges.take(reached, axis=1),
                state.take(reached, axis=1),
                None,
                accuracy=accuracy,
                effort=Effort(rounds=_POLISH),
            )
            orbit = orbit.renewed(reached, part)
    assert orbit is not None
    return Regulated(phase=state[5], limit=limit, orbit=orbit, reached=met & orbit.closed, most_W=most_W)


def carried(circuit: Circuit, edges: Array, target_W: Array) -> NDArray[np.bool_]:
    """Whether any phase carries a power into the ideal secondary bridge, to a part in a thousand; not which, (N,).

    Arguments are those of :func:`regulate`.
    """
    way, limit = np.where(target_W < 0, -1.0, 1.0), np.full(target_W.size, 0.5)
    state, doubtful = _start(circuit, edges, target_W, None)
    asked, met = np.flatnonzero(~doubtful), np.zeros(way.size, dtype=bool)
    if asked.size:
        _, _, met[asked] = settle(
            circuit.take(asked),
            edges.take(asked, axis=1),
            state.take(asked, axis=1),
            _demand(circuit, edges, target_W, limit).take(asked),
            accuracy=COARSE,
            effort=Effort(left_open=int(_FEW_MORE * way.size)),
        )
    left = np.flatnonzero(~met)
    if left.size:
        search = Bracketed.of(
            circuit.take(left), edges.take(left, axis=1), way[left], state.take(left, axis=1), COARSE
        )
        met[left] = search.carries(way[left] * target_W[left])
    return met


def _falling(
    circuit: Circuit, edges: Array, state: Array, target_W: Array, among: NDArray[np.bool_]
) -> NDArray[np.intp]:
    """Which states (6, N) that carry their target lie beyond the peak: a little less phase carries more."""
    doubtful = np.flatnonzero(among & (np.abs(state[5]) > _MAY_FALL))
    if not doubtful.size:
        return doubtful
    before = state.take(doubtful, axis=1)
    before[5] -= np.copysign(_BACK, before[5])
    _, orbit, _ = settle(
        circuit.take(doubtful), edges.take(doubtful, axis=1), before, None, effort=Effort(rounds=_BACK_ROUNDS)
    )
    return doubtful[np.abs(orbit.output_power_W()) > np.abs(target_W[doubtful])]


def _start(
    circuit: Circuit, edges: Array, target_W: Array, warm: Regulated | None
) -> tuple[Array, NDArray[np.bool_]]:
    """A state (6, N) to start from, and where that is too near the peak for Newton's rule."""
    if warm is not None:
        return warm.state(), ~warm.reached
    way = np.where(target_W < 0, -1.0, 1.0)
    size = phase_for_share(way * target_W / lossless_scale_W(circuit), edges, way)
    state = np.zeros((6, way.size))
    state[5] = way * size
    state[0] = lossless_start_A(circuit, edges + SHIFT * state[5])
    return state, size > _FLAT


def spare_power(edges: Array, regulated: Regulated) -> Array:
    """About how much of its power (relative) each point could add before the end of its branch, (N,).

    Where the peak was not looked at it is that of the lossless curve with the delays of the solution.
    """
    way = np.where(regulated.phase < 0, -1.0, 1.0)
    delayed = edges + regulated.orbit.delay
    now = power_share(delayed + SHIFT * regulated.phase)[0]
    most = power_share(delayed + SHIFT * (0.5 * way))[0]
    with np.errstate(divide="ignore", invalid="ignore"):
        estimated = np.where(now == 0, np.inf, most / now - 1.0)
        known = regulated.most_W / np.abs(regulated.orbit.output_power_W()) - 1.0
    return np.where(np.isfinite(known), known, estimated)
