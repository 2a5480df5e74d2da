"""The most that is carried: what rows show of it cuts a normal off, and a simulation is asked where that is close."""

import numpy as np
import pytest

from models.most_carried import NOTHING, Most, above_the_most, carries
from sim.model import Model
from sim.simulate import Points, can_run, simulate

SIGMA = 0.002


def near_the_most(share: np.ndarray) -> Points:
    """So many times the most that the baseline carries with the widest pulses."""
    low, high = 1900.0, 2400.0
    while high - low > 1e-3:
        middle = 0.5 * (low + high)
        runs = simulate(Model.baseline(), Points(D1=1.0, D2=0.0, power_W=middle)).feasible[0]
        low, high = (middle, high) if runs else (low, middle)
    return Points(D1=1.0, D2=0.0, power_W=low * share)


def test_without_rows_it_is_a_normal() -> None:
    most = Most(sigma=SIGMA)
    assert (most.mean, most.least, most.greatest) == pytest.approx((0.0, -2 * SIGMA, 3 * SIGMA), abs=1e-9)


@pytest.mark.parametrize("shown", [-0.003, 0.0, 0.004])
def test_what_is_shown_cuts_it_off(shown: float) -> None:
    most = Most(sigma=SIGMA, shown=shown)
    drawn = SIGMA * np.random.default_rng(3).standard_normal(2_000_000)
    left = drawn[drawn > shown]
    # at 0.004 a fortieth of the draws is left: three sigmas of its mean, and of the quantile at -0.003
    assert most.mean == pytest.approx(np.mean(left), abs=1e-5)
    assert most.least == pytest.approx(np.quantile(left, 0.02275), abs=1e-5)
    # some 60 draws of those at 0.004 are above: three sigmas of where they begin
    assert most.greatest == pytest.approx(np.quantile(left, 0.99865), abs=2e-4)


def test_the_row_that_shows_most_counts_unless_it_is_beyond_belief() -> None:
    assert Most.of(SIGMA, np.array([-0.01, 0.003, 0.001])).shown == 0.003
    assert Most.of(SIGMA, np.array([-0.01, 0.007, np.inf])).shown == -0.01
    assert Most.of(SIGMA, np.array([np.inf])).shown == NOTHING


def test_a_row_shows_by_how_much_it_is_above_the_most() -> None:
    share = np.array([0.9, 0.99, 0.9955, 1.0045, 1.015, 1.05])
    shown = above_the_most(Model.baseline(), near_the_most(share))
    # 0.9 has power to spare; powers are tried in steps of 2e-4
    np.testing.assert_allclose(shown[:-1], share[1:-1] - 1, atol=3e-4)
    assert shown[-1] == np.inf
    assert above_the_most(Model.baseline(), near_the_most(share[:1])).size == 0


def test_close_to_the_most_it_is_the_simulation_that_says() -> None:
    points = near_the_most(np.linspace(0.98, 1.02, 81))
    runs = simulate(Model.baseline(), points).feasible
    cold = can_run(Model.baseline(), points)
    assert np.count_nonzero(cold) > np.count_nonzero(runs)
    np.testing.assert_array_equal(carries(Model.baseline(), points), runs)
