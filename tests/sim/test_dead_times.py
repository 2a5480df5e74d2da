"""What edges see of each other: swings as ramps that share the instant step's volt-seconds."""

import numpy as np
import pytest

from sim.dead_times import _drive, _Ramp, magnetizing_current, wrapped
from sim.soft_switching import steps_of
from tests.sim.orbits import circuit, edges_at, random_duties

DEAD = 0.016  # 400 ns of 25 us


def test_a_ramp_has_the_volt_seconds_of_its_step() -> None:
    ramp = _Ramp(middle=np.array([0.004, -0.003]), half=np.array([0.002, 0.005]))
    late = np.array([0.02, 0.02])
    np.testing.assert_allclose(ramp.integral(late), late - ramp.middle, rtol=1e-12)
    np.testing.assert_array_equal(ramp.passed(late), 1.0)
    np.testing.assert_array_equal(ramp.integral(np.array([-0.02, -0.02])), 0.0)


def test_the_integral_is_that_of_the_share() -> None:
    time = np.linspace(-0.01, 0.02, 30001)
    ramp = _Ramp(middle=np.full(time.size, 0.003), half=np.full(time.size, 0.004))
    summed = np.concatenate(
        [[0.0], np.cumsum(0.5 * np.diff(time) * (ramp.passed(time)[1:] + ramp.passed(time)[:-1]))]
    )
    np.testing.assert_allclose(ramp.integral(time), summed, atol=1e-12)  # the trapezoid rule of lines


@pytest.mark.parametrize("other", [1, 2, 3])
@pytest.mark.parametrize("falling", [False, True])
def test_an_edge_sees_another_leg_pass_smoothly(other: int, falling: bool) -> None:
    count, late = 2001, np.linspace(-2 * DEAD, 2 * DEAD, 2001)
    c, ahead = circuit(count), np.full((4, 4, count), 0.4)
    ahead[other, 0] = wrapped(late + (1.0 if falling else 0.0))
    drive, meeting = _drive(c, ahead, np.full((4, count), 0.4 * DEAD))
    durations = np.diff(steps_of(c.dead_time_s), axis=0)
    seen_A = meeting.current_A[0] + sum(drive.in_step(k)[0] * step for k, step in enumerate(durations))
    first = np.diff(seen_A)  # at 0 the flip passes into the current at the edge, which the waveform has
    # an instant step bends the slope at one point, by all of it
    assert np.abs(np.diff(first))[np.abs(late[1:-1]) > 1e-4].max() < 0.05 * np.abs(first).max()


def test_magnetizing_current_is_a_triangle_of_zero_mean() -> None:
    D1, D2 = random_duties(20, seed=3)
    time = np.linspace(0.0, 2.0, 4001)[:-1, None] * np.ones(20)
    current_A = magnetizing_current(circuit(20), edges_at(D1, D2, np.full(20, 0.2)), time)
    np.testing.assert_allclose(current_A.mean(axis=0), 0.0, atol=1e-9)
    np.testing.assert_allclose(current_A[:2000], -current_A[2000:], atol=1e-9)
