"""Readings that are held out, predicted by the covariance of all, against the matrix of the rest."""

from dataclasses import replace

import numpy as np
import pytest

from models.diagnosis.held_out import HeldOut
from models.diagnosis.whitener import Covariance, Whitener
from tests.models.diagnosis.test_whitener import PARTS, READINGS, written_out

RNG = np.random.default_rng(2)
VECTORS = RNG.standard_normal((3, READINGS))
WHOLE = written_out(PARTS)
SOME = np.isin(np.arange(READINGS), [1, 4, 5, 9])
A_BLOCK = np.isin(np.arange(READINGS), PARTS.rows[0])  # no reading of the other one
ONE = np.arange(READINGS) == 3
# rounding, condition below 1000
CLOSE = 1e-9


@pytest.mark.parametrize("covariance", [PARTS, WHOLE], ids=["parts", "whole"])
@pytest.mark.parametrize("out", [SOME, A_BLOCK, ONE], ids=["some", "a block", "one"])
def test_what_is_held_out_is_predicted_by_the_rest(
    covariance: Covariance | np.ndarray, out: np.ndarray
) -> None:
    predicted = HeldOut.of(Whitener.of(covariance), out).predicted(VECTORS)
    weights = np.linalg.solve(WHOLE[np.ix_(~out, ~out)], WHOLE[np.ix_(~out, out)])
    np.testing.assert_allclose(predicted[:, out], VECTORS[:, ~out] @ weights, rtol=CLOSE, atol=CLOSE)
    np.testing.assert_array_equal(predicted[:, ~out], VECTORS[:, ~out])


@pytest.mark.parametrize("covariance", [PARTS, WHOLE], ids=["parts", "whole"])
@pytest.mark.parametrize("out", [SOME, A_BLOCK, ONE], ids=["some", "a block", "one"])
def test_the_rest_is_solved_by_itself(covariance: Covariance | np.ndarray, out: np.ndarray) -> None:
    solved = HeldOut.of(Whitener.of(covariance), out).solve(VECTORS)
    expected = np.linalg.solve(WHOLE[np.ix_(~out, ~out)], VECTORS[:, ~out].T).T
    np.testing.assert_allclose(solved[:, ~out], expected, rtol=CLOSE, atol=CLOSE)
    assert not np.any(solved[:, out])


def test_what_is_held_out_tells_nothing() -> None:
    held_out = HeldOut.of(Whitener.of(PARTS), SOME)
    other = np.where(SOME, 1e6, VECTORS)
    np.testing.assert_array_equal(held_out.predicted(other), held_out.predicted(VECTORS))
    np.testing.assert_array_equal(held_out.solve(other), held_out.solve(VECTORS))


def test_what_only_the_readings_held_out_tell_does_not_end_it() -> None:
    common = 1e9 * RNG.standard_normal((4, READINGS))
    common[0] = np.where(SOME, common[0], 0.0)
    common[1] = common[2] + 1e-6 * common[1]
    parts = replace(PARTS, common=common)
    held_out = HeldOut.of(Whitener.of(parts), SOME)
    assert np.isfinite(held_out.predicted(VECTORS)).all()
