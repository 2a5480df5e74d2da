"""The controller's job: the phase at which a demanded power arrives, on the rising branch."""

from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from numpy.typing import NDArray

from sim.piecewise import phase_for_share, power_share
from sim.steady_state import Circuit, Orbit, periodic

Array = NDArray[np.float64]

_SHIFT = np.array([0.0, 0.0, 1.0, 1.0])[:, None]
_ROOT_STEPS = 40
_PEAK_STEPS = 14  # golden section narrows the phase to 1e-3, the power near its peak to 1e-5
_NEAR = 0.85  # of the lossless peak: losses and dead time move the real one by less
_PEAK_ABOVE = 0.95  # the peak stands above the power at phase 1/2 by less than this leaves
_GOLDEN = (np.sqrt(5.0) - 1.0) / 2.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Regulated:
    """Phase (N,) in units of Th, the orbit there, whether the power is reached, and the most that can be.

    ``limit`` is the highest phase of the rising branch; ``most_W`` is NaN where the power was reached
    without looking there.
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
    """A circuit, its edges at phase 0 and the warm start that each solution leaves for the next."""

    circuit: Circuit
    edges: Array
    start_A: Array
    delay: Array

    def power(self, phase: Array, chosen: NDArray[np.intp]) -> Array:
        """Power at a phase for some of the points; keeps the orbit as their next start."""
        orbit = periodic(
            self.circuit.take(chosen),
            self.edges[:, chosen] + _SHIFT * phase,
            self.start_A[chosen],
            self.delay[:, chosen],
        )
        self.start_A[chosen], self.delay[:, chosen] = orbit.start_A, orbit.delay
        return orbit.output_power_W()


def lossless_scale_W(circuit: Circuit) -> Array:
    """n V1 V2 / (2 fs Lk), the unit of the lossless power."""
    return circuit.V1_V * circuit.nV2_V * circuit.half_period_s / circuit.inductance_H


def regulate(
    circuit: Circuit, edges: Array, target_W: Array, *, warm: Regulated | None = None, tolerance: float = 2e-7
) -> Regulated:
    """Solve the phase in [0, 1/2] for a power into the ideal secondary bridge, the smallest one.

    Parameters
    ----------
    circuit, edges : Circuit, array (4, N)
        The circuit, and the edges at phase 0 in units of Th.
    target_W : array (N,)
        Power to reach, not negative.
    warm : Regulated, optional
        A solution nearby.
    tolerance : float
        Of the power, relative, with 10 W as the least scale.

    The search is a secant on the lossy power, started from the lossless root and kept in a bracket; where
    the power at phase 1/2 falls a little short, the peak is searched by golden section.
    """
    size = target_W.size
    scale_W = lossless_scale_W(circuit)
    probe = _Probe(
        circuit=circuit,
        edges=edges,
        start_A=np.zeros(size) if warm is None else warm.orbit.start_A.copy(),
        delay=np.zeros((4, size)) if warm is None else warm.orbit.delay.copy(),
    )
    if warm is None:
        phase = phase_for_share(target_W / scale_W, edges)
        limit, most_W = _branch(probe, target_W, scale_W)
    else:
        phase, limit, most_W = warm.phase.copy(), warm.limit.copy(), warm.most_W.copy()
    short = most_W < target_W
    reached = np.zeros(size, dtype=bool)
    low, high = np.zeros(size), limit.copy()
    last_phase, last_W = np.full(size, np.nan), np.full(size, np.nan)
    phase = np.minimum(phase, limit)
    for step in range(_ROOT_STEPS):
        busy = np.flatnonzero(~reached & ~short)
        if not busy.size:
            break
        x, goal = phase[busy], target_W[busy]
        power_W = probe.power(x, busy)
        error = goal - power_W
        reached[busy] = np.abs(error) <= tolerance * np.maximum(goal, 10.0)
        top = (error > 0) & (x >= limit[busy]) & ~reached[busy]
        most_W[busy[top]], short[busy[top]] = power_W[top], True
        low[busy] = np.where(error > 0, x, low[busy])
        high[busy] = np.where(error <= 0, x, high[busy])
        with np.errstate(divide="ignore", invalid="ignore"):
            secant = (power_W - last_W[busy]) / (x - last_phase[busy])
        ideal = scale_W[busy] * np.maximum(power_share(edges[:, busy] + _SHIFT * x)[1], 0.02)
        slope = np.where(np.isfinite(secant) & (secant > 0.02 * ideal) & (secant < 5 * ideal), secant, ideal)
        last_phase[busy], last_W[busy] = x, power_W
        ahead = x + error / slope
        outside = (ahead <= low[busy]) | (ahead >= high[busy])
        halve = outside | (step % 6 == 5)
        ahead = np.where(halve, 0.5 * (low[busy] + high[busy]), ahead)
        ahead = np.where((high[busy] >= limit[busy]) & outside & (error > 0), limit[busy], ahead)
        phase[busy] = np.where(reached[busy], x, ahead)
    orbit = periodic(circuit, edges + _SHIFT * phase, probe.start_A, probe.delay)
    return Regulated(phase=phase, limit=limit, orbit=orbit, reached=reached & orbit.closed, most_W=most_W)


def _branch(probe: _Probe, target_W: Array, scale_W: Array) -> tuple[Array, Array]:
    """Highest phase of the rising branch, and the power there where the target comes near it (else NaN)."""
    limit, most_W = np.full(target_W.size, 0.5), np.full(target_W.size, np.nan)
    ceiling = scale_W * power_share(probe.edges + 0.5 * _SHIFT)[0]
    near = np.flatnonzero(target_W > _NEAR * ceiling)
    if near.size:
        most_W[near] = probe.power(limit[near], near)
        little = near[(most_W[near] < target_W[near]) & (most_W[near] > _PEAK_ABOVE * target_W[near])]
        if little.size:
            limit[little], most_W[little] = _peak(probe, little)
    return limit, most_W


def _peak(probe: _Probe, points: NDArray[np.intp]) -> tuple[Array, Array]:
    """Phase and power at the peak of some points, by golden section."""
    a, b = np.zeros(points.size), np.full(points.size, 0.55)
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
