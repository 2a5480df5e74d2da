"""Woodbury's way against numpy on the whole matrix."""

import numpy as np
import pytest

from models.diagnosis.geometry import Geometry
from models.diagnosis.leftover import Leftover, Leftovers
from models.diagnosis.whitener import Whitener

READINGS, OWN = 14, np.array([0, 2])
RNG = np.random.default_rng(3)
ROOT = RNG.standard_normal((READINGS, READINGS))
SPREADS, BASIS = RNG.standard_normal((4, READINGS)), RNG.standard_normal((5, READINGS))
WHOLE = ROOT @ ROOT.T + READINGS * np.eye(READINGS) + SPREADS.T @ SPREADS
LEFTOVER = Leftover(location="input", amplitude=1.7, columns=np.array([1, 3, 4]))
LINE = Leftover(location="gain of P_link1_W", amplitude=2.3, columns=np.array([2]))
GEOMETRY = Geometry.of(
    Whitener.of(WHOLE), SPREADS, Leftovers(basis=BASIS, configurations=(LEFTOVER, LINE), shared_by=2)
)
VECTORS = RNG.standard_normal((3, READINGS))
NOBODY = np.empty(0, dtype=np.intp)


def direct(own: np.ndarray, leftover: Leftover | None) -> np.ndarray:
    """The covariance written out."""
    covariance = WHOLE - SPREADS[own].T @ SPREADS[own]
    if leftover is not None:
        columns = leftover.amplitude * BASIS[leftover.columns]
        covariance = covariance + columns.T @ columns
    return covariance


@pytest.mark.parametrize("leftover", [None, LEFTOVER, LINE])
@pytest.mark.parametrize("own", [NOBODY, OWN])
def test_products_and_determinant_are_those_of_the_matrix_written_out(
    own: np.ndarray, leftover: Leftover | None
) -> None:
    (((products,), (log_det,)),) = GEOMETRY.products_beside([GEOMETRY.project(VECTORS)], [own], [leftover])
    covariance = direct(own, leftover)
    np.testing.assert_allclose(
        products, VECTORS @ np.linalg.solve(covariance, VECTORS.T), rtol=1e-9, atol=1e-12
    )
    expected = np.linalg.slogdet(covariance)[1] - np.linalg.slogdet(WHOLE)[1]
    assert log_det == pytest.approx(expected, abs=1e-10)


@pytest.mark.parametrize("leftover", [None, LEFTOVER, LINE])
@pytest.mark.parametrize("own", [NOBODY, OWN])
def test_solutions_are_those_of_the_matrix_written_out(own: np.ndarray, leftover: Leftover | None) -> None:
    expected = np.linalg.solve(direct(own, leftover), VECTORS.T).T
    np.testing.assert_allclose(GEOMETRY.solve(VECTORS, own, leftover), expected, rtol=1e-9, atol=1e-12)


def test_products_beside_many_leftovers_are_those_beside_each() -> None:
    seen, own = [GEOMETRY.project(VECTORS), GEOMETRY.project(VECTORS[:2])], [OWN, NOBODY]
    beside = [LINE, None, LEFTOVER]
    together = GEOMETRY.products_beside(seen, own, beside)
    for k, leftover in enumerate(beside):
        alone = GEOMETRY.products_beside(seen, own, [leftover])
        for (products, log_dets), (one, log_det) in zip(together, alone, strict=True):
            np.testing.assert_allclose(products[k], one[0], rtol=1e-9)  # rounding
            assert log_dets[k] == pytest.approx(log_det[0], abs=1e-12)


def test_vectors_less_others_and_spreads_beside_them_are_as_projected() -> None:
    moved = VECTORS.copy()
    moved[-1] -= np.array([0.3, -2.0]) @ VECTORS[:-1]
    expected = GEOMETRY.project(np.concatenate([moved, SPREADS[OWN]]))
    seen = GEOMETRY.project(VECTORS).less(np.array([0.3, -2.0]))
    found = GEOMETRY.with_spreads(seen, OWN)
    np.testing.assert_allclose(found.each_other, expected.each_other, rtol=1e-9, atol=1e-12)  # rounding
    np.testing.assert_allclose(found.on_spreads, expected.on_spreads, rtol=1e-9, atol=1e-12)  # rounding
    np.testing.assert_allclose(found.on_basis, expected.on_basis, rtol=1e-9, atol=1e-12)  # rounding


def test_choices_among_vectors_have_the_products_of_each_alone() -> None:
    seen = GEOMETRY.project(VECTORS, basis=False)
    choices, own = np.array([[0, 2], [1, 2], [0, 1]]), [OWN, NOBODY, OWN[:1]]
    for found, chosen, spreads in zip(GEOMETRY.products_among(seen, choices, own), choices, own, strict=True):
        (((products,), (log_det,)),) = GEOMETRY.products_beside([seen.of(chosen)], [spreads], [None])
        np.testing.assert_allclose(found[0][0], products, rtol=1e-12)  # rounding
        assert found[1][0] == pytest.approx(log_det, abs=1e-12)


def test_directions_found_together_are_seen_as_each_alone() -> None:
    for found, vectors in zip(GEOMETRY.directions([VECTORS, SPREADS]), (VECTORS, SPREADS), strict=True):
        expected = GEOMETRY.project(vectors)
        np.testing.assert_allclose(found.seen.each_other, expected.each_other, rtol=1e-9)  # rounding
        np.testing.assert_allclose(found.seen.on_spreads, expected.on_spreads, rtol=1e-9)
        np.testing.assert_allclose(found.seen.on_basis, expected.on_basis, rtol=1e-9)
        np.testing.assert_allclose(found.solved, GEOMETRY.whitener.solve(vectors.T).T, rtol=1e-9)
