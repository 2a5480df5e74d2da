"""What a hypothesis holds within the everyday line, as the part that it is then."""

from dataclasses import dataclass, replace

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from models.diagnosis.everyday import log_as_part, share_beyond
from models.diagnosis.evidence import (
    BesideLeftovers,
    Hypothesis,
    _beyond_everyday,
    weighed_with_leftovers,
)
from models.diagnosis.hypotheses import Fit, Term
from models.diagnosis.refinery import Refinery
from models.diagnosis.search import search
from models.diagnosis.signatures import Signature
from sim.effects.catalogue import effect
from sim.model import Model
from tests.models.diagnosis.fabricated import LinearBench, covariance_of, fit_of, joint_fit, refinery
from tests.models.diagnosis.straight_bench import (
    AUXILIARY,
    FLAT,
    GROWING,
    LINK,
    READINGS,
    SIGMA,
    SLANTED,
    WARM_UP,
    noise,
    stated,
    weighed,
)


def test_a_cause_no_further_off_than_parts_are_is_a_part() -> None:
    usual = LINK.entry.headline.tolerance
    bench = refinery(2.0 * usual * GROWING + noise(5), [LINK], SIGMA, usual * GROWING[None])
    within, whole = (
        {h.fit.effects: h.probability for h in found if h.leftover is None}
        for found in (weighed(bench), weighed_with_leftovers(bench, search(bench)))
    )
    assert whole[("link_resistance",)] > 0.05
    assert (
        within[("link_resistance",)] < 0.05 * whole[("link_resistance",)]
    )  # two sigmas of noise from the line


def test_nothing_counts_as_likely_as_the_part_that_its_spreads_did_not_find() -> None:
    """Three sigmas of a part that nothing knows no way to, and the same beyond the line."""
    usual = LINK.entry.headline.tolerance
    within, beyond = (refinery(k * usual * GROWING + noise(5), [LINK], SIGMA) for k in (3.0, 8.0))
    alone = weighed_with_leftovers(within, search(within))
    assert alone[0].fit.effects == ("link_resistance",)
    best = weighed(within)[0]
    assert (best.fit.effects, best.leftover) == ((), None)
    assert stated(beyond) == ("link_resistance",)


@pytest.mark.parametrize(("name", "other"), [("link_resistance", {}), ("fan_step", {"threshold_C": 40.0})])
def test_a_part_counts_as_nothing_with_nothings_prior(name: str, other: dict[str, float]) -> None:
    """Of a threshold's variants each has its share of the part's spread, as of the cause's prior."""
    usual = effect(name).headline.tolerance
    signature = Signature(entry=effect(name), other=other, slope=0.2 / usual * GROWING / GROWING.max())
    bench = refinery(3.0 * usual * signature.slope + noise(5), [signature], SIGMA)
    whole = weighed_with_leftovers(bench, search(bench))
    cause = next(h for h in whole if h.fit.terms and h.leftover is None)
    (term,) = cause.fit.terms
    after = {h.fit.effects: h.probability for h in reversed(weighed(bench)) if h.leftover is None}
    variants = len(effect(name).variants())
    prior = 0.5 / (0.5 * 0.75 / variants)  # of nothing, over that of the only cause there is
    as_part = prior / variants * np.exp(log_as_part(term))
    # simulated it knows nothing of the line, beyond which a ten-thousandth of it lies
    assert after[()] / after[(name,)] == pytest.approx(as_part / share_beyond(term), rel=2e-4)


@pytest.mark.parametrize(
    ("probability", "vaguer", "astray_W", "value"),
    [
        (1e-3, 1.0, 0.0, 2.0),
        (0.999, 1.0, 0.0, 1.0),
        (1e-3, 2.0, 0.0, 1.0),
        (1e-3, 1.0, 20.0, 1.0),
        (1e-40, 2.0, 0.0, 2.0),
        (1e-40, 1.0, 20.0, 1.0),
    ],
)
def test_what_counts_as_likely_as_a_larger_one_has_its_values(
    probability: float, vaguer: float, astray_W: float, value: float
) -> None:
    """Where a part was simulated as a cause the other cause has another value than beside spreads.

    One that is known much worse there, or that leaves a reading far off, is of slopes that were not simulated; what is
    known well without the part tells nothing where it explains nothing.
    """
    usual = LINK.entry.headline.tolerance
    bench = refinery(2.0 * FLAT + noise(5), [AUXILIARY, LINK], SIGMA)
    slopes = {"auxiliary_power": FLAT, "link_resistance": GROWING}
    both = joint_fit(slopes, 0.0 * FLAT, value=0.0).moved(np.array([2.0, usual]))
    auxiliary, link = both.terms
    alone = both.without("link_resistance").moved(np.array([-1.0]))
    there = replace(auxiliary, sigma=vaguer * auxiliary.sigma), replace(link, sigma=0.1 * usual)
    both = replace(both, terms=there, shift=both.shift + astray_W * (np.arange(READINGS) == 7))
    found = _beyond_everyday(
        BesideLeftovers.of(bench, [both, alone]),
        [
            Hypothesis(fit=fit, leftover=None, probability=p)
            for fit, p in ((both, 1.0 - probability), (alone, probability))
        ],
    )
    assert found[1].fit.terms[0].value == value
    np.testing.assert_allclose(found[1].fit.shift, value * FLAT, atol=1e-12)  # rounding


@dataclass(frozen=True)
class SteppedBench(LinearBench):
    """Every cause but nothing moves all readings by a step beside its line."""

    step: float = 0.3

    def _predicted(self, model: Model) -> np.ndarray:
        return super()._predicted(model) + (self.step if model.effects else 0.0)


def as_likely_as(bench: Refinery, *fits: Fit) -> list[Hypothesis]:
    """Hypotheses of these fits, as probable as evidence and prior have them."""
    weighed = [replace(fit, log_evidence=bench.weighed(fit).log_evidence) for fit in fits]
    best = max(map(bench.log_probability, weighed))
    likely = [float(np.exp(bench.log_probability(fit) - best)) for fit in weighed]
    return [Hypothesis(fit=fit, leftover=None, probability=p) for fit, p in zip(weighed, likely, strict=True)]


def test_nothing_has_what_a_part_does_where_it_was_simulated() -> None:
    """What is no straight line of the part stays with the hypothesis without it."""
    usual = LINK.entry.headline.tolerance
    bench = refinery(usual * GROWING + 0.3 + noise(5), [LINK], SIGMA)
    bench = replace(bench, observations=SteppedBench(bench.observations.value, [LINK]))  # type: ignore[arg-type]
    fit = joint_fit({"link_resistance": GROWING}, 0.0 * FLAT, value=0.0).moved(np.array([usual]))
    part = replace(fit, terms=(replace(fit.terms[0], sigma=0.1 * usual),), shift=fit.shift + 0.3)
    hypotheses = as_likely_as(bench, part, Fit.nothing(READINGS))
    bare = _beyond_everyday(BesideLeftovers.of(bench, [h.fit for h in hypotheses]), hypotheses)[1]
    np.testing.assert_allclose(bare.fit.shift, 0.3 * FLAT, atol=1e-12)  # rounding
    assert bare.fit.log_evidence == hypotheses[1].fit.log_evidence
    assert bare.probability > hypotheses[1].probability


@pytest.mark.parametrize("strange", [0.0, 1.5])
def test_a_part_is_as_likely_as_simulated_with_a_parts_spread_and_no_doubt_of_a_causes_law(
    strange: float,
) -> None:
    """As a spread it has the evidence of a covariance that holds it; what only the law explained is left over."""
    usual = SLANTED.entry.headline.tolerance
    law = np.sign(np.sin(2.0 * np.arange(READINGS)))
    residual = 4.0 * usual * SLANTED.slope + strange * law + noise(5)
    bench = refinery(residual, [SLANTED], SIGMA, laws=[(SLANTED, law[None] / usual)])
    fit = replace(fit_of("analyzer_gain", SLANTED.slope, value=0.0), shift=0.0 * FLAT).moved(
        np.array([4 * usual])
    )
    best = bench.weighed(fit)
    fit = fit.moved(best.step)
    fit = replace(fit, terms=(replace(fit.terms[0], sigma=best.sigma[0]),))
    hypotheses = as_likely_as(bench, fit, Fit.nothing(READINGS))
    nothing = _beyond_everyday(BesideLeftovers.of(bench, [h.fit for h in hypotheses]), hypotheses)[1]
    held = covariance_of(SIGMA, usual * SLANTED.slope[None])
    found, before = (
        multivariate_normal(cov=cov).logpdf(residual)
        for cov in (held, covariance_of(SIGMA, np.zeros((0, READINGS))))
    )
    gained = np.log(nothing.probability / hypotheses[1].probability)
    assert gained == pytest.approx(found - before, abs=0.02)  # its bounds and the line cut a hundredth of it


def test_what_only_a_doubted_law_explains_is_no_evidence_for_a_part() -> None:
    """Nothing leads and knows the part's spread: a cause whose law takes up a shape beside it tells it nothing."""
    usual = SLANTED.entry.headline.tolerance
    law = np.sign(np.sin(2.0 * np.arange(READINGS)))
    known = replace(SLANTED, everyday=usual)
    residual = 0.5 * usual * SLANTED.slope + 0.17 * law + noise(5)
    bench = refinery(residual, [known], SIGMA, usual * SLANTED.slope[None], laws=[(known, law[None] / usual)])
    bench = replace(bench, known=replace(bench.known, spread_names=("analyzer_gain",)))
    fits = search(bench)
    beside = BesideLeftovers.of(bench, fits)
    before, after = (
        {h.fit.effects: h.probability for h in reversed(found) if h.leftover is None}
        for found in (beside.hypotheses(), _beyond_everyday(beside, beside.hypotheses()))
    )
    assert before[()] > 0.5 > before[("analyzer_gain",)] > 0.3
    assert after[()] == before[()]


def test_what_has_its_values_from_a_larger_one_in_another_variant_is_weighed_as_a_part_itself() -> None:
    """The search has not seen those values alone in that variant."""
    slow, slower = (
        Signature(entry=WARM_UP, slope=SLANTED.slope, other={"time_constant_s": time_s})
        for time_s in (3600.0, 18000.0)
    )
    usual, creep = LINK.entry.headline.tolerance, WARM_UP.headline.tolerance
    both = 4.0 * usual * GROWING + creep * SLANTED.slope
    bench = refinery(both + noise(5), [LINK, slow, slower], SIGMA)

    def of(*found: tuple[Signature, float]) -> Fit:
        terms = tuple(Term(signature=s, value=v, sigma=0.1 * v, slope=s.slope) for s, v in found)
        fit = Fit(terms=terms, shift=sum(t.value * t.slope for t in terms) + 0.0 * FLAT)
        return replace(fit, log_evidence=bench.weighed(fit).log_evidence)

    fits = of((LINK, 4.0 * usual), (slower, creep)), of((slow, 2.0 * creep)), Fit.nothing(READINGS)
    hypotheses = as_likely_as(bench, *fits)
    _, single, bare = _beyond_everyday(BesideLeftovers.of(bench, fits), hypotheses)
    assert single.fit.terms[0].signature.key == slower.key
    assert single.fit.terms[0].value == creep
    assert bare.probability > 10.0 * hypotheses[2].probability  # moved there
