r"""The extended simulation: the baseline and the stated effects, all other parts as they were.

A cause's value is estimated with every part inside its everyday spread; the extension keeps those parts nominal, and
what they do to efficiency would be missing. Inside the interval that the readings leave a value, the extension takes
the one at which it says best what was measured of efficiency,

.. math:: \min_\delta \sum (r - S \delta)^2 / \sigma^2, \qquad -1.96\, u_k^- \le \delta_k \le 1.96\, u_k^+,

with r what is left of the input power under load without the spreads, S the effects' slopes there, u how uncertain each
value is, below it and above.
"""

import math

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from models.diagnosis.hypotheses import Fit, Term
from models.diagnosis.refinery import Refinery
from sim.model import Model

Array = NDArray[np.float64]

Z95 = 1.96
_LEAST_LIMIT = 1e-3  # of the normal part: below it rounding would be all there is


def interval(refinery: Refinery, fit: Fit, effect: str) -> tuple[float, float]:
    """The 95 % interval of an effect's value in a fit, inside its bounds."""
    term = fit.term(effect)
    of_shapes = _of_shapes(refinery, fit)[fit.effects.index(effect)]
    below, above = (_half(term, of_shapes, side) for side in (-Z95, Z95))
    return max(term.value - below, term.head.lower), min(term.value + above, term.head.upper)


def _half(term: Term, of_shapes: float, side: float) -> float:
    """How far the 95 % interval reaches to a ``side``, ±1.96; a spread inside limits never has 1.96 of its sigmas."""
    total = term.uncertainty(of_shapes, side)
    if not term.signature.entry.inside_limits:
        return Z95 * total
    spread = term.spread(side)
    return half_with_limit(math.sqrt(3.0) * spread, math.sqrt(total**2 - spread**2))


def half_with_limit(limit: float, sigma: float) -> float:
    r"""The h that :math:`|u + x|` stays under with 95 %, u uniform up to a limit and x normal with a sigma.

    .. math:: P(u + x < h) = \frac{\sigma}{2a} \left[ G\!\left(\frac{h + a}{\sigma}\right)
              - G\!\left(\frac{h - a}{\sigma}\right) \right], \quad G(z) = z\,\Phi(z) + \varphi(z) .

    >>> round(half_with_limit(1.0, 1e-6), 3), round(half_with_limit(1e-3, 1.0), 3)
    (0.95, 1.96)
    """
    if limit < _LEAST_LIMIT * sigma:
        return Z95 * sigma

    def below(half: float) -> float:
        up, down = (half + limit) / sigma, (half - limit) / sigma
        return sigma / (2.0 * limit) * float(_summed(up) - _summed(down))

    from scipy.optimize import brentq  # here: it loads slowly, and every diagnosis would pay

    return float(brentq(lambda half: below(half) - 0.975, 0.0, limit + 4.0 * sigma))


def _summed(z: float) -> float:
    """Integral of the normal distribution function up to z."""
    return float(z * ndtr(z) + math.exp(-0.5 * z * z) / math.sqrt(2.0 * math.pi))


def _of_shapes(refinery: Refinery, fit: Fit) -> list[float]:
    """How far the shapes of its own law let each value of a fit be off, one sigma, (k,)."""
    slopes, prior = np.stack([t.slope for t in fit.terms]), np.array([t.head.prior for t in fit.terms])
    solved = refinery.solve(fit, slopes)
    weights = np.linalg.solve(solved @ slopes.T + np.diag(prior**-2), solved)  # of the readings in each value
    laws = [refinery.laws.directions(t.signature, t.distance) for t in fit.terms]
    return [
        0.0 if law is None else abs(law.factor) * float(np.linalg.norm(law.vectors @ own))
        for law, own in zip(laws, weights, strict=True)
    ]


def extended(refinery: Refinery, fit: Fit, stated: tuple[str, ...], sigma: Array) -> Model:
    """The baseline with the effects that are stated of a fit; ``sigma`` (M,) is the noise of the readings."""
    observations = refinery.observations
    terms, inside = [fit.term(n) for n in stated], [interval(refinery, fit, n) for n in stated]
    if not terms:
        return refinery.baseline
    seen = observations.of("efficiency") & observations.loaded[observations.row]
    others = sum(
        (t.slope * t.distance for t in fit.terms if t.effect not in stated), start=np.zeros(seen.size)
    )
    left = refinery.residual - fit.shift + others
    vectors = np.stack([*(t.slope for t in terms), left])[:, seen] / sigma[seen]
    model = refinery.baseline
    for term, value in zip(terms, _values(terms, inside, vectors), strict=True):
        model = model.with_effect(term.effect, **term.signature.values(value))
    return model


def _values(terms: list[Term], inside: list[tuple[float, float]], vectors: Array) -> list[float]:
    """The values ``inside`` their intervals that leave least.

    ``vectors`` (k + 1, n) are the slopes and what the fit leaves, in sigmas. Each value is looked for in
    units of half its interval, from the middle: values are of ohms and of seconds.
    """
    low, high = np.array(inside).T
    middle, half = 0.5 * (low + high), 0.5 * (high - low)
    *slopes, left = vectors
    per_half = np.stack(slopes) * half[:, None]
    off = left - (middle - [t.value for t in terms]) @ np.stack(slopes)
    from scipy.optimize import lsq_linear  # here: it loads slowly, and every diagnosis would pay

    found = lsq_linear(per_half.T, off, bounds=(-1.0, 1.0))
    return [float(v) for v in np.clip(middle + half * found.x, low, high)]
