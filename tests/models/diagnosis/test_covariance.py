"""The covariance's building blocks against numpy, and what they must be."""

import numpy as np
import pytest

from models.diagnosis.covariance import Whitener, kernel


def random_covariance(size: int) -> np.ndarray:
    root = np.random.default_rng(1).standard_normal((size, size))
    return root @ root.T + size * np.eye(size)


def test_whitener_solves_as_numpy_does() -> None:
    covariance, right = random_covariance(12), np.random.default_rng(2).standard_normal((12, 3))
    solved = Whitener.of(covariance).solve(right)
    np.testing.assert_allclose(solved, np.linalg.solve(covariance, right), rtol=1e-10)  # condition below 100


def test_whitener_knows_the_log_determinant() -> None:
    covariance = random_covariance(12)
    sign, expected = np.linalg.slogdet(covariance)
    assert sign == 1
    assert Whitener.of(covariance).log_determinant == pytest.approx(expected, rel=1e-12)


def test_kernel_is_positive_definite_with_ones_on_its_diagonal() -> None:
    place = np.random.default_rng(3).uniform(0.0, 4.0, (60, 3))
    matrix = kernel(place, place)
    np.testing.assert_allclose(np.diag(matrix), 1.0, atol=1e-12)
    np.testing.assert_allclose(matrix, matrix.T, atol=1e-12)
    assert np.linalg.eigvalsh(matrix).min() > -60 * np.finfo(float).eps * 60  # zero, up to rounding


def test_kernel_falls_with_distance() -> None:
    origin, apart = np.zeros((1, 3)), np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [3.0, 0.0, 0.0]])
    np.testing.assert_allclose(kernel(origin, apart)[0], np.exp([0.0, -0.5, -4.5]), rtol=1e-12)
