"""Scores answers against the truth: found, false name, shares with their binomial intervals."""

from collections.abc import Sequence
from dataclasses import dataclass

from scipy.stats import binomtest

from experiments.blind.trial import Answer, BlindTrial

_POINTS = 100.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Scored:
    """A trial and its answer."""

    trial: BlindTrial
    answer: Answer

    @property
    def found(self) -> bool:
        """The hidden effect is the first named cause, or in the stated group."""
        return self.trial.effect is not None and self.trial.effect in self.answer.stated

    @property
    def false_name(self) -> bool:
        """Something is named, alone or as a group, and the hidden effect is not in it."""
        return bool(self.answer.stated) and not self.found

    @property
    def covered(self) -> bool | None:
        """Whether the interval of the first cause holds the hidden value; None where that is another effect."""
        t, a = self.trial, self.answer
        if t.effect is None or t.effect != a.first or t.value is None or a.value is None:
            return None
        return a.half_width is not None and abs(a.value - t.value) <= a.half_width

    @property
    def outcome(self) -> str:
        """``found``, ``missed``, ``false name``; of nothing hidden ``rightly none`` or ``not said``."""
        if self.found or self.false_name:
            return "found" if self.found else "false name"
        if self.trial.effect is None:
            return "rightly none" if self.answer.verdict == "consistent" else "not said"
        return "missed"


@dataclass(frozen=True, slots=True, kw_only=True)
class Share:
    """``hits`` of ``trials``."""

    hits: int
    trials: int

    @property
    def per_cent(self) -> float:
        """The share in per cent, NaN of no trials."""
        return _POINTS * self.hits / self.trials if self.trials else float("nan")

    @property
    def ci95(self) -> tuple[float, float]:
        """The 95 % interval of Clopper and Pearson (1934), in per cent; of no trials, everything."""
        if not self.trials:
            return 0.0, _POINTS
        interval = binomtest(self.hits, self.trials).proportion_ci(0.95, method="exact")
        return _POINTS * float(interval.low), _POINTS * float(interval.high)


def found_share(scored: Sequence[Scored]) -> Share:
    """How many of the hidden effects were found."""
    hiding = [s for s in scored if s.trial.effect is not None]
    return Share(hits=sum(s.found for s in hiding), trials=len(hiding))


def false_share(scored: Sequence[Scored]) -> Share:
    """How many answers named something that was not there."""
    return Share(hits=sum(s.false_name for s in scored), trials=len(scored))


def covered_share(scored: Sequence[Scored]) -> Share:
    """How many of the intervals of a first cause that is the hidden effect hold its value."""
    known = [s.covered for s in scored if s.covered is not None]
    return Share(hits=sum(known), trials=len(known))
