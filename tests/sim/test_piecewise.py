"""The lossless closed form by symmetry, derivative and inverse."""

import numpy as np

from sim.piecewise import phase_for_share, power_share
from tests.sim.orbits import PHASE_SHIFT, edges_at, random_duties

COUNT = 300


def test_power_is_odd_in_the_phase() -> None:
    D1, D2 = random_duties(COUNT, seed=16)
    phase = np.random.default_rng(16).uniform(0, 1, COUNT)
    forward, backward = (power_share(edges_at(D1, D2, s * phase))[0] for s in (1, -1))
    np.testing.assert_allclose(forward, -backward, atol=1e-14)  # rounding


def test_power_is_symmetric_about_a_quarter_period() -> None:
    D1, D2 = random_duties(COUNT, seed=17)
    off = np.random.default_rng(17).uniform(0, 0.5, COUNT)
    before, after = (power_share(edges_at(D1, D2, 0.5 + s * off))[0] for s in (-1, 1))
    np.testing.assert_allclose(before, after, atol=1e-14)


def test_the_slope_is_the_derivative() -> None:
    D1, D2 = random_duties(COUNT, seed=18)
    phase, h = np.random.default_rng(18).uniform(0, 0.5, COUNT), 1e-6
    ahead, behind = (power_share(edges_at(D1, D2, phase + s * h))[0] for s in (1, -1))
    slope = power_share(edges_at(D1, D2, phase))[1]
    np.testing.assert_allclose((ahead - behind) / (2 * h), slope, atol=1e-6)  # corners of g within h


def test_the_phase_found_carries_the_share() -> None:
    D1, D2 = random_duties(COUNT, seed=19)
    at_zero = edges_at(D1, D2, np.zeros(COUNT))
    peak = power_share(at_zero + 0.5 * PHASE_SHIFT)[0]
    wanted = peak * np.random.default_rng(19).uniform(0, 0.999, COUNT)
    phase = phase_for_share(wanted, at_zero)
    np.testing.assert_allclose(power_share(at_zero + PHASE_SHIFT * phase)[0], wanted, atol=1e-12)


def test_out_of_reach_is_a_quarter_period() -> None:
    D1, D2 = random_duties(20, seed=20)
    assert np.all(phase_for_share(np.full(20, 0.3), edges_at(D1, D2, np.zeros(20))) > 0.5 - 1e-12)
