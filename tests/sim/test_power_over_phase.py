"""Power over phase has no gaps: wherever the controller steps, a steady state is near."""

import numpy as np
import pytest

from tests.sim.orbits import Case, solve

DUTIES = [(1.0, 0.0), (0.95, 0.05), (0.765, 0.217), (0.8, 0.3), (0.6, 0.5), (0.4, 0.1)]


def scan(D1: float, D2: float, low: float, high: float, count: int) -> Case:
    return solve(np.full(count, D1), np.full(count, D2), np.linspace(low, high, count))


@pytest.mark.parametrize(("D1", "D2"), DUTIES)
def test_power_moves_in_small_steps(D1: float, D2: float) -> None:
    case = scan(D1, D2, 0.0, 0.48, 4801)
    step_W = np.abs(np.diff(case.orbit.output_power_W()))
    assert case.orbit.closed.all()
    # a law by the current's sign jumps by up to 90 W, 200 medians; where an edge turns from hard to soft
    # while another bridge's edge passes it, the slope itself is some ten times the usual one
    assert step_W.max() < 20 * np.median(step_W)


@pytest.mark.parametrize(("D1", "D2"), DUTIES)
def test_the_steepest_step_shrinks_with_the_step(D1: float, D2: float) -> None:
    low, high, steepest = 0.0, 0.48, []
    for _ in range(3):
        phase = np.linspace(low, high, 801)
        step_W = np.abs(np.diff(scan(D1, D2, low, high, 801).orbit.output_power_W()))
        worst = int(np.argmax(step_W))
        steepest.append(step_W[worst])
        low, high = phase[max(worst - 10, 0)], phase[min(worst + 10, 800)]
    # each zoom is 40 times finer: a slope falls as much, a gap would stay
    assert steepest[1] < steepest[0] / 8
    assert steepest[2] < steepest[1] / 8


@pytest.mark.parametrize(
    ("D1", "D2", "phase"), [(0.70147, 0.29313, 0.291), (0.74027, 0.2495, 0.2506), (0.90568, 0.05581, 0.07938)]
)
def test_power_rises_evenly_where_the_current_turns_between_two_swings(
    D1: float, D2: float, phase: float
) -> None:
    case = scan(D1, D2, phase - 1e-4, phase + 1e-4, 201)
    step_W = np.diff(case.orbit.output_power_W())
    assert case.orbit.closed.all()
    # a current that rested there made 0.1 to 0.24 W of gap, 10 to 25 steps; its drops may double a slope
    assert 0.3 * np.median(step_W) < step_W.min()
    assert step_W.max() < 3 * np.median(step_W)
