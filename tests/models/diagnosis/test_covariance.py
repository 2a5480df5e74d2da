"""The covariance's building blocks against numpy, and what they must be."""

import numpy as np

from models.diagnosis.covariance import kernel


def test_kernel_is_positive_definite_with_ones_on_its_diagonal() -> None:
    place = np.random.default_rng(3).uniform(0.0, 4.0, (60, 3))
    matrix = kernel(place, place)
    np.testing.assert_allclose(np.diag(matrix), 1.0, atol=1e-12)
    np.testing.assert_allclose(matrix, matrix.T, atol=1e-12)
    assert np.linalg.eigvalsh(matrix).min() > -60 * np.finfo(float).eps * 60  # zero, up to rounding


def test_kernel_falls_with_distance() -> None:
    origin, apart = np.zeros((1, 3)), np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [3.0, 0.0, 0.0]])
    np.testing.assert_allclose(kernel(origin, apart)[0], np.exp([0.0, -0.5, -4.5]), rtol=1e-12)
