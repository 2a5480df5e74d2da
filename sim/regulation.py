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

from sim.piecewise import phase_for_share, power_share
from sim.steady_state import FINE, NEAR, SHIFT, Accuracy, Demand, Orbit, periodic, settle, step_once
from sim.waveform import Circuit, lossless_start_A

Array = NDArray[np.float64]

_BELOW = 8.0  # dead times below phase 0: delays of unequal edges carry power to narrow pulses there
_LEAST_W = 10.0  # scale of the tolerance for small powers
_ROOT_STEPS = 40
_TRIES = 9  # rounds of it
_ROUND = 4  # every so many steps Newton's rule is tried inside the bracket
_POLISH = 3  # rounds that close what a search ends with
_BISECT = 6  # every so many steps the bracket is halved, in case the secant creeps
_SCAN = np.linspace(-1.0, 1.0, 13)  # of a peak: two scans narrow the phase to 2e-3, the power to 1e-5
_SCANS = 2
_SCAN_ROUNDS = 3  # of Newton's rule: its error is then below that of the scan
_HIGH, _FURTHEST = (
    0.9,
    0.52,
)  # a peak is where the lossless power is this share of its most, or a little beyond
_PEAK_ABOVE = 0.95  # the peak stands above the power at phase 1/2 by less than this leaves
_FLAT = 0.42  # where the lossless power is within 3 % of its most, Newton's rule is not asked
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
    ends = np.sort(np.stack([way * _lowest_phase(circuit, edges, way), way * limit]), axis=0)
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
    asked = np.flatnonzero(~doubtful)
    if asked.size == way.size:
        state, orbit, met = settle(circuit, edges, state, demand, accuracy=accuracy)
    else:
        met = np.zeros(way.size, dtype=bool)
        state[:, asked], part, met[asked] = settle(
            circuit.take(asked),
            edges.take(asked, axis=1),
            state.take(asked, axis=1),
            demand.take(asked),
            accuracy=accuracy,
        )
        orbit = part.among(way.size, asked)
    asked_again = met if warm is None or not rising else met & (np.abs(state[5] - warm.phase) > 0.5 * _BACK)
    met[_falling(circuit, edges, state, target_W, among=asked_again)] = False
    again = np.flatnonzero(~met)
    if again.size:
        search = _Bracketed.of(
            circuit.take(again), edges.take(again, axis=1), way[again], state.take(again, axis=1), accuracy
        )
        found, met[again], limit[again], most_W[again] = search.solve(way[again] * target_W[again])
        state[:, again] = found
        reached = np.flatnonzero(met[again])
        again = again[reached]
        if again.size:
            state[:, again], part, _ = settle(
                circuit.take(again),
                edges.take(again, axis=1),
                found.take(reached, axis=1),
                None,
                accuracy=accuracy,
                rounds=_POLISH,
            )
            orbit = orbit.renewed(again, part)
    return Regulated(phase=state[5], limit=limit, orbit=orbit, reached=met & orbit.closed, most_W=most_W)


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
        circuit.take(doubtful), edges.take(doubtful, axis=1), before, None, rounds=_BACK_ROUNDS
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


def _lowest_phase(circuit: Circuit, edges: Array, way: Array) -> Array:
    """A phase that carries no power whatever the delays: the pulses' centres some dead times the other way."""
    between_centres = np.mean(edges[2:], axis=0) - np.mean(edges[:2], axis=0)
    return np.asarray(-way * between_centres - _BELOW * circuit.dead_time_s / circuit.half_period_s)


@dataclass(frozen=True, slots=True, kw_only=True)
class _Bracketed:
    """A circuit, its edges at phase 0, and the start that each solution leaves for the next; phases in forward terms.

    What is kept of a start current is its excess over the lossless one, which hardly moves with the phase.
    """

    circuit: Circuit
    edges: Array
    way: Array
    accuracy: Accuracy
    excess_A: Array
    delay: Array

    @classmethod
    def of(cls, circuit: Circuit, edges: Array, way: Array, state: Array, accuracy: Accuracy) -> Self:
        """From wherever Newton's rule has left the points: their delays are kept, their currents not trusted."""
        return cls(
            circuit=circuit, edges=edges, way=way, accuracy=accuracy, excess_A=np.zeros(way.size),
            delay=state[1:5].copy(),
        )  # fmt: skip

    def power(self, phase: Array, chosen: NDArray[np.intp]) -> Array:
        """Power at a phase for some of the points; keeps the orbit as their next start."""
        orbit = self._orbit(phase, chosen)
        edges = self.edges.take(chosen, axis=1) + SHIFT * (self.way[chosen] * phase)
        self._keep(chosen, edges, np.concatenate([orbit.start_A[None], orbit.delay]))
        return np.asarray(self.way[chosen] * orbit.output_power_W())

    def _keep(self, chosen: NDArray[np.intp], edges: Array, state: Array) -> None:
        """Start current and delays, the first rows of a state, as the next start of some points."""
        self.delay[:, chosen] = state[1:5]
        self.excess_A[chosen] = state[0] - lossless_start_A(self.circuit.take(chosen), edges + state[1:5])

    def powers(self, phases: Array, chosen: NDArray[np.intp]) -> Array:
        """Powers at many phases (K, M) of some of the points, all at once."""
        repeated = np.tile(chosen, phases.shape[0])
        circuit, edges, guess = self._guess(phases.ravel(), repeated)
        _, orbit, _ = settle(circuit, edges, guess, None, accuracy=NEAR, rounds=_SCAN_ROUNDS)
        return np.asarray((self.way[repeated] * orbit.output_power_W()).reshape(phases.shape))

    def _guess(self, phase: Array, chosen: NDArray[np.intp]) -> tuple[Circuit, Array, Array]:
        """Circuit, edges and first state (6, M) of some of the points at a phase."""
        circuit = self.circuit.take(chosen)
        edges, delay = (
            self.edges.take(chosen, axis=1) + SHIFT * (self.way[chosen] * phase),
            self.delay.take(chosen, axis=1),
        )
        start_A = lossless_start_A(circuit, edges + delay) + self.excess_A[chosen]
        return circuit, edges, np.concatenate([start_A[None], delay, np.zeros((1, phase.size))])

    def _orbit(self, phase: Array, chosen: NDArray[np.intp]) -> Orbit:
        circuit, edges, guess = self._guess(phase, chosen)
        return periodic(circuit, edges, guess[0], guess[1:5], self.accuracy)

    def solve(self, goal_W: Array) -> tuple[Array, NDArray[np.bool_], Array, Array]:
        """States (6, N), whether the power is met, the end of the rising branch, and the most that flows."""
        limit, most_W = self._branch(goal_W)
        tolerance = self.accuracy.power
        search = _Search.between(_lowest_phase(self.circuit, self.edges, self.way), limit, goal_W)
        search.short[:] = most_W < goal_W * (1.0 - tolerance)
        search.descend(most_W, tolerance)
        for step in range(_ROOT_STEPS):
            busy = search.busy()
            if not busy.size:
                break
            if step % _ROUND == 0:
                self._settle(search, busy)
                busy = search.busy()
                if not busy.size:
                    break
            power_W = self.power(search.phase[busy], busy)
            search.learn(busy, power_W, tolerance)
            search.move(busy, power_W, bisect=step % _BISECT == _BISECT - 1)
        at = self.edges + SHIFT * (self.way * search.phase)
        start_A = self.excess_A + lossless_start_A(self.circuit, at + self.delay)
        state = np.concatenate([start_A[None], self.delay, (self.way * search.phase)[None]])
        return state, search.reached, limit, most_W

    def _settle(self, search: "_Search", busy: NDArray[np.intp]) -> None:
        """Newton's rule inside the brackets of some points."""
        way = self.way[busy]
        circuit, _, state = self._guess(search.phase[busy], busy)
        state[5] = way * search.phase[busy]
        ends = np.sort(np.stack([way * search.low[busy], way * search.high[busy]]), axis=0)
        demand = Demand(power_W=way * search.goal_W[busy], lowest=ends[0], highest=ends[1])
        state, _, met = settle(
            circuit, self.edges.take(busy, axis=1), state, demand, accuracy=self.accuracy, rounds=_TRIES
        )
        search.phase[busy[met]] = way[met] * state[5, met]
        search.reached[busy[met]] = True
        self._keep(busy[met], self.edges[:, busy[met]] + SHIFT * state[5, met], state[:, met])

    def _branch(self, goal_W: Array) -> tuple[Array, Array]:
        """Highest phase of the rising branch, and the power there."""
        everywhere = np.arange(goal_W.size)
        limit = np.full(goal_W.size, 0.5)
        most_W = self.power(limit, everywhere)
        little = np.flatnonzero((most_W < goal_W) & (most_W > _PEAK_ABOVE * goal_W))
        if little.size:
            limit[little], most_W[little] = self._peak(little)
        return limit, most_W

    def _peak(self, points: NDArray[np.intp]) -> tuple[Array, Array]:
        """Phase and power at the peak of some points, by ever closer scans.

        The first one is wide because a leg that turns from hard to soft near the peak can give it a second summit.
        """
        edges, way = self.edges.take(points, axis=1), self.way[points]
        most = np.abs(power_share(edges + SHIFT * (0.5 * way))[0])
        lowest = phase_for_share(_HIGH * most, edges, way)
        centre, width = 0.5 * (lowest + _FURTHEST), 0.5 * (_FURTHEST - lowest)
        for _ in range(_SCANS):
            phases = centre + width * _SCAN[:, None]
            powers = self.powers(phases, points)
            best = np.argmax(powers, axis=0)
            centre = np.take_along_axis(phases, best[None], axis=0)[0]
            width = width * (_SCAN[1] - _SCAN[0])
        return centre, np.take_along_axis(powers, best[None], axis=0)[0]


@dataclass(frozen=True, slots=True, kw_only=True)
class _Search:
    """A secant kept in a bracket, for N points at once; its arrays (N,) are worked on in place."""

    goal_W: Array
    limit: Array
    phase: Array
    low: Array
    high: Array
    last_phase: Array
    last_W: Array
    reached: NDArray[np.bool_]
    short: NDArray[np.bool_]

    @classmethod
    def between(cls, low: Array, limit: Array, goal_W: Array) -> Self:
        """A search that starts at the upper end."""
        unknown, no = np.full(low.size, np.nan), np.zeros(low.size, dtype=bool)
        return cls(
            goal_W=goal_W, limit=limit, phase=limit.copy(), low=low.copy(), high=limit.copy(),
            last_phase=unknown.copy(), last_W=unknown.copy(), reached=no.copy(), short=no.copy(),
        )  # fmt: skip

    def busy(self) -> NDArray[np.intp]:
        """Points neither reached nor out of reach."""
        return np.flatnonzero(~self.reached & ~self.short)

    def descend(self, most_W: Array, tolerance: float) -> None:
        """From the power at the upper end down the parabola that has its peak there."""
        known = self.busy()
        self.learn(known, most_W[known], tolerance)
        self.last_phase[known], self.last_W[known] = self.phase[known], most_W[known]
        left = np.sqrt(np.clip(1.0 - self.goal_W[known] / most_W[known], 0.0, 1.0))
        self.phase[known] = np.where(self.reached[known], self.phase[known], self.limit[known] * (1.0 - left))

    def learn(self, busy: NDArray[np.intp], power_W: Array, tolerance: float) -> None:
        """Judge the power at the present phases and narrow the brackets."""
        x, goal_W = self.phase[busy], self.goal_W[busy]
        error = goal_W - power_W
        self.reached[busy] = np.abs(error) <= tolerance * np.maximum(goal_W, _LEAST_W)
        self.short[busy] = (error > 0) & (x >= self.limit[busy]) & ~self.reached[busy]
        self.low[busy] = np.where(error > 0, x, self.low[busy])
        self.high[busy] = np.where(error <= 0, x, self.high[busy])

    def move(self, busy: NDArray[np.intp], power_W: Array, *, bisect: bool) -> None:
        """Step to the secant's root, or halve the bracket where that falls outside or ``bisect``."""
        x, error = self.phase[busy], self.goal_W[busy] - power_W
        low, high = self.low[busy], self.high[busy]
        with np.errstate(divide="ignore", invalid="ignore"):
            ahead = x + error * (x - self.last_phase[busy]) / (power_W - self.last_W[busy])
        self.last_phase[busy], self.last_W[busy] = x, power_W
        outside = ~((ahead > low) & (ahead < high))
        ahead = np.where(outside | bisect, 0.5 * (low + high), ahead)
        self.phase[busy] = np.where(self.reached[busy], x, ahead)


def spare_power(circuit: Circuit, edges: Array, regulated: Regulated) -> Array:
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
