"""Noise from replicates: a known sigma comes back, and what is not noise does not pass for it."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from models.diagnosis.noise import (
    ChannelNoise,
    Replicates,
    corrected,
    estimate_noise,
    scale_of,
    sigma_of,
    told_by_replicates,
)
from models.diagnosis.observations import Observations, observe
from sim.prototype import prototype
from tests.models.diagnosis.fabricated import loads

SET_POINTS, REPEATS = np.array([300.0, 600.0, 1000.0, 1500.0]), 75
DIFFERENCES = SET_POINTS.size * (REPEATS - 1)
# Squared differences of white noise are correlated: the estimate's relative standard error is
# sqrt(3 / (4 n)) instead of sqrt(1 / (2 n)). Four of them: one seed in 15,000 is outside.
TOLERANCE = 4 * np.sqrt(0.75 / DIFFERENCES)
CAUTION = 1 + 0.7 / np.sqrt(DIFFERENCES)  # the estimate's stated distance to the upper side
SIGMA = 2e-4  # of the power


@pytest.fixture
def campaign() -> Observations:
    """Four set points, measured in turn, seventy-five times each."""
    return loads(np.tile(SET_POINTS, REPEATS))


def white(observations: Observations) -> np.ndarray:
    draw = np.random.default_rng(5).standard_normal(observations.value.size)
    return SIGMA * scale_of(observations, "efficiency") * draw


def looked_at(
    observations: Observations, noise: list[ChannelNoise], sigma: np.ndarray, left: np.ndarray
) -> np.ndarray:
    told = told_by_replicates(observations, noise, sigma)
    return corrected(observations, noise, told, sigma, left)


def test_a_known_sigma_comes_back(campaign: Observations) -> None:
    (noise,) = estimate_noise(campaign, Replicates.of(campaign), white(campaign))
    assert noise.differences == DIFFERENCES
    assert noise.sigma / SIGMA / CAUTION == pytest.approx(1.0, abs=TOLERANCE)


def test_a_linear_drift_is_not_taken_for_noise(campaign: Observations) -> None:
    scale = scale_of(campaign, "efficiency")
    drift = 20 * SIGMA * scale * np.linspace(0.0, 1.0, scale.size)
    (noise,) = estimate_noise(campaign, Replicates.of(campaign), white(campaign) + drift)
    assert noise.sigma / SIGMA / CAUTION == pytest.approx(1.0, abs=TOLERANCE)
    assert np.std(drift / scale) > 5 * SIGMA  # a plain standard deviation would have been fooled


def test_what_a_set_point_itself_is_off_by_is_not_noise(campaign: Observations) -> None:
    by_set_point = 0.01 * np.asarray(campaign.points.power_W)
    (noise,) = estimate_noise(campaign, Replicates.of(campaign), white(campaign) + by_set_point)
    (plain,) = estimate_noise(campaign, Replicates.of(campaign), white(campaign))
    assert noise.sigma == pytest.approx(plain.sigma, rel=1e-9)  # rounding


def test_heavy_tails_are_stated(campaign: Observations) -> None:
    residual = white(campaign)
    (normal,) = estimate_noise(campaign, Replicates.of(campaign), residual)
    (heavy,) = estimate_noise(
        campaign,
        Replicates.of(campaign),
        np.where(np.arange(residual.size) % 40 == 0, 8 * residual, residual),
    )
    # the kurtosis of n normal draws has a standard error of sqrt(24 / n), here about 0.3
    assert abs(normal.excess_kurtosis) < 4 * np.sqrt(24 / DIFFERENCES)
    assert heavy.excess_kurtosis > 5


def test_autocorrelation_is_stated(campaign: Observations) -> None:
    draws = np.random.default_rng(6).standard_normal((REPEATS, SET_POINTS.size))
    slow = draws.copy()
    for k in range(1, REPEATS):
        slow[k] = 0.8 * slow[k - 1] + 0.6 * draws[k]
    scale = scale_of(campaign, "efficiency")
    (white_noise,) = estimate_noise(campaign, Replicates.of(campaign), scale * draws.ravel())
    (slow_noise,) = estimate_noise(campaign, Replicates.of(campaign), scale * slow.ravel())
    # successive differences of white noise correlate by -1/2, of this one by -1/10
    assert abs(white_noise.autocorrelation) < 0.3
    assert slow_noise.autocorrelation > 0.5


def test_set_points_read_twice_tell_nothing_of_a_memory() -> None:
    observations = loads(np.tile(np.linspace(300.0, 1500.0, 60), 2))
    (noise,) = estimate_noise(observations, Replicates.of(observations), white(observations))
    assert noise.differences == 60
    assert noise.autocorrelation == 0.0


def test_without_replicates_an_assumed_noise_stands_in() -> None:
    observations = loads(np.linspace(300.0, 1500.0, 30))
    (noise,) = estimate_noise(observations, Replicates.of(observations), np.zeros(30))
    assert noise.differences == 0
    assert noise.sigma > 0
    assert np.all(sigma_of(observations, [noise]) > 0)


def test_a_table_that_was_rounded_is_known_to_its_last_digit_only() -> None:
    exact = loads(SET_POINTS)
    rounded = replace(exact, value=10.0 * np.round(exact.value / 10.0))
    noise = estimate_noise(exact, Replicates.of(exact), np.zeros(SET_POINTS.size))
    added = sigma_of(rounded, noise) ** 2 - sigma_of(exact, noise) ** 2
    np.testing.assert_allclose(added, 10.0**2 / 12)  # uniform over a step of 10 W


def test_rows_without_load_tell_of_their_own_noise() -> None:
    loaded = pd.DataFrame({"D1": 0.9, "D2": 0.1, "P2_W": np.tile(SET_POINTS, 5), "kind": "load"})
    idle = pd.DataFrame({"kind": ["standby"] * 8, "P2_W": 0.0})
    frame = pd.concat([loaded.assign(P1_W=loaded["P2_W"] / 0.98), idle.assign(P1_W=0.0)], ignore_index=True)
    observations = observe(frame.assign(time_s=60.0 * np.arange(len(frame))), prototype())
    carries = observations.loaded[observations.row]
    residual = np.where(carries, 0.0, 0.12 * np.tile([1.0, -1.0], len(frame) // 2))
    noise = estimate_noise(observations, Replicates.of(observations), residual)
    sigma = sigma_of(observations, noise)
    assert np.all(sigma[~carries] > 0.12)  # the upper side
    assert np.all(sigma[carries] < 0.06)  # loaded rows repeat exactly: the floor of the instrument is left


def test_noise_is_that_of_the_range_below_a_share_of_the_rated_power() -> None:
    frame = pd.DataFrame(
        {"D1": 0.9, "D2": 0.1, "P2_W": [10.0, 100.0, 1000.0], "P1_W": 1010.0, "kind": "load"}
    )
    ten_times = replace(prototype(), rated_power_W=20e3)
    assert scale_of(observe(frame, prototype()), "efficiency").tolist() == [200.0, 200.0, 1000.0]
    assert scale_of(observe(frame, ten_times), "efficiency").tolist() == [2000.0, 2000.0, 2000.0]


def test_readings_of_a_load_that_wanders_are_replicates() -> None:
    rng = np.random.default_rng(7)
    power_W = np.tile(SET_POINTS, 15) * (1 + 1e-3 * np.clip(rng.standard_normal(60), -2.5, 2.5))
    wandering = loads(power_W)
    (noise,) = estimate_noise(wandering, Replicates.of(wandering), np.zeros(60))
    assert noise.differences == 4 * 14  # of each set point, less one


def test_a_set_power_that_was_not_noted_everywhere_makes_no_replicates(campaign: Observations) -> None:
    noted = replace(campaign, frame=campaign.frame.assign(P_set_W=campaign.frame["P2_W"]))
    nowhere = replace(campaign, frame=campaign.frame.assign(P_set_W=np.nan))
    partly = noted.frame["P_set_W"].where(campaign.frame["P2_W"] < 1000.0)
    somewhere = replace(campaign, frame=campaign.frame.assign(P_set_W=partly))
    wanted = [rows.tolist() for rows in Replicates.of(campaign).carrying]
    assert len(wanted) == SET_POINTS.size
    for observations in (noted, nowhere, somewhere):
        assert [rows.tolist() for rows in Replicates.of(observations).carrying] == wanted


def test_a_sweep_over_power_has_no_replicates() -> None:
    sweep = loads(np.linspace(300.0, 1500.0, 50))  # steps of 24 W
    (noise,) = estimate_noise(sweep, Replicates.of(sweep), np.zeros(50))
    assert noise.differences == 0


def heavy_sink(noise_K: float) -> Observations:
    """A heatsink's temperature at four set points, fifteen times each, with normal noise."""
    draw = np.random.default_rng(8).standard_normal(60)
    power_W = np.tile(SET_POINTS, 15)
    frame = pd.DataFrame({"D1": 0.9, "D2": 0.1, "P2_W": power_W, "kind": "load", "P1_W": power_W / 0.98})
    frame = frame.assign(T_heatsink_C=40.0 + noise_K * draw, time_s=60.0 * np.arange(60))
    return observe(frame, prototype())


@pytest.mark.parametrize("noise_K", [0.15, 0.6])
def test_replicates_count_with_what_they_say(noise_K: float) -> None:
    """A floor of 0.2 K and the margin of an estimate are cautions: what is left and replicates agree on less."""
    observations = heavy_sink(noise_K)
    residual = np.where(observations.of("T_heatsink_C"), observations.value - 40.0, 0.0)
    noise = estimate_noise(observations, Replicates.of(observations), residual)
    first = sigma_of(observations, noise)
    sigma = looked_at(observations, noise, first, residual / first)
    usual = np.median(sigma[observations.of("T_heatsink_C")])
    # 56 differences and 60 readings of the same noise: three standard errors of sqrt(1 / (2 n))
    assert usual == pytest.approx(noise_K, rel=3 * np.sqrt(1 / (2 * 60)))


def test_replicates_that_drift_do_not_undo_what_is_taken_for_noise() -> None:
    observations = heavy_sink(0.6)
    residual = np.where(observations.of("T_heatsink_C"), observations.value - 40.0, 0.0)
    noise = estimate_noise(observations, Replicates.of(observations), residual)
    first = 0.2 * sigma_of(observations, noise)
    left = np.random.default_rng(9).standard_normal(first.size)
    sigma = looked_at(observations, noise, first, left)
    # what is left is of one sigma, to three standard errors of sixty readings; replicates would have made it four
    assert np.median(sigma / first) == pytest.approx(1.0, rel=3 * np.sqrt(1 / (2 * 60)))


def test_replicates_that_share_their_rounding_do_not_deny_it() -> None:
    exact = loads(np.tile(SET_POINTS, 15))
    observations = replace(exact, value=10.0 * np.round(exact.value / 10.0))
    noise = estimate_noise(observations, Replicates.of(observations), np.zeros(60))
    first = sigma_of(observations, noise)
    left = np.random.default_rng(10).uniform(-5.0, 5.0, 60) / first
    sigma = looked_at(observations, noise, first, left)
    # a step of 10 W; the mean of sixty squares of a uniform deviate has a standard error of 12 %, its root of 6
    np.testing.assert_allclose(sigma, 10.0 / np.sqrt(12), rtol=0.18)


def test_a_single_reading_far_off_is_widened_and_the_others_are_not() -> None:
    observations = loads(np.linspace(300.0, 1500.0, 60))
    noise = estimate_noise(observations, Replicates.of(observations), np.zeros(60))
    left = np.random.default_rng(1).standard_normal(60)
    left[7], first = 30.0, np.full(60, 0.1)
    sigma = looked_at(observations, noise, first, left)
    assert sigma[7] > 8 * np.median(sigma)  # 30 sigmas, of which three are ordinary
    assert np.delete(sigma, 7).max() < 1.5 * np.median(sigma)


def test_what_normal_noise_leaves_does_not_change_it() -> None:
    many = loads(np.full(20_000, 500.0))
    noise = [ChannelNoise(channel="efficiency", sigma=1e-4, proportional=True, differences=0,
                          excess_kurtosis=0.0, autocorrelation=0.0)]  # fmt: skip
    first, left = np.full(20_000, 0.05), np.random.default_rng(4).standard_normal(20_000)
    # the mean square of n normal draws has a standard error of sqrt(2 / n), their root half of it: 0.5 %
    assert np.median(looked_at(many, noise, first, left)) == pytest.approx(0.05, rel=0.01)
