"""Plan ``adaptive``: the next rows of a campaign, chosen from what it has measured.

A choice is a pure function of the accepted rows, the plan so far, the settings and their seed, so that a campaign
which died between choosing and setting chooses the same again. It goes, in this order, by

1. the question between the explanations that the diagnosis has left: rows that tell them apart, best per minute;
2. the optimum: rows on those hills of a load that may be the highest;
3. the surrogate: rows where its efficiency is uncertain near the optimum.

It ends with the budget, or when what is stated is sure, nothing that is left to do here would tell more, and the
optimum is known well enough. What somebody has to come for (another wiring, four wires, a warmer room) is told, never
done.
"""

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import islice
from typing import TYPE_CHECKING, Protocol, Self

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from bench.config import BenchConfig, CampaignConfig
from bench.plan import AMBIENT_C, Box, Kind, PlannedPoint, candidates_of
from bench.plan_config import AdaptiveConfig
from bench.prediction import Asked, FloatArray, Predictor, model_of
from bench.within import Within
from bench.wording import action_text, effect_name, join
from models.screening import LOADED_KINDS
from models.space_filling import farthest

if TYPE_CHECKING:
    from models.diagnosis.diagnose import Diagnosis
    from models.diagnosis.race import NextMeasurement

_WORTH_A_BUDGET = 2.0  # sigmas that all rows left have to tell together, to go on when a verdict is settled
_WORTH_ANYTHING = 0.05  # sigmas that a row has to tell while none is
_MOST_ASKED = 80  # candidates of which every explanation is asked what it expects
_LOADS = 19  # over the range of power, at which the optimum is looked for
_LOADED_MIN, _UNLOADED_MIN = 4.0, 1.5  # bench minutes of a row, before any was measured


@dataclass(frozen=True, slots=True, kw_only=True)
class Choice:
    """Rows to measure next, none when the campaign has enough; what it goes by, line by line, for people.

    ``verdict`` and ``stated`` are the diagnosis of the rows so far, where there is one.
    """

    rows: tuple[PlannedPoint, ...] = ()
    said: tuple[str, ...] = ()
    verdict: str = ""
    stated: tuple[str, ...] = ()


class Chooses(Protocol):
    """Anything that lets a plan grow; it must be pure, and fit to be sent to another process."""

    def __call__(self, table: pd.DataFrame, planned: Sequence[PlannedPoint]) -> Choice:
        """The rows after ``planned``, all of which are done; ``table`` are those accepted."""
        ...


def chooser(campaign: CampaignConfig, bench: BenchConfig, predict: Predictor, *, file: str) -> Chooses | None:
    """Who chooses for this campaign; None for a plan that is known to its end."""
    if campaign.plan.adaptive is None:
        return None
    candidates, _, _ = candidates_of(campaign, bench, predict, file)
    within = Within(predict, bench, campaign.plan)
    return Adaptive(campaign=campaign, bench=bench, candidates=candidates, within=within)


@dataclass(frozen=True, slots=True, kw_only=True)
class Adaptive:
    """Chooses among ``candidates`` (N, 3) of D1, D2 and power in W, and tops of hills that are ``within`` limits."""

    campaign: CampaignConfig
    bench: BenchConfig
    candidates: Box
    within: Predictor

    def __call__(self, table: pd.DataFrame, planned: Sequence[PlannedPoint]) -> Choice:
        """As ``Chooses``."""
        so_far = _SoFar.of(table, planned)
        left = self._left(so_far)
        if left <= 0:
            return Choice(said=(f"enough: the budget of {self._budget()} is used up",))
        allowed = self._not_refused(so_far)
        if not len(allowed):
            return Choice(said=("enough: every candidate was tried and rejected",))
        found = _diagnosed(table, self.bench)
        if isinstance(found, str):
            rows = self._rows(self._lonely(allowed, so_far), left, so_far)
            return Choice(rows=tuple(rows), said=(f"no diagnosis yet: {found}",))
        wanted, said = self._informed(found, allowed, so_far, left)
        return Choice(
            rows=tuple(self._rows(wanted, left, so_far)),
            said=tuple(said),
            verdict=found.verdict.kind,
            stated=found.verdict.stated,
        )

    @property
    def _settings(self) -> AdaptiveConfig:
        return self.campaign.plan.adaptive or AdaptiveConfig()

    def _budget(self) -> str:
        minutes = self._settings.minutes
        return f"{self.campaign.plan.points} rows" + (f" or {minutes:g} minutes" if minutes else "")

    def _left(self, so_far: "_SoFar") -> int:
        """Rows that the budget still has."""
        rows = (self.campaign.plan.points or 0) - len(so_far.planned)
        if self._settings.minutes is None:
            return rows
        return min(rows, int((self._settings.minutes - so_far.minutes) / so_far.loaded_min))

    def _not_refused(self, so_far: "_SoFar") -> Box:
        """Candidates but those whose rows were all rejected."""
        kept = [place for place in map(tuple, self.candidates.tolist()) if place not in so_far.refused]
        return np.array(kept).reshape(-1, 3)

    def _lonely(self, allowed: Box, so_far: "_SoFar") -> Iterator[PlannedPoint]:
        """Points far from all that were measured."""
        known = [(row.D1, row.D2, row.power_W) for row in so_far.planned if row.kind is Kind.LOAD]
        span = np.ptp(self.candidates, axis=0)
        for k in islice(farthest(allowed, np.array(known).reshape(-1, 3), span), self._settings.at_once):
            yield _load(allowed[k], "far from everything measured so far")

    def _informed(
        self, found: "Diagnosis", allowed: Box, so_far: "_SoFar", left: int
    ) -> tuple[Iterator[PlannedPoint], list[str]]:
        """What the diagnosis asks for; where it asks for nothing, what the optimum does, then the surrogate."""
        from models.diagnosis.bench_options import Allowed
        from models.near_optimum import least_known

        verdict, settings = found.verdict, self._settings
        causes = join([effect_name(name) for name in verdict.stated])
        stated = f"verdict so far: {verdict.kind}" + (f", {causes}" if causes else "")
        settled = is_settled(found, settings.probability)
        may = Allowed(
            set_points=allowed[:: -(-len(allowed) // _MOST_ASKED)],
            loaded_min=so_far.loaded_min,
            unloaded_min=so_far.unloaded_min,
            by_hand=False,
            least_sigma=_WORTH_A_BUDGET / left**0.5 if settled else _WORTH_ANYTHING,
            together_sigma=_WORTH_A_BUDGET,
        )
        doable = [step for step in found.steps(may, settings.at_once) if not step.by_hand]
        if doable:
            return (self._step(step) for step in doable for _ in range(step.repeats)), [stated]
        said = [
            stated,
            *(f"for somebody at the bench: {action_text(s.action)}" for s in found.next if s.by_hand),
        ]
        if undecided := self._undecided(found, so_far):
            return iter(undecided), said
        unsure = least_known(found.calibrated, allowed, settings.at_once)
        if unsure.sigma <= settings.optimum and settled:
            known = f"the optimum is known to {100 * unsure.sigma:.3f} points"
            return iter(()), [*said, f"enough: nothing that is left to do here would tell more, and {known}"]
        why = f"efficiency near the optimum is uncertain, up to {100 * unsure.sigma:.3f} points"
        return (_load(allowed[k], why) for k in unsure.chosen), said

    def _undecided(self, found: "Diagnosis", so_far: "_SoFar") -> list[PlannedPoint]:
        """Loads of which nobody knows whether they are carried, else tops of hills that may be the highest of theirs.

        None where what that costs is little.
        """
        from models.rival_hills import RivalHills

        loads_W = np.linspace(*self.campaign.ranges.power_W, _LOADS)
        may = found.calibrated.worth_a_try(loads_W)
        untried = [place for place in may[self._settable(may, so_far)] if _load(place, "") not in so_far]
        if untried:
            why = "may be the most that can be carried, or more: only who measures there knows"
            return [_load(place, why) for place in untried[: self._settings.at_once]]
        rivals = RivalHills.of(found.calibrated, loads_W)
        lost = float(np.max(rivals.lost(), initial=0.0))
        if lost <= self._settings.lost:
            return []
        why = (
            f"another hill may be the highest of its load: {100 * lost:.4f} points lost on average, at worst"
        )
        settable = self._settable(rivals.place, so_far)
        return [_load(rivals.place[k], why) for k in rivals.chosen(self._settings.at_once, settable)]

    def _settable(self, place: Box, so_far: "_SoFar") -> NDArray[np.bool_]:
        """Which set points (K, 3) are in the campaign's ranges and the bench's limits, and were not refused."""
        box = self.campaign.ranges
        low, high = np.array([box.D1, box.D2, box.power_W]).T
        D1, D2, power_W = place.T
        runs = self.within(Asked(D1=D1, D2=D2, power_W=power_W, ambient_C=AMBIENT_C)).feasible
        tried = np.array([row in so_far.refused for row in map(tuple, place.tolist())], dtype=bool)
        return np.asarray(runs & ~tried & np.all((place >= low) & (place <= high), axis=1))

    def _step(self, step: "NextMeasurement") -> PlannedPoint:
        """A step of the diagnosis as a row, with the question that it answers."""
        parts = join([effect_name(name) for name in step.separates]) or "what was stated"
        why = f"tells about {parts}: {step.expected_sigma:.1f} sigma expected of {step.repeats}"
        if step.set_point is not None:
            return _load(step.set_point, why)
        converter = self.bench.converter
        idle = _load((converter.start_D1, converter.start_D2, 0.0), why)
        return replace(idle, kind=Kind(step.action))

    def _rows(self, wanted: Iterator[PlannedPoint], left: int, so_far: "_SoFar") -> Iterator[PlannedPoint]:
        """As many of the wanted rows as may be, numbered, with the reference as often as the plan has it."""
        every, since = self.campaign.plan.reference_every, so_far.since_reference
        numbers, counts = dict(so_far.numbers), dict(so_far.counts)
        for row in islice(
            _with_references(wanted, so_far.reference, every, since), min(left, self._settings.at_once)
        ):
            key = _place(row)
            number = numbers.setdefault(key, len(numbers))
            yield replace(row, point=number, repeat=counts.get(key, 0))
            counts[key] = counts.get(key, 0) + 1


def _with_references(
    wanted: Iterator[PlannedPoint], reference: PlannedPoint | None, every: int, since: int
) -> Iterator[PlannedPoint]:
    for row in wanted:
        if reference is not None and every and since >= every:
            yield replace(reference, why="the reference again: noise, and what drifts")
            since = 0
        yield row
        since += row.kind is Kind.LOAD


def _load(place: Sequence[float], why: str) -> PlannedPoint:
    D1, D2, power_W = map(float, place)
    return PlannedPoint(point=0, repeat=0, kind=Kind.LOAD, D1=D1, D2=D2, power_W=power_W, why=why)


def _place(row: PlannedPoint) -> tuple[Kind, float, float, float]:
    """What tells a point from the others."""
    return row.kind, row.D1, row.D2, row.power_W


@dataclass(frozen=True, slots=True, kw_only=True)
class _SoFar:
    """What a campaign has done: its rows, the minutes that it took and a row of either kind takes, and its points.

    ``refused`` are set points (D1, D2, power) of which no row was accepted.
    """

    planned: Sequence[PlannedPoint]
    minutes: float
    loaded_min: float
    unloaded_min: float
    numbers: dict[tuple[Kind, float, float, float], int]
    counts: dict[tuple[Kind, float, float, float], int]
    refused: frozenset[tuple[float, float, float]]

    @classmethod
    def of(cls, table: pd.DataFrame, planned: Sequence[PlannedPoint]) -> Self:
        """From the accepted rows, and all that were planned until now."""
        accepted = set(table["point"].astype(int)) if len(table) else set()
        tried = [row for row in planned if row.kind is Kind.LOAD]
        spent = _minutes(table)
        loaded = table["kind"].isin(LOADED_KINDS).to_numpy()[1:] if len(table) else np.empty(0, dtype=bool)
        return cls(
            planned=planned,
            minutes=float(spent.sum()),
            loaded_min=_usual(spent[loaded], _LOADED_MIN),
            unloaded_min=_usual(spent[~loaded], _UNLOADED_MIN),
            numbers={_place(row): row.point for row in planned},
            counts=Counter(map(_place, planned)),
            refused=frozenset((r.D1, r.D2, r.power_W) for r in tried if r.point not in accepted),
        )

    def __contains__(self, row: PlannedPoint) -> bool:
        """Whether its point was planned before."""
        return _place(row) in self.numbers

    @property
    def reference(self) -> PlannedPoint | None:
        """The reference point, where the plan has one."""
        return next((row for row in self.planned if row.kind is Kind.REFERENCE), None)

    @property
    def since_reference(self) -> int:
        """Rows with load after the last reference."""
        kinds = [row.kind for row in self.planned]
        last = max((k for k, kind in enumerate(kinds) if kind is Kind.REFERENCE), default=-1)
        return kinds[last + 1 :].count(Kind.LOAD)


def is_settled(found: "Diagnosis", probability: float) -> bool:
    """Whether all that is stated is as probable as asked for; a group is that where more rows do not part it.

    Few rows show nothing that is surely beyond an ordinary bench: what has to be probable is no cause at all.
    """
    verdict = found.verdict
    if verdict.kind == "consistent":
        return verdict.nothing_probability >= probability
    known = {cause.effect: cause.probability for cause in verdict.causes}
    named = all(known[name] >= probability for name in verdict.stated)
    tied = verdict.kind == "group" and not verdict.left_open
    return tied or (verdict.kind == "named" and named)


def _minutes(table: pd.DataFrame) -> FloatArray:
    """From each accepted row to the next one, (N - 1,)."""
    if len(table) < 2:
        return np.empty(0)
    return np.asarray(np.diff(table["time_s"].to_numpy(dtype=np.float64)) / 60.0)


def _usual(minutes: FloatArray, otherwise: float) -> float:
    return float(np.median(minutes)) if minutes.size else otherwise


def _diagnosed(table: pd.DataFrame, bench: BenchConfig) -> "Diagnosis | str":
    """The diagnosis of the accepted rows against the bench's model, or why there is none."""
    from bench.diagnosing import NotDiagnosed, refused_in_words
    from models.dataset import load_measurements  # here: it takes a second to load, and every verb would pay
    from models.diagnosis.diagnose import diagnose

    try:
        with refused_in_words():
            return diagnose(load_measurements(table), model_of(bench.converter))
    except NotDiagnosed as why:
        return str(why)
