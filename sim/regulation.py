"""The controller's job: the phase at which a demanded power arrives, on the rising branch.

Power to the primary is the mirror image, of phase and power: the search runs in forward terms for both.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from numpy.typing import NDArray

from sim.piecewise import phase_for_share, power_share
from sim.steady_state import Circuit, Orbit, lossless_start_A, periodic

Array = NDArray[np.float64]

_LEAST_W = 10.0  # scale of the tolerance for small powers
_SHIFT = np.array([0.0, 0.0, 1.0, 1.0])[:, None]
_ROOT_STEPS = 40
_PEAK_SCAN = np.linspace(0.04, 0.52, 25)
_PEAK_STEPS = 8  # golden section narrows the phase to 1e-3, the power near its peak to 1e-5
_BISECT = 6  # every so many steps the bracket is halved, in case the secant creeps
_NEAR = 0.5  # of the lossless peak: dead time and losses lower that of narrow pulses by a third
_PEAK_ABOVE = 0.95  # the peak stands above the power at phase 1/2 by less than this leaves
_GOLDEN = (np.sqrt(5.0) - 1.0) / 2.0


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


@dataclass(frozen=True, slots=True, kw_only=True)
class _Probe:
    """A circuit, its edges at phase 0 and the warm start that each solution leaves for the next.

    What is kept of a start current is its excess over the lossless one, which hardly moves with the phase.
    ``way`` is 1 where power is wanted at the secondary, -1 where at the primary; phase and power are counted that way.
    """

    circuit: Circuit
    edges: Array
    way: Array
    excess_A: Array
    delay: Array

    def power(self, phase: Array, chosen: NDArray[np.intp]) -> Array:
        """Power at a phase for some of the points; keeps the orbit as their next start."""
        return self.way[chosen] * self.orbit(phase, chosen).output_power_W()

    def orbit(self, phase: Array, chosen: NDArray[np.intp]) -> Orbit:
        """The orbit at a phase for some of the points."""
        circuit, edges = (
            self.circuit.take(chosen),
            self.edges[:, chosen] + _SHIFT * (self.way[chosen] * phase),
        )
        delay = self.delay[:, chosen]
        guess = lossless_start_A(circuit, edges + delay) + self.excess_A[chosen]
        orbit = periodic(circuit, edges, guess, delay)
        self.delay[:, chosen] = orbit.delay
        self.excess_A[chosen] = orbit.start_A - lossless_start_A(circuit, edges + orbit.delay)
        return orbit


def lossless_scale_W(circuit: Circuit) -> Array:
    """n V1 V2 / (2 fs Lk) in W, the unit of the lossless power; a quarter of it is the most that can flow."""
    return circuit.V1_V * circuit.nV2_V * circuit.half_period_s / circuit.inductance_H


@dataclass(frozen=True, slots=True, kw_only=True)
class _Search:
    """A secant kept in a bracket, for N points at once; its arrays (N,) are worked on in place."""

    goal_W: Array
    ideal_slope_W: Callable[[Array, NDArray[np.intp]], Array]
    limit: Array
    most_W: Array
    phase: Array
    low: Array
    high: Array
    last_phase: Array
    last_W: Array
    reached: NDArray[np.bool_]
    short: NDArray[np.bool_]

    def busy(self) -> NDArray[np.intp]:
        """Points neither reached nor out of reach."""
        return np.flatnonzero(~self.reached & ~self.short)

    def learn(self, busy: NDArray[np.intp], power_W: Array, tolerance: float) -> None:
        """Judge the power at the present phases and narrow the brackets."""
        x, goal_W = self.phase[busy], self.goal_W[busy]
        error = goal_W - power_W
        self.reached[busy] = np.abs(error) <= tolerance * np.maximum(goal_W, _LEAST_W)
        top = (error > 0) & (x >= self.limit[busy]) & ~self.reached[busy]
        self.most_W[busy[top]], self.short[busy[top]] = power_W[top], True
        self.low[busy] = np.where(error > 0, x, self.low[busy])
        self.high[busy] = np.where(error <= 0, x, self.high[busy])

    def move(self, busy: NDArray[np.intp], power_W: Array, *, bisect: bool) -> None:
        """Step to the secant's root, or halve the bracket where that falls outside or ``bisect``."""
        x, error = self.phase[busy], self.goal_W[busy] - power_W
        low, high, limit = self.low[busy], self.high[busy], self.limit[busy]
        with np.errstate(divide="ignore", invalid="ignore"):
            secant = (power_W - self.last_W[busy]) / (x - self.last_phase[busy])
        ideal = self.ideal_slope_W(x, busy)
        slope = np.where(np.isfinite(secant) & (secant > 0.02 * ideal) & (secant < 5 * ideal), secant, ideal)
        self.last_phase[busy], self.last_W[busy] = x, power_W
        ahead = x + error / slope
        outside = (ahead <= low) | (ahead >= high)
        ahead = np.where(outside | bisect, 0.5 * (low + high), ahead)
        ahead = np.where((high >= limit) & outside & (error > 0), limit, ahead)
        self.phase[busy] = np.where(self.reached[busy], x, ahead)


def regulate(
    circuit: Circuit, edges: Array, target_W: Array, *, warm: Regulated | None = None, tolerance: float = 2e-7
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
    tolerance : float
        Of the power, relative, with 10 W as the least scale.

    The search is a secant on the lossy power, started from the lossless root and kept in a bracket that ends
    at phase 1/2; where the power there falls a little short, the peak is searched by golden section. The
    bracket starts below phase 0 by as much as delays of the edges can carry power there.
    """
    scale_W, way = lossless_scale_W(circuit), np.where(target_W < 0, -1.0, 1.0)
    probe, goal_W = _probe(circuit, edges, way, warm), way * target_W
    if warm is None:
        phase = phase_for_share(goal_W / scale_W, edges, way)
        limit, most_W = _branch(probe, goal_W, scale_W)
    else:
        phase, limit, most_W = way * warm.phase, warm.limit.copy(), warm.most_W.copy()

    def ideal_slope_W(x: Array, busy: NDArray[np.intp]) -> Array:
        moved = edges[:, busy] + _SHIFT * (way[busy] * x)
        return scale_W[busy] * np.maximum(power_share(moved)[1], 0.02)

    search = _Search(
        goal_W=goal_W,
        ideal_slope_W=ideal_slope_W,
        limit=limit,
        most_W=most_W,
        phase=np.minimum(phase, limit),
        low=_lowest_phase(circuit, edges, way),
        high=limit.copy(),
        last_phase=np.full(target_W.size, np.nan),
        last_W=np.full(target_W.size, np.nan),
        reached=np.zeros(target_W.size, dtype=bool),
        short=most_W < goal_W,
    )
    for step in range(_ROOT_STEPS):
        busy = search.busy()
        if not busy.size:
            break
        power_W = probe.power(search.phase[busy], busy)
        search.learn(busy, power_W, tolerance)
        search.move(busy, power_W, bisect=step % _BISECT == _BISECT - 1)
    phase = search.phase
    orbit = probe.orbit(phase, np.arange(target_W.size))
    return Regulated(
        phase=way * phase, limit=limit, orbit=orbit, reached=search.reached & orbit.closed, most_W=most_W
    )


def _probe(circuit: Circuit, edges: Array, way: Array, warm: Regulated | None) -> _Probe:
    """A probe that starts from nothing, or from a solution nearby."""
    size = edges.shape[1]
    if warm is None:
        nothing = np.zeros(size)
        return _Probe(circuit=circuit, edges=edges, way=way, excess_A=nothing, delay=np.zeros((4, size)))
    delay = warm.orbit.delay.copy()
    lossless = lossless_start_A(circuit, edges + _SHIFT * warm.phase + delay)
    excess_A = warm.orbit.start_A - lossless
    return _Probe(circuit=circuit, edges=edges, way=way, excess_A=excess_A, delay=delay)


def _lowest_phase(circuit: Circuit, edges: Array, way: Array) -> Array:
    """A phase that carries no power whatever the delays: the pulses' centres two dead times the other way."""
    between_centres = np.mean(edges[2:], axis=0) - np.mean(edges[:2], axis=0)
    return np.asarray(-way * between_centres - 2.0 * circuit.dead_time_s / circuit.half_period_s)


def _branch(probe: _Probe, target_W: Array, scale_W: Array) -> tuple[Array, Array]:
    """Highest phase of the rising branch, and the power there where the target comes near it (else NaN)."""
    limit, most_W = np.full(target_W.size, 0.5), np.full(target_W.size, np.nan)
    ceiling = probe.way * scale_W * power_share(probe.edges + 0.5 * _SHIFT * probe.way)[0]
    near = np.flatnonzero(target_W > _NEAR * ceiling)
    if near.size:
        most_W[near] = probe.power(limit[near], near)
        little = near[(most_W[near] < target_W[near]) & (most_W[near] > _PEAK_ABOVE * target_W[near])]
        if little.size:
            limit[little], most_W[little] = _peak(probe, little)
    return limit, most_W


def _peak(probe: _Probe, points: NDArray[np.intp]) -> tuple[Array, Array]:
    """Phase and power at the peak of some points: the best of a coarse scan, then golden section around it.

    The scan is there because a leg that turns from hard to soft near the peak can give it a second summit.
    """
    coarse = np.stack([probe.power(np.full(points.size, phase), points) for phase in _PEAK_SCAN])
    best, step = _PEAK_SCAN[np.argmax(coarse, axis=0)], _PEAK_SCAN[1] - _PEAK_SCAN[0]
    a, b = best - step, best + step
    c, d = b - _GOLDEN * (b - a), a + _GOLDEN * (b - a)
    at_c, at_d = probe.power(c, points), probe.power(d, points)
    for _ in range(_PEAK_STEPS):
        left = at_c > at_d
        a, b = np.where(left, a, c), np.where(left, d, b)
        new = np.where(left, b - _GOLDEN * (b - a), a + _GOLDEN * (b - a))
        at_new = probe.power(new, points)
        c, d = np.where(left, new, d), np.where(left, c, new)
        at_c, at_d = np.where(left, at_new, at_d), np.where(left, at_c, at_new)
    return np.where(at_c > at_d, c, d), np.maximum(at_c, at_d)
