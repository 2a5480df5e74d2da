r"""A cause that is not there all the time: one that sets in, or goes away, in the course of a campaign.

A contact that works loose, a fan that stops, a supply that was changed over: before some row the readings agree with
the simulation, behind it they are moved as a cause of the catalogue moves them. Its direction is

.. math:: s_e(\theta)\, [t \ge t_0] \quad \text{or} \quad s_e(\theta)\, [t < t_0]

of any effect e at any moment, beside nothing and beside the explanation that leads. Noise that is fitted to what is
left grows until such a step is within it, so it is looked for in the noise that replicates tell. Where it is decisively
likelier than all that is there all the time, and than any leftover, it becomes a rival among the leftovers, and all is
weighed again. What changes need be no cause: where a sensor, a voltage that nobody read or a leftover on that side is
likelier than the cause with its law open (:mod:`models.diagnosis.change`), that is said in its place. Efficiency alone
is not asked: what sets in is no more there than a gain that wanders.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from models.diagnosis.change import (
    Change,
    Step,
    gains,
    likelier_change,
    sensors_among,
    with_wandering_conditions,
)
from models.diagnosis.hypotheses import Fit
from models.diagnosis.leftover import Leftovers
from models.diagnosis.lone import LEAST_ROWS, lone_variance
from models.diagnosis.observations import Observations
from models.diagnosis.refinery import Refinery
from models.diagnosis.signatures import Signature
from models.diagnosis.whitener import Covariance, Whitener
from sim.effects.catalogue import CATALOGUE

Array = NDArray[np.float64]
Replicated = Callable[[Array], Covariance]

AMPLITUDE = 1.0  # one sigma, in times of what is found at first
_MOMENTS = 8  # that every effect is tried at: the next one is a sixteenth of the rows away at most
_SIMULATED = 3  # effects that are simulated at their values
_TWICE = 2  # times: what is far from a line
_DECISIVE = 10.0  # in log evidence, beyond the odds of so many tries
PLACE = "part of the time"  # a leftover's place


@dataclass(frozen=True, slots=True, kw_only=True)
class Onset:
    """A cause that is there on one side of a moment only, and the ``direction`` (M,) in which it moves readings there.

    Its first parameter is ``value`` in ``unit`` there, ``aside`` on the other side. ``row`` (of the frame) is the first
    one behind the moment, ``after_s`` when that was measured, from the first of all rows on, ``before`` the row in
    front of it; it ``sets_in`` there, or goes away. What changes is the ``change``, where that is likelier: the cause
    only resembles it.
    """

    effect: str
    parameter: str
    unit: str
    value: float
    aside: float
    after_s: float
    before: int
    row: int
    sets_in: bool
    direction: Array
    change: Change | None = None

    @property
    def columns(self) -> Array:
        """All directions (q, M) in which readings may move there."""
        return self.direction[None] if self.change is None else self.change.columns

    def of_a_sensor(self, sensor: Change, best: "_Best", time_s: Array) -> "Onset":
        """That a sensor is off instead, where its own ``best`` step says; at the times of readings (M,)."""
        moment, columns = best.moment, sensor.columns * best.there(time_s)
        return replace(
            self, change=replace(sensor, columns=columns), sets_in=best.sets_in,
            after_s=moment.after_s, before=moment.before, row=moment.row,
        )  # fmt: skip

    def read(self, shift: Array) -> "Onset":
        """The same at the value where it moves readings by a ``shift`` (M,)."""
        if self.change is not None:
            return replace(self, change=self.change.read(shift))
        times = float(shift @ self.direction / (self.direction @ self.direction))
        value = self.aside + times * (self.value - self.aside)
        return replace(self, value=value, direction=times * self.direction)

    def as_plain(self, rows: Sequence[int]) -> dict[str, Any]:
        """For the JSON answer; ``rows`` is which row of the table each of the frame was."""
        moment = {
            "sets_in": self.sets_in,
            "after_s": self.after_s,
            "between_rows": [rows[self.before], rows[self.row]],
        }
        if self.change is not None:
            return moment | {"effect": None, "parameter": None, "check": None} | self.change.as_plain()
        return moment | {
            "effect": self.effect,
            "parameter": {"name": self.parameter, "unit": self.unit, "value": self.value, "off": self.aside},
            "check": CATALOGUE[self.effect].check_at(self.value),
            "place": None,
            "sensor": None,
        }


def is_onset(location: str) -> bool:
    """Whether a leftover's place is a cause that is not there all the time."""
    return location == PLACE


@dataclass(frozen=True, slots=True)
class _Moment:
    """A moment between two rows (of the frame) that follow each other in time, ``after_s`` of the campaign's first."""

    at_s: float
    after_s: float
    before: int
    row: int


def _moments(observations: Observations) -> list[_Moment]:
    """All between rows with readings, with enough rows on either side; none where no time was noted."""
    rows, every_s = np.unique(observations.row), np.asarray(observations.points.time_s)
    time_s = every_s[rows]
    order = rows[np.argsort(time_s, kind="stable")]
    times_s = np.sort(time_s)
    return [
        _Moment(
            at_s=float(times_s[k]),
            after_s=float(times_s[k] - np.min(every_s)),
            before=int(order[k - 1]),
            row=int(order[k]),
        )
        for k in range(LEAST_ROWS, rows.size - LEAST_ROWS + 1)
        if times_s[k] > times_s[k - 1]
    ]


@dataclass(frozen=True, slots=True, kw_only=True)
class _Best:
    """The best step of one effect: its log evidence in all, the moment, on which side, and times its direction.

    ``whole`` is the log evidence of the same all the time.
    """

    log_evidence: float
    whole: float
    moment: _Moment
    sets_in: bool
    times: float

    def there(self, time_s: Array) -> NDArray[np.bool_]:
        """Which readings (M,), at their times, are on its side of the moment."""
        return np.asarray((time_s >= self.moment.at_s) == self.sets_in)

    def step(self, direction: Array, time_s: Array) -> Step:
        """What a direction (M,), one sigma long, does there."""
        there = self.there(time_s)
        return Step(shift=self.times * direction * there, there=there, columns=(direction * there)[None])

    def is_decisive(self, least: float, decisive: float) -> bool:
        """Whether it is decisively likelier than the same all the time, and than all else, which asks the ``least``."""
        return self.log_evidence >= max(least, self.whole + decisive)

    def other_side(self) -> "_Best":
        """The same of what the fit beside it has, whose value is open: the opposite on the other side."""
        return replace(self, sets_in=not self.sets_in, times=-self.times)


@dataclass(frozen=True, slots=True, kw_only=True)
class _Beside:
    """What a fit that is there all the time leaves, (M,), under a covariance with the fit's values and laws open.

    ``pulled`` (M,) is C^-1 of it, ``bare`` its log evidence and prior, but for a constant.
    """

    fit: Fit
    whitener: Whitener
    pulled: Array
    bare: float

    @classmethod
    def of(cls, refinery: Refinery, fit: Fit, covariance: Covariance) -> "_Beside":
        """Beside a fit."""
        left = refinery.residual - fit.shift
        laws = [d.factor * d.vectors for d in refinery.law(fit)]
        values = [t.head.prior * t.slope[None] for t in fit.terms]
        whitener = Whitener.of(covariance.wider(np.concatenate([np.empty((0, left.size)), *laws, *values])))
        pulled = whitener.solve(left)
        bare = refinery.log_prior(fit) - 0.5 * (float(left @ pulled) + whitener.log_determinant)
        return cls(fit=fit, whitener=whitener, pulled=pulled, bare=bare)

    def without_a_step(self, leftovers: Leftovers) -> float:
        """The log evidence of the best that is there all the time: of no leftover, or of the best one."""
        return self.bare + max([0.0, *gains(self.whitener, self.pulled, leftovers)])

    def best_steps(self, directions: Array, time_s: Array, moments: Sequence[_Moment]) -> list[_Best]:
        """Of each direction (E, M), one sigma long, the best moment and side; ``time_s`` (M,) is that of readings."""
        behind = np.array([time_s >= moment.at_s for moment in moments])
        steps = directions[:, None] * behind
        solved = self.whitener.solve(directions.T).T
        whole, whole_pull = np.sum(directions * solved, axis=1), directions @ self.pulled
        after, after_pull = (
            self.whitener.squares(np.concatenate(steps)).reshape(steps.shape[:2]),
            steps @ self.pulled,
        )
        before = whole[:, None] - 2.0 * np.sum(steps * solved[:, None], axis=-1) + after
        told = np.stack([after, before], axis=1)  # behind the moment, in front of it
        pull = np.stack([after_pull, whole_pull[:, None] - after_pull], axis=1)
        gain, in_all = _gain(told, pull), _gain(whole, whole_pull)
        found = []
        for k, best in enumerate(np.argmax(gain.reshape(len(gain), -1), axis=1).tolist()):
            side, moment = divmod(best, len(moments))
            found.append(
                _Best(
                    log_evidence=self.bare + float(gain[k, side, moment]),
                    whole=self.bare + float(in_all[k]),
                    moment=moments[moment],
                    sets_in=side == 0,
                    times=float(pull[k, side, moment] / (1.0 + told[k, side, moment])),
                )
            )
        return found

    def value_beside(self, effect: str, step: Array) -> float:
        """The value of one of the fit's effects where readings are moved by a ``step`` (M,) as well."""
        term = self.fit.term(effect)
        pulled = self.pulled - self.whitener.solve(step)
        return term.value + term.head.prior**2 * float(term.slope @ pulled)


def _gain(told: Array, pull: Array) -> Array:
    """Log evidence gained by directions of one sigma, from their products with themselves and with what is left."""
    return np.asarray(0.5 * (pull**2 / (1.0 + told) - np.log1p(told)))


def find_onset(
    refinery: Refinery, fits: Sequence[Fit], replicated: Replicated, leftovers: Leftovers
) -> Onset | None:
    """The cause that sets in or goes away, where one is decisively likelier than all that is there all the time.

    Beside each of the ``fits``, in a covariance with the noise that replicates tell: ``replicated`` has it beside what
    moves the readings by a shift (M,). The few readings that even the best step leaves far off count for next to
    nothing: they would be the better explained by whatever happens next to them. None with efficiency alone.
    """
    o = refinery.observations
    if o.efficiency_alone or not (moments := _moments(o)):
        return None
    tried = [moments[k] for k in np.unique(np.linspace(0, len(moments) - 1, _MOMENTS).round().astype(int))]
    time_s = np.asarray(o.points.time_s)[o.row]
    effects, sensors = refinery.known.effects, sensors_among(refinery, leftovers)
    slopes = [s.slope * s.entry.headline.prior for s in effects]
    directions = np.stack([*slopes, *(each.columns[0] for each in sensors)])
    decisive = _DECISIVE + math.log(2.0 * len(moments) * len(directions))

    def asked(replicated: Replicated) -> tuple[list[_Beside], _Beside, list[_Best], float]:
        beside = [_Beside.of(refinery, fit, replicated(fit.shift)) for fit in fits]
        steps = [(each, each.best_steps(directions, time_s, tried)) for each in beside]
        here, straight = max(steps, key=lambda pair: max(step.log_evidence for step in pair[1]))
        return beside, here, straight, max(step.log_evidence for step in straight)

    beside, here, straight, largest = asked(replicated)
    if largest < max(each.bare for each in beside) + decisive:  # as most are: nothing else need be asked
        return None
    likeliest = max(range(len(straight)), key=lambda k: straight[k].log_evidence)
    plain = straight[likeliest].step(directions[likeliest], time_s)
    lone = _left_alone(refinery, here.fit, plain, replicated)
    if np.any(lone):
        replicated = _noisier(replicated, lone)
        beside, here, straight, largest = asked(replicated)
    always = with_wandering_conditions(refinery, leftovers)
    least = max(each.without_a_step(always) for each in beside) + decisive
    if largest < least:
        return None
    order = sorted(range(len(effects)), key=lambda k: -straight[k].log_evidence)[:_SIMULATED]
    found = [_Tried.on_its_line(here, effects[k], straight[k]) for k in order]
    for _ in range(_TWICE):
        found = _simulated(refinery, here, found, moments)
    first = max(found, key=lambda each: each.best.log_evidence)
    onset, best, step = first.onset(here, time_s), first.best, first.step(refinery, time_s)
    for sensor, own in _best_sensor(
        here, list(zip(sensors, straight[len(effects) :], strict=True)), time_s, moments
    ):
        if own.log_evidence > best.log_evidence:
            onset, best = onset.of_a_sensor(sensor, own, time_s), own
            step = own.step(sensor.columns[0], time_s)
    if not best.is_decisive(least, decisive):
        return None
    doubted = _Beside.of(refinery, here.fit, replicated(here.fit.shift + step.shift))
    left = refinery.residual - here.fit.shift
    likelier = likelier_change(refinery, left, step, doubted.whitener, leftovers)
    return replace(onset, change=likelier or onset.change)


def _noisier(replicated: Replicated, variance: Array) -> Replicated:
    return lambda shift: replicated(shift).noisier(variance)


def _left_alone(refinery: Refinery, fit: Fit, step: Step, replicated: Replicated) -> Array:
    """The variance (M,) of readings that stand alone beside a fit with a step on it."""
    beside = _Beside.of(refinery, fit, replicated(fit.shift + step.shift).wider(step.columns))
    return lone_variance(beside.whitener, refinery.residual - fit.shift, refinery.observations.row)


def _best_sensor(
    here: _Beside, sensors: Sequence[tuple[Change, _Best]], time_s: Array, moments: Sequence[_Moment]
) -> list[tuple[Change, _Best]]:
    """The sensor that is likeliest to be off on one side of the moments tried so far, at the best of all moments.

    None without any.
    """
    if not sensors:
        return []
    likeliest, _ = max(sensors, key=lambda each: each[1].log_evidence)
    (best,) = here.best_steps(likeliest.columns, time_s, moments)
    return [(likeliest, best)]


@dataclass(frozen=True, slots=True, kw_only=True)
class _Tried:
    """An effect at a ``value`` on one side of a moment, at another ``aside``, and the ``best`` step of that size.

    ``direction`` (M,) is what the value moves all rows by; ``is_known``, where the fit beside it has the effect too.
    """

    signature: Signature
    aside: float
    value: float
    is_known: bool
    best: _Best
    direction: Array

    @classmethod
    def on_its_line(cls, here: _Beside, signature: Signature, best: _Best) -> "_Tried":
        """An effect at the end of one sigma of its prior, along its slope."""
        head, is_known = signature.entry.headline, signature.effect in here.fit.effects
        aside = here.fit.term(signature.effect).value if is_known else head.off
        return cls(
            signature=signature, aside=aside, value=aside + head.prior, is_known=is_known, best=best,
            direction=signature.slope * head.prior,
        ).with_more_there()  # fmt: skip

    def with_more_there(self) -> "_Tried":
        """On the side where there is more of the effect: what sets in, where it can be told so, does not go away."""
        further = (
            self.best.times * (self.value - self.aside) * (self.aside - self.signature.entry.headline.off)
        )
        return replace(self, best=self.best.other_side()) if self.is_known and further < 0.0 else self

    def moved(self) -> "_Tried":
        """At the value that its best step says, inside the bounds."""
        head = self.signature.entry.headline
        value = self.aside + self.best.times * (self.value - self.aside)
        return replace(self, value=float(np.clip(value, head.lower, head.upper)))

    def seen(self, direction: Array, best: _Best) -> "_Tried":
        """With what the simulator says that its value does."""
        return replace(self, direction=direction, best=best).with_more_there()

    def step(self, refinery: Refinery, time_s: Array) -> Step:
        """What it does on its side of the moment, at the times of readings (M,), with its law open."""
        there, distance = self.best.there(time_s), self.value - self.aside
        return Step.of_a_cause(refinery, self.signature, distance, self.direction * there, there)

    def onset(self, here: _Beside, time_s: Array) -> Onset:
        """All of it, at the times of readings (M,); what the fit beside it has of the effect is fitted again."""
        head, moment = self.signature.entry.headline, self.best.moment
        there, aside = self.direction * self.best.there(time_s), self.aside
        if self.is_known:
            aside = here.value_beside(self.signature.effect, self.best.times * there)
        return Onset(
            effect=self.signature.effect, parameter=head.name, unit=head.unit, value=aside + self.value - self.aside,
            aside=aside, after_s=moment.after_s, before=moment.before, row=moment.row, sets_in=self.best.sets_in,
            direction=there,
        )  # fmt: skip


def _simulated(
    refinery: Refinery, here: _Beside, tried: Sequence[_Tried], moments: Sequence[_Moment]
) -> list[_Tried]:
    """Each at the value that its step so far says, simulated, at the best of all moments."""
    o, moved = refinery.observations, [each.moved() for each in tried]
    base = refinery.model(here.fit, np.zeros(len(refinery.known.modes.spreads)))
    models = [base.with_effect(t.signature.effect, **t.signature.values(t.value)) for t in moved]
    (plain, _), *solved = o.solved([base, *models], refinery.near)
    directions = np.nan_to_num(np.stack([there - plain for there, _ in solved]))
    bests = here.best_steps(directions, np.asarray(o.points.time_s)[o.row], moments)
    return [t.seen(direction, best) for t, direction, best in zip(moved, directions, bests, strict=True)]
