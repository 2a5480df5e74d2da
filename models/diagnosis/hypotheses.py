r"""A hypothesis: nothing, or some effects with their values; and the evidence for it.

Values have the prior N(off, prior^2) inside their bounds. With S the effects' slopes, r what the fit leaves, C' the
covariance under the hypothesis, :math:`\Lambda` the prior's and :math:`P = S^T C'^{-1} S + \Lambda^{-1}`, the
marginal likelihood about the fit is Laplace's (Bishop, 2006, section 4.4), exact where the model is linear:

.. math:: \ln p = -\tfrac12 r^T C'^{-1} r - \tfrac12 \ln\det C' - \tfrac12 \sum \theta^2/\tau^2
          + \tfrac12 g^T P^{-1} g - \tfrac12 \ln\det(\Lambda P),\quad g = S^T C'^{-1} r - \Lambda^{-1} \theta .

Mass of the prior and of the posterior outside the bounds does not count.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import Self

import numpy as np
from numpy.typing import NDArray
from scipy.special import log_ndtr

from models.diagnosis.geometry import Geometry, Projection
from models.diagnosis.leftover import Leftover
from models.diagnosis.lines import Key
from models.diagnosis.signatures import Signature, Signatures
from sim.effects.base import EffectParameter

Array = NDArray[np.float64]
Rows = NDArray[np.intp]

_P_CONSISTENT = 0.5
_P_CAUSES = (0.75, 0.2, 0.05)  # one, two or three causes, where there are any
EVERYDAY = 4.1  # standard deviations: of 25 normal spreads, one is further off in one bench of a thousand
SURELY = 1.64  # standard deviations of the fit: 95 %
_NEAR_A_BOUND = 1e-3  # of the range that is searched
_GAINED = 1.0  # most that a step still to go may add to the evidence


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
    def at_bound(self) -> bool:
        """Whether it lies where the search for it ends: it may be further off."""
        near = _NEAR_A_BOUND * (self.head.upper - self.head.lower)
        return min(self.value - self.head.lower, self.head.upper - self.value) <= near

    @property
    def acting(self) -> tuple[float, float, float]:
        """Distance from off as it acts, its standard deviation, and what ordinary benches have of it, one sigma."""
        acting, slope = self.head.acting(self.value)
        return acting, slope * self.sigma, max(self.head.tolerance, self.signature.everyday)

    @property
    def beyond_everyday(self) -> bool:
        """Whether the end of its interval that is nearer to off is further off than any ordinary bench has it.

        That end is asked itself: what acts by its reciprocal is no straight line over the interval.
        """
        nearer = self.value - math.copysign(SURELY * self.sigma, self.distance)
        if (nearer - self.head.off) * self.distance <= 0.0:
            return False
        *_, usual = self.acting
        return abs(self.head.acting(nearer)[0]) > EVERYDAY * usual

    def spread(self, sigmas: float) -> float:
        """How far the effect's own parts may be off, one sigma, in the value's unit; as it is so many sigmas away."""
        return self.signature.entry.spread_at(self.value, self.signature.everyday, sigmas)

    def uncertainty(self, of_shapes: float, sigmas: float = 0.0) -> float:
        """Standard deviation of the value: of the fit, of the parts' own spreads, and of the effect's law.

        ``of_shapes`` is how far the law's shapes already let the fit be off, part of ``sigma``: its level is the rest.
        The parts' spreads are as they are ``sigmas`` away from the value.
        """
        entry = self.signature.entry
        level = math.sqrt(max((entry.law_at(self.value) * self.distance) ** 2 - of_shapes**2, 0.0))
        return math.hypot(self.sigma, self.spread(sigmas), level)

    def aside(self, share: float) -> Self:
        """The value moved by a share of the prior scale, inside its bounds."""
        step = share * self.head.prior
        return replace(self, value=self.value + (step if self.value + step <= self.head.upper else -step))

    def with_slope(self, slope: Array) -> Self:
        """The same with another slope where that is finite; a threshold keeps its own."""
        if self.signature.entry.threshold:
            return self
        return replace(self, slope=np.where(np.isfinite(slope), slope, self.slope))

    def moved(self, step: float, sigma: float | None = None) -> Self:
        """The value moved, at most to its bounds; with another deviation where one is given."""
        head = self.head
        return self.at(min(max(self.value + step, head.lower), head.upper), sigma)

    def at(self, value: float, sigma: float | None = None) -> Self:
        """The same slope at another value; as ``replace``, in a third of its time."""
        sigma = self.sigma if sigma is None else sigma
        return type(self)(signature=self.signature, value=value, sigma=sigma, slope=self.slope)


@dataclass(frozen=True, slots=True, kw_only=True)
class Fit:
    """A hypothesis fitted. ``shift`` (M,) is what it adds to the baseline, beside the linear part of the spreads.

    ``log_evidence`` counts against an arbitrary constant that all fits of one geometry share. ``bend`` (n, N) is by how
    much its simulation's unknowns were beside the straight lines that it started along, ``spreads`` (K,) how many
    sigmas everyday spreads were off there; its next simulation goes a ``share`` of the way to the most probable ones.
    """

    terms: tuple[Term, ...]
    shift: Array
    log_evidence: float = -np.inf
    bend: Array | float = 0.0
    spreads: Array | float = 0.0
    share: float = 1.0

    @classmethod
    def nothing(cls, readings: int) -> Self:
        """The hypothesis that nothing is wrong."""
        return cls(terms=(), shift=np.zeros(readings))

    @property
    def effects(self) -> tuple[str, ...]:
        """Names of the effects, none for nothing."""
        return tuple(t.effect for t in self.terms)

    @property
    def key(self) -> tuple[Key, ...]:
        """The effects, each with the values of its other parameters: what tells variants apart."""
        return tuple(t.signature.key for t in self.terms)

    def has_beyond_everyday(self, term: Term) -> bool:
        """Whether one of its causes is further off than any ordinary bench has it.

        A cause alone that is uncertain by more than parts scatter is so as if it were uncertain by that: what readings
        see badly needs evidence against nothing, in whose covariance its parts' spreads are, and is no part where it
        has that. Beside another cause it may be uncertain for that one's sake.
        """
        acting, _, usual = term.acting
        far = abs(acting) > (EVERYDAY + SURELY) * usual
        return term.beyond_everyday or (len(self.terms) == 1 and far)

    def term(self, effect: str) -> Term:
        """The term of an effect."""
        return next(t for t in self.terms if t.effect == effect)

    def own(self, known: Signatures) -> Rows:
        """Which spreads the effects take the place of."""
        return known.own_spreads(*self.effects)

    def vectors(self, residual: Array) -> Array:
        """Slopes, then what is left of a residual, (k + 1, M)."""
        return np.stack([*(t.slope for t in self.terms), residual - self.shift])

    def moved(self, steps: Array) -> Self:
        """Every value moved along its slope."""
        return self.at(tuple(t.moved(s) for t, s in zip(self.terms, steps.tolist(), strict=True)))

    def without(self, effect: str) -> Self:
        """The same without one of its effects, whose slope leads back to off."""
        off = tuple(t.at(t.head.off) if t.effect == effect else t for t in self.terms)
        return replace(self.at(off), terms=tuple(t for t in self.terms if t.effect != effect))

    def at(self, terms: tuple[Term, ...], log_evidence: float | None = None) -> Self:
        """The same terms at other values, moved there along their slopes; with another evidence where one is given."""
        change = sum((new.value - old.value) * old.slope for new, old in zip(terms, self.terms, strict=True))
        evidence = self.log_evidence if log_evidence is None else log_evidence
        return type(self)(
            terms=terms,
            shift=self.shift + change,
            log_evidence=evidence,
            bend=self.bend,
            spreads=self.spreads,
        )


def log_prior(fit: Fit, catalogue: int) -> float:
    """Log prior of a hypothesis out of a catalogue of so many effects; each shares it among its variants."""
    causes = len(fit.terms)
    if causes == 0:
        return float(np.log(_P_CONSISTENT))
    variants = math.prod(len(t.signature.entry.variants()) for t in fit.terms)
    ways = math.comb(catalogue, causes) * variants
    return math.log((1 - _P_CONSISTENT) * _P_CAUSES[causes - 1] / ways)


@dataclass(frozen=True, slots=True, kw_only=True)
class Weighed:
    """Evidence of a fit under one covariance, the step to its best values there, and their deviations, (k,).

    ``log_evidence`` counts at most a last, small step; ``promised`` is what there is if the slopes hold all the way.
    """

    log_evidence: float
    promised: float
    step: Array
    sigma: Array


@dataclass(frozen=True, slots=True, kw_only=True)
class WeighedBeside:
    """The same of a fit beside each of L leftovers: both evidences (L,), steps and deviations (L, k)."""

    log_evidence: Array
    promised: Array
    step: Array
    sigma: Array

    def at(self, place: int) -> Weighed:
        """Beside one of them."""
        return Weighed(
            log_evidence=float(self.log_evidence[place]),
            promised=float(self.promised[place]),
            step=self.step[place],
            sigma=self.sigma[place],
        )


def weigh(
    fits: Sequence[Fit],
    seen: Sequence[Projection],
    geometry: Geometry,
    own: Sequence[Rows],
    leftovers: Sequence[Leftover | None] = (None,),
) -> list[WeighedBeside]:
    """Laplace's evidence of every fit beside every leftover.

    ``seen`` are the projections of ``fit.vectors(residual)``, then of its laws' columns.
    """
    return evidence_of(fits, geometry.products_beside(seen, own, leftovers))


def evidence_of(fits: Sequence[Fit], products: Sequence[tuple[Array, Array]]) -> list[WeighedBeside]:
    """The same from products (L, n, n) of each fit's vectors under L covariances, and their ln det (L,)."""
    alike: dict[tuple[int, int], list[int]] = {}
    for k, (fit, (inner, _)) in enumerate(zip(fits, products, strict=True)):
        alike.setdefault((len(fit.terms), inner.shape[-1]), []).append(k)
    found: dict[int, WeighedBeside] = {}
    for members in alike.values():
        inner, log_det = (np.stack([products[k][part] for k in members]) for part in (0, 1))
        weighed = _weighed([fits[k] for k in members], inner, log_det)
        found |= zip(members, weighed, strict=True)
    return [found[k] for k in range(len(fits))]


@dataclass(frozen=True, slots=True)
class _Values:
    """Of F fits with k terms each: values, distances from off, bounds and prior scales, all (F, 1, k)."""

    value: Array
    distance: Array
    lower: Array
    upper: Array
    prior: Array

    @classmethod
    def of(cls, fits: Sequence[Fit]) -> Self:
        """Of these fits."""
        terms = [
            [(t.value, t.distance, t.head.lower, t.head.upper, t.head.prior) for t in fit.terms]
            for fit in fits
        ]
        return cls(*np.moveaxis(np.array(terms), 2, 0)[:, :, None])

    def held(self, step: Array) -> NDArray[np.bool_]:
        """Which stand at a bound and would go further, (F, L, k)."""
        at_lower, at_upper = self.value <= self.lower, self.value >= self.upper
        return np.asarray((at_lower & (step < 0)) | (at_upper & (step > 0)))


def _weighed(fits: Sequence[Fit], inner: Array, log_det: Array) -> list[WeighedBeside]:
    """The evidence of F fits of one size from products (F, L, n, n) under each covariance, and its ln det (F, L)."""
    size = len(fits[0].terms)
    inner, log_det = law_let_in(inner, log_det, size + 1)
    bare = -0.5 * (inner[..., -1, -1] + log_det)
    if not size:
        none = np.empty((bare.shape[1], 0))
        return [WeighedBeside(log_evidence=b, promised=b, step=none, sigma=none) for b in bare]
    at, first = _Values.of(fits), np.array([sum(_inside_at_first(t.head) for t in fit.terms) for fit in fits])
    prior = at.prior
    # in the prior's units
    scaled = prior[..., None] * inner[..., :size, :size] * prior[..., None, :] + np.eye(size)
    pull = prior * inner[..., :size, -1] - at.distance / prior
    inverse = np.linalg.inv(scaled)
    ahead = np.einsum("flij,flj->fli", inverse, pull)
    step, sigma = prior * ahead, prior * np.sqrt(np.diagonal(inverse, axis1=2, axis2=3))
    held = at.held(step)
    gained = 0.5 * np.sum(pull * ahead, axis=2)
    free, of_free = _free_step(scaled, pull, held) if np.any(held) else (ahead, gained)
    here = bare - 0.5 * (np.sum((at.distance / prior) ** 2, axis=2) + np.linalg.slogdet(scaled)[1])
    here = here + np.sum(log_inside((at.lower, at.upper), at.value + step, sigma), axis=2) - first[:, None]
    promised, step = here + gained, prior * free
    evidence = here + gained - of_free + np.minimum(of_free, _GAINED)
    return [
        WeighedBeside(log_evidence=e, promised=p, step=s, sigma=d)
        for e, p, s, d in zip(evidence, promised, step, sigma, strict=True)
    ]


def _free_step(scaled: Array, pull: Array, held: NDArray[np.bool_]) -> tuple[Array, Array]:
    """The step (F, L, k) in the prior's units of the values that no bound holds, and what it gains (F, L)."""
    fixed = held[..., :, None] | held[..., None, :]
    inner = np.where(fixed, np.eye(scaled.shape[-1]), scaled)
    pull = np.where(held, 0.0, pull)
    step = np.asarray(np.linalg.solve(inner, pull[..., None])[..., 0])
    return step, np.asarray(0.5 * np.sum(pull * step, axis=2))


def law_let_in(inner: Array, log_det: Array, vectors: int) -> tuple[Array, Array]:
    """Products (..., n, n) of the first so many, under a covariance that the directions after them were added to."""
    more = inner.shape[-1] - vectors
    if not more:
        return inner, log_det
    # the directions first: one root says what is seen of both
    order = np.roll(np.arange(more + vectors), more)
    root = np.linalg.cholesky(np.eye(more + vectors) + inner[..., order[:, None], order])
    onto = np.asarray(root[..., more:, :more])
    log_det = log_det + 2.0 * np.sum(np.log(np.diagonal(root, axis1=-2, axis2=-1)[..., :more]), axis=-1)
    return inner[..., :vectors, :vectors] - onto @ np.swapaxes(onto, -1, -2), log_det


def log_inside(
    bounds: tuple[Array | float, Array | float], mean: Array | float, sigma: Array | float
) -> Array:
    """Log of the share of N(mean, sigma^2) inside the bounds, to rounding where the nearer bound cuts."""
    below, above = (mean - bounds[0]) / sigma, (bounds[1] - mean) / sigma
    near, far = log_ndtr(np.minimum(below, above)), log_ndtr(-np.maximum(below, above))
    return np.asarray(near + np.log1p(-np.exp(np.minimum(far - near, -1e-12))))


@cache
def _inside_at_first(head: EffectParameter) -> float:
    """The same of the prior."""
    return float(log_inside((head.lower, head.upper), head.off, head.prior))
