"""A covariance by its parts against numpy on the whole matrix."""

import numpy as np
import pytest

from models.diagnosis.whitener import Covariance, Whitener

RNG = np.random.default_rng(1)
READINGS = 12
ORDER = RNG.permutation(READINGS)


def random_covariance(size: int) -> np.ndarray:
    root = RNG.standard_normal((size, size))
    return root @ root.T + size * np.eye(size)


PARTS = Covariance(
    rows=(np.sort(ORDER[:5]), np.sort(ORDER[5:])),
    own=(random_covariance(5), random_covariance(7)),
    common=3.0 * RNG.standard_normal((2, READINGS)),
)
RIGHT = RNG.standard_normal((READINGS, 3))


def written_out(parts: Covariance) -> np.ndarray:
    """The matrix that the parts make."""
    matrix = parts.common.T @ parts.common
    for rows, own in zip(parts.rows, parts.own, strict=True):
        matrix[np.ix_(rows, rows)] += own
    return matrix


@pytest.mark.parametrize("covariance", [PARTS, written_out(PARTS)], ids=["parts", "whole"])
def test_whitener_solves_as_numpy_does(covariance: Covariance | np.ndarray) -> None:
    expected = np.linalg.solve(written_out(PARTS), RIGHT)
    solved = Whitener.of(covariance).solve(RIGHT)
    np.testing.assert_allclose(solved, expected, rtol=1e-9)  # condition below 1000


@pytest.mark.parametrize("covariance", [PARTS, written_out(PARTS)], ids=["parts", "whole"])
def test_whitener_knows_the_log_determinant(covariance: Covariance | np.ndarray) -> None:
    sign, expected = np.linalg.slogdet(written_out(PARTS))
    assert sign == 1
    assert Whitener.of(covariance).log_determinant == pytest.approx(expected, rel=1e-12)  # rounding


@pytest.mark.parametrize("covariance", [PARTS, written_out(PARTS)], ids=["parts", "whole"])
def test_squares_are_products_with_what_is_solved(covariance: Covariance | np.ndarray) -> None:
    expected = np.sum(RIGHT * np.linalg.solve(written_out(PARTS), RIGHT), axis=0)
    np.testing.assert_allclose(Whitener.of(covariance).squares(RIGHT.T), expected, rtol=1e-9)  # as above


@pytest.mark.parametrize("covariance", [PARTS, written_out(PARTS)], ids=["parts", "whole"])
def test_directions_that_blocks_have_in_common_are_solved_as_any_others(
    covariance: Covariance | np.ndarray,
) -> None:
    whitener = Whitener.of(covariance)
    for directions in (PARTS.common[:1], PARTS.common, PARTS.common[1:], RIGHT.T):
        expected = np.linalg.solve(written_out(PARTS), directions.T).T
        np.testing.assert_allclose(whitener.solve_directions(directions), expected, rtol=1e-9)  # as above


def test_a_direction_inside_a_block_widens_it() -> None:
    more = RNG.standard_normal((3, READINGS))
    inside = np.setdiff1d(np.arange(READINGS), PARTS.rows[0])
    more[:2, inside] = 0.0  # the third reaches into every block
    wider = PARTS.wider(more)
    assert len(wider.common) == len(PARTS.common) + 1
    np.testing.assert_allclose(written_out(wider), written_out(PARTS) + more.T @ more, rtol=1e-12)  # rounding


def test_noise_is_on_the_diagonal() -> None:
    variance = RNG.uniform(1.0, 2.0, READINGS)
    np.testing.assert_allclose(
        written_out(PARTS.noisier(variance)),
        written_out(PARTS) + np.diag(variance),
        rtol=1e-12,  # rounding
    )


@pytest.mark.parametrize("covariance", [PARTS, written_out(PARTS)], ids=["parts", "whole"])
def test_whitener_knows_the_diagonal_of_the_inverse(covariance: Covariance | np.ndarray) -> None:
    expected = np.diag(np.linalg.inv(written_out(PARTS)))
    # condition below 1000
    np.testing.assert_allclose(Whitener.of(covariance).diagonal(), expected, rtol=1e-9)
