"""Readings that stand alone are widened by what they are off, and never so many that they may be an effect."""

import numpy as np
import pytest

from models.diagnosis.lone import FAR, LEAST_ROWS, lone_variance
from models.diagnosis.whitener import Covariance, Whitener

COUNT = 40
ROW = np.arange(COUNT)


def alike() -> Whitener:
    """Noise of 1 beside what moves all readings together by 100, and what grows with the row."""
    common = np.stack([np.full(COUNT, 100.0), np.linspace(-100.0, 100.0, COUNT)])
    return Whitener.of(Covariance(rows=(ROW,), own=(np.eye(COUNT),), common=common))


def quiet() -> np.ndarray:
    return np.random.default_rng(4).normal(size=COUNT)


def test_what_readings_have_in_common_is_no_outlier() -> None:
    assert not np.any(lone_variance(alike(), quiet() + 250.0 + 3.0 * ROW, ROW))


@pytest.mark.parametrize("where", [(0,), (7, 30), (3, 4, 5, 6, 39)])
def test_those_far_off_are_widened_by_what_the_others_say_they_are_off(where: tuple[int, ...]) -> None:
    off = np.zeros(COUNT)
    off[list(where)] = 800.0
    found = lone_variance(alike(), quiet() + off - 250.0, ROW)
    assert tuple(np.flatnonzero(found)) == where
    off_by = np.sqrt(found[list(where)])
    np.testing.assert_allclose(off_by, 800.0, atol=5.0)  # noise of 1 there, and of the line


def test_as_many_as_may_be_an_effect_are_none() -> None:
    off = np.where(ROW < LEAST_ROWS, 800.0, 0.0)
    assert not np.any(lone_variance(alike(), quiet() + off, ROW))
    of_one_row = np.where(ROW < LEAST_ROWS, 0, ROW)
    assert np.count_nonzero(lone_variance(alike(), quiet() + off, of_one_row)) == LEAST_ROWS


def test_what_is_not_far_off_counts_as_it_did() -> None:
    off = np.zeros(COUNT)
    off[11] = FAR - 3.0  # noise there is below 3
    assert not np.any(lone_variance(alike(), quiet() + off, ROW))
