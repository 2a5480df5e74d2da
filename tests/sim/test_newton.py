"""The Jacobian of orbit and power against differences, and what Newton's rule makes of it."""

import numpy as np
import pytest
from numpy.typing import NDArray

from sim.newton import Demand, Effort, jacobian, settle
from sim.orbit import COARSE, Sweep
from sim.steady_state import periodic
from sim.waveform import lossless_start_A
from tests.sim.orbits import PHASE_SHIFT, circuit, edges_at, random_duties

Array = NDArray[np.float64]

COUNT, STEP = 120, 1e-7
NAMES = ("start current", "delay 1", "delay 2", "delay 3", "delay 4", "phase")


@pytest.fixture(scope="module")
def solved() -> tuple:
    D1, D2 = random_duties(COUNT, seed=31)
    phase = np.random.default_rng(32).uniform(0.02, 0.4, COUNT)
    c, edges = circuit(COUNT), edges_at(D1, D2, np.zeros(COUNT))
    orbit = periodic(c, edges + PHASE_SHIFT * phase, np.zeros(COUNT), np.zeros((4, COUNT)))
    return c, edges, np.concatenate([orbit.start_A[None], orbit.delay, phase[None]]), orbit


def residuals(c, edges: Array, state: Array) -> Array:
    sweep = Sweep.of(c, edges, state)
    power_W = sweep.orbit(state, COARSE).output_power_W()
    return np.concatenate([sweep.gap_A[None], sweep.late, power_W[None]])


@pytest.mark.parametrize("column", range(6), ids=NAMES)
def test_the_jacobian_is_that_of_differences(solved: tuple, column: int) -> None:
    c, edges, state, _ = solved
    moved = state.copy()
    moved[column] += STEP
    differences = (residuals(c, edges, moved) - residuals(c, edges, state)) / STEP
    ours = jacobian(c, Sweep.of(c, edges, state), regulated=True)[:, column]
    scale = np.abs(differences).max(axis=1)
    scale[1:5] = 1.0  # a delay enters its own equation with -1
    off = np.abs(ours - differences) / scale[:, None]
    # eddy currents, the midpoint rule for power, and how a flip weighs inside another's dead time are left out
    assert np.quantile(off, 0.9, axis=1).max() < 0.02


def test_newtons_rule_finds_the_phase_of_a_power(solved: tuple) -> None:
    c, edges, state, orbit = solved
    power_W = orbit.output_power_W()
    demand = Demand(power_W=power_W, lowest=np.full(COUNT, -0.05), highest=np.full(COUNT, 0.5))
    start = np.zeros_like(state)
    start[5] = state[5] + 0.02
    start[0] = lossless_start_A(c, edges + PHASE_SHIFT * start[5])
    found, _, met = settle(c, edges, start, demand)
    assert met.mean() > 0.85  # plateaus of narrow pulses are left to the bracketed search
    steep = met & (power_W > 300.0) & (state[5] < 0.35)
    # 2e-7 of the power over its slope
    np.testing.assert_allclose(found[5][steep], state[5][steep], atol=1e-5)


def test_few_sweeps_close_nearly_every_orbit(solved: tuple) -> None:
    c, edges, state, _ = solved
    start = np.zeros_like(state)
    start[5] = state[5]
    start[0] = lossless_start_A(c, edges + PHASE_SHIFT * start[5])
    _, _, met = settle(c, edges, start, None, effort=Effort(rounds=6))
    assert met.mean() > 0.9  # a wrong Jacobian takes tens


def test_an_effort_that_may_leave_points_open_ends_sooner(solved: tuple) -> None:
    c, edges, state, _ = solved
    start = np.zeros_like(state)
    start[5] = state[5]
    start[0] = lossless_start_A(c, edges + PHASE_SHIFT * start[5])
    _, _, met = settle(c, edges, start, None, effort=Effort(left_open=COUNT // 2))
    assert COUNT // 2 <= met.sum() < COUNT
