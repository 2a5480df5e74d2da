"""Which edges meet in a dead time, what they see of each other, and that power stays smooth where they pass."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from sim.dead_times import _Groups, magnetizing_current
from sim.parameters import Converter
from sim.prototype import prototype
from sim.steady_state import half_period
from tests.sim.orbits import circuit, edges_at, random_duties, solve

Array = NDArray[np.float64]
DEAD = 0.016  # 400 ns of 25 us


def groups(*places: float) -> _Groups:
    """One point whose edges lie at these places of the half period."""
    return _Groups.of(np.array(places)[:, None], np.array([DEAD]))


def test_edges_a_dead_time_apart_are_alone() -> None:
    found = groups(0.0, 0.9, 0.3, 0.3 + DEAD)
    assert found.size[:, 0].tolist() == [1, 1, 1, 1]
    assert found.first[:, 0].tolist() == [0, 1, 2, 3]


def test_edges_in_a_chain_are_one_group() -> None:
    found = groups(0.52, 0.1, 0.5, 0.51)
    legs, points, _ = found.legs(3, 3)
    assert legs[:, 0].tolist() == [2, 3, 0]
    assert points.tolist() == [0]
    assert found.behind[:, 0] == pytest.approx([0.02, 0.0, 0.0, 0.01])


def test_a_group_may_span_the_end_of_the_half_period() -> None:
    found = groups(0.004, 0.5, 0.995, 0.7)
    assert found.first[:, 0].tolist() == [2, 1, 2, 3]
    assert found.behind[0, 0] == pytest.approx(0.009)
    assert found.legs(2, 2)[0][:, 0].tolist() == [2, 0]


def test_a_pair_among_larger_groups_says_which_of_its_legs_there_are() -> None:
    legs, _, there = groups(0.5, 0.1, 0.51, 0.3).legs(2, 4)
    assert legs[:, 0].tolist() == [0, 2, 0, 0]
    assert there[:, 0].tolist() == [True, True, False, False]


@pytest.mark.parametrize("gap", [DEAD, -DEAD, 0.0])
def test_power_passes_smoothly_where_edges_begin_to_meet(gap: float) -> None:
    D1, D2 = 0.8, 0.3
    phase = gap + 0.5 * (1 + D2 - D1) + np.linspace(-1e-4, 1e-4, 81)  # Q1 near S1's edge
    case = solve(np.full(81, D1), np.full(81, D2), phase)
    step_W = np.diff(case.orbit.output_power_W())
    # 2.5e-6 Th a step are 15 mW; the two ways to the current of the later edge may differ by a step's worth
    assert np.abs(np.diff(step_W)).max() < 0.02


def late(converter: Converter, phase: float) -> Array:
    """How much later than in the prototype's orbit the four legs swing from its very state, in Th."""
    case = solve(0.708, 0.277, np.array([phase]))
    state = np.concatenate([case.orbit.start_A[None], case.orbit.delay, np.zeros((1, 1))])
    _, open_ = half_period(circuit(1, converter), case.edges, state)
    return open_[1:, 0]


def test_a_leg_that_meets_another_feels_its_capacitance() -> None:
    secondary = prototype().secondary
    larger = replace(secondary.switch.capacitance, zero_bias_F=2 * secondary.switch.capacitance.zero_bias_F)
    slower = replace(
        prototype(), secondary=replace(secondary, switch=replace(secondary.switch, capacitance=larger))
    )
    meeting, apart = late(slower, 0.292), late(slower, 0.292 + 2 * DEAD)  # Q1 is 0.008 behind S1, or 0.04
    assert abs(meeting[0]) > 1e-3 * DEAD
    assert abs(apart[0]) < 1e-6 * DEAD  # the orbit closes to 1e-9 Th
    assert min(abs(meeting[2]), abs(apart[2])) > 1e-2 * DEAD  # Q1 itself


def test_magnetizing_current_is_a_triangle_of_zero_mean() -> None:
    D1, D2 = random_duties(20, seed=3)
    time = np.linspace(0.0, 2.0, 4001)[:-1, None] * np.ones(20)
    current_A = magnetizing_current(circuit(20), edges_at(D1, D2, np.full(20, 0.2)), time)
    np.testing.assert_allclose(current_A.mean(axis=0), 0.0, atol=1e-9)
    np.testing.assert_allclose(current_A[:2000], -current_A[2000:], atol=1e-9)
