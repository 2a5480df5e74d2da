"""From probabilities to a verdict that an engineer can act on.

``consistent``: that nothing is wrong cannot be excluded. ``named``: one cause has 95 % of all probability, with
or without a leftover beside it. ``group``: causes that this design cannot tell apart have it together.
``unknown``: the residuals need a leftover more than any cause, or nothing above reaches 95 %.
"""

from dataclasses import dataclass

import numpy as np

from models.diagnosis.covariance import Whitener
from models.diagnosis.evidence import Fit, Hypothesis

SURE = 0.95
_UNEXPLAINED = 4.0  # chi-squared per reading: noise that is understated by half leaves 2.3
_TIED_BELOW = 5.0  # sigmas of isolability under which a design does not tell two causes apart


@dataclass(frozen=True, slots=True, kw_only=True)
class Cause:
    """A cause with its marginal probability, over leftovers; ``fit`` is its most probable fit."""

    fit: Fit
    probability: float
    tied_with: tuple[str, ...] = ()

    @property
    def effect(self) -> str:
        """The effect's name."""
        return self.fit.effect


@dataclass(frozen=True, slots=True, kw_only=True)
class Verdict:
    """``kind`` is consistent, named, group or unknown; causes by probability; the tied groups."""

    kind: str
    causes: tuple[Cause, ...]
    groups: tuple[tuple[str, ...], ...]
    consistent_probability: float
    unknown_probability: float


def isolability(a: Fit, b: Fit, whitener: Whitener) -> float:
    """How many sigmas of a's fitted shift b cannot imitate: ||(I - P_b) s_a|| in whitened residuals."""
    weighted = whitener.solve(np.stack([a.shift, b.shift], axis=1))
    aa, ab, bb = (
        float(a.shift @ weighted[:, 0]),
        float(a.shift @ weighted[:, 1]),
        float(b.shift @ weighted[:, 1]),
    )
    return float(np.sqrt(max(aa - ab**2 / bb if bb > 0 else aa, 0.0)))


def _marginal(hypotheses: list[Hypothesis]) -> list[Cause]:
    best: dict[str, Fit] = {}
    total: dict[str, float] = {}
    for h in hypotheses:
        if h.fit.signature is not None:
            name = h.fit.effect
            best.setdefault(name, h.fit)
            total[name] = total.get(name, 0.0) + h.probability
    order = sorted(total, key=lambda name: -total[name])
    return [Cause(fit=best[name], probability=total[name]) for name in order]


def _tie_group(causes: list[Cause], whitener: Whitener) -> tuple[str, ...]:
    """The leading cause and those with a share that the design cannot tell from it, until 95 % is reached."""
    first, total = causes[0], causes[0].probability
    group = [first.effect]
    for other in causes[1:]:
        if total >= SURE or other.probability < 1e-3:
            break
        if isolability(first.fit, other.fit, whitener) < _TIED_BELOW:
            group.append(other.effect)
            total += other.probability
    return tuple(group)


def judge(hypotheses: list[Hypothesis], whitener: Whitener, misfit: float = 1.0) -> Verdict:
    """The verdict of a posterior.

    ``misfit`` is the chi-squared per reading that the most probable fit leaves without a leftover; far above one,
    nothing that was tried explains the data, and no name is given.
    """
    nothing = sum(h.probability for h in hypotheses if h.fit.signature is None and h.leftover_W == 0.0)
    nameless = sum(h.probability for h in hypotheses if h.fit.signature is None and h.leftover_W > 0.0)
    leftover = sum(h.probability for h in hypotheses if h.leftover_W > 0.0)
    causes = _marginal(hypotheses)
    group = _tie_group(causes, whitener)
    together = sum(c.probability for c in causes if c.effect in group)
    if causes[0].probability >= SURE:
        kind, group = "named", group[:1]
    elif together >= SURE:
        kind = "group"
    elif nothing >= 1 - SURE and nothing >= nameless:
        kind = "consistent"  # it cannot be excluded that nothing is wrong: no cause is named
    else:
        kind = "unknown"
    if kind in ("named", "group") and misfit > _UNEXPLAINED:
        kind = "unknown"
    tied = group if kind == "group" else ()
    shown = [
        Cause(
            fit=c.fit,
            probability=c.probability,
            tied_with=tuple(n for n in tied if n != c.effect and c.effect in tied),
        )
        for c in causes
        if c.probability >= 1e-3
    ]
    return Verdict(
        kind=kind,
        causes=tuple(shown),
        groups=(tied,) if len(tied) > 1 else (),
        consistent_probability=nothing,
        unknown_probability=leftover,
    )
