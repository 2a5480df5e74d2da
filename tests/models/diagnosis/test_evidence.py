"""Evidence on a linear bench, where the marginal likelihood can be integrated by brute force."""

import numpy as np
import pytest
from scipy.integrate import quad

from models.diagnosis.evidence import fitted, posterior
from models.diagnosis.signatures import Signature
from tests.models.diagnosis.fabricated import refinery

READINGS = 24
SIGMA = np.linspace(0.2, 0.4, READINGS)
GROWING = np.linspace(5.0, 60.0, READINGS)  # W per Ohm
LINK = Signature(effect="link_resistance", slope=GROWING)
AUXILIARY = Signature(effect="auxiliary_power", slope=np.ones(READINGS))


def noise(seed: int) -> np.ndarray:
    return SIGMA * np.random.default_rng(seed).standard_normal(READINGS)


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


def test_the_closed_form_is_the_integral_over_the_prior() -> None:
    spread = 0.3 * np.sin(np.arange(READINGS))[None]
    residual = 0.05 * GROWING + noise(1)
    bench, covariance = refinery(residual, [LINK], SIGMA, spread)
    _, (fit,) = fitted(bench)
    # nothing but rounding and the quadrature's 1e-8 lies between them
    assert fit.log_evidence == pytest.approx(integrated(residual, covariance.plain, LINK), abs=1e-5)


def test_the_fitted_value_and_its_sigma_are_those_of_ridge_regression() -> None:
    residual = 0.05 * GROWING + noise(2)
    bench, _ = refinery(residual, [LINK], SIGMA)
    _, (fit,) = fitted(bench)
    precision = np.sum((GROWING / SIGMA) ** 2) + LINK.entry.headline.prior**-2
    assert fit.sigma == pytest.approx(precision**-0.5, rel=1e-9)
    assert fit.value == pytest.approx(np.sum(GROWING * residual / SIGMA**2) / precision, abs=0.06 * fit.sigma)


def test_probabilities_add_up_to_one_and_the_cause_leads() -> None:
    bench, covariance = refinery(0.05 * GROWING + noise(3), [AUXILIARY, LINK], SIGMA)
    hypotheses = posterior(bench, covariance)
    assert sum(h.probability for h in hypotheses) == pytest.approx(1.0, abs=1e-12)
    assert hypotheses[0].fit.effect == "link_resistance"
    assert hypotheses[0].probability > 0.7  # a leftover has a prior of 0.2, and none is needed here


def test_noise_alone_names_nothing() -> None:
    bench, covariance = refinery(noise(4), [AUXILIARY, LINK], SIGMA)
    assert posterior(bench, covariance)[0].fit.effect == "nothing"


def test_an_everyday_spread_is_not_called_a_cause() -> None:
    spread = 0.03 * GROWING[None]  # one sigma of it looks like 30 mOhm
    residual = spread[0] + noise(5)
    blind, blind_covariance = refinery(residual, [LINK], SIGMA)
    aware, covariance = refinery(residual, [LINK], SIGMA, spread)
    assert posterior(blind, blind_covariance)[0].fit.effect == "link_resistance"
    assert posterior(aware, covariance)[0].fit.effect == "nothing"


def test_a_leftover_takes_what_no_effect_explains() -> None:
    strange = 3.0 * np.sign(np.sin(7.0 * np.arange(READINGS)))
    bench, covariance = refinery(strange + noise(6), [AUXILIARY, LINK], SIGMA)
    hypotheses = posterior(bench, covariance)
    assert sum(h.probability for h in hypotheses if h.leftover_W > 0) > 0.99


def test_a_value_stays_inside_its_bounds() -> None:
    bench, _ = refinery(-0.05 * GROWING, [LINK], SIGMA)
    _, (fit,) = fitted(bench)
    assert fit.value == 0.0  # a resistance that is added cannot be negative
