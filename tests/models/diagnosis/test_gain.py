"""The gain on held-out bands of power, on linear data whose cause is known."""

from dataclasses import replace

import numpy as np
import pytest

from models.diagnosis.gain import Gain, Readings, held_out_gains
from models.diagnosis.leftover import smooth_maps
from models.diagnosis.observations import Observations
from models.diagnosis.whitener import Covariance
from tests.models.diagnosis.fabricated import fit_of, loads

POWER = np.random.default_rng(1).permutation(np.linspace(200.0, 2000.0, 60))
GROWING = (POWER / 1000.0) ** 2 * 50.0  # W per Ohm: a series resistance
FLAT = np.full(60, 1.0)  # W per W: a constant loss
RESISTANCE_Ohm = 0.08
NOISE_W = 0.05
NOISE = NOISE_W * np.random.default_rng(2).standard_normal(60)


def campaign(residual: np.ndarray) -> Observations:
    return replace(loads(POWER), value=POWER / 0.98 + residual)


ALL = np.ones(60, dtype=bool)


def gains_of(
    residual: np.ndarray, spread: np.ndarray | None = None, counts: np.ndarray = ALL
) -> tuple[Gain, ...]:
    cause = fit_of("link_resistance", RESISTANCE_Ohm * GROWING, slope=GROWING, value=RESISTANCE_Ohm)
    rival = fit_of("auxiliary_power", 2.0 * FLAT, slope=FLAT, value=2.0)
    place = POWER[:, None] / 700.0
    plain = NOISE_W**2 * np.eye(60)
    if spread is not None:
        plain = plain + np.outer(spread, spread)
    readings = Readings(
        observations=campaign(residual),
        residual=residual,
        counts=counts,
        covariance=Covariance.whole(plain),
        leftover=5.0 * smooth_maps(place),
    )
    return held_out_gains(readings, cause, rival, seed=0)


def gain_of(residual: np.ndarray, spread: np.ndarray | None = None) -> Gain:
    return gains_of(residual, spread)[0]


def test_before_is_the_mean_gap_in_efficiency() -> None:
    gain = gain_of(RESISTANCE_Ohm * GROWING)
    P1 = POWER / 0.98
    exact = np.mean(np.abs(POWER / P1 - POWER / (P1 + RESISTANCE_Ohm * GROWING)))
    # the gain is linear in the gap, which is at most 0.8 % of the input power here
    assert gain.before == pytest.approx(exact, rel=0.01)


def test_the_true_cause_leaves_only_noise() -> None:
    gain = gain_of(RESISTANCE_Ohm * GROWING + NOISE)
    noise = np.mean(np.abs(NOISE) * POWER / (POWER / 0.98) ** 2)
    assert gain.after == pytest.approx(noise, rel=0.1)  # the fit's own error adds a sixtieth
    assert gain.after < 0.05 * gain.before


def test_a_wrong_cause_and_a_leftover_leave_more() -> None:
    gain = gain_of(RESISTANCE_Ohm * GROWING + NOISE)
    assert gain.wrong_cause is not None
    assert gain.wrong_cause > 5 * gain.after
    assert gain.leftover_only > 2 * gain.after


def test_a_leftover_takes_up_most_of_a_smooth_gap_beside_fitted_points() -> None:
    _, quarters = gains_of(RESISTANCE_Ohm * GROWING + NOISE)  # of the time: every power was fitted in others
    assert quarters.leftover_only < 0.5 * quarters.before


def test_calibration_takes_a_spread_up_beside_the_cause() -> None:
    gain = gain_of(RESISTANCE_Ohm * GROWING + NOISE + FLAT, spread=FLAT)
    noise = np.mean(np.abs(NOISE) * POWER / (POWER / 0.98) ** 2)
    assert gain.after > 3 * gain.calibrated
    assert gain.calibrated == pytest.approx(noise, rel=0.15)  # two parameters fitted to 45 readings


def test_every_error_lies_in_its_own_interval() -> None:
    gain = gain_of(RESISTANCE_Ohm * GROWING + NOISE + FLAT, spread=FLAT)
    low, high = gain.calibrated_ci95
    assert 0 < low < gain.before - gain.calibrated < high
    for name in ("before", "after", "wrong_cause", "leftover_only", "calibrated"):
        low, high = gain.intervals[name]
        assert low < getattr(gain, name) < high, name


def test_the_interval_of_a_real_gain_excludes_zero_and_holds_the_mean() -> None:
    gain = gain_of(RESISTANCE_Ohm * GROWING + NOISE)
    low, high = gain.ci95
    assert 0 < low < gain.before - gain.after < high


def test_an_outlier_is_not_judged() -> None:
    outlier = 7
    counts = np.arange(60) != outlier
    wild = RESISTANCE_Ohm * GROWING + np.where(counts, NOISE, 300.0)
    kept = np.abs(wild / (POWER / 0.98 + wild) ** 2 * POWER)[counts]
    assert gains_of(wild, counts=counts)[0].before == pytest.approx(np.mean(kept), rel=1e-9)  # rounding


def test_a_cause_that_is_not_there_gains_nothing() -> None:
    gain = gain_of(NOISE)
    assert gain.after == pytest.approx(gain.before, rel=0.1)  # one parameter fitted to 45 readings of noise


def test_too_few_readings_have_no_blocks() -> None:
    observations = loads(POWER[:8])
    fit = fit_of("link_resistance", GROWING[:8])
    readings = Readings(
        observations=observations,
        residual=np.zeros(8),
        counts=ALL[:8],
        covariance=Covariance.whole(np.eye(8)),
        leftover=np.eye(8),
    )
    assert held_out_gains(readings, fit, None, seed=0) == ()


def test_what_does_not_vary_has_no_blocks() -> None:
    # D1, D2 are fixed
    assert [gain.blocks for gain in gains_of(NOISE)] == ["power band", "quarter of the time"]


def test_what_lies_in_one_block_alone_is_not_held_out() -> None:
    seen = campaign(NOISE)
    steady = replace(seen, points=replace(seen.points, power_W=np.full(60, 1000.0)))
    readings = Readings(
        observations=steady,
        residual=NOISE,
        counts=ALL,
        covariance=Covariance.whole(NOISE_W**2 * np.eye(60)),
        leftover=np.ones((1, 60)),
    )
    cause = fit_of("link_resistance", RESISTANCE_Ohm * GROWING, slope=GROWING, value=RESISTANCE_Ohm)
    assert [gain.blocks for gain in held_out_gains(readings, cause, None, seed=0)] == ["quarter of the time"]


def test_held_out_time_is_predicted_from_other_times_only() -> None:
    late_W = 5.0 * (np.arange(60) >= 45)  # in the last quarter, at random powers
    bands, quarters = gains_of(late_W)
    assert bands.wrong_cause is not None
    assert quarters.wrong_cause is not None
    # a constant loss, fitted: 0 W for the last quarter and 5/3 W for the others; over bands 5/4 W for all
    expected = np.mean([5.0, 5 / 3, 5 / 3, 5 / 3]) / np.mean([3.75, 1.25, 1.25, 1.25])
    # in efficiency a watt counts by 1 / power: 60 random powers, a tenth
    assert quarters.wrong_cause / bands.wrong_cause == pytest.approx(expected, rel=0.1)
