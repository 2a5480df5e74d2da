"""Values that an ordinary bench may have, and thresholds that take up what another cause leaves: no causes."""

from dataclasses import replace

import numpy as np
import pytest

from models.diagnosis.evidence import Hypothesis
from models.diagnosis.verdict import judge
from models.diagnosis.whitener import Whitener
from sim.effects.catalogue import CATALOGUE
from tests.models.diagnosis.fabricated import fit_of, joint_fit

SIGMA = 0.5
WHITENER = Whitener.of(SIGMA**2 * np.eye(4))
ALONG, ACROSS = np.array([30.0, 0.0, 0.0, 0.0]), np.array([0.0, 40.0, 0.0, 0.0])


def test_a_cause_no_further_off_than_any_ordinary_part_is_not_named() -> None:
    head = CATALOGUE["fan_step"].headline
    for tolerances, kind in ((1.0, "consistent"), (5.0, "named")):
        fit = fit_of("fan_step", ALONG, value=head.off + tolerances * head.tolerance)
        assert judge([Hypothesis(fit=fit, leftover=None, probability=1.0)], WHITENER).kind == kind


def test_what_is_surely_beyond_a_thousand_benches_is_a_cause() -> None:
    head = CATALOGUE["fan_step"].headline
    # 25 normal spreads, one lab of a thousand; 95 % of the fit's sigma
    line = head.off + 4.1 * head.tolerance + 1.64 * 0.1
    for value, consistent in ((line - 0.01, 0.9), (line + 0.01, 0.0)):
        fit = fit_of("fan_step", ALONG, value=value)
        verdict = judge([Hypothesis(fit=fit, leftover=None, probability=0.9)], WHITENER)
        assert verdict.consistent_probability == pytest.approx(consistent)
        assert [c.effect for c in verdict.causes] == ([] if consistent else ["fan_step"])


def test_what_acts_by_its_reciprocal_is_as_far_off_as_that() -> None:
    head = CATALOGUE["magnetizing_inductance"].headline
    for value, kind in (
        (head.off + 6 * head.tolerance, "consistent"),
        (head.off - 5 * head.tolerance, "named"),
    ):
        fit = fit_of("magnetizing_inductance", ALONG, value=value)
        sure = replace(fit, terms=(replace(fit.terms[0], sigma=1e-5),))
        assert judge([Hypothesis(fit=sure, leftover=None, probability=1.0)], WHITENER).kind == kind


def test_an_uncertain_value_far_off_is_beyond_the_line_by_the_nearer_end_of_its_interval() -> None:
    """3 of 12 mH, known to 1.3 mH: at 5.2 mH it is far off still, though on the slope at 3 mH it would not be."""
    head = CATALOGUE["magnetizing_inductance"].headline
    (term,) = fit_of("magnetizing_inductance", ALONG, value=head.off / 4).terms
    acting, sigma, usual = replace(term, sigma=head.off / 9).acting
    assert abs(acting) < 4.1 * usual + 1.64 * sigma
    assert replace(term, sigma=head.off / 9).beyond_everyday
    assert not replace(term, sigma=head.off / 2).beyond_everyday  # the interval goes past off


def test_a_small_threshold_beside_another_cause_does_not_count() -> None:
    prior = CATALOGUE["fan_step"].headline.prior
    for value, stated in ((0.6 * prior, ()), (0.9 * prior, ("fan_step",))):
        fit = joint_fit({"link_resistance": ALONG, "fan_step": ACROSS}, ALONG + ACROSS, value=value)
        verdict = judge([Hypothesis(fit=fit, leftover=None, probability=1.0)], WHITENER)
        assert set(verdict.stated) - {"link_resistance"} == set(stated)


def test_a_small_threshold_counts_beside_what_every_bench_has() -> None:
    prior = CATALOGUE["fan_step"].headline.prior
    both = joint_fit({"link_resistance": ALONG, "fan_step": ACROSS}, ALONG + ACROSS, value=0.7 * prior)
    inside = 4.0 * both.terms[0].head.tolerance  # the line is at 4.1
    everyday = replace(both, terms=(replace(both.terms[0], value=inside), both.terms[1]))
    verdict = judge([Hypothesis(fit=everyday, leftover=None, probability=1.0)], WHITENER)
    assert verdict.stated == ("fan_step",)


def test_a_threshold_that_is_no_cause_stands_in_the_way_as_what_is_left_over_does() -> None:
    prior = CATALOGUE["fan_step"].headline.prior
    fit = joint_fit({"link_resistance": ALONG, "fan_step": ACROSS}, ALONG + ACROSS, value=0.6 * prior)
    link = replace(fit.terms[0], value=1.0)  # ten sigmas from off, the fan eighteen
    for probability, kind in ((0.9, "unknown"), (0.02, "named")):
        caught = Hypothesis(
            fit=replace(fit, terms=(link, fit.terms[1])), leftover=None, probability=probability
        )
        alone = Hypothesis(
            fit=joint_fit({"link_resistance": ALONG}, ALONG), leftover=None, probability=1 - probability
        )
        assert judge([caught, alone], WHITENER).kind == kind
