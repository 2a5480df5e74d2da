"""Values that are everyday one by one need not be so together."""

import numpy as np
import pytest

from models.diagnosis.everyday import everyday_together, log_everyday, nearest_everyday
from models.diagnosis.hypotheses import EVERYDAY, Fit, Term
from models.diagnosis.signatures import Signature
from models.diagnosis.whitener import Whitener
from sim.effects.catalogue import effect
from tests.models.diagnosis.fabricated import refinery

QUIET = Whitener.of(1e-4 * np.eye(3))
SAME, ANOTHER = np.array([1.0, 0.0, 0.0]), np.array([0.0, 1.0, 0.0])


def term(name: str, usual: float, *, sigma: float, slope: np.ndarray) -> Term:
    """A value so many everyday sigmas from off, known to ``sigma`` of them, that moves readings by one for each."""
    entry = effect(name)
    unit = entry.headline.tolerance
    signature = Signature(entry=entry, slope=slope / unit)
    return Term(
        signature=signature, value=entry.headline.off + usual * unit, sigma=sigma * unit, slope=slope / unit
    )


def cables(usual: float, *, sigma: float, slopes: tuple[np.ndarray, np.ndarray]) -> list[Term]:
    names = ("cable_resistance_input", "cable_resistance_output")
    return [term(name, usual, sigma=sigma, slope=slope) for name, slope in zip(names, slopes, strict=True)]


def test_two_halves_of_one_distance_are_not_ordinary() -> None:
    """The readings tell their sum, 14 sigmas, and nothing of their difference."""
    tied = (SAME, SAME + 1e-4 * ANOTHER)
    halves = cables(7.0, sigma=4.0, slopes=tied)
    assert not any(half.beyond_everyday for half in halves)
    assert not everyday_together(halves, QUIET)
    assert everyday_together(cables(3.4, sigma=4.0, slopes=tied), QUIET)  # 6.8 in sum, 4.8 as a length


def test_two_values_of_which_the_readings_tell_each_are_ordinary_within_the_line() -> None:
    apart = (SAME, ANOTHER)
    assert everyday_together(cables(3.4, sigma=0.01, slopes=apart), QUIET)
    assert not everyday_together(cables(4.0, sigma=0.01, slopes=apart), QUIET)
    assert everyday_together(cables(4.0, sigma=1.0, slopes=apart), QUIET)  # 0.66 beyond, known to 1


def test_what_is_beyond_alone_is_beyond_together() -> None:
    far, near = (
        cables(6.0, sigma=0.1, slopes=(SAME, ANOTHER))[0],
        cables(0.1, sigma=0.1, slopes=(SAME, ANOTHER))[1],
    )
    assert not everyday_together([far, near], QUIET)
    assert everyday_together([near], QUIET)
    assert everyday_together([], QUIET)


@pytest.mark.parametrize("correlation", [-0.95, -0.3, 0.0, 0.8])
def test_the_nearest_everyday_state_is_found(correlation: float) -> None:
    sigma, values = np.array([0.7, 2.0]), np.array([5.0, 4.5])
    covariance = np.outer(sigma, sigma) * np.array([[1.0, correlation], [correlation, 1.0]])
    angle = np.linspace(0.0, 2 * np.pi, 200_001)
    rim = 5.0 * np.stack([np.cos(angle), np.sin(angle)])  # where the nearest lies
    away = rim - values[:, None]
    tried = np.sqrt(np.min(np.sum(away * np.linalg.solve(covariance, away), axis=0)))
    # the grid's step of 1.3e-4 moves the smallest square by its own square
    assert nearest_everyday(values, covariance) == pytest.approx(tried, rel=1e-6)


def test_one_value_gives_the_line() -> None:
    assert nearest_everyday(np.array([EVERYDAY + 3.0]), np.array([[4.0]])) == pytest.approx(1.5, rel=1e-12)


@pytest.mark.parametrize(("sigmas", "share"), [(1.0, 1.0), (4.1, 0.5), (8.0, 0.0)])
def test_what_needs_a_part_beyond_the_line_does_not_count(sigmas: float, share: float) -> None:
    wave = 2.0 * np.sin(np.arange(24))
    bench = refinery(sigmas * wave, [], np.full(24, 0.1), wave[None])
    nothing = Fit.nothing(24)
    # known to a seventieth of a sigma, which the prior draws back by a fifteenth of that
    assert np.exp(log_everyday(bench, nothing)) == pytest.approx(share, abs=0.05)
