"""Shares with their binomial intervals, and the goals made of them."""

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from scipy.stats import binomtest, norm

from experiments.blind.answer import Answer
from experiments.blind.trial import BlindTrial
from experiments.harness.result import Goal

_POINTS = 100.0
_LOG_ODDS = math.log(0.95 / 0.05)  # from which a cause is named


@dataclass(frozen=True, slots=True, kw_only=True)
class Scored:
    """A trial, its answer, and what the truth said of both; without an answer where it was excluded.

    ``tied`` are the effects that what is hidden cannot be told from, ``nearest`` the sigmas to the next one.
    """

    trial: BlindTrial
    isolability: float | None
    tied: tuple[str, ...] = ()
    nearest: float | None = None
    answer: Answer | None = None

    @classmethod
    def of(cls, trial: BlindTrial, record: dict[str, Any]) -> Self:
        """From a journal's record."""
        return cls(
            trial=trial,
            isolability=record["isolability"],
            tied=tuple(record["tied"]),
            nearest=record["nearest"],
            answer=None if record["excluded"] else Answer.from_plain(record["answer"]),
        )

    @property
    def said(self) -> Answer:
        """The answer of a trial that was not excluded."""
        if self.answer is None:
            raise ValueError(f"{self.trial.key} was excluded and has no answer")
        return self.answer

    @property
    def right_first(self) -> bool:
        """A verdict that names, with a hidden effect first."""
        return self.said.verdict in ("named", "group") and self.said.first in self.trial.names

    @property
    def stated(self) -> bool:
        """Every hidden effect is named or in a stated group."""
        return bool(self.trial.names) and set(self.trial.names) <= set(self.said.stated)

    @property
    def exact(self) -> bool:
        """Just what is hidden is named."""
        return set(self.said.named) == set(self.trial.names) == set(self.said.stated)

    @property
    def wrong(self) -> bool:
        """Something is stated that is not there."""
        return self.said.misnames(self.trial.names)

    @property
    def unknown(self) -> bool:
        """The verdict is ``unknown``."""
        return self.said.verdict == "unknown"

    @property
    def consistent(self) -> bool:
        """The verdict is ``consistent``."""
        return self.said.verdict == "consistent"


@dataclass(frozen=True, slots=True, kw_only=True)
class Share:
    """``hits`` of ``trials``."""

    hits: int
    trials: int

    @classmethod
    def of(cls, outcomes: Iterable[bool]) -> Self:
        """Count what is true."""
        known = list(outcomes)
        return cls(hits=sum(known), trials=len(known))

    @property
    def per_cent(self) -> float:
        """The share in per cent, NaN of no trials."""
        return _POINTS * self.hits / self.trials if self.trials else float("nan")

    def interval(self, confidence: float = 0.95) -> tuple[float, float]:
        """The interval of Clopper and Pearson (1934), in per cent; of no trials, everything."""
        if not self.trials:
            return 0.0, _POINTS
        interval = binomtest(self.hits, self.trials).proportion_ci(confidence, method="exact")
        return _POINTS * float(interval.low), _POINTS * float(interval.high)

    def goal(self, name: str, bar: float, *, at_least: bool) -> Goal:
        """The share as a goal with its bar in per cent."""
        said = f"{name} ({self.hits} of {self.trials})"
        return Goal(
            name=said, value=self.per_cent, bar=bar, at_least=at_least, unit="%", ci95=self.interval()
        )


def judged(scored: Sequence[Scored]) -> list[Scored]:
    """Those that were not excluded."""
    return [one for one in scored if one.answer is not None]


def share(scored: Sequence[Scored], holds: Callable[[Scored], bool]) -> Share:
    """How many of the judged ones hold."""
    return Share.of(holds(one) for one in judged(scored))


def left_by_noise(sigmas: Iterable[float], against: float = 0.0) -> float:
    """How many of two explanations each, so many sigmas apart, noise alone leaves both possible, whoever judges.

    Under noise of one sigma the log odds between them are normal, of mean d^2/2 and variance d^2 (Van Trees, Detection,
    Estimation, and Modulation Theory, 1968, section 2.6), and the right one alone is stated from 95 % on. Beforehand
    such log odds are ``against`` it.

    >>> round(left_by_noise([5.0, 10.0]), 4)
    0.028
    >>> round(left_by_noise([5.0, 10.0], against=math.log(36)), 4)
    0.1162
    """
    d = np.array([sigma for sigma in sigmas if np.isfinite(sigma)])
    return float(np.sum(norm.cdf((_LOG_ODDS + against - 0.5 * d**2) / d)))
