"""Settling and uncertainty, on samples whose truth is known."""

import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest

from bench.config import MeasureConfig, SettlingConfig
from bench.instruments import TEMPERATURES, Sample
from bench.measure import line, measure, settle, uncertainties, unsettled
from drivers.clock import StepClock

SETTINGS = SettlingConfig(window_s=10, sample_every_s=2, limit_s=300)
RANGES = {"range_U1_V": 300.0, "range_I1_A": 5.0, "range_U2_V": 150.0, "range_I2_A": 10.0}


def error_limit_W(power_W: float, range_W: float) -> float:
    return 0.0005 * power_W + 0.001 * range_W


def sample(time_s: float, P1_W: float, P2_W: float = 970.0, heatsink_C: float = 50.0) -> Sample:
    temperatures = dict.fromkeys(TEMPERATURES, 40.0) | {"T_heatsink_C": heatsink_C}
    return Sample(time_s=time_s, values={"P1_W": P1_W, "P2_W": P2_W, **temperatures})


def settling_time(rise_W: float, tau_s: float, noise: float = 0.0, heat_K: float = 0.0) -> tuple[bool, float]:
    """Settle on an input power that approaches 1000 W, and a heatsink that approaches 50 degC."""
    clock, rng = StepClock(), np.random.default_rng(2)

    def take() -> Sample:
        decay = math.exp(-clock.now() / tau_s)
        P1_W = (1000.0 + rise_W * decay) * (1 + noise * rng.normal())
        return sample(clock.now(), P1_W, heatsink_C=50.0 - heat_K * decay)

    settled = settle(take, clock.sleep, SETTINGS, power_W=2000.0)
    return settled.ok, settled.seconds


def test_a_steady_point_takes_one_window() -> None:
    assert settling_time(0.0, 1.0) == (True, 10.0)


def test_an_exponential_settles_when_its_slope_is_below_the_limit() -> None:
    ok, seconds = settling_time(20.0, 20.0)
    # relative slope 20/1000/20 · exp(-t/20) falls to 1e-5 per s at 92 s; the window reaches back 10 s,
    # where the slope is larger: between 92 s and one window and a sample later
    assert ok
    assert 92.0 <= seconds <= 92.0 + 12.0


def test_heat_alone_keeps_a_point_from_settling() -> None:
    ok, seconds = settling_time(0.0, 60.0, heat_K=20.0)
    # 20/60 K/s falls to 0.02 K/s at 60·ln(16.7) = 169 s
    assert ok
    assert 168.0 <= seconds <= 168.0 + 12.0


def test_small_noise_does_not_hinder_settling() -> None:
    ok, seconds = settling_time(0.0, 1.0, noise=5e-5)
    assert ok
    assert seconds < 60.0  # a window whose slope is significant by chance, 5 in 100, is passed soon


def test_a_wild_point_ends_at_the_time_limit_and_says_what_moved() -> None:
    clock, rng = StepClock(), np.random.default_rng(2)
    take = lambda: sample(clock.now(), 1000.0 * (1 + 0.01 * rng.normal()))  # noqa: E731
    settled = settle(take, clock.sleep, SETTINGS, power_W=2000.0)
    assert (settled.ok, settled.seconds) == (False, 300.0)
    assert "P1 spreads by 0.0" in settled.said


def test_what_is_still_warming_is_called_by_its_name() -> None:
    window = [sample(2.0 * k, 1000.0, heatsink_C=50.0 + 0.1 * k) for k in range(6)]
    assert unsettled(window, SETTINGS, power_W=2000.0) == "heatsink drifts by 0.05 K/s"
    cooling = [replace(s, time_s=-s.time_s) for s in reversed(window)]
    assert unsettled(cooling, SETTINGS, power_W=2000.0) == "heatsink drifts by −0.05 K/s"


def test_a_jump_inside_the_window_is_not_settled() -> None:
    clock = StepClock()
    take = lambda: sample(clock.now(), 1000.0 if clock.now() < 8.0 else 1010.0)  # noqa: E731
    assert settle(take, clock.sleep, SETTINGS, power_W=2000.0).seconds >= 18.0


def test_standby_settles_on_input_power_alone() -> None:
    clock = StepClock()
    take = lambda: sample(clock.now(), 8.0, P2_W=0.0)  # noqa: E731
    assert settle(take, clock.sleep, SETTINGS, power_W=2000.0).ok


def test_line_agrees_with_numpy() -> None:
    rng = np.random.default_rng(0)
    t, y = np.sort(rng.uniform(0, 10, 9)), rng.normal(size=(9, 3))
    slope, error, _ = line(t, y)
    for k in range(3):
        fit, covariance = np.polyfit(t, y[:, k], 1, cov=True)
        assert slope[k] == pytest.approx(fit[0], rel=1e-9)  # the same arithmetic
        assert error[k] == pytest.approx(math.sqrt(covariance[0, 0]), rel=1e-9)


def test_type_B_alone_follows_the_analyzer() -> None:
    found = uncertainties([sample(0.0, 1000.0)] * 4, error_limit_W, RANGES)
    u1 = (0.0005 * 1000 + 0.001 * 1500) / math.sqrt(3)
    u2 = (0.0005 * 970 + 0.001 * 1500) / math.sqrt(3)
    assert found["u_P1_W"] == pytest.approx(u1)
    assert found["u_P2_W"] == pytest.approx(u2)
    assert found["u_efficiency"] == pytest.approx(0.97 * math.hypot(u1 / 1000, u2 / 970))


def test_type_A_shrinks_with_the_root_of_the_count() -> None:
    few = [sample(0.0, 1000.0 + d) for d in (-1.0, 1.0)] * 2
    many = few * 25
    exact = lambda _W, _range_W: 0.0  # noqa: E731
    ratio = uncertainties(few, exact, RANGES)["u_P1_W"] / uncertainties(many, exact, RANGES)["u_P1_W"]
    assert ratio == pytest.approx(5.0 * math.sqrt(99 / 100 * 4 / 3), rel=1e-9)  # √25, and n - 1 for n


def test_measure_averages_and_keeps_the_updates() -> None:
    updates: Iterator[Sample] = iter([sample(t, 1000.0 + t) for t in (0.0, 1.0, 2.0, 3.0)])
    row = measure(lambda: next(updates), MeasureConfig(samples=4), error_limit_W, RANGES)
    assert row.numbers["P1_W"] == 1001.5
    assert row.numbers["time_s"] == 1.5
    assert row.numbers["efficiency"] == pytest.approx(970.0 / 1001.5)
    assert [update["P1_W"] for update in row.samples] == [1000.0, 1001.0, 1002.0, 1003.0]
