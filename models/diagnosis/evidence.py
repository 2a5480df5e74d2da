"""The posterior: what a search has found, every hypothesis weighed again beside every leftover."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from models.diagnosis.everyday import log_everyday
from models.diagnosis.hypotheses import Fit, WeighedBeside, log_prior, weigh
from models.diagnosis.leftover import Leftover
from models.diagnosis.refinery import Refinery
from models.diagnosis.search import search

Array = NDArray[np.float64]

P_LEFTOVER = 0.2
_WORTH_IT = 1e-3  # probability from which it is asked what a hypothesis needs of parts
NEGLIGIBLE = 1e-16  # probability: all such together are below rounding


@dataclass(frozen=True, slots=True, kw_only=True)
class Hypothesis:
    """A fit with or without leftover, and its posterior probability."""

    fit: Fit
    leftover: Leftover | None
    probability: float


def posterior(refinery: Refinery) -> list[Hypothesis]:
    """Every hypothesis with its probability, the most probable first.

    Where one needs parts further off than any ordinary bench has them, only what it is without them counts.
    """
    hypotheses = weighed_with_leftovers(refinery, search(refinery))
    worth = sum(h.probability > _WORTH_IT for h in hypotheses)  # they come first
    shares = [math.exp(log_everyday(refinery, h.fit, h.leftover)) for h in hypotheses[:worth]]
    counted = [h.probability * share for h, share in zip(hypotheses[:worth], shares, strict=True)]
    counted += [h.probability for h in hypotheses[worth:]]
    found = [replace(h, probability=p / sum(counted)) for h, p in zip(hypotheses, counted, strict=True)]
    return sorted(found, key=lambda h: -h.probability)


def weighed_with_leftovers(refinery: Refinery, fits: Iterable[Fit]) -> list[Hypothesis]:
    """Fits without and with every leftover, the values beside a leftover fitted again.

    Of each fit, what has no probability worth a word is left out, but for itself alone and beside its best leftover.
    """
    geometry, catalogue = refinery.geometry, len({s.effect for s in refinery.known.effects})
    configurations = geometry.leftovers.configurations
    fits, leftovers = list(fits), [None, *configurations]
    shares = [_log_share(leftover, geometry.leftovers.shared_by) for leftover in leftovers]
    own = [fit.own(refinery.known) for fit in fits]
    log = np.empty((len(fits), len(leftovers)))
    weighed = _of_their_own(
        refinery, fits, weigh(fits, refinery.seen(fits), geometry, own, leftovers), leftovers
    )
    for k, (fit, beside) in enumerate(zip(fits, weighed, strict=True)):
        log[k] = log_prior(fit, catalogue)
        log[k] += shares
        log[k, 0] += beside.log_evidence[0]
        log[k, 1:] += beside.promised[1:]
    probability = np.exp(log - np.logaddexp.reduce(log, axis=None))
    counts = (probability > NEGLIGIBLE) | (log == log.max(axis=1, keepdims=True))
    counts[:, 0] = True  # without leftover
    settled = [_settled(*each) for each in zip(fits, weighed, counts, strict=True)]
    order = [divmod(int(k), len(leftovers)) for k in np.argsort(-probability, axis=None)]
    return [
        Hypothesis(fit=settled[k][c], leftover=leftovers[c], probability=float(probability[k, c]))
        for k, c in order
        if counts[k, c]
    ]


def _of_their_own(
    refinery: Refinery,
    fits: Sequence[Fit],
    weighed: Sequence[WeighedBeside],
    leftovers: Sequence[Leftover | None],
) -> list[WeighedBeside]:
    """The same, causes beside a threshold known no better than by what they do themselves, from off.

    Which rows lie beyond it where nobody read them tells where it is, not how far off another cause is.
    """
    found = list(weighed)
    mixed = [k for k, fit in enumerate(fits) if len({t.signature.entry.threshold for t in fit.terms}) > 1]
    if not mixed:
        return found
    straight = [
        replace(fits[k], terms=tuple(t.with_slope(t.signature.slope) for t in fits[k].terms)) for k in mixed
    ]
    own = [fit.own(refinery.known) for fit in straight]
    themselves = weigh(straight, refinery.seen(straight), refinery.geometry, own, leftovers)
    for k, beside in zip(mixed, themselves, strict=True):
        found[k] = replace(found[k], sigma=np.maximum(found[k].sigma, beside.sigma))
    return found


def log_total(hypotheses: Sequence[Hypothesis], refinery: Refinery) -> float:
    """Log evidence of all hypotheses of one geometry together, priors included; the most probable comes first."""
    best, catalogue = hypotheses[0], len({s.effect for s in refinery.known.effects})
    share = _log_share(best.leftover, refinery.geometry.leftovers.shared_by)
    return best.fit.log_evidence + log_prior(best.fit, catalogue) + share - math.log(best.probability)


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
