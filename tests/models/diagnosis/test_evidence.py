"""Evidence on a linear bench, where the marginal likelihood can be integrated by brute force."""

from dataclasses import dataclass, replace

import numpy as np
import pytest
from scipy.integrate import quad

from models.diagnosis.evidence import weighed_with_leftovers
from models.diagnosis.hypotheses import Fit, log_prior
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
    noise,
    stated,
    weighed,
)

BENT = 3000.0 * np.linspace(0.2, 1.0, READINGS) ** 4  # W per squared Ohm


def integrated(residual: np.ndarray, covariance: np.ndarray, signature: Signature) -> float:
    """ln of the likelihood averaged over the prior of the effect's value, against that of nothing."""
    head, inverse = signature.entry.headline, np.linalg.inv(covariance)

    def misfit(value: float) -> float:
        left = residual - signature.slope * (value - head.off)
        return float(left @ inverse @ left)

    best = min(np.linspace(head.off - head.prior, head.off + 4 * head.prior, 2001), key=misfit)

    def density(value: float) -> float:
        prior = np.exp(-0.5 * ((value - head.off) / head.prior) ** 2) / np.sqrt(2 * np.pi) / head.prior
        return float(prior * np.exp(-0.5 * (misfit(value) - misfit(best))))

    area, _ = quad(density, best - 2 * head.prior, best + 2 * head.prior, points=[best], limit=200)
    return float(np.log(area)) - 0.5 * (misfit(best) - misfit(head.off))


def alone(bench: Refinery) -> Fit:
    """The fit of the one effect that a bench knows."""
    return next(fit for fit in search(bench) if fit.terms)


def above_nothing(bench: Refinery) -> float:
    nothing, *singles = search(bench)
    return singles[0].log_evidence - nothing.log_evidence


def test_the_closed_form_is_the_integral_over_the_prior() -> None:
    spread = 0.3 * np.sin(np.arange(READINGS))[None]
    residual = 0.05 * GROWING + noise(1)
    bench = refinery(residual, [LINK], SIGMA, spread)
    # the prior and the posterior are cut at 0; of the integral's prior only the half above is meant here.
    # Nothing but rounding and the quadrature's 1e-8 lies between them
    expected = integrated(residual, covariance_of(SIGMA, spread), LINK) + np.log(2.0)
    assert above_nothing(bench) == pytest.approx(expected, abs=1e-5)


def test_the_fitted_value_and_its_sigma_are_those_of_ridge_regression() -> None:
    residual = 0.05 * GROWING + noise(2)
    term = weighed(refinery(residual, [LINK], SIGMA))[0].fit.term("link_resistance")
    precision = np.sum((GROWING / SIGMA) ** 2) + LINK.entry.headline.prior**-2
    assert term.sigma == pytest.approx(precision**-0.5, rel=1e-9)
    assert term.value == pytest.approx(
        np.sum(GROWING * residual / SIGMA**2) / precision, abs=0.06 * term.sigma
    )


def test_probabilities_add_up_to_one_and_the_cause_leads() -> None:
    hypotheses = weighed(refinery(0.05 * GROWING + noise(3), [AUXILIARY, LINK], SIGMA))
    assert sum(h.probability for h in hypotheses) == pytest.approx(1.0, abs=1e-12)
    assert hypotheses[0].fit.effects == ("link_resistance",)
    assert hypotheses[0].probability > 0.7  # a leftover has a prior of 0.2, and none is needed here


def test_noise_alone_names_nothing() -> None:
    assert stated(refinery(noise(4), [AUXILIARY, LINK], SIGMA)) == ()


def test_two_causes_at_once_are_found_together() -> None:
    both = 0.05 * GROWING + 2.0 + noise(7)
    best = weighed(refinery(both, [AUXILIARY, LINK, SLANTED], SIGMA))[0]
    assert best.fit.effects == ("auxiliary_power", "link_resistance")
    assert best.fit.term("auxiliary_power").value == pytest.approx(2.0, abs=4 * best.fit.terms[0].sigma)


@dataclass(frozen=True)
class BentBench(LinearBench):
    """A bench of which one effect's doing bends upwards."""

    def _predicted(self, model: Model) -> np.ndarray:
        value = model.effects.get("link_resistance", {}).get("resistance_Ohm", 0.0)
        return super()._predicted(model) + BENT * value**2


def test_a_cause_whose_line_led_far_astray_is_followed_back() -> None:
    value = 0.06 * GROWING + BENT * 0.06**2 + 3.0 * FLAT + noise(5)
    effects = [LINK, AUXILIARY, SLANTED]
    bench = replace(
        refinery(value, effects, SIGMA),
        observations=BentBench(value, effects),  # type: ignore[arg-type]  # as much of it as a refinery needs
    )
    assert stated(bench) == ("auxiliary_power", "link_resistance")


def test_three_causes_at_once_are_found_together() -> None:
    three = 0.05 * GROWING + 2.0 + 0.01 * SLANTED.slope + noise(8)
    best = weighed(refinery(three, [AUXILIARY, LINK, SLANTED], SIGMA))[0]
    assert set(best.fit.effects) == {"auxiliary_power", "link_resistance", "analyzer_gain"}


def test_one_cause_is_not_called_two() -> None:
    hypotheses = weighed(refinery(0.05 * GROWING + noise(9), [AUXILIARY, LINK, SLANTED], SIGMA))
    assert sum(h.probability for h in hypotheses if len(h.fit.terms) > 1) < 0.1


def test_larger_hypotheses_share_a_smaller_prior() -> None:
    one, two = (
        fit_of("link_resistance", GROWING),
        joint_fit({"auxiliary_power": FLAT, "link_resistance": GROWING}, GROWING),
    )
    catalogue = 20
    assert np.exp(log_prior(Fit.nothing(3), catalogue)) == pytest.approx(0.5)
    assert catalogue * np.exp(log_prior(one, catalogue)) == pytest.approx(0.5 * 0.75)
    assert 190 * np.exp(log_prior(two, catalogue)) == pytest.approx(0.5 * 0.2)  # 20 * 19 / 2 pairs


def test_an_everyday_spread_is_not_called_a_cause() -> None:
    spread = 0.03 * GROWING[None]  # one sigma of it looks like 30 mOhm
    residual = spread[0] + noise(5)
    assert stated(refinery(residual, [LINK], SIGMA)) == ("link_resistance",)
    assert stated(refinery(residual, [LINK], SIGMA, spread)) == ()


def test_what_needs_parts_beyond_the_line_hardly_counts() -> None:
    """A spread of ten sigmas, and an effect of another shape that nothing calls for."""
    bench = refinery(10.0 * FLAT + noise(5), [LINK], SIGMA, FLAT[None])
    before, after = (
        next(h.probability for h in found if h.fit.effects == () and h.leftover is None)
        for found in (weighed_with_leftovers(bench, search(bench)), weighed(bench))
    )
    assert before > 0.5
    assert after < 1e-3


def test_a_leftover_takes_what_no_effect_explains() -> None:
    strange = 3.0 * np.sign(np.sin(7.0 * np.arange(READINGS)))
    hypotheses = weighed(refinery(strange + noise(6), [AUXILIARY, LINK], SIGMA))
    assert sum(h.probability for h in hypotheses if h.leftover is not None) > 0.99


def test_a_value_stays_inside_its_bounds() -> None:
    bench = refinery(-0.05 * GROWING, [LINK], SIGMA)
    assert alone(bench).terms[0].value == 0.0  # a resistance that is added cannot be negative
    assert above_nothing(bench) < -5  # and its evidence knows how far outside the data would have it


def test_a_value_at_its_bound_lets_no_other_promise_more_than_a_last_step() -> None:
    residual = 30.0 * FLAT - 0.01 * GROWING  # a resistance below nothing, and power far beyond the next step
    bench = refinery(residual, [LINK, AUXILIARY], SIGMA)
    terms = {"auxiliary_power": FLAT, "link_resistance": GROWING}
    both = joint_fit(terms, np.zeros(READINGS), value=0.0)
    power, resistance = both.without("link_resistance"), both.without("auxiliary_power")
    of_both, of_power = bench.weighed(both), bench.weighed(power)
    assert bench.weighed(both.moved(np.array([0.0, 0.01]))).step[1] < 0.0  # it would go below nothing
    assert of_both.step[1] == 0.0
    assert of_both.step[0] == pytest.approx(of_power.step[0], rel=1e-9)  # rounding
    assert of_both.promised > of_both.log_evidence + 100.0
    held = 0.01**2 * 0.5 * float(GROWING**2 @ SIGMA**-2.0)  # most that the resistance could still gain
    assert of_both.log_evidence < of_power.log_evidence + held
    assert bench.weighed(resistance).log_evidence < of_power.log_evidence


def test_a_slope_that_was_learned_wrongly_is_simulated_anew() -> None:
    bench = refinery(0.05 * GROWING + noise(10), [LINK], SIGMA)
    wrong = replace(alone(bench), terms=(replace(alone(bench).terms[0], slope=3.0 * GROWING[::-1]),))
    (sharp,) = bench.sharpened([wrong])
    np.testing.assert_allclose(sharp.terms[0].slope, GROWING, rtol=1e-9)  # the bench is linear
    was, becomes = (bench.weighed(fit).sigma[0] for fit in (wrong, sharp))
    assert was < 0.5 * becomes  # and would have been believed


@pytest.mark.parametrize("order", [1, -1])
def test_of_several_starts_of_the_same_causes_the_best_is_followed(order: int) -> None:
    bench = refinery(0.05 * GROWING + noise(3), [LINK], SIGMA)
    line = replace(Fit.nothing(READINGS), terms=(alone(bench).terms[0],))
    starts = [
        replace(line.moved(np.array([value - line.terms[0].value])), log_evidence=evidence)
        for value, evidence in ((0.05, -10.0), (0.2, -500.0))
    ]
    (kept,) = bench.followed(starts[::order], leader=1e6)  # far ahead: none of them goes on
    assert kept.terms[0].value == pytest.approx(0.05)


@pytest.mark.parametrize(("beside", "own"), [("fan_step", True), ("auxiliary_power", False)])
def test_rows_moved_across_a_threshold_do_not_tell_how_far_off_another_cause_is(
    beside: str, own: bool
) -> None:
    """A slope with the fan's own step in it is far steeper than what the other cause does by itself."""
    step = Signature(entry=effect(beside), slope=FLAT)
    bench = refinery(0.05 * GROWING + 3.0 + noise(3), [LINK, step], SIGMA)
    fit = joint_fit({"link_resistance": GROWING, beside: FLAT}, 0.05 * GROWING + 3.0)
    fan, (link, flat) = 1000.0 * (np.arange(READINGS) % 7 == 0), fit.terms
    link = replace(link, signature=LINK, value=0.05, slope=GROWING + fan)
    fit = replace(fit, terms=(link, replace(flat, signature=step, value=3.0)))
    (bare,) = (h.fit for h in weighed_with_leftovers(bench, [fit]) if h.leftover is None)
    found = bare.term("link_resistance").sigma
    alone = bench.weighed(replace(fit, terms=(replace(link, slope=GROWING), fit.terms[1]))).sigma[0]
    assert found == pytest.approx(alone if own else bench.weighed(fit).sigma[0], rel=1e-9)
    assert alone > 3.0 * bench.weighed(fit).sigma[0]
