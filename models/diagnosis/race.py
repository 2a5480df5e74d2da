r"""Explanations against each other: what every option of a bench would tell them apart by, and which to take first.

Two explanations i and j that fit what was measured expect other readings y of an option. It separates them by

.. math:: d_{ij}^2 = (y_i - y_j)^T (V + \operatorname{diag}(\sigma^2))^{-1} (y_i - y_j)

with V what the measurements leave open (:mod:`models.diagnosis.left_open`), the mean of what it is under i and under j:
a part's spread or the simulation's own inaccuracy that explains the difference as well is no separation, and a point
that was measured tells less of itself and of its neighbours. Steps are chosen one after the other, each with those
before it taken as measured: worth :math:`\sum p_i p_j \exp(-D_{ij}^2/2) \, d_{ij}^2 / 2` per minute, with
:math:`D_{ij}` what they separate already. Many small steps are worth it where they tell enough together.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Self

import numpy as np
from numpy.typing import NDArray

from models.diagnosis.bench_options import Allowed, Option, Options, SetPoint
from models.diagnosis.hypotheses import Fit
from models.diagnosis.left_open import Ahead, left_open
from models.diagnosis.observations import CHANNELS
from models.diagnosis.refinery import Refinery
from sim.model import Model

Array = NDArray[np.float64]

SEPARATED = 4.0  # sigmas at which the worse of two explanations keeps less than one part in a thousand
NO_FIT = Fit(terms=(), shift=np.empty(0))


@dataclass(frozen=True, slots=True, kw_only=True)
class NextMeasurement:
    """An action, the effects it separates, by how many sigmas, the bench minutes it takes, and its set point.

    Sigmas and minutes are those of all ``repeats`` together. ``by_hand`` is what a campaign cannot do itself.
    """

    action: str
    separates: tuple[str, ...]
    expected_sigma: float
    minutes: float
    set_point: SetPoint | None = None
    repeats: int = 1
    by_hand: bool = False

    @classmethod
    def of(cls, option: Option, separates: tuple[str, ...], distance2: float) -> Self:
        """A step that takes an option once."""
        return cls(
            action=option.action,
            separates=separates,
            expected_sigma=float(np.sqrt(distance2)),
            minutes=option.minutes,
            set_point=option.set_point,
            by_hand=option.by_hand,
        )

    def once_more(self, again: Self) -> Self:
        """The same step with one repeat more, which adds what it tells."""
        return replace(
            self,
            repeats=self.repeats + again.repeats,
            minutes=self.minutes + again.minutes,
            expected_sigma=float(np.hypot(self.expected_sigma, again.expected_sigma)),
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
    """An explanation that is still possible: its effects, probability, the model that it makes, and its fit.

    It is ``stated`` where the verdict states one of its causes as tied.
    """

    effects: tuple[str, ...]
    probability: float
    model: Model
    fit: Fit = NO_FIT
    stated: bool = False


def worth_doing(gains: Sequence[Array], first: Sequence[int], allowed: Allowed) -> int:
    """How many steps to take of those that add so much (squared sigmas of each pair), each chosen for one pair.

    To the last one that is worth it by itself; those behind it, all of them or none.
    """
    alone = [k + 1 for k, pair in enumerate(first) if gains[k][pair] >= allowed.least_sigma**2]
    kept = max(alone, default=0)
    together = [sum(float(gain[pair]) for gain in gains[kept:]) for pair in first[kept:]]
    return len(first) if max(together, default=0.0) >= allowed.together_sigma**2 else kept


@dataclass(slots=True)
class Race:
    """How far each pair of R rivals is apart by what was chosen, and what every option would add.

    ``open_`` (R, N, N) is what is left open of the N = K C readings, ``apart`` (2, pairs, N) how differently a pair
    expects them, as either of its two sees it.
    """

    options: Options
    rivals: Sequence[Rival]
    pairs: NDArray[np.intp]
    open_: Array
    apart: Array

    @classmethod
    def of(cls, options: Options, rivals: Sequence[Rival], refinery: Refinery | None) -> Self:
        """Before anything is chosen."""
        pairs = np.array(list(combinations(range(len(rivals)), 2)), dtype=np.intp)
        size = options.sigma.size
        expected = options.readings.reshape(len(rivals), size).copy()  # what is beside it is added in place
        open_ = np.zeros((len(rivals), size, size))
        if refinery is not None:
            ahead = Ahead(points=options.points, channels=CHANNELS, near=options.near, rows=options.rows)
            found, known = (
                left_open(refinery, ahead, [r.fit for r in rivals]),
                len(options.points) * len(CHANNELS),
            )
            expected[:, :known] += found.beside
            open_[:, :known, :known] = found.covariance
        apart = expected[pairs[:, 0]] - expected[pairs[:, 1]]
        blind = np.isnan(apart).any(axis=0) | np.isnan(np.diagonal(open_, axis1=1, axis2=2)).any(axis=0)
        apart[:, blind] = 0.0
        open_[:, blind] = 0.0
        open_[:, :, blind] = 0.0
        return cls(options, rivals, pairs, open_, np.stack([apart, apart]))

    def among(self, rows: Sequence[int], channels: Sequence[int]) -> Self:
        """The same with some of the options, and some of their channels."""
        grid = np.arange(self.options.sigma.size).reshape(self.options.sigma.shape)
        kept = grid[np.ix_(list(rows), list(channels))].ravel()
        return replace(
            self,
            options=self.options.take(rows, channels),
            open_=self.open_[:, kept[:, None], kept],
            apart=self.apart[:, :, kept],
        )

    def steps(self, most: int, allowed: Allowed) -> tuple[list[NextMeasurement], list[float]]:
        """Steps in the order of their worth, and what they separate each pair by, squared.

        What is behind the last step that is worth doing, by itself or with all that follow it, is left out. What is
        done by hand is done once: it errs the same way again.
        """
        weight, minutes = self.weight(), self.options.minutes
        reached, gains, chosen = np.zeros(len(self.pairs)), list[Array](), list[tuple[int, int]]()
        for _ in range(most):
            unsettled = reached < SEPARATED**2
            if not np.any(unsettled):
                break
            gain = self._gains()
            worth = (weight * np.exp(-0.5 * reached)) @ gain / minutes
            best = int(np.argmax(worth))
            if self.options.what[best].by_hand:
                minutes[best] = np.inf
            chosen.append((best, int(np.argmax(np.where(unsettled, weight * gain[:, best], -1.0)))))
            gains.append(gain[:, best])
            reached = reached + gain[:, best]
            self._take(best)
        kept = worth_doing(gains, [pair for _, pair in chosen], allowed)
        steps, first_for = dict[int, NextMeasurement](), dict[int, int]()
        for (option, pair), gain in zip(chosen[:kept], gains, strict=False):
            said = first_for.setdefault(option, pair)  # a repeat separates what the first measurement does
            new = NextMeasurement.of(self.options.what[option], self._differ(said), float(gain[said]))
            steps[option] = steps[option].once_more(new) if option in steps else new
        return list(steps.values()), np.sum([np.zeros(len(self.pairs)), *gains[:kept]], axis=0).tolist()

    def of_pairs(self, pairs: Sequence[int]) -> Self:
        """The same of some of the pairs."""
        return replace(self, pairs=self.pairs[list(pairs)], apart=self.apart[:, list(pairs)])

    def stated(self, pairs: Sequence[int]) -> list[int]:
        """Those of the pairs of which the verdict states both."""
        return [k for k in pairs if all(self.rivals[r].stated for r in self.pairs[k])]

    def altogether(self, measured: int) -> Array:
        """Squared sigmas between each pair, (pairs,), if all options together had as many rows as were measured."""
        noise2 = self.options.sigma.ravel() ** 2 * len(self.options.what) / measured
        spread = self.open_ + np.diag(noise2)
        total = np.zeros(len(self.pairs))
        for side in (0, 1):
            apart = self.apart[side]
            solved = np.linalg.solve(spread[self.pairs[:, side]], apart[:, :, None])[:, :, 0]
            total += 0.5 * np.sum(apart * solved, axis=1)
        return total

    def weight(self) -> Array:
        """How probable both of a pair are, (pairs,)."""
        return np.array([self.rivals[i].probability * self.rivals[j].probability for i, j in self.pairs])

    def _differ(self, pair: int) -> tuple[str, ...]:
        """Effects that one explanation of a pair has and the other has not."""
        one, other = (self.rivals[k].effects for k in self.pairs[pair])
        return tuple(sorted(set(one) ^ set(other)))

    def _gains(self) -> Array:
        """Squared sigmas that each option adds to each pair, the mean of what its two expect, (pairs, K)."""
        count, channels = self.options.sigma.shape
        grid = np.arange(count * channels).reshape(count, channels)
        spread = self.open_[:, grid[:, :, None], grid[:, None, :]] + self._noise()
        total = np.zeros((len(self.pairs), count))
        for side in (0, 1):
            apart = self.apart[side][:, grid, None]
            solved = np.linalg.solve(spread[self.pairs[:, side]], apart)
            total += 0.5 * np.sum(apart * solved, axis=(2, 3))
        return total

    def _noise(self) -> Array:
        """Variances of each option's readings on the diagonal, (K, C, C)."""
        return np.asarray(self.options.sigma[:, :, None] ** 2 * np.eye(self.options.sigma.shape[1]))

    def _take(self, option: int) -> None:
        """An option was measured: what is left open of all others, and how far the pairs still differ there."""
        channels = self.options.sigma.shape[1]
        block = slice(option * channels, (option + 1) * channels)
        gain = np.stack(
            [o[:, block] @ np.linalg.inv(o[block, block] + self._noise()[option]) for o in self.open_]
        )
        for side in (0, 1):
            known = gain[self.pairs[:, side]] @ self.apart[side][:, block, None]
            self.apart[side] = self.apart[side] - known[:, :, 0]
        self.open_ = self.open_ - gain @ self.open_[:, block]
