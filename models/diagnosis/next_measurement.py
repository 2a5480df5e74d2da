r"""What to measure next: the points and actions that tell the remaining explanations apart, best per minute.

For two explanations i and j that fit what was measured, a reading with noise sigma separates them by
:math:`d_{ij} = |y_i - y_j| / \sigma`, summed in squares over channels. Steps are chosen one after the other: each is
worth :math:`\sum p_i p_j \exp(-D_{ij}^2/2) \, d_{ij}^2 / 2` per minute, with :math:`D_{ij}` what the steps before
it separate already. Where no step can, the channel is named that would.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Self

import numpy as np
from numpy.typing import NDArray

from models.diagnosis.bench_options import Option, Options, SetPoint, bench_options
from models.diagnosis.evidence import Hypothesis
from models.diagnosis.hypotheses import Fit
from models.diagnosis.observations import CHANNELS, Observations
from models.diagnosis.refinery import Refinery
from sim.model import Model

Array = NDArray[np.float64]

MOST_STEPS = 10
SEPARATED = 4.0  # sigmas at which the worse of two explanations keeps less than one part in a thousand
_LEAST = 0.03  # probability from which an explanation takes part
_MOST_RIVALS = 6
_WORTH_DOING = 0.5  # sigmas


@dataclass(frozen=True, slots=True, kw_only=True)
class NextMeasurement:
    """An action, the effects it separates, by how many sigmas, the bench minutes it takes, and its set point.

    Sigmas and minutes are those of all ``repeats`` together.
    """

    action: str
    separates: tuple[str, ...]
    expected_sigma: float
    minutes: float
    set_point: SetPoint | None = None
    repeats: int = 1

    @classmethod
    def of(cls, option: Option, separates: tuple[str, ...], distance2: float) -> Self:
        """A step that takes an option once."""
        return cls(
            action=option.action,
            separates=separates,
            expected_sigma=float(np.sqrt(distance2)),
            minutes=option.minutes,
            set_point=option.set_point,
        )

    def once_more(self) -> Self:
        """The same step with one repeat more."""
        n = self.repeats + 1
        return replace(
            self,
            repeats=n,
            minutes=self.minutes * n / self.repeats,
            expected_sigma=self.expected_sigma * (n / self.repeats) ** 0.5,
        )

    def as_plain(self) -> dict[str, object]:
        """For the JSON answer."""
        at = {} if self.set_point is None else dict(zip(("D1", "D2", "P_W"), self.set_point, strict=True))
        return {
            "action": self.action,
            "separates": list(self.separates),
            "expected_sigma": self.expected_sigma,
            "minutes": self.minutes,
            "repeats": self.repeats,
            **at,
        }


@dataclass(frozen=True, slots=True, kw_only=True)
class Rival:
    """An explanation that is still possible: its effects, probability and the model that it makes."""

    effects: tuple[str, ...]
    probability: float
    model: Model


def rivals_of(hypotheses: Sequence[Hypothesis], refinery: Refinery) -> list[Rival]:
    """The most probable explanations, one for each set of effects, at their own everyday spreads."""
    total: dict[tuple[str, ...], float] = {}
    fits: dict[tuple[str, ...], Fit] = {}
    for h in hypotheses:
        fits.setdefault(h.fit.effects, h.fit)
        total[h.fit.effects] = total.get(h.fit.effects, 0.0) + h.probability
    chosen = sorted(((p, e) for e, p in total.items() if p >= _LEAST), reverse=True)[:_MOST_RIVALS]
    return [
        Rival(effects=e, probability=p, model=refinery.model(fits[e], refinery.spreads(fits[e])))
        for p, e in chosen
    ]


def next_measurements(
    observations: Observations, rivals: Sequence[Rival], most: int = MOST_STEPS
) -> list[NextMeasurement]:
    """The steps to take, in their order, until the rivals are apart; none where one explanation is left."""
    if len(rivals) < 2:
        return []
    present = [c for c in CHANNELS if c in observations.channels]
    options = bench_options(observations, [r.model for r in rivals], present)
    steps, apart = _chosen(options, rivals, most)
    tied = [pair for pair, d2 in apart.items() if d2 < SEPARATED**2]
    return steps + (_missing_channel(observations, [rivals[k] for k in tied[0]]) if tied else [])


def _differ(one: Rival, other: Rival) -> tuple[str, ...]:
    """Effects that one of two explanations has and the other has not."""
    return tuple(sorted(set(one.effects) ^ set(other.effects)))


def _chosen(
    options: Options, rivals: Sequence[Rival], most: int
) -> tuple[list[NextMeasurement], dict[tuple[int, int], float]]:
    """Steps in the order of their worth, and what they separate each pair by, squared."""
    pairs = list(combinations(range(len(rivals)), 2))
    weight = np.array([rivals[i].probability * rivals[j].probability for i, j in pairs])
    d2 = np.stack([np.sum(options.distance2(i, j), axis=-1) for i, j in pairs])
    reached = np.zeros(len(pairs))
    steps: dict[int, NextMeasurement] = {}
    for _ in range(most):
        if not np.any(reached < SEPARATED**2):
            break
        worth = (weight * np.exp(-0.5 * reached)) @ d2 / options.minutes
        best = int(np.argmax(worth))
        first = int(np.argmax(np.where(reached < SEPARATED**2, weight * d2[:, best], -1.0)))
        if d2[first, best] < _WORTH_DOING**2:
            break
        reached = reached + d2[:, best]
        i, j = pairs[first]
        new = NextMeasurement.of(options.what[best], _differ(rivals[i], rivals[j]), d2[first, best])
        steps[best] = steps[best].once_more() if best in steps else new
    return list(steps.values()), dict(zip(pairs, reached.tolist(), strict=True))


def _missing_channel(observations: Observations, two: Sequence[Rival]) -> list[NextMeasurement]:
    """The channel that is not measured and would separate two rivals best, at the point to use it at; or none."""
    absent = [c for c in CHANNELS if c not in observations.channels]
    if not absent:
        return []
    d2 = (options := bench_options(observations, [r.model for r in two], absent)).distance2(0, 1)
    best, channel = (int(k) for k in np.unravel_index(int(np.argmax(d2)), d2.shape))
    if d2[best, channel] < _WORTH_DOING**2:
        return []
    step = NextMeasurement.of(options.what[best], _differ(*two), d2[best, channel])
    needed = (
        f"no point will do with the channels measured: measure {absent[channel].column} too; {step.action}"
    )
    return [replace(step, action=needed)]
