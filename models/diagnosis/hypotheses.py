r"""A hypothesis: nothing, or some effects with their values; and the evidence for it.

Values have the prior N(off, prior^2) inside their bounds. With S the effects' slopes, r what the fit leaves, C' the
covariance under the hypothesis, :math:`\Lambda` the prior's and :math:`P = S^T C'^{-1} S + \Lambda^{-1}`, the
marginal likelihood about the fit is Laplace's (Bishop, 2006, section 4.4), exact where the model is linear:

.. math:: \ln p = -\tfrac12 r^T C'^{-1} r - \tfrac12 \ln\det C' - \tfrac12 \sum \theta^2/\tau^2
          + \tfrac12 g^T P^{-1} g - \tfrac12 \ln\det(\Lambda P),\quad g = S^T C'^{-1} r - \Lambda^{-1} \theta .

Mass of the prior and of the posterior outside the bounds does not count.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import Self

import numpy as np
from numpy.typing import NDArray
from scipy.special import log_ndtr

from models.diagnosis.geometry import Geometry, Projection
from models.diagnosis.leftover import Leftover
from models.diagnosis.signatures import Signature, Signatures
from sim.effects.base import EffectParameter

Array = NDArray[np.float64]
Rows = NDArray[np.intp]

_EVERYDAY = 3.0  # standard deviations, the part's own spread among them
_GAINED = 1.0  # most that a step still to go may add to the evidence, where bounds do not hold it


@dataclass(frozen=True, slots=True, kw_only=True)
class Term:
    """One effect of a hypothesis: its value with a standard deviation, and the slope (M,) there."""

    signature: Signature
    value: float
    sigma: float
    slope: Array

    @property
    def effect(self) -> str:
        """The effect's name."""
        return self.signature.effect

    @property
    def head(self) -> EffectParameter:
        """The parameter that the value is of."""
        return self.signature.entry.headline

    @property
    def distance(self) -> float:
        """From off, in the value's unit."""
        return self.value - self.head.off

    @property
    def significance(self) -> float:
        """Distance from off in standard deviations."""
        return abs(self.distance) / self.sigma

    @property
    def beyond_everyday(self) -> bool:
        """Whether the value is further off than any ordinary bench has it."""
        return abs(self.distance) > _EVERYDAY * float(np.hypot(self.sigma, self.head.tolerance))

    @property
    def uncertainty(self) -> float:
        """Standard deviation of the value: of the fit, of the part's own spread, and of the effect's law."""
        entry = self.signature.entry
        return float(np.hypot(np.hypot(self.sigma, entry.spread_at(self.value)), entry.law * self.distance))

    def aside(self, share: float) -> Self:
        """The value moved by a share of the prior scale, inside its bounds."""
        step = share * self.head.prior
        return replace(self, value=self.value + (step if self.value + step <= self.head.upper else -step))

    def with_slope(self, slope: Array) -> Self:
        """The same with another slope where that is finite; a threshold keeps its own."""
        if self.signature.entry.threshold:
            return self
        return replace(self, slope=np.where(np.isfinite(slope), slope, self.slope))

    def moved(self, step: float) -> Self:
        """The value moved, at most to its bounds."""
        value = float(np.clip(self.value + step, self.head.lower, self.head.upper))
        return replace(self, value=value)


@dataclass(frozen=True, slots=True, kw_only=True)
class Fit:
    """A hypothesis fitted. ``shift`` (M,) is what it adds to the baseline, beside the linear part of the spreads.

    ``log_evidence`` counts against an arbitrary constant that all fits of one geometry share. ``bend`` (n, N) is by how
    much its simulation's unknowns were beside the straight lines that it started along.
    """

    terms: tuple[Term, ...]
    shift: Array
    log_evidence: float = -np.inf
    bend: Array | float = 0.0

    @classmethod
    def nothing(cls, readings: int) -> Self:
        """The hypothesis that nothing is wrong."""
        return cls(terms=(), shift=np.zeros(readings))

    @classmethod
    def on_a_line(cls, terms: tuple[Term, ...], bend: Array) -> Self:
        """Terms at their values, each along its slope from off; ``bend`` (M,) comes on top."""
        return cls(terms=terms, shift=bend + sum(t.slope * t.distance for t in terms))

    @property
    def effects(self) -> tuple[str, ...]:
        """Names of the effects, none for nothing."""
        return tuple(t.effect for t in self.terms)

    def term(self, effect: str) -> Term:
        """The term of an effect."""
        return next(t for t in self.terms if t.effect == effect)

    def own(self, known: Signatures) -> Rows:
        """Which spreads the effects take the place of."""
        return np.unique(np.concatenate([np.empty(0, dtype=np.intp), *map(known.own_spreads, self.effects)]))

    def vectors(self, residual: Array) -> Array:
        """Slopes, then what is left of a residual, (k + 1, M)."""
        return np.stack([*(t.slope for t in self.terms), residual - self.shift])

    def moved(self, steps: Array) -> Self:
        """Every value moved along its slope."""
        terms = tuple(t.moved(float(s)) for t, s in zip(self.terms, steps, strict=True))
        change = sum((new.value - old.value) * old.slope for new, old in zip(terms, self.terms, strict=True))
        return replace(self, terms=terms, shift=self.shift + change)


@dataclass(frozen=True, slots=True, kw_only=True)
class Weighed:
    """Evidence of a fit under one covariance, the step to its best values there, and their deviations, (k,).

    ``log_evidence`` counts at most a last, small step; ``promised`` is what there is if the slopes hold all the way.
    """

    log_evidence: float
    promised: float
    step: Array
    sigma: Array


def weigh(
    fits: Sequence[Fit],
    seen: Sequence[Projection],
    geometry: Geometry,
    own: Sequence[Rows],
    leftovers: Sequence[Leftover | None] = (None,),
) -> list[list[Weighed]]:
    """Laplace's evidence of every fit beside every leftover, one list a fit.

    ``seen`` are the projections of ``fit.vectors(residual)``, then of its laws' columns.
    """
    products = geometry.products_beside(seen, own, leftovers)
    return [_weighed(fit, *found) for fit, found in zip(fits, products, strict=True)]


def _weighed(fit: Fit, inner: Array, log_det: Array) -> list[Weighed]:
    """The evidence from products (L, k, k) under each covariance and its log-determinant (L,)."""
    size = len(fit.terms)
    inner, log_det = _law_let_in(inner, log_det, size + 1)
    bare = -0.5 * (inner[:, -1, -1] + log_det)
    if not size:
        none = np.empty(0)
        return [Weighed(log_evidence=b, promised=b, step=none, sigma=none) for b in bare.tolist()]
    prior = np.array([t.head.prior for t in fit.terms])
    distance = np.array([t.distance for t in fit.terms])
    scaled = prior[:, None] * inner[:, :size, :size] * prior + np.eye(size)  # in units of the prior
    pull = prior * inner[:, :size, -1] - distance / prior
    inverse = np.linalg.inv(scaled)
    ahead = np.einsum("lij,lj->li", inverse, pull)
    step, sigma = prior * ahead, prior * np.sqrt(np.diagonal(inverse, axis1=1, axis2=2))
    held = _held(fit, step)
    gained = 0.5 * np.sum(pull * ahead, axis=1)
    here = bare - 0.5 * (np.sum((distance / prior) ** 2) + np.linalg.slogdet(scaled)[1])
    for k, t in enumerate(fit.terms):
        here = here + _inside(t.head, t.value + step[:, k], sigma[:, k]) - _inside_at_first(t.head)
    promised, step = here + gained, np.where(held, 0.0, step)
    evidence = here + np.where(np.any(held, axis=1), gained, np.minimum(gained, _GAINED))
    return [
        Weighed(log_evidence=e, promised=p, step=step[k], sigma=sigma[k])
        for k, (e, p) in enumerate(zip(evidence.tolist(), promised.tolist(), strict=True))
    ]


def _law_let_in(inner: Array, log_det: Array, vectors: int) -> tuple[Array, Array]:
    """Products of the first so many, under a covariance that the directions after them were added to."""
    more = inner.shape[1] - vectors
    if not more:
        return inner, log_det
    root = np.linalg.cholesky(np.eye(more) + inner[:, vectors:, vectors:])
    onto = np.linalg.solve(root, inner[:, vectors:, :vectors])
    log_det = log_det + 2.0 * np.sum(np.log(np.diagonal(root, axis1=1, axis2=2)), axis=1)
    return inner[:, :vectors, :vectors] - np.swapaxes(onto, 1, 2) @ onto, log_det


def _held(fit: Fit, step: Array) -> NDArray[np.bool_]:
    """Which terms stand at a bound and would go further, (L, k)."""
    at_lower = np.array([t.value <= t.head.lower for t in fit.terms])
    at_upper = np.array([t.value >= t.head.upper for t in fit.terms])
    return np.asarray((at_lower & (step < 0)) | (at_upper & (step > 0)))


def _inside(head: EffectParameter, mean: Array | float, sigma: Array | float) -> Array:
    """Log of the share of N(mean, sigma^2) inside the bounds, to rounding where the nearer bound cuts."""
    below, above = (mean - head.lower) / sigma, (head.upper - mean) / sigma
    near, far = log_ndtr(np.minimum(below, above)), log_ndtr(-np.maximum(below, above))
    return np.asarray(near + np.log1p(-np.exp(np.minimum(far - near, -1e-12))))


@cache
def _inside_at_first(head: EffectParameter) -> float:
    """The same of the prior."""
    return float(_inside(head, head.off, head.prior))
