"""A cause whose own law is a little wrong in shape: it stays one cause, and its interval says so."""

from dataclasses import replace

import numpy as np
import pytest

from models.diagnosis.evidence import BesideLeftovers, posterior, with_laws_as_read
from models.diagnosis.extension import interval
from models.diagnosis.geometry import Geometry
from models.diagnosis.hypotheses import Fit, WeighedBeside
from models.diagnosis.law import Laws, law_columns, law_maps
from models.diagnosis.leftover import Leftovers
from models.diagnosis.refinery import Refinery
from models.diagnosis.search import search
from models.diagnosis.signatures import Signature
from models.diagnosis.thresholds import State
from models.diagnosis.whitener import Whitener
from sim.effects.base import Effect
from sim.effects.catalogue import effect
from tests.models.diagnosis.fabricated import joint_fit, loads, refinery

READINGS = 60
SIGMA = np.full(READINGS, 0.1)
POWER_W = np.random.default_rng(1).uniform(200.0, 1800.0, READINGS)
GROWING = 100.0 * (POWER_W / 1800.0) ** 2  # W per Ohm
LINK = Signature(entry=effect("link_resistance"), slope=GROWING)
LAW = LINK.entry.law
AUXILIARY = Signature(entry=effect("auxiliary_power"), slope=np.ones(READINGS))
GAIN = Signature(entry=effect("analyzer_gain"), slope=POWER_W)
BENT = 0.05 * np.cos(np.pi * POWER_W / 1800.0)  # of the cause's shift, over all loads
WRONG = 0.1 * GROWING * (1 + BENT) + SIGMA * np.random.default_rng(2).standard_normal(READINGS)
MAPS = np.stack([np.cos(k * np.pi * POWER_W / 1800.0) for k in (1, 2, 3)])


def bench(value: np.ndarray, law: float) -> Refinery:
    return refinery(value, [LINK, AUXILIARY, GAIN], SIGMA, laws=[(LINK, law * MAPS * GROWING)])


def named(value: np.ndarray, law: float) -> Fit:
    there = bench(value, law)
    return next(h.fit for h in posterior(BesideLeftovers.of(there, search(there))) if h.leftover is None)


def test_a_law_wrong_in_shape_by_five_per_cent_brings_no_second_cause() -> None:
    large = 4.0 * WRONG  # so that what brings a second one is more than parts are off by
    assert len(named(large, 0.0).effects) > 1  # taken for exact, it does
    assert named(large, 0.05).effects == ("link_resistance",)


def test_a_second_cause_that_is_there_is_still_found() -> None:
    assert named(WRONG + 3.0, 0.05).effects == ("auxiliary_power", "link_resistance")


def test_a_values_uncertainty_holds_what_its_law_and_its_part_are_worth() -> None:
    (term,) = named(WRONG, 0.05).terms
    law = term.signature.entry.law
    spread = replace(term, signature=replace(term.signature, everyday=0.002))
    assert spread.uncertainty(0.0) == pytest.approx(
        np.sqrt(term.sigma**2 + 0.002**2 + (law * term.value) ** 2),
        rel=1e-12,  # rounding
    )
    assert term.sigma > 2 * named(WRONG - 0.1 * GROWING * BENT, 0.0).terms[0].sigma


def test_a_value_that_is_extrapolated_is_the_less_sure() -> None:
    (term,) = named(WRONG, 0.05).terms
    entry = replace(term.signature.entry, extrapolated=0.7)
    further = replace(term, signature=replace(term.signature, entry=entry))
    expected = np.hypot(term.uncertainty(0.0), 0.7 * term.value * term.distance)
    assert further.uncertainty(0.0) == pytest.approx(expected, rel=1e-12)  # rounding
    assert expected > 1.5 * term.uncertainty(0.0)


def test_what_a_law_is_worth_counts_once() -> None:
    there, fit = bench(WRONG, LAW), named(WRONG, LAW)
    (term,) = fit.terms
    shapes = LAW * term.distance * MAPS * GROWING
    weights = np.linalg.solve(np.diag(SIGMA**2) + shapes.T @ shapes, GROWING)
    of_shapes = np.linalg.norm(shapes @ weights) / (GROWING @ weights + term.head.prior**-2)
    assert 0.1 * LAW * term.distance < of_shapes < LAW * term.distance  # so that a part is left for the level
    low, high = interval(there, fit, "link_resistance")
    whole = np.sqrt(term.sigma**2 - of_shapes**2 + (LAW * term.distance) ** 2)
    assert high - low == pytest.approx(2 * 1.96 * whole, rel=1e-9)  # rounding


def test_weighing_with_columns_is_weighing_with_the_covariance_that_they_make() -> None:
    fit = bench(WRONG, 0.05).weighed(named(WRONG, 0.05))
    law = 0.05 * named(WRONG, 0.05).terms[0].distance * MAPS * GROWING
    matrix = np.diag(SIGMA**2) + law.T @ law
    none = Leftovers(basis=np.empty((0, READINGS)), configurations=(), shared_by=0)
    whole = Geometry.of(Whitener.of(matrix), np.zeros((0, READINGS)), none)
    plain = Refinery(known=bench(WRONG, 0.0).known, observations=bench(WRONG, 0.0).observations,
                     baseline=bench(WRONG, 0.0).baseline, geometry=whole)  # fmt: skip
    expected = plain.weighed(named(WRONG, 0.05))
    bare = Whitener.of(np.diag(SIGMA**2)).log_determinant
    constant = 0.5 * (whole.whitener.log_determinant - bare)
    assert fit.log_evidence == pytest.approx(expected.log_evidence - constant, abs=1e-6)  # rounding
    np.testing.assert_allclose(fit.sigma, expected.sigma, rtol=1e-9)


def test_what_is_left_is_pulled_under_the_same_covariance() -> None:
    there, fit = bench(WRONG, 0.05), named(WRONG, 0.05)
    law = 0.05 * fit.terms[0].distance * MAPS * GROWING
    expected = np.linalg.solve(np.diag(SIGMA**2) + law.T @ law, WRONG - fit.shift)
    np.testing.assert_allclose(there.solved(fit), expected, rtol=1e-8, atol=1e-8)


def as_read(value: np.ndarray, law: float) -> Refinery:
    there = bench(value, law)
    return with_laws_as_read(BesideLeftovers.of(there, search(there))).refinery


def test_a_law_that_readings_agree_with_is_doubted_less() -> None:
    feared, found = bench(WRONG, 0.05).laws, as_read(WRONG - 0.1 * GROWING * BENT, 0.05).laws
    assert (feared.share, found.share) == (1.0, 0.3)
    whole, less = (laws.directions(LINK, 0.1) for laws in (feared, found))
    assert whole is not None
    assert less is not None
    assert less.factor == pytest.approx(0.3 * whole.factor, rel=1e-12)  # rounding


def test_a_law_that_is_as_wrong_as_feared_is_doubted_as_ever() -> None:
    assert as_read(WRONG, 0.05).laws.share == 1.0


def test_where_something_is_left_over_no_law_is_doubted_less() -> None:
    strange = 3.0 * np.sign(np.sin(7.0 * np.arange(READINGS)))  # which only a leftover explains
    there = bench(0.1 * GROWING + strange, 0.05)
    found = posterior(BesideLeftovers.of(there, search(there)))
    assert sum(h.probability for h in found if h.leftover is not None) > 0.99
    assert with_laws_as_read(BesideLeftovers.of(there, search(there))).refinery is there


@pytest.mark.parametrize(("then", "share"), [(1, 0.3), (2, 1.0)])
def test_where_it_takes_a_cause_more_no_law_is_doubted_less(
    then: int, share: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    there = bench(WRONG, 0.05)
    slopes = {"link_resistance": GROWING, "auxiliary_power": np.ones(READINGS)}
    fits = [joint_fit(dict(list(slopes.items())[:causes]), 0.1 * GROWING) for causes in (1, 2)]

    def made_up(beside: BesideLeftovers) -> tuple[np.ndarray, list[WeighedBeside]]:
        """Ten in log evidence better with laws doubted less, by so many causes then."""
        less = beside.refinery.laws.share < 1.0
        best = [len(fit.terms) == (then if less else 1) for fit in beside.fits]
        return np.where(best, 10.0 if less else 0.0, -np.inf)[:, None], []

    monkeypatch.setattr(BesideLeftovers, "log_weights", made_up)
    assert with_laws_as_read(BesideLeftovers.of(there, fits)).refinery.laws.share == share


def test_where_a_threshold_lies_is_doubted_as_ever() -> None:
    step = Signature(entry=effect("fan_step"), other={"threshold_C": 40.0}, slope=np.ones(READINGS))
    laws = replace(Laws.of([(step, np.ones((1, READINGS)))], bench(WRONG, 0.0).geometry), share=0.3)
    directions = laws.directions(step, 2.0)
    assert directions is not None
    assert directions.factor == 2.0


def test_maps_of_a_law_are_smooth_and_have_no_level() -> None:
    maps, near = law_maps(loads(POWER_W)), np.argsort(POWER_W)  # one channel: it has no factor of its own
    np.testing.assert_allclose(maps.mean(axis=1), 0.0, atol=1e-12)
    assert np.max(np.abs(np.diff(maps[0, near]))) < 0.2 * np.ptp(maps[0, near])  # 60 loads over a broad bump


def test_a_reading_near_a_threshold_is_free_to_lie_on_either_side() -> None:
    observations = loads(np.linspace(300.0, 1500.0, 10))
    heatsink_C, exact = np.linspace(35.0, 44.0, 10), np.zeros(10)
    state = State(value={"T_heatsink_C": heatsink_C}, sigma={"T_heatsink_C": exact})
    slope = (heatsink_C > 40.0).astype(float)
    low = Signature(entry=effect("fan_step"), other={"threshold_C": 30.0}, slope=np.ones(10))
    step = Signature(entry=effect("fan_step"), other={"threshold_C": 40.0}, slope=slope)
    ((_, of_low), (_, of_step)) = law_columns([low, step], observations, state)
    # a whole step; what is smooth is two per cent of one
    free = np.flatnonzero(np.any(of_step == 1.0, axis=0))
    np.testing.assert_array_equal(free, [4, 5, 6])  # 39 to 41 degC: the threshold is good to 1.5 K
    assert not np.any(of_low == 1.0)
    assert Laws.none().directions(step, 1.0) is None


def test_beyond_the_last_threshold_that_is_tried_readings_are_as_free() -> None:
    heatsink_C = np.linspace(35.0, 44.0, 10)
    state = State(value={"T_heatsink_C": heatsink_C}, sigma={"T_heatsink_C": np.zeros(10)})
    slope = np.where(heatsink_C > 40.0, 1.0, 0.0)
    alone = Signature(entry=effect("fan_step"), other={"threshold_C": 40.0}, slope=slope)
    ((_, columns),) = law_columns([alone], loads(np.linspace(300.0, 1500.0, 10)), state)
    np.testing.assert_array_equal(np.flatnonzero(np.any(columns == 1.0, axis=0)), [4, 5, 6])


def test_where_nobody_read_the_temperature_more_readings_are_free_and_each_by_its_odds() -> None:
    observations = loads(np.linspace(300.0, 1500.0, 10))
    state = State(
        value={"T_heatsink_C": np.linspace(35.0, 44.0, 10)}, sigma={"T_heatsink_C": np.full(10, 1.0)}
    )
    step = Signature(entry=effect("fan_step"), other={"threshold_C": 40.0}, slope=np.ones(10))
    ((_, columns),) = law_columns([step], observations, state)
    free = np.max(columns[np.sum(columns != 0.0, axis=1) == 1], axis=0)
    np.testing.assert_array_equal(free[4:7], 1.0)  # within 1.5 K, as ever
    assert np.all(np.diff(free[:5]) >= 0.0)
    assert np.all(np.diff(free[6:]) <= 0.0)
    assert 0.9 < free[3] < 0.95  # half a sigma beyond: odds of 0.31 to 0.69
    assert free[0] == 0.0  # three and a half sigmas beyond


def test_what_a_formula_is_known_to_leave_out_is_in_proportion_to_what_the_cause_does() -> None:
    skin, observations = Signature(entry=effect("skin_effect"), slope=GROWING), loads(POWER_W)
    share = np.linspace(0.0, 0.5, READINGS)

    def errors(entry: Effect) -> list[np.ndarray]:
        return [share, share**2] if entry.name == "skin_effect" else []

    (_, plain), (_, of_link) = law_columns([skin, LINK], observations, State())
    (_, (*others, flat, flatter)), (_, link) = law_columns([skin, LINK], observations, State(), errors)
    np.testing.assert_array_equal(others, plain)
    np.testing.assert_array_equal(link, of_link)
    np.testing.assert_allclose([flat, flatter], [share * GROWING, share**2 * GROWING], rtol=1e-12)  # rounding
