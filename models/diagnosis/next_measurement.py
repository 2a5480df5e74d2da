r"""What to measure next: the points and actions that tell the remaining explanations apart, best per minute.

Two explanations i and j that fit what was measured expect other readings y of an option. It separates them by

.. math:: d_{ij}^2 = (y_i - y_j)^T (V + \operatorname{diag}(\sigma^2))^{-1} (y_i - y_j)

with V what the measurements leave open (:mod:`models.diagnosis.left_open`), the mean of what it is under i and under j:
a part's spread or the simulation's own inaccuracy that explains the difference as well is no separation, and a point
that was measured tells less of itself and of its neighbours. Steps are chosen one after the other, each with those
before it taken as measured: worth :math:`\sum p_i p_j \exp(-D_{ij}^2/2) \, d_{ij}^2 / 2` per minute, with
:math:`D_{ij}` what they separate already. Many small steps are worth it where they tell enough together. Where all
of them leave a pair tied, it is said what they tell at most, and which channel would do, in as many rows or in as
many as were measured: the cheapest that separates all such pairs, or the one that tells most, if that is a sigma. What
the verdict states as tied comes first, however improbable one of it is.
"""

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Self

import numpy as np
from numpy.typing import NDArray

from models.diagnosis.bench_options import (
    ANYTHING,
    UNLOADED,
    Again,
    Allowed,
    Option,
    Options,
    SetPoint,
    bench_options,
    usual_sigma,
    with_room,
)
from models.diagnosis.evidence import Hypothesis
from models.diagnosis.hypotheses import Fit
from models.diagnosis.left_open import Ahead, left_open
from models.diagnosis.measured_again import telling_rows
from models.diagnosis.observations import CHANNELS, Observations
from models.diagnosis.refinery import Refinery
from sim.model import Model

Array = NDArray[np.float64]

MOST_STEPS = 10
SEPARATED = 4.0  # sigmas at which the worse of two explanations keeps less than one part in a thousand
_SAID = 0.1  # sigmas
_WORTH_A_CHANNEL = 1.0  # sigmas that it tells of some pair
_HOWEVER_LITTLE = Allowed(least_sigma=0.0)
NO_FIT = Fit(terms=(), shift=np.empty(0))
_LEAST = 0.03  # probability from which an explanation takes part
_MOST_RIVALS = 6
# Assumption: the controller has D0, a temperature needs a sensor, a current a probe, an ac power an analyzer's element.
_CHEAPEST_FIRST = (
    "D0", "T_heatsink_C", "T_transformer_C", "T_inductor_C", "I_L_rms_A", "P_link1_W", "P_link2_W",
)  # fmt: skip
_MANY = 60  # measured points that lie as close as a grid over their ranges would
_LOOKED_AT = 40  # of them: those that tell most if they were measured again


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


def rivals_of(
    hypotheses: Sequence[Hypothesis], refinery: Refinery, tied: Collection[str] = ()
) -> list[Rival]:
    """The most probable explanations, one for each set of effects, at their own everyday spreads.

    Of causes that are stated as ``tied`` the best explanation by each is one, improbable as it may be.
    """
    total: dict[tuple[str, ...], float] = {}
    fits: dict[tuple[str, ...], Fit] = {}
    for h in hypotheses:
        fits.setdefault(h.fit.effects, h.fit)
        total[h.fit.effects] = total.get(h.fit.effects, 0.0) + h.probability
    ranked = sorted(((p, e) for e, p in total.items()), reverse=True)
    stated = {next(e for _, e in ranked if name in e) for name in tied}
    others = [e for p, e in ranked if p >= _LEAST and e not in stated]
    taking_part = stated | set(others[: max(_MOST_RIVALS - len(stated), 0)])
    chosen = [(p, e) for p, e in ranked if e in taking_part]
    return [
        Rival(
            effects=e,
            probability=p,
            model=refinery.model(fits[e], refinery.spreads(fits[e])),
            fit=fits[e],
            stated=e in stated,
        )
        for p, e in chosen
    ]


def next_measurements(
    observations: Observations,
    rivals: Sequence[Rival],
    *,
    refinery: Refinery | None = None,
    most: int = MOST_STEPS,
    allowed: Allowed = ANYTHING,
) -> list[NextMeasurement]:
    """The allowed steps to take, in their order, until the rivals are apart; none where one explanation is left.

    First what is best per minute. Where some of it is done by hand, behind it what set points alone can tell; where
    they leave a pair tied, the channel that is missing. The ``refinery`` knows what the measurements leave open;
    without one every rival is taken at its word.
    """
    if len(rivals) < 2:
        return []
    again, like = None, None if refinery is None else refinery.baseline
    if refinery is not None and allowed.set_points is None:
        again = _again(refinery, rivals)
    options = bench_options(observations, [r.model for r in rivals], CHANNELS, allowed, again, like)
    if refinery is not None:
        options = options.noisier(_noisier_than_usual(refinery))
    everything = _Race.of(options, rivals, refinery)
    present = [k for k, c in enumerate(CHANNELS) if c in observations.channels]
    steps, reached = everything.among(range(len(options.what)), present).steps(most, allowed)
    alone = [k for k, option in enumerate(options.what) if not option.by_hand]
    if any(step.by_hand for step in steps):
        others, reached = everything.among(alone, present).steps(most, allowed)
        steps += [step for step in others if step.action not in {s.action for s in steps}]
    absent = [c.column for c in CHANNELS if c not in observations.channels]
    tied = [k for k, d2 in enumerate(reached) if d2 < SEPARATED**2]
    if tied and absent:
        # with other channels a diagnosis keeps further from the most that can be carried
        room = with_room(replace(observations, channels=CHANNELS), [r.model for r in rivals], options.points)
        rows = [k for k in alone if room[k]]
        measured = np.unique(observations.row).size
        for pairs in (everything.stated(tied), tied):
            told = float(np.sqrt(min((reached[k] for k in pairs), default=0.0)))
            if asked := everything.of_pairs(pairs).missing(rows, absent, most, measured, told):
                return steps + asked
    return steps


def _noisier_than_usual(refinery: Refinery) -> Array:
    """How many times the usual noise a reading of each of all channels has on this bench; 1 at least, and unread."""
    o, times = refinery.observations, np.ones(len(CHANNELS))
    converter = refinery.baseline.converter
    usual = usual_sigma(CHANNELS, np.asarray(o.points.power_W)[o.row], converter)
    for k, channel in enumerate(CHANNELS):
        loaded = o.of(channel.name) & o.loaded[o.row]
        if np.any(loaded):
            times[k] = max(float(np.median(refinery.noise[loaded] / usual[loaded, k])), 1.0)
    return times


def asks_again(refinery: Refinery) -> bool:
    """Whether measured rows are asked for again: there are enough of them and nothing has to be simulated anew."""
    kind = _measured_kinds(refinery)
    return refinery.near is not None and int(np.sum(kind == "load")) >= _MANY and set(UNLOADED) <= set(kind)


def _measured_kinds(refinery: Refinery) -> NDArray[np.str_]:
    """Of the rows with readings."""
    o = refinery.observations
    return np.asarray(o.frame["kind"].to_numpy()[np.unique(o.row)])


def _again(refinery: Refinery, rivals: Sequence[Rival]) -> Again | None:
    """The measured rows that tell most, where they are asked for again."""
    if refinery.near is None or not asks_again(refinery):
        return None
    among = np.unique(refinery.observations.row)[_measured_kinds(refinery) == "load"]
    rows = telling_rows(refinery, [(r.fit, r.probability) for r in rivals], among)
    return Again(rows=rows[:_LOOKED_AT], near=refinery.near)


def worth_doing(gains: Sequence[Array], first: Sequence[int], allowed: Allowed) -> int:
    """How many steps to take of those that add so much (squared sigmas of each pair), each chosen for one pair.

    To the last one that is worth it by itself; those behind it, all of them or none.
    """
    alone = [k + 1 for k, pair in enumerate(first) if gains[k][pair] >= allowed.least_sigma**2]
    kept = max(alone, default=0)
    together = [sum(float(gain[pair]) for gain in gains[kept:]) for pair in first[kept:]]
    return len(first) if max(together, default=0.0) >= allowed.together_sigma**2 else kept


@dataclass(slots=True)
class _Race:
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
        expected, open_ = options.readings.reshape(len(rivals), size), np.zeros((len(rivals), size, size))
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
        weight, minutes = self._weight(), self.options.minutes
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

    def missing(
        self, rows: Sequence[int], columns: Sequence[str], most: int, measured: int, told: float
    ) -> list[NextMeasurement]:
        """The channel of these columns that the pairs need, and where to begin with it; or none that tells a sigma.

        It is judged by what it tells in the best rows, ``most`` of them, or if as many as were ``measured`` had it.
        Rows of the channels that there are have ``told`` so many sigmas of the worst pair.
        """
        if not len(self.pairs):
            return []
        weight, found = self._weight(), list[tuple[float, str, NextMeasurement]]()
        for column in (c for c in _CHEAPEST_FIRST if c in columns):
            place = next(k for k, channel in enumerate(CHANNELS) if channel.column == column)
            alone = self.among(rows, [place])
            steps, reached = alone.steps(most, _HOWEVER_LITTLE)
            apart = np.maximum(reached, alone._altogether(measured))
            if np.max(apart) >= _WORTH_A_CHANNEL**2:
                found.append((float(weight @ np.minimum(apart, SEPARATED**2)), column, steps[0]))
        if not found:
            return []
        _, column, step = max(found, key=lambda each: each[0])  # the first of several that separate all
        so_far = f", {told:.1f} sigma at most" if told > _SAID else ""
        action = f"no point will do with the channels measured{so_far}: measure {column} too; {step.action}"
        return [replace(step, action=action, by_hand=True)]

    def _altogether(self, measured: int) -> Array:
        """Squared sigmas between each pair, (pairs,), if all options together had as many rows as were measured."""
        noise2 = self.options.sigma.ravel() ** 2 * len(self.options.what) / measured
        spread = self.open_ + np.diag(noise2)
        total = np.zeros(len(self.pairs))
        for side in (0, 1):
            apart = self.apart[side]
            solved = np.linalg.solve(spread[self.pairs[:, side]], apart[:, :, None])[:, :, 0]
            total += 0.5 * np.sum(apart * solved, axis=1)
        return total

    def _weight(self) -> Array:
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
