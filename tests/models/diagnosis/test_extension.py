"""The extended model says what was measured as well as the value's interval lets it."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.special import ndtr

from models.diagnosis.extension import extended, half_with_limit, interval
from models.diagnosis.hypotheses import Fit
from models.diagnosis.refinery import Refinery
from models.diagnosis.signatures import Signature
from sim.effects.catalogue import effect
from sim.model import Model
from tests.models.diagnosis.fabricated import joint_fit, loads, refinery

COUNT = 20
SIGMA = np.full(COUNT, 0.2)
VALUE_W = 5.0
ONE = np.ones(COUNT)


def that_leaves(left_W: float, name: str = "auxiliary_power") -> tuple[Refinery, Fit]:
    """A refinery, and a fit of 5 W of auxiliary power that leaves so much of every reading."""
    observations = loads(np.linspace(500.0, 1500.0, COUNT))
    bench = refinery(observations.value, [Signature(entry=effect(name), slope=ONE)], SIGMA)
    fit = joint_fit({name: ONE}, observations.value - left_W, value=VALUE_W)
    return replace(bench, observations=observations), fit


def power_W(left_W: float) -> float:
    bench, fit = that_leaves(left_W)
    return extended(bench, fit, ("auxiliary_power",), SIGMA).effects["auxiliary_power"]["power_W"]


def test_inside_its_interval_a_value_takes_up_what_is_left() -> None:
    # to the tolerance of the solver, of half an interval
    assert power_W(0.15) == pytest.approx(VALUE_W + 0.15, abs=1e-6)


@pytest.mark.parametrize("left_W", [-3.0, 3.0])
def test_no_value_leaves_its_interval(left_W: float) -> None:
    bench, fit = that_leaves(left_W)
    low, high = interval(bench, fit, "auxiliary_power")
    assert power_W(left_W) == pytest.approx(low if left_W < 0 else high, rel=1e-6)


def test_a_reading_that_counts_for_little_moves_little() -> None:
    bench, fit = that_leaves(0.0)
    fit = replace(fit, shift=fit.shift - np.where(np.arange(COUNT) == 3, 50.0, 0.0))
    wide = np.where(np.arange(COUNT) == 3, 100.0, 0.2)
    model = extended(bench, fit, ("auxiliary_power",), wide)
    # 50 W of a reading that is good to 100 W, among nineteen good to 0.2 W
    assert model.effects["auxiliary_power"]["power_W"] == pytest.approx(VALUE_W, abs=1e-4)


def test_without_a_cause_it_is_the_baseline() -> None:
    bench, fit = that_leaves(1.0)
    assert extended(bench, fit, (), SIGMA) == Model.baseline()


def test_an_interval_of_a_uniform_and_a_normal_part_holds_95_per_cent() -> None:
    limit, sigma = 2.0, 0.7
    half = half_with_limit(limit, sigma)
    # midpoints: their sum errs by their spacing squared
    uniform = limit * (np.arange(2000) + 0.5) / 1000 - limit
    holds = np.mean(ndtr((half - uniform) / sigma) - ndtr((-half - uniform) / sigma))
    assert holds == pytest.approx(0.95, abs=1e-6)


@pytest.mark.parametrize(("name", "sigmas"), [("analyzer_offset", 0.95 * 3**0.5), ("auxiliary_power", 1.96)])
def test_a_spread_inside_limits_counts_no_further_than_they_go(name: str, sigmas: float) -> None:
    bench, fit = that_leaves(0.0, name)
    (term,) = fit.terms
    spread = 0.1 * term.head.upper
    wide = replace(
        term, signature=replace(term.signature, everyday=spread), value=0.5 * spread, sigma=1e-3 * spread
    )
    _, high = interval(bench, replace(fit, terms=(wide,)), name)
    # the fit and a law of a hundredth of half a spread count by their squares
    assert high - wide.value == pytest.approx(sigmas * spread, rel=1e-4)


def test_a_sure_cause_whose_part_is_known_to_a_ratio_has_an_interval_above_off() -> None:
    name = "reverse_recovery"
    bench, fit = that_leaves(0.0, name)
    (term,) = fit.terms
    sure = replace(term, signature=replace(term.signature, everyday=0.4), value=2.1, sigma=1e-3)
    low, high = interval(bench, replace(fit, terms=(sure,)), name)
    # its law is good to 15 % of the value, which counts by its square beside the ratio
    assert 0.0 < low < 2.1 < high
    assert (1.0 + low) * (1.0 + high) == pytest.approx(3.1**2, rel=0.1)
    assert 1.0 + low == pytest.approx(3.1 * np.exp(-1.96 * 0.4), rel=0.1)
