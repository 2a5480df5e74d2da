"""The lab's analyzer: errors inside its specification, noise as a good one has."""

import numpy as np
import pytest

from drivers.mocks.lab.instruments import FACTOR, draw_instruments, read_element
from tests.drivers.mocks.lab.laboratories import PERFECT

MANY = 40000
LABS = [draw_instruments(np.random.default_rng(seed)) for seed in range(2000)]


def updates(element: int, seed: int = 1) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Many updates of 300 V, 5 A, 1500 W by an analyzer without fixed errors."""
    truth = [np.full(MANY, x) for x in (300.0, 5.0, 1500.0)]
    return read_element(PERFECT, element, truth, np.random.default_rng(seed))


@pytest.mark.parametrize(("element", "noise"), [(1, 1e-4), (2, 1e-4), (3, 4e-4), (4, 4e-4)])
def test_noise_of_power_is_as_stated(element: int, noise: float) -> None:
    _, _, watts = updates(element)
    assert np.mean(watts) == pytest.approx(1500.0, rel=1e-5)
    assert np.std(watts) == pytest.approx(1500.0 * noise, rel=0.03)  # 40,000 draws of a heavy tail


def test_noise_has_heavier_tails_than_normal() -> None:
    _, _, watts = updates(1)
    z = (watts - np.mean(watts)) / np.std(watts)
    assert np.mean(z**4) > 3.5  # 3 for a normal distribution, 6 for six degrees of freedom


def test_the_same_seed_reads_the_same() -> None:
    np.testing.assert_array_equal(updates(1, seed=4)[2], updates(1, seed=4)[2])


@pytest.mark.parametrize(("element", "limit"), [(1, 5e-4), (2, 5e-4), (3, 3e-3), (4, 3e-3)])
def test_gains_of_voltage_current_and_power_fill_the_specification(element: int, limit: float) -> None:
    volts = np.array([errors.voltage_gain[element] for errors in LABS])
    amps = np.array([errors.current_gain[element] for errors in LABS])
    for gain in (volts, amps, volts + amps):
        assert 0.95 * limit < np.max(np.abs(gain)) <= limit * (1 + 1e-9)  # a sum is rounded
    # 2000 draws tell a spread to 1.6 %; a uniform one has its limit over root three
    assert np.std(volts + amps) == pytest.approx(limit / np.sqrt(3), rel=0.05)
    assert np.std(volts) == pytest.approx(FACTOR * limit, rel=0.05)


def test_offsets_stay_inside_the_specification() -> None:
    for errors in LABS:
        assert abs(errors.offset_A[1]) <= 2.5e-3  # 0.05 % of a range of 5 A
        assert abs(errors.offset_A[2]) <= 5e-3  # and of 10 A
        assert max(abs(errors.offset_W[3]), abs(errors.offset_W[4])) <= 3.0  # 0.2 % of a range of 1500 W
        assert abs(errors.output_sense) <= 1e-3  # the converter's own sensor


def test_an_offset_current_is_read_as_power_at_no_load() -> None:
    errors = draw_instruments(np.random.default_rng(3))
    _, amps, watts = read_element(
        errors, 1, [np.array(300.0), np.array(0.0), np.array(0.0)], np.random.default_rng(1)
    )
    assert amps == pytest.approx(errors.offset_A[1], rel=1e-3)  # noise is relative
    assert watts == pytest.approx(300.0 * errors.offset_A[1], rel=1e-3)
