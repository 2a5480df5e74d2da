r"""Whether what a hypothesis holds may be what ordinary benches have, its values taken together.

Each value alone is everyday up to a line (:mod:`models.diagnosis.hypotheses`). Two causes that the readings hardly
tell apart share one distance between them in any proportion, and halfway neither is beyond its line, though no ordinary
bench has both. With w the values and C their covariance, in sigmas of ordinary benches, the nearest state that one
may have is

.. math:: \min_y\ (y - w)^T C^{-1} (y - w) \quad \text{where} \quad |y| \le y_k ,

with :math:`y_1 = 4.1`, :math:`y_2 = 5.0`, :math:`y_3 = 5.7` for one, two or three values: one value alone gives the
line. A hypothesis that needs another part beyond the line loses that share of its probability: such a part is a cause
by another name. Of a cause only the share beyond the line counts as a cause; the rest counts for the hypothesis without
it, with the part's spread as prior.
"""

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from models.diagnosis.hypotheses import EVERYDAY, SURELY, Fit, Term, law_let_in, log_inside
from models.diagnosis.leftover import Leftover
from models.diagnosis.refinery import Refinery
from models.diagnosis.whitener import Whitener

Array = NDArray[np.float64]

# of 25 normal spreads some two, or some three, are further off in one bench of a thousand, as some one is of its line
_FURTHEST = {1: EVERYDAY, 2: 5.0, 3: 5.7}
_LEAST_OPEN = 1e-6  # of a spread's variance, against rounding
_LEAST_BEYOND = 0.05  # of a prior: whose line lies further out is of parts, hardly of a cause
_LEAST_TOLD = 1e-9  # of the prior's precision, by the readings, against rounding
_HALVINGS = 60  # of a bracket: to a double's own accuracy


def everyday_together(fit: Fit, whitener: Whitener) -> bool:
    """Whether the values of a hypothesis may be those of an ordinary bench; ``whitener`` is that of the readings."""
    terms = fit.terms
    if any(fit.has_beyond_everyday(term) for term in terms):
        return False
    acting, sigma, usual = np.array([term.acting for term in terms]).reshape(-1, 3).T
    if len(terms) < 2 or not np.all(usual * sigma > 0.0):
        return True
    if np.linalg.norm(acting / usual) <= _FURTHEST[len(terms)]:
        return True  # as most are: what follows takes a look at all readings
    covariance = np.outer(sigma, sigma) * _correlation(terms, whitener) / np.outer(usual, usual)
    return nearest_everyday(acting / usual, covariance) <= SURELY


def log_everyday(refinery: Refinery, fit: Fit, leftover: Leftover | None = None) -> float:
    """Log of the share of a hypothesis in which every spread, each for itself, is within the everyday line."""
    line = np.full(len(refinery.known.spreads), EVERYDAY)
    larger = refinery.larger(fit)
    line[: larger.size] *= larger
    others = np.setdiff1d(np.arange(line.size), fit.own(refinery.known))
    line, geometry, left = line[others], refinery.geometry, (refinery.residual - fit.shift)[None]
    seen = geometry.project(left, basis=leftover is not None).with_directions(left, refinery.law(fit))
    whole = geometry.with_spreads(seen, others)
    (((products,), _),) = geometry.products_beside([whole], [fit.own(refinery.known)], [leftover])
    beside = len(seen.each_other)  # what is left, and laws, which go last
    order = np.r_[0, beside : len(products), 1:beside]
    products, _ = law_let_in(products[order[:, None], order], np.zeros(()), 1 + others.size)
    sigma = np.sqrt(np.clip(1.0 - np.diagonal(products)[1:], _LEAST_OPEN, 1.0))
    return float(np.sum(log_inside((-line, line), products[0, 1:], sigma)))


def parts_beyond(refinery: Refinery, fit: Fit, leftover: Leftover | None = None) -> dict[str, float]:
    """Which parts and instruments an explanation needs further off than any ordinary bench has, and how many sigmas."""
    spreads, others = refinery.known.spreads, np.ones(len(refinery.known.spreads), dtype=bool)
    others[fit.own(refinery.known)] = False
    others[others.size - refinery.known.lags :] = False  # heat that lags behind is no part
    off = spreads @ refinery.solved(fit, leftover)
    larger = refinery.larger(fit)
    off[: larger.size] /= larger
    return {
        name: float(off[k])
        for k, name in enumerate(refinery.known.spread_names)
        if others[k] and abs(off[k]) > EVERYDAY
    }


def share_beyond(term: Term) -> float:
    """How much of a value is beyond the everyday line, over how much of its prior is, if that is worth a word."""
    of_prior = _beyond(term, term.head.off, term.head.prior)
    return _beyond(term, term.value, term.sigma) / max(of_prior, _LEAST_BEYOND)


def _beyond(term: Term, mean: float, sigma: float) -> float:
    """Share of N(mean, sigma^2), inside the bounds, that is beyond the everyday line."""
    head, (*_, usual) = term.head, term.acting
    within = log_inside(head.inside(EVERYDAY * usual), mean, sigma)
    return -math.expm1(min(float(within - log_inside((head.lower, head.upper), mean, sigma)), 0.0))


def log_as_part(term: Term) -> float:
    r"""Log of the evidence of a value that is a part's spread, within the line, over that as a cause's.

    With l what the readings alone know it to and m where they have it, :math:`N(m; 0, l^2 + \tau^2)` is the density of
    the readings under a prior of scale tau, but for what all priors share. A spread is normal in what acts. A value
    surely beyond the line is no part: no part was simulated there. What it is uncertain by beyond a part's own spread
    moves that line no further out.
    """
    acting, sigma, usual = term.acting
    if abs(acting) > EVERYDAY * usual + SURELY * min(sigma, usual):
        return -math.inf
    slope, prior2, alone2 = sigma / term.sigma, term.head.prior**2, _told_alone(term)
    back = term.distance * alone2 / prior2  # how far the prior has drawn the value to off
    as_spread = _log_normal(acting + slope * back, slope**2 * alone2 + _scatter(term) ** 2) + math.log(slope)
    as_cause = _log_normal(term.distance + back, alone2 + prior2)
    line, at, share = EVERYDAY * usual, *_as_spread(term)
    within = log_inside((-line, line), at, slope * math.sqrt(share * alone2))
    return as_spread - as_cause + float(within)


def as_part(term: Term) -> Term:
    """A value as that of a part, where that has it: the spread of ordinary parts is its prior.

    A spread is normal in what acts.
    """
    head, entry = term.head, term.signature.entry
    value = head.value_of(_as_spread(term)[0])
    spread = replace(head, prior=_scatter(term) / head.acting(value)[1])
    signature = replace(term.signature, entry=replace(entry, parameters=(spread, *entry.parameters[1:])))
    return replace(term, signature=signature, value=value)


def _told_alone(term: Term) -> float:
    """The variance of a value by the readings alone, without its prior."""
    prior2 = term.head.prior**2
    return 1.0 / max(term.sigma**-2 - 1.0 / prior2, _LEAST_TOLD / prior2)


def _as_spread(term: Term) -> tuple[float, float]:
    """Where what acts is as a part's spread, and the share of its distance, as the readings have it, that this is."""
    acting, sigma, _ = term.acting
    slope, alone2, scatter2 = sigma / term.sigma, _told_alone(term), _scatter(term) ** 2
    share = scatter2 / (slope**2 * alone2 + scatter2)
    return share * (acting + slope * term.distance * alone2 / term.head.prior**2), share


def _scatter(term: Term) -> float:
    """One sigma of what ordinary parts do, as acting: that of the spreads which nothing itself is weighed with."""
    return term.signature.everyday or term.head.tolerance


def _log_normal(x: float, variance: float) -> float:
    return -0.5 * (x * x / variance + math.log(variance))


def nearest_everyday(values: Array, covariance: Array) -> float:
    """How many standard deviations values (k,) are from the nearest that are everyday; all in everyday sigmas.

    >>> round(nearest_everyday(np.array([7.0, 0.0]), np.eye(2)), 6)
    2.0
    """
    furthest = _FURTHEST[len(values)]
    if np.linalg.norm(values) <= furthest:
        return 0.0
    stiff, axes = np.linalg.eigh(np.linalg.inv(covariance))
    along = axes.T @ values

    def length(pull: float) -> float:
        return float(np.linalg.norm(stiff * along / (stiff + pull)))

    low, high = 0.0, float(np.max(stiff))
    while length(high) > furthest:
        low, high = high, 4.0 * high
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if length(middle) > furthest else (low, middle)
    return float(np.sqrt(np.sum(stiff * (along * high / (stiff + high)) ** 2)))


def _correlation(terms: Sequence[Term], whitener: Whitener) -> Array:
    """Of the values, as the readings and their priors leave them, (k, k)."""
    slopes = np.stack([term.slope for term in terms])
    told = slopes @ whitener.solve(slopes.T) + np.diag([term.head.prior**-2.0 for term in terms])
    left = np.linalg.inv(told)
    scale = np.sqrt(np.diag(left))
    return np.asarray(left / np.outer(scale, scale))
