"""The posterior: what a search has found, every hypothesis weighed again beside every leftover."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from numpy.typing import NDArray

from models.diagnosis.everyday import as_part, log_as_part, log_everyday, share_beyond
from models.diagnosis.hypotheses import Fit, Term, WeighedBeside, evidence_of, weigh
from models.diagnosis.leftover import Leftover
from models.diagnosis.refinery import Refinery

Array = NDArray[np.float64]

P_LEFTOVER = 0.2
NEGLIGIBLE = 1e-16  # probability: all such together are below rounding
_WORTH_IT = 1e-3  # probability from which it is asked what a hypothesis needs of parts
_LEADS = 0.5  # probability of a hypothesis from which nothing is decided by how much more it has
_LARGEST = 700.0  # exponent, against overflow
# probability from which it is asked whether causes are parts by another name, and from which a hypothesis' own values
# tell anything
_WORTH_A_LOOK = 1e-6
_NARROWER = 0.3  # of what causes' own laws are feared to be wrong by, where readings show that they are as good as that
_WORSE = 1.5  # times the standard deviation, of a value or of what is left: slopes that were not simulated
_LEADING = 6  # hypotheses that tell


@dataclass(frozen=True, slots=True, kw_only=True)
class Hypothesis:
    """A fit with or without leftover, and its posterior probability."""

    fit: Fit
    leftover: Leftover | None
    probability: float


def probability_of(hypotheses: Iterable[Hypothesis]) -> float:
    """The probability of some hypotheses, of which no two hold at once; rounding does not make it more than sure."""
    return min(sum(h.probability for h in hypotheses), 1.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class BesideLeftovers:
    """Fits of a refinery, each beside no leftover and every other: products (L, n, n) of its vectors, ln det (L,).

    That is all that evidence asks of the readings; laws may be doubted otherwise afterwards.
    """

    refinery: Refinery
    fits: list[Fit]
    products: list[tuple[Array, Array]]

    @classmethod
    def of(cls, refinery: Refinery, fits: Iterable[Fit]) -> Self:
        """Of these fits."""
        fits, leftovers = list(fits), _with_none(refinery)
        own = [fit.own(refinery.known) for fit in fits]
        products = refinery.geometry.products_beside(refinery.seen(fits), own, leftovers)
        return cls(refinery=refinery, fits=fits, products=products)

    def among(self, chosen: Sequence[int]) -> Self:
        """Some of the fits."""
        return replace(self, fits=[self.fits[k] for k in chosen], products=[self.products[k] for k in chosen])

    def doubting(self, share: float) -> Self:
        """The same with causes' own laws doubted by a share of what is feared: their columns, the last, by as much."""
        other, found = replace(self.refinery, laws=replace(self.refinery.laws, share=share)), []
        for fit, (inner, log_det) in zip(self.fits, self.products, strict=True):
            laws = zip(self.refinery.law(fit), other.law(fit), strict=True)
            longer = [np.full(len(new.vectors), new.factor / old.factor) for old, new in laws]
            scale = np.concatenate([np.ones(len(fit.terms) + 1), *longer])
            found.append((inner * np.outer(scale, scale), log_det))
        return replace(self, refinery=other, products=found)

    def with_exact_laws(self, asked: Sequence[tuple[Hypothesis, Term]]) -> list[tuple[float, Term]]:
        """Log evidence that hypotheses gain where one of their causes has an exact law, and that one's value then."""
        place = {fit.key: k for k, fit in enumerate(self.fits)}
        column = {_key(leftover): c for c, leftover in enumerate(_with_none(self.refinery))}
        fits, products = list[Fit](), list[tuple[Array, Array]]()
        for hypothesis, term in asked:
            k, c = place[hypothesis.fit.key], column[_key(hypothesis.leftover)]
            inner, log_det = (part[c : c + 1] for part in self.products[k])
            laws = (
                (t.effect, self.refinery.laws.directions(t.signature, t.distance)) for t in self.fits[k].terms
            )
            doubted = [
                np.full(len(law.vectors), float(name != term.effect)) for name, law in laws if law is not None
            ]
            kept = np.concatenate([np.ones(len(self.fits[k].terms) + 1), *doubted])
            fits += [self.fits[k], self.fits[k]]
            products += [(inner, log_det), (inner * np.outer(kept, kept), log_det)]
        weighed, found = evidence_of(fits, products), list[tuple[float, Term]]()
        for (hypothesis, term), fit, feared, exact in zip(
            asked, fits[::2], weighed[::2], weighed[1::2], strict=True
        ):
            before, after = (
                w.log_evidence if hypothesis.leftover is None else w.promised for w in (feared, exact)
            )
            at = fit.effects.index(term.effect)
            step, known = (exact.step - feared.step)[0, at], (exact.sigma / feared.sigma)[0, at]
            alone = term.moved(float(step), sigma=float(known) * term.sigma)
            found.append((float(after[0] - before[0]), alone))
        return found

    def log_weights(self) -> tuple[Array, list[WeighedBeside]]:
        """Log evidence and log prior (F, L) of every fit beside every leftover, and what they were weighed from."""
        refinery, leftovers = self.refinery, _with_none(self.refinery)
        shares = [_log_share(leftover, refinery.geometry.leftovers.shared_by) for leftover in leftovers]
        log, weighed = np.empty((len(self.fits), len(leftovers))), evidence_of(self.fits, self.products)
        for k, (fit, beside) in enumerate(zip(self.fits, weighed, strict=True)):
            log[k] = refinery.log_prior(fit)
            log[k] += shares
            log[k, 0] += beside.log_evidence[0]
            log[k, 1:] += beside.promised[1:]
        return log, weighed

    def hypotheses(self) -> list[Hypothesis]:
        """Fits without and with every leftover, the values beside a leftover fitted again, the most probable first.

        Of each fit, what has no probability worth a word is left out, but for itself alone and beside its best
        leftover.
        """
        fits, leftovers = self.fits, _with_none(self.refinery)
        log, weighed = self.log_weights()
        probability = np.exp(log - np.logaddexp.reduce(log, axis=None))
        counts = (probability > NEGLIGIBLE) | (log == log.max(axis=1, keepdims=True))
        counts[:, 0] = True  # without leftover
        weighed = _of_their_own(self.refinery, fits, weighed, counts)
        settled = [_settled(*each) for each in zip(fits, weighed, counts, strict=True)]
        order = [divmod(int(k), len(leftovers)) for k in np.argsort(-probability, axis=None)]
        return [
            Hypothesis(fit=settled[k][c], leftover=leftovers[c], probability=float(probability[k, c]))
            for k, c in order
            if counts[k, c]
        ]


def weighed_with_leftovers(refinery: Refinery, fits: Iterable[Fit]) -> list[Hypothesis]:
    """The hypotheses that fits make :class:`BesideLeftovers`."""
    return BesideLeftovers.of(refinery, fits).hypotheses()


def with_laws_as_read(beside: BesideLeftovers) -> BesideLeftovers:
    """The same with causes' own laws doubted less, where the readings are likelier so.

    That is asked of all explanations that lead together. Where it takes a leftover, or a cause more, laws are not as
    good as that.
    """
    fits, refinery = beside.fits, beside.refinery
    leading = beside.among(
        sorted(range(len(fits)), key=lambda k: -refinery.log_probability(fits[k]))[:_LEADING]
    )
    narrower = leading.doubting(_NARROWER)
    (feared, _), (tried, _) = leading.log_weights(), narrower.log_weights()
    better = np.logaddexp.reduce(tried, axis=None) > np.logaddexp.reduce(feared, axis=None)
    (before, _), (first, leftover) = (divmod(int(np.argmax(log)), log.shape[1]) for log in (feared, tried))
    as_simple = leftover == 0 and len(leading.fits[first].terms) <= len(leading.fits[before].terms)
    return beside.doubting(_NARROWER) if better and as_simple else beside


def posterior(beside: BesideLeftovers) -> list[Hypothesis]:
    """What a search has found, each with its probability, the most probable first.

    Where one needs parts further off than any ordinary bench has them, only what it is without them counts; and where
    one has causes that are no further off than parts are, only what it is beyond that.
    """
    refinery, hypotheses = beside.refinery, beside.hypotheses()
    worth = sum(h.probability > _WORTH_IT for h in hypotheses)  # they come first
    shares = [math.exp(log_everyday(refinery, h.fit, h.leftover)) for h in hypotheses[:worth]]
    counted = [h.probability * share for h, share in zip(hypotheses[:worth], shares, strict=True)]
    counted += [h.probability for h in hypotheses[worth:]]
    found = [replace(h, probability=p) for h, p in zip(hypotheses, counted, strict=True)]
    found = _beyond_everyday(beside, found)
    total = sum(h.probability for h in found)
    if not total:  # as good as nothing explains the readings within the line
        return hypotheses
    found = [replace(h, probability=h.probability / total) for h in found]
    return sorted(found, key=lambda h: -h.probability)


def _beyond_everyday(beside: BesideLeftovers, hypotheses: Sequence[Hypothesis]) -> list[Hypothesis]:
    """Each hypothesis with that share of its probability in which all its causes are beyond the everyday line.

    The rest is evidence for the hypothesis without that cause, and replaces that one's probability where it is larger:
    the search then missed that state of the parts. Where that decides, it is simulated as a part first. The other
    causes take their values from here, unless these are much vaguer than in a hypothesis that tells anything itself, or
    leave much more of the readings: beside a threshold, a part that carries a row across it has no slope.
    """
    found, places = list(hypotheses), dict[tuple[object, ...], int]()
    total = sum(h.probability for h in hypotheses)
    refinery, before = beside.refinery, {fit.key: fit for fit in beside.fits}
    for k, h in enumerate(hypotheses):
        places.setdefault(_name(h.fit.effects, h.leftover), k)
    for size in sorted({len(h.fit.terms) for h in hypotheses}, reverse=True):
        asked = [k for k, h in enumerate(found) if len(h.fit.terms) == size and h.probability > _WORTH_A_LOOK]
        less = [
            (k, term, fewer)
            for k in asked
            for term in found[k].fit.terms
            if (fewer := places.get(_name(found[k].fit.without(term.effect).effects, found[k].leftover)))
            is not None
        ]
        exact_laws = beside.with_exact_laws([(hypotheses[k], term) for k, term, _ in less])
        for (k, term, fewer), (exact, alone) in zip(less, exact_laws, strict=True):
            fit, others = found[k].fit, found[k].fit.without(term.effect)
            prior = refinery.log_prior(others) - refinery.log_prior(fit)
            one_of = math.log(len(term.signature.entry.variants()))
            likely = found[k].probability * math.exp(
                min(prior - one_of + exact + log_as_part(alone), _LARGEST)
            )
            open_ = found[k].leftover is None and found[fewer].probability < _LEADS * total
            if open_ and likely > max(found[fewer].probability, _WORTH_IT * total):
                # the search has simulated the variant that this hypothesis had to begin with
                gained = _log_gained_as_part(
                    refinery, before[hypotheses[k].fit.key], term, hypotheses[fewer].fit
                )
                likely = hypotheses[fewer].probability * math.exp(min(gained - one_of, _LARGEST))
            if likely > found[fewer].probability:
                own, tells = found[fewer].fit, found[fewer].probability > _WORTH_A_LOOK * total
                worse = (tells and _is_vaguer(others, own)) or _leaves_more(refinery, others, own)
                there = own if worse else replace(others, log_evidence=own.log_evidence)
                found[fewer] = replace(found[fewer], fit=there, probability=likely)
        for k in asked:
            beyond = found[k].probability * math.prod(share_beyond(t) for t in found[k].fit.terms)
            found[k] = replace(found[k], probability=beyond)
    return found


def _log_gained_as_part(refinery: Refinery, fit: Fit, term: Term, fewer: Fit) -> float:
    """Log evidence that a hypothesis gains where a part, simulated as a cause of ``fit``, is simulated as a part.

    Its value has the spread of ordinary parts for its prior then, and its law is as good as that of any part: what only
    the doubt about a cause's law explained is left over again. It starts from where the readings have it as a part.
    """
    part = as_part(term)
    terms = tuple(replace(t, signature=part.signature) if t.effect == term.effect else t for t in fit.terms)
    step = np.array([part.value - t.value if t.effect == term.effect else 0.0 for t in terms])
    exact = replace(refinery, laws=refinery.laws.without(term.signature))
    (found,) = exact.followed(exact.simulated([replace(fit, terms=terms).moved(step)]))
    return float(exact.weighed(found).log_evidence - fewer.log_evidence)


def _is_vaguer(fit: Fit, than: Fit) -> bool:
    """Whether a fit knows a value of the same causes much worse than another."""
    return any(one.sigma > _WORSE * other.sigma for one, other in zip(fit.terms, than.terms, strict=True))


def _leaves_more(refinery: Refinery, fit: Fit, than: Fit) -> bool:
    """Whether a fit leaves much more of the readings, in sigmas, than another."""
    left, than_left = (float((refinery.residual - f.shift) @ refinery.solved(f)) for f in (fit, than))
    return left > _WORSE**2 * than_left


def _name(effects: Sequence[str], leftover: Leftover | None) -> tuple[object, ...]:
    return tuple(effects), _key(leftover)


def _key(leftover: Leftover | None) -> tuple[str, float] | None:
    return None if leftover is None else leftover.key


def _of_their_own(
    refinery: Refinery,
    fits: Sequence[Fit],
    weighed: Sequence[WeighedBeside],
    counts: NDArray[np.bool_],
) -> list[WeighedBeside]:
    """The weighed fits, in which no cause beside a threshold is known better than its own signature tells it.

    Rows that cross a threshold which nobody read tell where it is, not how far off the other cause is. It is asked
    beside the leftovers that count for any of them, (F, L).
    """
    found = list(weighed)
    mixed = [k for k, fit in enumerate(fits) if len({t.signature.entry.threshold for t in fit.terms}) > 1]
    if not mixed:
        return found
    straight = [
        replace(fits[k], terms=tuple(t.with_slope(t.signature.slope) for t in fits[k].terms)) for k in mixed
    ]
    own, places = [fit.own(refinery.known) for fit in straight], np.flatnonzero(np.any(counts[mixed], axis=0))
    leftovers = _with_none(refinery)
    beside = [leftovers[c] for c in places.tolist()]
    themselves = weigh(straight, refinery.seen(straight), refinery.geometry, own, beside)
    for k, alone in zip(mixed, themselves, strict=True):
        sigma = found[k].sigma.copy()
        sigma[places] = np.maximum(sigma[places], alone.sigma)
        found[k] = replace(found[k], sigma=sigma)
    return found


def _with_none(refinery: Refinery) -> list[Leftover | None]:
    """All that a fit is weighed beside: no leftover, and every one."""
    return [None, *refinery.geometry.leftovers.configurations]


def log_total(hypotheses: Sequence[Hypothesis], refinery: Refinery) -> float:
    """Log evidence of all hypotheses of one geometry together, priors included; the most probable comes first."""
    best = hypotheses[0]
    share = _log_share(best.leftover, refinery.geometry.leftovers.shared_by)
    return refinery.log_probability(best.fit) + share - math.log(best.probability)


def _log_share(leftover: Leftover | None, shared_by: int) -> float:
    """Log of the prior's share of a leftover out of so many, or of none."""
    if not shared_by:
        return 0.0
    return math.log(1 - P_LEFTOVER if leftover is None else P_LEFTOVER / shared_by)


def _settled(fit: Fit, beside: WeighedBeside, counts: NDArray[np.bool_]) -> dict[int, Fit]:
    """The fit at its best values beside each leftover that counts (L,), with their deviations.

    Without leftover, the first, the simulator has the last word; beside one the tangents have.
    """
    places = np.flatnonzero(counts)
    steps, sigmas = beside.step[places].tolist(), beside.sigma[places].tolist()
    settled: dict[int, Fit] = {}
    for c, step, sigma in zip(places.tolist(), steps, sigmas, strict=True):
        terms = tuple(t.moved(s, sigma=d) for t, s, d in zip(fit.terms, step, sigma, strict=True))
        evidence = beside.promised[c] if c else beside.log_evidence[0]
        settled[c] = fit.at(terms, float(evidence))
    return settled
