"""A phase looked for in a bracket, where Newton's rule from afar does not find it: near the most that can flow.

All is seen in forward terms: where power flows to the primary, phase and power are mirrored.
"""

from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from sim.piecewise import phase_for_share, power_share
from sim.steady_state import NEAR, SHIFT, Accuracy, Demand, Effort, Orbit, periodic, settle
from sim.waveform import Circuit, lossless_start_A

Array = NDArray[np.float64]
Index = NDArray[np.intp]

_LEAST_W = 10.0  # scale of the tolerance for small powers
_BELOW = 8.0  # dead times below phase 0: delays of unequal edges carry power to narrow pulses there
_ROOT_STEPS = 40
_TRIES = 9  # rounds of it
_ROUND = 4  # every so many steps Newton's rule is tried inside the bracket
_WIDE = 1e-3  # of Th: what it does not find in a narrower one is no smooth function's root
_FEW = 50  # points that are looked for at many phases at once: it costs no more than two steps
_AROUND = np.linspace(1.0, 0.0, 14)[1:-1] ** 2
_STARTS = (0.2, 0.4, 0.6, 0.8)  # of a bracket
_BISECT = 6  # every so many steps the bracket is halved, in case the secant creeps
_JUMP = 1e-9  # of Th: power that misses its goal on either side of so narrow a bracket jumps over it
_SCAN = np.linspace(-1.0, 1.0, 13)  # of a peak: two scans narrow the phase to 2e-3, the power to 1e-5
_SCANS = 2
_SCAN_ROUNDS = 3  # of Newton's rule: its error is then below that of the scan
# a peak is where the lossless power is this share of its most, or a little beyond
_HIGH, _FURTHEST = 0.9, 0.52
_PEAK_ABOVE = 0.95  # the peak stands above the power at phase 1/2 by less than this leaves


def lowest_phase(circuit: Circuit, edges: Array, way: Array) -> Array:
    """A phase that carries no power whatever the delays: the pulses' centres some dead times the other way."""
    between_centres = np.mean(edges[2:], axis=0) - np.mean(edges[:2], axis=0)
    return np.asarray(-way * between_centres - _BELOW * circuit.dead_share)


@dataclass(frozen=True, slots=True, kw_only=True)
class Found:
    """States (6, N), whether the power is met, the end of the rising branch, the most that flows, the orbit at 1/2.

    ``most_W`` is NaN where it is not why the power is not met.
    """

    state: Array
    reached: NDArray[np.bool_]
    limit: Array
    most_W: Array
    farthest: Orbit


@dataclass(frozen=True, slots=True, kw_only=True)
class Bracketed:
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

    def _keep(self, chosen: Index, edges: Array, state: Array) -> None:
        """Start current and delays, the first rows of a state, as the next start of some points."""
        self.delay[:, chosen] = state[1:5]
        self.excess_A[chosen] = state[0] - lossless_start_A(self.circuit.take(chosen), edges + state[1:5])

    def powers(self, phases: Array, chosen: Index) -> tuple[Array, Array]:
        """Powers (K, M) at many phases of some of the points, all at once, and the states (6, K, M) there."""
        repeated = np.tile(chosen, phases.shape[0])
        circuit, edges, guess = self._guess(phases.ravel(), repeated)
        state, orbit, _ = settle(
            circuit, edges, guess, None, accuracy=NEAR, effort=Effort(rounds=_SCAN_ROUNDS)
        )
        powers = (self.way[repeated] * orbit.output_power_W()).reshape(phases.shape)
        return powers, state.reshape(6, *phases.shape)

    def _guess(self, phase: Array, chosen: Index) -> tuple[Circuit, Array, Array]:
        """Circuit, edges and first state (6, M) of some of the points at a phase."""
        circuit = self.circuit.take(chosen)
        edges, delay = (
            self.edges.take(chosen, axis=1) + SHIFT * (self.way[chosen] * phase),
            self.delay.take(chosen, axis=1),
        )
        start_A = lossless_start_A(circuit, edges + delay) + self.excess_A[chosen]
        return circuit, edges, np.concatenate([start_A[None], delay, np.zeros((1, phase.size))])

    def orbit(self, phase: Array, chosen: Index) -> tuple[Orbit, Array]:
        """The orbit at a phase for some of the points, their next start, and its power."""
        circuit, edges, guess = self._guess(phase, chosen)
        orbit = periodic(circuit, edges, guess[0], guess[1:5], self.accuracy)
        self._keep(chosen, edges, np.concatenate([orbit.start_A[None], orbit.delay]))
        return orbit, np.asarray(self.way[chosen] * orbit.output_power_W())

    def carries(self, goal_W: Array) -> NDArray[np.bool_]:
        """Whether there is a phase for each power: one scan of a peak finds its power to some parts in ten thousand."""
        _, most_W, little = self._at_half(goal_W)
        most_W[little] = self._peak(little, scans=1)[1]
        return np.asarray(most_W >= goal_W * (1.0 - self.accuracy.power))

    def _at_half(self, goal_W: Array) -> tuple[Orbit, Array, Index]:
        """The orbit at phase 1/2, its power, and which points have a peak that may carry what is missing."""
        orbit, most_W = self.orbit(np.full(goal_W.size, 0.5), np.arange(goal_W.size))
        return orbit, most_W, np.flatnonzero((most_W < goal_W) & (most_W > _PEAK_ABOVE * goal_W))

    def solve(self, goal_W: Array) -> "Found":
        """Whether there is a phase for each power, and which."""
        tolerance, limit = self.accuracy.power, np.full(goal_W.size, 0.5)
        orbit, most_W, little = self._at_half(goal_W)
        limit[little], most_W[little], phases, powers = self._peak(little)
        search = _Search.between(lowest_phase(self.circuit, self.edges, self.way), limit, goal_W)
        search.short[:] = most_W < goal_W * (1.0 - tolerance)
        share = np.divide(goal_W, most_W, out=np.ones_like(goal_W), where=goal_W < most_W)
        search.descend(most_W, self._lossless_phase(share, limit))
        search.narrow(little, phases, powers)
        for step in range(_ROOT_STEPS):
            if step % _ROUND == 0:
                self._settle(search)
            if step == 0 and search.busy().size <= _FEW:
                self._look_around(search)
                self._settle(search)
            busy = search.busy()
            if not busy.size:
                break
            _, power_W = self.orbit(search.phase[busy], busy)
            search.learn(busy, power_W, tolerance)
            search.move(busy, power_W, bisect=step % _BISECT == _BISECT - 1)
        at = self.edges + SHIFT * (self.way * search.phase)
        start_A = self.excess_A + lossless_start_A(self.circuit, at + self.delay)
        state = np.concatenate([start_A[None], self.delay, (self.way * search.phase)[None]])
        told_W = np.where(search.reached | search.short, most_W, np.nan)
        return Found(state=state, reached=search.reached, limit=limit, most_W=told_W, farthest=orbit)

    def _lossless_phase(self, share: Array, limit: Array) -> Array:
        """Smallest phase of a share of the power at the limit, on the lossless curve of edges with the last delays."""
        edges = self.edges + self.delay
        most = self.way * power_share(edges + SHIFT * (self.way * limit))[0]
        return phase_for_share(share * most, edges, self.way)

    def _settle(self, search: "_Search") -> None:
        """Newton's rule inside the brackets; of few points from several phases, of whose ends the lowest is taken."""
        busy = search.busy()
        busy = busy[search.high[busy] - search.low[busy] > _WIDE]
        if not busy.size:
            return
        low, high = search.low[busy], search.high[busy]
        starts = [search.phase[busy], *(low + share * (high - low) for share in _STARTS if busy.size <= _FEW)]
        rows, phase = np.tile(busy, len(starts)), np.concatenate(starts)
        way = self.way[rows]
        circuit, _, state = self._guess(phase, rows)
        state[5] = way * phase
        ends = np.sort(np.stack([way * search.low[rows], way * search.high[rows]]), axis=0)
        demand = Demand(power_W=way * search.goal_W[rows], lowest=ends[0], highest=ends[1])
        edges, effort = self.edges.take(rows, axis=1), Effort(rounds=_TRIES, left_open=rows.size // 10)
        state, _, met = settle(circuit, edges, state, demand, accuracy=self.accuracy, effort=effort)
        ended = np.where(met, way * state[5], np.inf).reshape(len(starts), -1)
        best, column = np.argmin(ended, axis=0), np.arange(busy.size)
        found = np.flatnonzero(np.isfinite(ended[best, column]))
        there, state = busy[found], state[:, best[found] * busy.size + found]
        search.phase[there] = self.way[there] * state[5]
        search.reached[there] = True
        self._keep(there, self.edges[:, there] + SHIFT * state[5], state)

    def _look_around(self, search: "_Search") -> None:
        """Narrow the brackets by many phases at once, the closer the nearer to the upper end."""
        busy = search.busy()
        if not busy.size:
            return
        low, high = search.low[busy], search.high[busy]
        phases = high - (high - low) * _AROUND[:, None]
        search.narrow(busy, phases, self.powers(phases, busy)[0])

    def _peak(self, points: Index, scans: int = _SCANS) -> tuple[Array, Array, Array, Array]:
        """Phase and power at the peak of some points, by ever closer scans; their rising phases (K, M) and powers.

        The first one is wide because a leg that turns from hard to soft near the peak can give it a second summit.
        """
        if not points.size:
            return np.empty(0), np.empty(0), np.empty((1, 0)), np.empty((1, 0))
        edges, way = self.edges.take(points, axis=1), self.way[points]
        most = np.abs(power_share(edges + SHIFT * (0.5 * way))[0])
        lowest = phase_for_share(_HIGH * most, edges, way)
        centre, width = 0.5 * (lowest + _FURTHEST), 0.5 * (_FURTHEST - lowest)
        seen = []
        for _ in range(scans):
            phases = centre + width * _SCAN[:, None]
            powers, states = self.powers(phases, points)
            seen.append((phases, powers))
            best = np.argmax(powers, axis=0), np.arange(points.size)
            centre, width = phases[best], width * (_SCAN[1] - _SCAN[0])
            most_W = powers[best]
            self._keep(points, edges + SHIFT * (way * centre), states[:, *best])
        phases, powers = (np.concatenate(x) for x in zip(*seen, strict=True))
        order = np.argsort(phases, axis=0)
        rising = (np.take_along_axis(values, order, axis=0) for values in (phases, powers))
        return centre, most_W, *rising


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

    def busy(self) -> Index:
        """Points neither reached nor out of reach, whose power does not jump over its goal."""
        return np.flatnonzero(~self.reached & ~self.short & (self.high - self.low > _JUMP))

    def descend(self, most_W: Array, phase: Array) -> None:
        """From the power at the upper end to a first phase below; a goal within the tolerance of the most is met."""
        self.reached[:] = ~self.short & (self.goal_W >= most_W)
        known = self.busy()
        self.last_phase[known], self.last_W[known] = self.limit[known], most_W[known]
        self.phase[known] = np.minimum(phase[known], self.limit[known])

    def narrow(self, points: Index, phases: Array, powers: Array) -> None:
        """Bracket busy ones of some points by powers (K, M) at rising phases, to a phase on either side."""
        first, column = np.argmax(powers >= self.goal_W[points], axis=0), np.arange(points.size)
        between = np.flatnonzero((first > 0) & ~self.reached[points] & ~self.short[points])
        rows, first, column = points[between], first[between], column[between]
        x, P = phases[first, column], powers[first, column]
        last_x, last_P = phases[first - 1, column], powers[first - 1, column]
        self.phase[rows] = last_x + (x - last_x) * (self.goal_W[rows] - last_P) / (P - last_P)
        self.low[rows] = np.where(first > 1, phases[first - 2, column], self.low[rows])
        self.high[rows] = np.minimum(phases[np.minimum(first + 1, len(phases) - 1), column], self.high[rows])

    def learn(self, busy: Index, power_W: Array, tolerance: float) -> None:
        """Judge the power at the present phases and narrow the brackets."""
        x, goal_W = self.phase[busy], self.goal_W[busy]
        error = goal_W - power_W
        self.reached[busy] = np.abs(error) <= tolerance * np.maximum(goal_W, _LEAST_W)
        self.short[busy] = (error > 0) & (x >= self.limit[busy]) & ~self.reached[busy]
        self.low[busy] = np.where(error > 0, x, self.low[busy])
        self.high[busy] = np.where(error <= 0, x, self.high[busy])

    def move(self, busy: Index, power_W: Array, *, bisect: bool) -> None:
        """Step to the secant's root, or halve the bracket where that falls outside or ``bisect``."""
        x, error = self.phase[busy], self.goal_W[busy] - power_W
        low, high = self.low[busy], self.high[busy]
        with np.errstate(divide="ignore", invalid="ignore"):
            ahead = x + error * (x - self.last_phase[busy]) / (power_W - self.last_W[busy])
        self.last_phase[busy], self.last_W[busy] = x, power_W
        outside = ~((ahead > low) & (ahead < high))
        ahead = np.where(outside | bisect, 0.5 * (low + high), ahead)
        self.phase[busy] = np.where(self.reached[busy], x, ahead)
