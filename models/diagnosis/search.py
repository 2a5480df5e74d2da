"""The search: every effect alone, then pairs and triples of what leads.

All hypotheses are ranked in closed form on their tangents; those in reach of the best are simulated and moved by
Newton steps until their values stand still. Where an effect is far from a line, that may end short of its best value,
and a further cause beside it, next to off itself, may lead it there. Such a cause is left out again, and the value
kept.
"""

from collections.abc import Iterable, Sequence
from dataclasses import replace
from itertools import combinations, product

import numpy as np
from numpy.typing import NDArray

from models.diagnosis.hypotheses import EVERYDAY, Fit, Term, evidence_of, weigh
from models.diagnosis.refinery import STILL, Refinery, hopeless
from models.diagnosis.signatures import Signature
from models.diagnosis.variants import step_of

Array = NDArray[np.float64]

_FOLLOWED, _PAIRS, _TRIPLES = 8, 8, 4  # hypotheses of each size that are followed to the end
_SCREENED = 12  # combinations on tangents that are looked at closer
_SHARPENED = 6  # that get slopes simulated at their values
_NAMED = 3  # parts of a hypothesis that are tried as causes
_TO_EXTEND = 3  # leading hypotheses that are tried with one cause more
_IN_REACH = 6.0  # in log probability: a hypothesis that is worth slopes of its own
_LARGER_IN_REACH = 3.0  # the same with one cause more, and on its tangents: worth a simulation
_GOES_ALONG = 0.5  # further off: slopes taken anew often bring it in reach, and to ask once more costs more
_FAINT = 3.0  # standard deviations from off: a cause that may well not be there
_BETTER = 0.5  # in log evidence: another place, not a step along the old one
_SIGNIFICANT = 3.0  # standard deviations
_AS_PROMISED = 2.0  # in log evidence: nothing that was simulated so near its tangent has no more to gain
_LIKELY_NOTHING = 1.0  # in log evidence: how far behind nothing
_FAR_BEHIND = 200.0  # in log evidence on its line: how far that errs so far out
_FAR_BEHIND_EACH = 0.25  # of each reading: the more there are, the further a line that bends falls behind
_SHORT_OF = 0.5  # in log evidence: how far a simulation falls short of its line where that bends
_FAR = (-0.4, 0.4)  # of the prior scale: where to start again where the line led to a place worse than off
_PART_WAY = (0.3, 0.5, 0.75)  # where to start again where the line would lead and what is there is far behind
_REACH = 3.0  # prior scales that a line is trusted over
_TOO_NEAR = 0.1  # prior scales from off: so short a way teaches no bend


def on_tangents(refinery: Refinery) -> list[Fit]:
    """Nothing and every effect alone on its tangent, without any simulation: a first look."""
    nothing = Fit.nothing(refinery.residual.size)
    lines = _best_variants(_screened(refinery, nothing))
    return [replace(nothing, log_evidence=refinery.weighed(nothing).log_evidence), *lines]


def search(refinery: Refinery) -> list[Fit]:
    """Nothing, every effect alone, and the pairs and triples in reach, all fitted; without leftover."""
    fits, scans = _alone(refinery, on_tangents(refinery))
    straight = [*(_term(s) for s in refinery.known.effects), *_secants(fits[0], scans)]
    refinery = refinery.near_to(max(fits, key=refinery.log_probability))
    for size, most in ((2, _PAIRS), (3, _TRIPLES)):
        larger = _larger(refinery, fits, straight, size, most)
        if not larger:
            break
        better = _shorter(refinery, larger, fits)
        fits = _with([*fits, *larger], better)
        if better:
            fits = _with(fits, _larger(refinery, fits, straight, size, most))
    return _sharpened(refinery, fits)


def _sharpened(refinery: Refinery, fits: list[Fit]) -> list[Fit]:
    """All fits, those in reach of the best with slopes of their own, and at the values that these lead to.

    A slope learned on the way may be too shallow, and what is known worse then is too likely. Where slopes of their own
    take that from the best, others come in reach.
    """
    sharp, rest = list[Fit](), fits
    while leading := _to_sharpen(refinery, sharp, rest):
        ids = {id(fit) for fit in leading}
        rest = [fit for fit in rest if id(fit) not in ids]
        sharp += refinery.followed(refinery.sharpened(leading), still=STILL)
    return [*rest, *sharp]


def _to_sharpen(refinery: Refinery, sharp: Sequence[Fit], rest: Sequence[Fit]) -> list[Fit]:
    """Of the rest those in reach of the best, as many as may be sharpened still, the most probable first.

    With any of them goes what is all but in reach.
    """
    first = max([*rest, *sharp], key=refinery.log_probability)

    def short_by(fit: Fit) -> float:
        reach = _LARGER_IN_REACH if len(fit.terms) > len(first.terms) else _IN_REACH
        return refinery.log_probability(first) - refinery.log_probability(fit) - reach

    order = sorted((f for f in rest if f.terms), key=refinery.log_probability, reverse=True)
    if not any(short_by(f) < 0.0 for f in order):
        return []
    return [f for f in order if short_by(f) < _GOES_ALONG][: _SHARPENED - len(sharp)]


def _alone(refinery: Refinery, tangents: Sequence[Fit]) -> tuple[list[Fit], list[Fit]]:
    """Nothing and every single effect, fitted; and the simulated starting values of those that are far from a line.

    All are simulated once, those that lead to the end. An effect that is likelier absent, and nearer to off than where
    its signature was simulated, is not simulated again.
    """
    nothing, *lines = tangents
    straight = nothing.log_evidence
    scans = [start for line in lines for start in _moved_to(line, line.terms[0].head.starts)]
    scans = _not_far_behind(refinery, scans, straight)
    known = [line for line in lines if _is_known(line, straight)]
    lines = [line for line in lines if not _is_known(line, straight)]
    nothing, *curves = refinery.simulated([nothing, *lines, *scans])
    curves, scans = curves[: len(lines)], curves[len(lines) :]
    starts = [
        start
        for line, curve in zip(lines, curves, strict=True)
        if not line.terms[0].head.starts
        and curve.log_evidence - nothing.log_evidence < min(line.log_evidence - straight - _SHORT_OF, 0.0)
        for start in _moved_to(line, [t.head.off + far * t.head.prior for t in line.terms for far in _FAR])
    ]
    starts = _not_far_behind(refinery, starts, nothing.log_evidence)
    lost = _part_way(lines, curves, nothing.log_evidence, straight)
    sigmas = [w.sigma for w in refinery.weighed_all(lines)]
    tried = [*map(_tangent, lines, curves, sigmas), *scans, *(refinery.simulated(starts) if starts else [])]
    # each to its own end: where they begin, none tells which leads furthest
    tried += [
        end for begun in (refinery.simulated(lost) if lost else []) for end in refinery.followed([begun])
    ]
    once = _best([*tried, *_about(refinery, nothing, known)])
    leader = max(nothing.log_evidence, once[0].log_evidence)
    near = [fit for fit in once if fit.log_evidence > hopeless(leader)]
    far = once[len(near) :]
    promise = [fit for fit, w in zip(far, refinery.weighed_all(far), strict=True) if w.promised > leader]
    chosen = [*near[:_FOLLOWED], *_significant(refinery, near[_FOLLOWED:]), *promise]
    names = {fit.effects for fit in chosen}
    if abs(nothing.log_evidence - straight) > _AS_PROMISED:
        nothing, *followed = refinery.followed([nothing, *chosen], leader)
    else:
        followed = refinery.followed(chosen, leader)
    return [nothing, *_sorted([*followed, *(f for f in once if f.effects not in names)])], scans


def _part_way(lines: Sequence[Fit], curves: Sequence[Fit], nothing: float, straight: float) -> list[Fit]:
    """Starting values on the way of those lines that promise to lead, and led to where no step leads back from.

    A line that bends overshoots, and what is simulated there, parts far off beside it, may be a place of its own.
    ``nothing`` and ``straight`` are the log evidence of nothing, simulated and on its line.
    """
    leader = max([nothing, *(curve.log_evidence for curve in curves)])
    lost = [
        line
        for line, curve in zip(lines, curves, strict=True)
        if line.log_evidence - straight > leader - nothing and curve.log_evidence < hopeless(leader)
    ]
    ways = [[t.head.off + part * t.distance for t in line.terms for part in _PART_WAY] for line in lost]
    return [start for line, way in zip(lost, ways, strict=True) for start in _moved_to(line, way)]


def _not_far_behind(refinery: Refinery, starts: Sequence[Fit], nothing: float) -> list[Fit]:
    """Those starting values whose evidence, on their lines, is in reach of the hypothesis that nothing is wrong."""
    least = hopeless(nothing, max(_FAR_BEHIND, _FAR_BEHIND_EACH * refinery.residual.size))
    weighed = refinery.weighed_all(starts)
    return [fit for fit, w in zip(starts, weighed, strict=True) if w.log_evidence > least]


def _is_known(line: Fit, nothing: float) -> bool:
    """Whether an effect on its line is likely nothing, no further from off than where the line was simulated."""
    (term,) = line.terms
    near = abs(term.distance) <= abs(step_of(term.signature.entry))
    return near and line.log_evidence < nothing - _LIKELY_NOTHING


def _about(refinery: Refinery, nothing: Fit, lines: Sequence[Fit]) -> list[Fit]:
    """Lines about what nothing was simulated to be, with their evidence there."""
    moved = [
        replace(line, shift=line.shift + nothing.shift, bend=nothing.bend, spreads=nothing.spreads)
        for line in lines
    ]
    weighed = refinery.weighed_all(moved)
    return [replace(fit, log_evidence=w.log_evidence) for fit, w in zip(moved, weighed, strict=True)]


def _screened(refinery: Refinery, nothing: Fit) -> list[Fit]:
    """Every effect at the best value of its tangent about what ``nothing`` predicts."""
    return _fitted_lines(refinery, [replace(nothing, terms=(_term(s),)) for s in refinery.known.effects])


def _fitted_lines(refinery: Refinery, fits: Sequence[Fit]) -> list[Fit]:
    """Fits moved to the best values of their tangents, with their evidence there."""
    bare, own = refinery.seen_bare(fits, basis=False), [fit.own(refinery.known) for fit in fits]
    moved, there = [], []
    here = weigh(fits, refinery.with_laws(fits, bare), refinery.geometry, own)
    for fit, seen, weighed in zip(fits, bare, here, strict=True):
        reach = _REACH * np.array([t.head.prior for t in fit.terms])
        moved.append(fit.moved(np.clip(weighed.step[0], -reach, reach)))
        way = zip(moved[-1].terms, fit.terms, strict=True)
        there.append(seen.less(np.array([new.value - old.value for new, old in way])))
    last = weigh(moved, refinery.with_laws(moved, there), refinery.geometry, own)
    return [replace(fit, log_evidence=w.at(0).log_evidence) for fit, w in zip(moved, last, strict=True)]


def _best_variants(fits: list[Fit]) -> list[Fit]:
    """One fit an effect, its best variant: :func:`log_prior` shares the prior among them."""
    found: dict[tuple[str, ...], list[Fit]] = {}
    for fit in fits:
        found.setdefault(fit.effects, []).append(fit)
    return [max(variants, key=lambda f: f.log_evidence) for variants in found.values()]


def _moved_to(line: Fit, values: Iterable[float]) -> list[Fit]:
    """The line at other values, inside the bounds and not at off."""
    (term,) = line.terms
    inside = {term.moved(value - term.value).value for value in values} - {term.head.off}
    return [line.moved(np.array([value - term.value])) for value in sorted(inside)]


def _tangent(line: Fit, curve: Fit, sigma: Array) -> Fit:
    """The simulated fit with the slope at its value, taken as a parabola from off through what was simulated.

    The spreads went a part of the way, as in Broyden's update of :mod:`models.diagnosis.refinery`.
    """
    (term,) = curve.terms
    if term.signature.entry.threshold or abs(term.distance) < _TOO_NEAR * term.head.prior:
        return curve
    steps2 = (term.distance / sigma[0]) ** 2
    share = steps2 / (steps2 + float(np.sum(np.square(curve.spreads))) + 1.0)
    bend = 2 * share * (curve.shift - line.shift) / term.distance
    return replace(curve, terms=(replace(term, slope=term.slope + bend),))


def _best(fits: Iterable[Fit]) -> list[Fit]:
    """The best fit of each set of effects, best first."""
    best: dict[tuple[str, ...], Fit] = {}
    for fit in _sorted(fits):
        best.setdefault(fit.effects, fit)
    return list(best.values())


def _sorted(fits: Iterable[Fit]) -> list[Fit]:
    return sorted(fits, key=lambda f: -f.log_evidence)


def _significant(refinery: Refinery, fits: Sequence[Fit]) -> list[Fit]:
    """Those whose value is off by more than its own uncertainty could be, everyday spread included."""
    found = []
    for fit, weighed in zip(fits, refinery.weighed_all(fits), strict=True):
        (term,), (sigma,) = fit.terms, weighed.sigma
        if abs(term.distance) > _SIGNIFICANT * float(np.hypot(sigma, term.head.tolerance)):
            found.append(fit)
    return found


def _secants(nothing: Fit, scans: Iterable[Fit]) -> list[Term]:
    """One term for each simulated starting value of an effect that is far from a line: the secant from off to it."""
    return [replace(t, slope=(f.shift - nothing.shift) / t.distance) for f in scans for t in f.terms]


def _with(fits: list[Fit], found: Iterable[Fit]) -> list[Fit]:
    """The fits in their order, each set of effects at the best place that is known of it."""
    best = {fit.effects: fit for fit in fits}
    for fit in found:
        best[fit.effects] = max(best.get(fit.effects, fit), fit, key=lambda f: f.log_evidence)
    return list(best.values())


def _larger(refinery: Refinery, fits: list[Fit], straight: list[Term], size: int, most: int) -> list[Fit]:
    """The hypotheses of that size that are in reach of the best, simulated and followed.

    ``fits`` begin with nothing; the further causes come with ``straight`` slopes from off, or those learned alone.
    """
    nothing, learned = fits[0], [f.terms[0] for f in fits if len(f.terms) == 1]
    base, terms = [f for f in fits if len(f.terms) == size - 1], [*learned, *straight]
    leading = max(map(refinery.log_probability, fits))
    pairs = combinations([_term(t.signature) for t in learned], 2)
    candidates = _on_tangents(refinery, nothing, pairs) if size == 2 else []
    for fit in _sorted(base)[:_TO_EXTEND]:
        candidates += _on_tangents(refinery, fit, [(t,) for t in terms])
    candidates = [replace(f, terms=tuple(sorted(f.terms, key=lambda t: t.effect))) for f in candidates]
    candidates = [f for f in candidates if refinery.log_probability(f) > leading - _LARGER_IN_REACH]
    chosen = _best(candidates)[:most]
    chosen += _other_variants(chosen, candidates)
    for fit in _sorted(base)[:_TO_EXTEND]:
        if fit.terms and refinery.log_probability(fit) > leading - _IN_REACH:
            chosen += _with_parts_named(refinery, fit)
    if not chosen:
        return []
    leader = max(f.log_evidence for f in fits)
    simulated = refinery.simulated(chosen)
    if crossed := _crossed(chosen, simulated, refinery.known.effects):
        simulated += refinery.simulated(crossed)
    return _best(refinery.followed(simulated, leader))


def _with_parts_named(refinery: Refinery, fit: Fit) -> list[Fit]:
    """A fit with one cause more, at the value of a part that it needs further off than any ordinary bench has it.

    Tangents need not promise anything: without that cause it is no hypothesis. The parts that are furthest off count.
    """
    spreads, found = refinery.known.spreads, list[tuple[float, Fit]]()
    off = spreads @ refinery.solved(fit)
    for signature in refinery.known.effects:
        own = refinery.known.own_spreads(signature.effect)
        if own.size != 1 or signature.effect in fit.effects or abs(off[own[0]]) < EVERYDAY:
            continue
        term, along = _term(signature), signature.slope
        step = float(off[own[0]] * (spreads[own[0]] @ along) / (along @ along))
        terms = tuple(sorted((*fit.terms, term), key=lambda t: t.effect))
        moved = replace(fit, terms=terms).moved(np.array([step if t is term else 0.0 for t in terms]))
        found.append((abs(float(off[own[0]])), moved))
    return [moved for _, moved in sorted(found, key=lambda each: -each[0])[:_NAMED]]


def _shorter(refinery: Refinery, fits: Sequence[Fit], known: Sequence[Fit]) -> list[Fit]:
    """Fits without one of their faint causes each, followed to the end: those that gain on what is ``known``.

    What gains may have faint causes of its own, and is tried without these too.
    """
    starts = [
        fit.without(term.effect)
        for fit, weighed in zip(fits, refinery.weighed_all(fits), strict=True)
        for term, sigma in zip(fit.terms, weighed.sigma, strict=True)
        if len(fit.terms) > 1 and abs(term.distance) < _FAINT * sigma
    ]
    if not starts:
        return []
    evidence = {fit.effects: fit.log_evidence for fit in known}
    found = refinery.followed(refinery.simulated(starts), max(evidence.values()))
    better = [f for f in found if f.log_evidence > evidence.get(f.effects, -np.inf) + _BETTER]
    return [*better, *_shorter(refinery, better, _with([*known], better))]


def _crossed(aimed: Iterable[Fit], simulated: Iterable[Fit], known: Sequence[Signature]) -> list[Fit]:
    """What fell far short of its tangents, heat having moved rows across a threshold, with every other threshold."""
    both = zip(aimed, simulated, strict=True)
    short = _best(fit for line, fit in both if fit.log_evidence < hopeless(line.log_evidence))
    found = []
    for fit, s in product(short, known):
        if s.entry.threshold and s.effect in fit.effects and s.other != fit.term(s.effect).signature.other:
            terms = (replace(t, signature=s, slope=s.slope) if t.effect == s.effect else t for t in fit.terms)
            found.append(replace(fit, terms=tuple(terms)))
    return found


def _other_variants(chosen: Sequence[Fit], candidates: Sequence[Fit]) -> list[Fit]:
    """The same effects as what is chosen, in another variant, or with another slope of what is far from a line.

    Which of them is best on tangents says little: slopes end at different values, and heat moves a threshold's rows.
    """
    sets, known = {f.effects for f in chosen}, {id(f) for f in chosen}
    same = [f for f in candidates if f.effects in sets and id(f) not in known]
    return [f for f in same if any(t.head.starts or t.signature.entry.parameters[1:] for t in f.terms)]


def _term(signature: Signature) -> Term:
    """An effect at its off value, with its slope there."""
    return Term(signature=signature, value=signature.entry.headline.off, sigma=np.inf, slope=signature.slope)


def _on_tangents(refinery: Refinery, base: Fit, more: Iterable[Sequence[Term]]) -> list[Fit]:
    """The best fits with some terms more, as many for each, than a simulated one, on straight lines from its state."""
    sets = [chosen for chosen in more if _are_new(chosen, base)]
    if not sets:
        return []
    terms = {id(t): t for chosen in sets for t in chosen}
    place, off = {key: k for k, key in enumerate(terms)}, {key: t.at(t.head.off) for key, t in terms.items()}
    *slopes, left = base.vectors(refinery.residual)
    vectors = np.stack([*slopes, *(t.slope for t in terms.values()), left])
    seen = refinery.geometry.project(vectors, basis=False).with_directions(vectors, refinery.law(base))
    ends = list(range(len(vectors) - 1, len(seen.each_other)))  # what is left, then the laws' columns
    fits = [replace(base, terms=(*base.terms, *(off[id(t)] for t in chosen))) for chosen in sets]
    parts = [[*range(len(slopes)), *(len(slopes) + place[id(t)] for t in chosen), *ends] for chosen in sets]
    own = [fit.own(refinery.known) for fit in fits]
    weighed = evidence_of(fits, refinery.geometry.products_among(seen, np.array(parts), own))
    best = sorted(range(len(fits)), key=lambda k: -weighed[k].promised[0])[:_SCREENED]
    return _fitted_lines(refinery, [fits[k] for k in best])


def _are_new(chosen: Sequence[Term], base: Fit) -> bool:
    """Whether these are different effects, none of which a fit has."""
    effects = {t.effect for t in chosen}
    return len(effects) == len(chosen) and effects.isdisjoint(base.effects)
