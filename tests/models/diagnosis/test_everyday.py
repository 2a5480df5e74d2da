"""Values that are everyday one by one need not be so together."""

import numpy as np
import pytest
from scipy.stats import norm

from models.diagnosis.everyday import (
    everyday_together,
    log_as_part,
    log_everyday,
    nearest_everyday,
    parts_beyond,
    share_beyond,
)
from models.diagnosis.hypotheses import EVERYDAY, Fit, Term
from models.diagnosis.signatures import Signature
from models.diagnosis.whitener import Whitener
from sim.effects.catalogue import effect
from tests.models.diagnosis.fabricated import fit_of, refinery

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


def together(terms: list[Term]) -> bool:
    return everyday_together(Fit(terms=tuple(terms), shift=np.zeros(3)), QUIET)


def test_two_halves_of_one_distance_are_not_ordinary() -> None:
    """The readings tell their sum, 14 sigmas, and nothing of their difference."""
    tied = (SAME, SAME + 1e-4 * ANOTHER)
    halves = cables(7.0, sigma=4.0, slopes=tied)
    assert not any(half.beyond_everyday for half in halves)
    assert not together(halves)
    assert together(cables(3.4, sigma=4.0, slopes=tied))  # 6.8 in sum, 4.8 as a length


def test_two_values_of_which_the_readings_tell_each_are_ordinary_within_the_line() -> None:
    apart = (SAME, ANOTHER)
    assert together(cables(3.4, sigma=0.01, slopes=apart))
    assert not together(cables(4.0, sigma=0.01, slopes=apart))
    assert together(cables(4.0, sigma=1.0, slopes=apart))  # 0.66 beyond, known to 1


def test_a_part_that_has_to_be_further_off_than_any_is_said_with_its_sigmas() -> None:
    spread = np.array([1.0, 1.0, 1.0])
    for off, said in ((3.9, {}), (6.0, {"spread 0": 6.0})):
        bench = refinery(off * spread, [], np.full(3, 1e-3), spreads=spread[None])
        # of what the readings are off by, noise takes some 1e-6
        assert parts_beyond(bench, Fit.nothing(3)) == pytest.approx(said, rel=1e-5)


def test_a_cause_alone_that_is_badly_seen_is_beyond_the_line_as_parts_scatter() -> None:
    """Whether it is there at all is for its probability; beside another it may be uncertain for that one's sake."""
    near, far = (cables(usual, sigma=3.0, slopes=(SAME, ANOTHER)) for usual in (5.7, 5.8))  # of 4.1 and 1.64
    assert together(near[:1])
    assert not together(far[:1])
    assert not far[0].beyond_everyday
    assert together([far[0], cables(0.1, sigma=0.1, slopes=(SAME, ANOTHER))[1]])


def test_what_is_beyond_alone_is_beyond_together() -> None:
    far, near = (
        cables(6.0, sigma=0.1, slopes=(SAME, ANOTHER))[0],
        cables(0.1, sigma=0.1, slopes=(SAME, ANOTHER))[1],
    )
    assert not together([far, near])
    assert together([near])
    assert together([])


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


def test_parts_are_as_far_off_as_the_readings_have_them_beside_laws_and_a_leftover() -> None:
    k, sigma = np.arange(24), np.linspace(0.2, 0.4, 24)
    spreads = np.stack([np.sin(0.9 * k), np.cos(0.4 * k), 0.3 * np.sin(0.2 * k)])
    cause, law = fit_of("link_resistance", 0.1 * k, slope=1.0 * k, value=0.1), np.cos(1.3 * k)
    residual = cause.shift + 4.2 * spreads[0] - 3.9 * spreads[1]
    signature = cause.terms[0].signature
    bench = refinery(residual, [signature], sigma, spreads, laws=[(signature, law[None])])
    for leftover in (None, bench.geometry.leftovers.configurations[0]):
        beside = 0.0 if leftover is None else leftover.amplitude**2
        covariance = np.diag(sigma**2 + beside) + spreads.T @ spreads + 0.1**2 * np.outer(law, law)
        solved = np.linalg.solve(covariance, spreads.T)
        mean, scale = (
            residual @ solved - cause.shift @ solved,
            np.sqrt(1.0 - np.sum(spreads.T * solved, axis=0)),
        )
        within = norm.cdf((EVERYDAY - mean) / scale) - norm.cdf((-EVERYDAY - mean) / scale)
        assert 0.01 < np.prod(within) < 0.99
        assert log_everyday(bench, cause, leftover) == pytest.approx(
            np.sum(np.log(within)), rel=1e-8
        )  # rounding


def density(x: float | np.ndarray, sigma: float) -> float | np.ndarray:
    return np.exp(-0.5 * (x / sigma) ** 2) / sigma


VALUES = [
    ("leakage_inductance", -0.0386, 0.003),  # just inside a line of 0.041, as its slope may go either way
    ("leakage_inductance", -0.0450, 0.003),
    ("leakage_inductance", -0.0480, 0.003),
    ("link_resistance", 0.0100, 0.004),  # which is never below zero
    ("magnetizing_inductance", 0.0140, 0.003),
    ("magnetizing_inductance", 0.0197, 0.005),  # acts by its reciprocal
    ("magnetizing_inductance", 0.0072, 0.0004),
]
BROAD = ("leakage_inductance", -0.0600, 0.020), ("leakage_inductance", -0.0600, 0.040)
BEYOND = [-0.0480, 0.0072]


@pytest.mark.parametrize(("name", "value", "sigma"), VALUES)
def test_what_of_a_value_is_beyond_the_line_is_the_integral(name: str, value: float, sigma: float) -> None:
    head = effect(name).headline
    grid = np.linspace(head.lower, head.upper, 2_000_001)
    acting = head.off * (1 - head.off / grid) if head.reciprocal else grid - head.off
    far = np.abs(acting) > EVERYDAY * head.tolerance

    def share(mean: float, scale: float) -> float:
        mass = density(grid - mean, scale)
        return float(np.sum(mass[far]) / np.sum(mass))

    signature = Signature(entry=effect(name), slope=SAME)
    term = Term(signature=signature, value=value, sigma=sigma, slope=SAME)
    # the grid's step of some 1e-7 of the bounds, over the least width
    assert share_beyond(term) == pytest.approx(share(value, sigma) / share(head.off, head.prior), rel=1e-3)


@pytest.mark.parametrize("spread", [1.0, 0.5])
@pytest.mark.parametrize(("name", "value", "sigma"), [v for v in VALUES if v[1] not in BEYOND])
def test_the_evidence_of_a_value_as_a_part_is_the_integral(
    name: str, value: float, sigma: float, spread: float
) -> None:
    """Parts whose spread is narrower than the tolerance have that spread, and the tolerance's line."""
    head = effect(name).headline
    everyday = spread * head.tolerance
    if head.reciprocal:
        sigma *= 0.1  # so that what acts is straight over the value's uncertainty
    signature = Signature(entry=effect(name), slope=SAME, everyday=everyday)
    term = Term(signature=signature, value=value, sigma=sigma, slope=SAME)
    # what the readings alone say: the value, drawn to off by its prior, has been taken back
    alone = (sigma**-2 - head.prior**-2) ** -0.5
    told = head.off + (value - head.off) * (1 + (alone / head.prior) ** 2)
    grid = np.linspace(told - 40 * alone, told + 40 * alone, 2_000_001)
    acting = head.off * (1 - head.off / grid) if head.reciprocal else grid - head.off
    slope = (head.off / grid) ** 2 if head.reciprocal else 1.0
    seen = density(grid - told, alone)
    as_part = seen * density(acting, everyday) * slope * (np.abs(acting) < EVERYDAY * head.tolerance)
    as_cause = seen * density(grid - head.off, head.prior)
    expected = np.sum(as_part) / np.sum(as_cause)
    # how far what acts is from straight over half a millihenry, five sigmas out in its tail
    tolerance = 0.5 if head.reciprocal else 1e-3
    assert np.exp(log_as_part(term)) == pytest.approx(expected, rel=tolerance)


@pytest.mark.parametrize(("name", "value", "sigma"), [*(v for v in VALUES if v[1] in BEYOND), *BROAD])
def test_a_value_surely_beyond_the_line_is_no_part(name: str, value: float, sigma: float) -> None:
    signature = Signature(entry=effect(name), slope=SAME)
    assert log_as_part(Term(signature=signature, value=value, sigma=sigma, slope=SAME)) == -np.inf


def test_what_parts_are_off_by_as_far_as_a_prior_reaches_is_hardly_ever_a_cause() -> None:
    head = effect("leakage_inductance").headline
    wide = Signature(entry=effect("leakage_inductance"), slope=SAME, everyday=head.prior)
    far = Term(signature=wide, value=0.99 * head.upper, sigma=1e-3, slope=SAME)
    assert share_beyond(far) == 0.0


@pytest.mark.parametrize(("value", "there"), [(-0.6, True), (1.999, True), (1.9, False), (0.0, False)])
def test_a_value_is_at_its_bound_where_the_search_ends(value: float, there: bool) -> None:
    entry = effect("output_capacitance")
    assert (entry.headline.lower, entry.headline.upper) == (-0.6, 2.0)
    assert (
        Term(signature=Signature(entry=entry, slope=SAME), value=value, sigma=0.1, slope=SAME).at_bound
        is there
    )
