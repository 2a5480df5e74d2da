"""From probabilities to a verdict that an engineer can act on.

``consistent``: that nothing is wrong cannot be excluded. ``named``: at least one cause has 95 % of all probability,
alone or with others, with or without a leftover beside it, and nothing that this design cannot tell from it has one
per cent; groups may stand beside it. ``group``: only several causes reach 95 % together, which this design cannot tell
apart, or which it could and these data did not. ``unknown``: a leftover, a bad fit or outliers that confirm each other
forbid a name, or nothing reaches 95 %.
"""

import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from models.diagnosis.everyday import everyday_together
from models.diagnosis.evidence import Hypothesis, probability_of
from models.diagnosis.hypotheses import Fit, Term
from models.diagnosis.leftover import GAIN_IN_TIME
from models.diagnosis.sensors import is_sensor
from models.diagnosis.unexplained import Unexplained
from models.diagnosis.whitener import Whitener

Array = NDArray[np.float64]

SURE = 0.95
_UNEXPLAINED = 4.0  # squared sigmas per reading: noise that is understated by half leaves 2.3
BY_CHANCE = 4.5  # sigmas by which two readings of one row may miss the same
_TIED_BELOW = 5.0  # sigmas of isolability under which a design does not tell two causes apart
# times the leftover's length; a threshold catches what is not smooth
_ABOVE_LEFTOVER, _THRESHOLD_ABOVE = 1.25, 3.0
_OF_ITS_OWN = 0.75  # prior scales from which a threshold stands beside another cause
_LIKELY = 0.5  # probability from which a leftover, or a threshold that is no cause, has to be reckoned with
# sigmas of a leftover that the model's own shortcomings have on any bench; at most beside causes, whose laws miss a
# little too, by some times what they are doubted by; and of a gain that wanders in any room
_FAINT, _FAINT_BESIDE, _FAINT_GAIN = 5.0, 11.0, 11.0
_LAWS_MISS = 2.0
_POSSIBLE = 0.01  # probability from which what the design does not tell from a sure cause is stated beside it
# in log likelihood: how far behind a sure cause readings exclude another one
_EXCLUDED = math.log((1.0 - SURE) / SURE)
_WORTH_A_WORD = 1e-3  # of probability: below it a cause is not listed


@dataclass(frozen=True, slots=True, kw_only=True)
class Cause:
    """A cause with its probability over all hypotheses that hold it; ``fit`` is the most probable of them."""

    effect: str
    fit: Fit
    probability: float
    tied_with: tuple[str, ...] = ()

    @property
    def term(self) -> Term:
        """Its value, deviation and slope in that fit."""
        return self.fit.term(self.effect)

    @property
    def shift(self) -> Array:
        """What the cause adds to the prediction, (M,): all of its fit where it is alone, else along its slope."""
        return self.fit.shift if len(self.fit.terms) == 1 else self.term.slope * self.term.distance


@dataclass(frozen=True, slots=True, kw_only=True)
class Verdict:
    """``kind`` is consistent, named, group or unknown; causes by probability; the tied groups.

    ``stated`` are the effects that the verdict stands for: the named ones, or the first of each group. A group is
    ``left_open`` where its causes are not tied by the design: more rows like these would tell which it is.
    ``consistent_probability`` is that of nothing beyond an ordinary bench, ``nothing_probability`` that of no cause at
    all, ``unknown_probability`` that of a leftover which is more than the model's own shortcomings, or, of a verdict
    ``unknown``, of anything that is no cause. ``strained`` says that the causes would need laws off by all that is
    feared, and that nothing is stated for that.
    """

    kind: str
    causes: tuple[Cause, ...]
    groups: tuple[tuple[str, ...], ...]
    stated: tuple[str, ...]
    consistent_probability: float
    nothing_probability: float
    unknown_probability: float
    left_open: bool = False
    strained: bool = False

    @property
    def named(self) -> tuple[str, ...]:
        """The causes that the verdict names, none where it only states groups."""
        return self.stated if self.kind == "named" else ()


def isolability(a: Array, b: Array, whitener: Whitener) -> float:
    """How many sigmas of shift a (M,) shift b cannot imitate: ||(I - P_b) s_a|| in whitened residuals."""
    both = np.stack([a, b])
    (aa, ab), (_, bb) = both @ whitener.solve(both.T)
    return float(np.sqrt(max(aa - ab**2 / bb if bb > 0 else aa, 0.0)))


def _is_ordinary(hypothesis: Hypothesis, faint: bool, whitener: Whitener) -> bool:
    """Whether it holds nothing that an ordinary bench has not; a ``faint`` leftover is that."""
    return (faint or hypothesis.leftover is None) and everyday_together(hypothesis.fit, whitener)


def _place(hypotheses: Sequence[Hypothesis]) -> str:
    """The most probable place of a leftover."""
    return next((h.leftover.location for h in hypotheses if h.leftover is not None), "")


def _is_faint(hypotheses: Sequence[Hypothesis], length: float) -> bool:
    """Whether a leftover of this length, at its most probable place, is one that any bench has."""
    return length < (_FAINT_GAIN if _place(hypotheses) == GAIN_IN_TIME else _FAINT)


def _faint_beside(hypotheses: Sequence[Hypothesis], causes: Sequence[Cause], whitener: Whitener) -> float:
    """How long a leftover may be that is but what any bench has, and what the laws of sure causes miss."""
    if _place(hypotheses) == GAIN_IN_TIME:
        return _FAINT_GAIN
    doubts = [
        c.term.signature.entry.law * math.sqrt(float(c.shift @ whitener.solve(c.shift)))
        for c in causes
        if c.probability >= SURE
    ]
    return min(_FAINT + _LAWS_MISS * math.hypot(*doubts), _FAINT_BESIDE)


def _above(term: Term) -> float:
    """How many times the leftover's length a cause's significance must be for its name."""
    return _THRESHOLD_ABOVE if term.signature.entry.threshold else _ABOVE_LEFTOVER


def _catches(term: Term, fit: Fit) -> bool:
    """Whether a threshold effect merely takes up the error of another cause's law: it is small, and one is beside it.

    What is beside it within the everyday line is no cause, and its law's error is small.
    """
    if not term.signature.entry.threshold or abs(term.distance) >= _OF_ITS_OWN * term.head.prior:
        return False
    return any(other.beyond_everyday for other in fit.terms if other is not term)


def _has_caught(fit: Fit) -> bool:
    """Whether a threshold of it is no cause."""
    return any(_catches(term, fit) for term in fit.terms)


def _caught(hypotheses: Sequence[Hypothesis]) -> float:
    """How many sigmas a threshold has that is probable but no cause: what is left over by another name; 0 without."""
    caught = [(h.probability, t) for h in hypotheses for t in h.fit.terms if _catches(t, h.fit)]
    if sum(probability for probability, _ in caught) < _LIKELY:
        return 0.0
    return max(caught, key=lambda entry: entry[0])[1].significance


def _is_cause(term: Term, fit: Fit) -> bool:
    """Whether it is further off in a fit than on any ordinary bench, and no threshold that catches another's error."""
    return fit.has_beyond_everyday(term) and not _catches(term, fit)


def marginal(hypotheses: Sequence[Hypothesis]) -> list[Cause]:
    """Every cause with the probability that it is further off than on any ordinary bench, most probable first."""
    best: dict[str, Fit] = {}
    total: dict[str, float] = {}
    for h in hypotheses:
        for term in h.fit.terms:
            if _is_cause(term, h.fit):
                best.setdefault(term.effect, h.fit)
                total[term.effect] = total.get(term.effect, 0.0) + h.probability
    order = sorted(total, key=lambda name: -total[name])
    return [Cause(effect=name, fit=best[name], probability=min(total[name], 1.0)) for name in order]


def _standing(cause: Cause, hypotheses: Sequence[Hypothesis], leftover: float, faint: float) -> float:
    """How many sigmas a cause stands out by beside a leftover of such a length: its distance from off.

    Beside one that is not ``faint``, which would be said, another leftover may do what the cause does: no more then
    than the root of twice the log odds against all that explains the readings without it.
    """
    without = probability_of(h for h in hypotheses if cause.effect not in h.fit.effects)
    if leftover < faint or without <= 0.0:
        return cause.term.significance
    odds = max(_any_of(hypotheses, (cause.effect,)) / without, 1.0)
    return min(cause.term.significance, math.sqrt(2.0 * math.log(odds)))


def _any_of(hypotheses: Sequence[Hypothesis], effects: Collection[str]) -> float:
    """Probability that at least one of the effects is there."""
    return probability_of(h for h in hypotheses if not set(effects).isdisjoint(h.fit.effects))


def _any_is_cause(hypotheses: Sequence[Hypothesis], effects: Collection[str]) -> float:
    """Probability that at least one of the effects is further off than on any ordinary bench."""
    return probability_of(
        h for h in hypotheses if any(t.effect in effects and _is_cause(t, h.fit) for t in h.fit.terms)
    )


def _without(hypotheses: Sequence[Hypothesis], other: Cause, group: Collection[str]) -> list[Hypothesis]:
    """The hypotheses that hold a cause and none of a group."""
    return [h for h in hypotheses if other.effect in h.fit.effects and set(group).isdisjoint(h.fit.effects)]


def _instead(hypotheses: Sequence[Hypothesis], other: Cause, group: Collection[str]) -> float:
    """Probability of a cause where none of a group is there."""
    return probability_of(_without(hypotheses, other, group))


def _log_told(fit: Fit) -> float:
    """Log likelihood of a fit at its values, but for what all share: its evidence less what priors say of these."""
    priors = (0.5 * (t.distance / t.head.prior) ** 2 + math.log(t.head.prior / t.sigma) for t in fit.terms)
    return fit.log_evidence + sum(priors)


def _readings_exclude(hypotheses: Sequence[Hypothesis], other: Cause, group: Collection[str]) -> bool:
    """Whether the readings alone, with as many causes at most, exclude a cause in the place of a group.

    What priors alone make improbable is not told by the readings.
    """
    first = next(h.fit for h in hypotheses if not set(group).isdisjoint(h.fit.effects))
    instead = (h.fit for h in _without(hypotheses, other, group) if len(h.fit.terms) <= len(first.terms))
    return max(map(_log_told, instead), default=-math.inf) < _log_told(first) + _EXCLUDED


def _tie_group(
    first: Cause, rivals: Sequence[Cause], hypotheses: Sequence[Hypothesis], whitener: Whitener
) -> tuple[str, ...]:
    """A cause and the rivals that the design cannot tell from it, each that is possible; none below 95 % together.

    Beside what is sure, only a rival that the readings themselves leave possible.
    """
    group = [first.effect]
    for other in rivals:
        sure = _any_of(hypotheses, group) >= SURE
        tied = isolability(first.shift, other.shift, whitener) < _TIED_BELOW
        possible = _instead(hypotheses, other, group) >= (_POSSIBLE if sure else _WORTH_A_WORD)
        if tied and possible and not (sure and _readings_exclude(hypotheses, other, group)):
            group.append(other.effect)
    return tuple(group) if _any_of(hypotheses, group) >= SURE else ()


def _left_open(causes: Sequence[Cause], hypotheses: Sequence[Hypothesis]) -> list[tuple[str, ...]]:
    """One group of the fewest causes with 95 % together, each possible instead of those before it; or none.

    What is there in any case is open for how far it is off, and takes no other's place.
    """
    group: list[str] = []
    for cause in causes:
        if not _is_there(cause, hypotheses) and _instead(hypotheses, cause, group) >= _POSSIBLE:
            group.append(cause.effect)
        if _any_of(hypotheses, group) >= SURE:
            return [tuple(group)]
    return []


def judge(
    hypotheses: Sequence[Hypothesis],
    whitener: Whitener,
    misfit: float = 1.0,
    leftover: float = 0.0,
    agreement: float = 0.0,
    *,
    strained: bool = False,
) -> Verdict:
    """The verdict of a posterior.

    ``leftover`` is the length in sigmas of what is left over, where anything is. Where that is probable a cause is
    stated beside it only if its value is further from off, well above: what nobody has thought of looks a little
    like something, but for a sensor that is off. Beside a long one the
    readings must also call for it against any other leftover. What is sure and shorter than that is no cause beside a
    stated one: it is not listed, and the leftover is said.

    ``misfit`` is the mean square in sigmas that the most probable fit leaves without a leftover; far above one,
    nothing that was tried explains the data, and no cause is listed. Where readings that were taken for outliers
    confirm each other, by ``agreement`` sigmas, none is stated; nor where the explanations are ``strained``
    (:mod:`models.diagnosis.strain`).
    """
    fits, alike = misfit <= _UNEXPLAINED, agreement > BY_CHANCE
    nameable = not alike and not strained
    bare = [h for h in hypotheses if not h.fit.terms]
    faint = _is_faint(hypotheses, leftover)
    ordinary = probability_of(h for h in hypotheses if _is_ordinary(h, faint, whitener))
    nameless = probability_of(h for h in bare if h.leftover is not None and not faint)
    beside = probability_of(h for h in hypotheses if h.leftover is not None)
    causes = marginal(hypotheses) if fits else []
    in_the_way = beside >= _LIKELY and not is_sensor(_place(hypotheses))
    least = max(leftover if in_the_way else 0.0, _caught(hypotheses))
    at_most = _faint_beside(hypotheses, causes, whitener)
    standing = {c.effect: _standing(c, hypotheses, least, at_most) for c in causes}
    large = [c for c in causes if nameable and standing[c.effect] >= least * _above(c.term)]
    excluded = ordinary < 1 - SURE
    groups = _groups(large, hypotheses, whitener, excluded=excluded)
    below = [c for c in causes if c.probability >= SURE and standing[c.effect] < least]
    tied_by_data = excluded and not groups
    if tied_by_data:
        groups = _left_open(large, [h for h in hypotheses if faint or h.leftover is None])
    named = tuple(group[0] for group in groups if len(group) == 1)
    if groups:
        kind = "named" if named else "group"
    elif not excluded and ordinary >= nameless and fits and not alike:
        kind = "consistent"  # it cannot be excluded that nothing is wrong: no cause is named
    else:
        kind = "unknown"
    tied = tuple(group for group in groups if len(group) > 1)
    if kind == "unknown":  # whatever stands in the way of a name
        beyond = probability_of(h for h in hypotheses if h.leftover is not None or _has_caught(h.fit))
    else:
        beyond = 0.0 if faint or (groups and not below and leftover < at_most) else beside
    # beside a name, what is shorter than a leftover is a part of that
    listed = [c for c in causes if not groups or c not in below]
    said = {name for group in groups for name in group}
    listed = [c for c in listed if c.effect in said or not _rather_ordinary(c, hypotheses)]
    return Verdict(
        kind=kind,
        causes=tuple(_with_ties(c, tied) for c in listed if c.probability >= _WORTH_A_WORD),
        groups=tied,
        stated=named or tuple(group[0] for group in groups),
        consistent_probability=ordinary,
        nothing_probability=probability_of(h for h in bare if h.leftover is None),
        unknown_probability=beyond if fits and not alike and not (strained and kind == "unknown") else 1.0,
        left_open=tied_by_data and bool(groups),
        strained=strained and kind == "unknown",
    )


def telling_of(verdict: Verdict, left: Unexplained) -> Verdict:
    """The verdict, with what is ``left`` over said where it carries more watts than the stated causes together.

    Few sigmas are most of the gap where little is known of a loss: in efficiency alone.
    """
    stated = [c.shift[left.readings] for c in verdict.causes if c.effect in verdict.stated]
    if not (stated and left.likely) or left.size < _FAINT:
        return verdict
    if float(np.sum(left.watts**2)) <= float(np.sum(np.sum(stated, axis=0) ** 2)):
        return verdict
    return replace(verdict, unknown_probability=max(verdict.unknown_probability, left.probability))


def _groups(
    large: Sequence[Cause], hypotheses: Sequence[Hypothesis], whitener: Whitener, *, excluded: bool
) -> list[tuple[str, ...]]:
    """What is stated: each sure cause with all that could be there instead, and what has 95 % only together.

    While it is not ``excluded`` that nothing is wrong, everything would be in a group. What is there in any case, but
    not surely further off than parts are, is in none; nor, beside a sure cause, are several of which that holds.
    """
    sure = [c for c in large if c.probability >= SURE]
    rest = [c for c in large if c.probability < SURE]
    groups = [_tie_group(c, rest, hypotheses, whitener) for c in sure]
    taken = {name for group in groups for name in group}
    rest = [c for c in rest if c.effect not in taken and not _is_there(c, hypotheses)]
    together = _tie_group(rest[0], rest[1:], hypotheses, whitener) if rest and excluded else ()
    if not together or (groups and _any_is_cause(hypotheses, together) < SURE):
        return groups
    return [*groups, together]


def _rather_ordinary(cause: Cause, hypotheses: Sequence[Hypothesis]) -> bool:
    """Whether what may be there is rather as large as on any bench: no cause."""
    return cause.probability < _LIKELY * _any_of(hypotheses, (cause.effect,))


def _is_there(cause: Cause, hypotheses: Sequence[Hypothesis]) -> bool:
    """Whether a cause is surely there, further off than parts are or not."""
    return _any_of(hypotheses, (cause.effect,)) >= SURE


def _with_ties(cause: Cause, groups: Sequence[tuple[str, ...]]) -> Cause:
    tied = tuple(dict.fromkeys(n for g in groups if cause.effect in g for n in g if n != cause.effect))
    return Cause(effect=cause.effect, fit=cause.fit, probability=cause.probability, tied_with=tied)
