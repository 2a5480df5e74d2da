"""Tied pairs: the diagnosis proposes measurements, the lab carries them out, and the diagnosis is asked again.

What does not stand out in the first table at all (:func:`~experiments.blind.trial.isolability`) ties nothing: such
trials are excluded and counted. A pair is separated where what is hidden is stated and its rival is not; a third cause
may be tied with both still.
Whether any measurements could separate a pair is computed from the truth: of a lattice over the whole design
space, standby and no load, the ten rows that raise the pair's isolability most, one after the other. What the rival
does is what it does in the trial's own lab.
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import groupby
from typing import Any, Self

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.linalg import cholesky, solve_triangular

from drivers.mocks.lab.hidden import HIDDEN
from drivers.mocks.lab.survey import POINT_S, Schedule, schedule, settle, survey
from experiments.blind.answer import Answer
from experiments.blind.draws import tied
from experiments.blind.part import Outcome, Part, Run
from experiments.blind.reach import CHANNELS, Reach, hiding, shift_between, worked_out
from experiments.blind.scoring import Share
from experiments.blind.sight import LEAST_SIGMA, beyond
from experiments.blind.trial import BlindTrial, isolability, laboratory, measured, plain_laboratory, sight_of
from experiments.harness.lab_data import random_set_points
from experiments.harness.result import Table
from models.dataset import load_measurements
from models.diagnosis.diagnose import diagnose
from models.screening import LOADED_KINDS

Array = NDArray[np.float64]
Rows = NDArray[np.intp]

TIED, MOST_ROWS = 120, 10
_LATTICE_SEED, _LATTICE = 17, 120
_COLUMNS = ["kind", "D1", "D2", "P2_W", "P1_W", "efficiency", "time_s", "T_ambient_C"]
_SET_POINT = re.compile(r"D1\s*=\s*([0-9.]+).*?D2\s*=\s*([0-9.]+).*?([0-9.]+)\s*W\b")
_WARMER = re.compile(r"warm the room by ([0-9.]+) K")
_AFTER_S = 3600.0  # the proposed rows are another session


@dataclass(frozen=True, slots=True, kw_only=True)
class Proposal:
    """What a proposed step asks for: a row for the bench, so often and so much warmer, or a missing channel.

    Both are None for what this bench cannot do: swapping leads, another dead time, four wires.
    """

    plan: Schedule | None = None
    repeats: int = 1
    warmer_K: float = 0.0
    channel: str | None = None


def understood(step: Mapping[str, Any]) -> Proposal:
    """A step as a bench would take it.

    >>> understood({"action": "measure P_link1_W too"}).channel
    'P_link1_W'
    >>> understood({"action": "measure D1 = 0.820, D2 = 0.100, 900 W again"}).plan.power_W
    array([900.])
    """
    action, repeats = str(step["action"]), int(step.get("repeats", 1))
    missing = [name for name in CHANNELS[1:] if name in action]
    if missing:
        return Proposal(channel=missing[0])
    words = action.lower().replace("-", "_").replace(" ", "_")
    for kind in ("standby", "no_load"):
        if kind in words:
            one = schedule(np.array([0.8]), np.array([0.0]), np.array([200.0]), standby=1, no_load=1)
            return Proposal(plan=_bare(one, kind), repeats=repeats)
    warmer = _WARMER.search(action)
    found = _SET_POINT.search(action)
    if found is None or not (warmer or action.startswith("measure")):
        return Proposal()
    D1, D2, power_W = (np.array([float(text)]) for text in found.groups())
    plan = _bare(schedule(D1, D2, power_W, standby=0, no_load=0), "load")
    return Proposal(plan=plan, repeats=repeats, warmer_K=float(warmer[1]) if warmer else 0.0)


def _bare(plan: Schedule, kind: str) -> Schedule:
    """Only the rows of one kind."""
    keep = plan.kind == kind
    return Schedule(
        D1=plan.D1[keep], D2=plan.D2[keep], power_W=plan.power_W[keep], kind=plan.kind[keep],
        time_s=np.zeros(int(keep.sum())),
    )  # fmt: skip


@dataclass(slots=True)
class Bench:
    """A lab of which only powers are read, and the rows measured so far."""

    trial: BlindTrial
    table: pd.DataFrame
    added: int = 0

    @classmethod
    def of(cls, trial: BlindTrial) -> "Bench":
        """The first campaign: rows that carry load."""
        table = survey(laboratory(trial), trial.plan, seed=trial.seed)
        loaded = table[table["kind"].isin(LOADED_KINDS)]
        return cls(trial, loaded[_COLUMNS])

    def carry_out(self, steps: Sequence[Proposal]) -> None:
        """Measure their rows, as many as are left to measure: one session, another one where the room is warmer."""
        for warmer_K, same in groupby(steps, key=lambda step: step.warmer_K):
            rows = [step.plan for step in same for _ in range(step.repeats) if step.plan is not None]
            if rows := rows[: MOST_ROWS - self.added]:
                self._session(rows, warmer_K)

    def _session(self, rows: Sequence[Schedule], warmer_K: float) -> None:
        """Measure rows one after the other; the first of them warms the bench up before it counts."""
        lab = laboratory(self.trial)
        lab = replace(lab, quirks=replace(lab.quirks, warmer_K=warmer_K))
        start_s = float(self.table["time_s"].max()) + _AFTER_S
        plan = replace(rows[0], time_s=rows[0].time_s + start_s)
        for row in rows:
            plan = plan.followed_by(row, POINT_S)
        self.added += len(rows)
        more = survey(lab, plan, seed=self.trial.seed + 1_000_000 * self.added)
        counts = more[more["time_s"] > start_s]
        self.table = pd.concat([self.table, counts[_COLUMNS]], ignore_index=True)

    def diagnosed(self) -> dict[str, Any]:
        """The JSON answer to what was measured so far."""
        return diagnose(load_measurements(self.table)).as_plain()


def decided(answer: Answer) -> bool:
    """Whether an answer leaves a bench nothing to separate: it names, and states no group. It need not be right."""
    return answer.verdict == "named" and not answer.groups


def settled(trial: BlindTrial, answer: Answer) -> bool:
    """Whether what is hidden is named alone."""
    return answer.named == trial.names and answer.stated == trial.names


def separated(trial: BlindTrial, answer: Answer) -> bool:
    """Whether what is hidden is stated and its rival is not, whatever third cause may be tied with both."""
    return set(trial.names) <= set(answer.stated) and trial.rival not in answer.stated


def ask_tied(trial: BlindTrial) -> dict[str, Any]:
    """Diagnose, do what it proposes, ten rows at most, and ask again, until it names without a group, right or wrong.

    Which channel is asked for is what the last answer says. A trial that shows nothing is ``excluded``.
    """
    if not _is_seen(trial):
        return {"excluded": True}
    bench = Bench.of(trial)
    plain = bench.diagnosed()
    first = plain["verdict"]
    while not decided(Answer.of(plain, 0.0)) and bench.added < MOST_ROWS:
        feasible = [p for p in map(understood, plain["next"]) if p.plan is not None]
        if not feasible:
            break
        bench.carry_out(feasible)
        plain = bench.diagnosed()
    possible, needed = _possible(trial)
    answer = Answer.of(plain, 0.0)
    channels = {p.channel for p in map(understood, plain["next"]) if p.channel}
    return {
        "excluded": False,
        "first": first,
        "last": plain["verdict"],
        "separated": separated(trial, answer),
        "alone": settled(trial, answer),
        "rows": bench.added,
        "channels": sorted(channels),
        "separable_sigma": possible,
        "needed": needed,
    }


def _is_seen(trial: BlindTrial) -> bool:
    """Whether the first table shows by itself that something is wrong, as the truth has it."""
    return isolability(trial, sight_of(trial, measured(trial))) >= LEAST_SIGMA


@lru_cache(maxsize=4)
def _whole_space(design: int, points: int) -> Schedule:
    """A design followed by everything that could be measured."""
    base = BlindTrial(row="tied", seed=design, points=points).plan
    D1, D2, power_W = random_set_points(_LATTICE, np.random.default_rng([_LATTICE_SEED, 10])).T
    return base.followed_by(schedule(D1, D2, power_W, reference_every=10**9))


def seen_from(trial: BlindTrial) -> tuple[Schedule, ...]:
    """What the truth is asked at."""
    assert trial.design is not None
    return trial.plan, _whole_space(trial.design, trial.points)


def _possible(trial: BlindTrial) -> tuple[float, list[str]]:
    """Isolability from the rival after the ten best rows, and the channels that would separate both at once."""
    assert trial.rival is not None
    _, plan = seen_from(trial)
    known = worked_out(plan)
    shift, *instead = _shifts(trial, plan, trial.rival)
    runs = np.all([np.isfinite(there.reindex(shift.index)) for there in instead], axis=0)
    rows = _Rows.of(known.with_planes({trial.rival: instead}), shift[runs], trial.rival)
    start_s = float(trial.plan.time_s[-1])
    time_s = rows.index.get_level_values(0).to_numpy()
    kind = pd.Series(plan.kind, index=plan.time_s).reindex(time_s).to_numpy()
    channel = rows.index.get_level_values(1).to_numpy()
    first = (time_s <= start_s) & np.isin(kind, LOADED_KINDS)
    chosen = np.flatnonzero(first & (channel == "P1_W"))
    candidates = np.flatnonzero((time_s > start_s) & (channel == "P1_W"))
    sigma = rows.beyond(chosen)
    for _ in range(MOST_ROWS):
        if sigma >= LEAST_SIGMA or not candidates.size:
            break
        each = rows.beyond_with(chosen, candidates)
        best = int(np.argmax(each))
        sigma, chosen = each[best], np.append(chosen, candidates[best])
        candidates = np.delete(candidates, best)
    needed = [
        name
        for name in CHANNELS[1:]
        if rows.beyond(np.flatnonzero(first & np.isin(channel, ("P1_W", name)))) >= LEAST_SIGMA
    ]
    return sigma, needed


@dataclass(frozen=True, slots=True, kw_only=True)
class _Rows:
    """Readings by time and channel: their variances (M,), what is not known of all of them (K, M), and ``columns``
    (M, 3), the shift and the plane of its rival."""

    index: "pd.Index[Any]"
    variance: Array
    nuisance: Array
    columns: Array

    @classmethod
    def of(cls, known: Reach, shift: pd.Series, rival: str) -> Self:
        """Of a shift the readings that an ordinary lab has too."""
        place = known.index.get_indexer(shift.index)
        here = np.flatnonzero(place >= 0)
        place = place[here]
        return cls(
            index=shift.index[here],
            variance=known.sigma[place] ** 2 + known.bent[place] ** 2,
            nuisance=known.unknown(voltages_read=False)[:, place],
            columns=np.column_stack([shift.to_numpy(dtype=float)[here], known.effects[rival][:, place].T]),
        )

    def beyond(self, chosen: Rows) -> float:
        """Sigmas of the shift that the rival cannot imitate, in some of the readings."""
        return _beyond(solve_triangular(self._root(chosen), self.columns[chosen], lower=True))

    def beyond_with(self, chosen: Rows, candidates: Rows) -> list[float]:
        """The same with each of the candidates beside them: a whitened row more."""
        root = self._root(chosen)
        white = solve_triangular(root, self.columns[chosen], lower=True)
        shared = solve_triangular(root, self.nuisance[:, chosen].T @ self.nuisance[:, candidates], lower=True)
        own = self.variance[candidates] + np.sum(self.nuisance[:, candidates] ** 2, axis=0)
        left = np.sqrt(own - np.sum(shared**2, axis=0))
        more = (self.columns[candidates] - shared.T @ white) / left[:, None]
        return [_beyond(np.vstack([white, row])) for row in more]

    def _root(self, chosen: Rows) -> Array:
        nuisance = self.nuisance[:, chosen]
        return np.asarray(cholesky(np.diag(self.variance[chosen]) + nuisance.T @ nuisance, lower=True))


def _beyond(white: Array) -> float:
    """How much of a shift is not in its rival's plane, both whitened, (M, 3)."""
    return float(np.linalg.norm(beyond(white[:, 1:], white[:, :1])))


def _shifts(trial: BlindTrial, plan: Schedule, rival: str) -> list[pd.Series]:
    """What the trial's lab reads beside itself with nothing hidden; and with its rival, at both ends of its range."""
    plain = plain_laboratory(trial)
    labs = (laboratory(trial), *(hiding(plain, {rival: value}) for value in HIDDEN[rival].drawn))
    origin = settle(plain, plan)
    before = survey(plain, plan, seed=trial.seed, settled=origin)
    near = (survey(lab, plan, seed=trial.seed, settled=settle(lab, plan, origin)) for lab in labs)
    return [shift_between(table, before) for table in near]


def right_about_channels(record: Mapping[str, Any]) -> bool:
    """Whether a channel was asked for that separates the pair; or none, where none does by itself."""
    asked, needed = set(record["channels"]), set(record["needed"])
    return bool(asked & needed) or not (asked or needed)


def _tied(run: Run) -> Outcome:
    asked = run.records(tied, TIED, ask_tied, seen_from)
    done = [(trial, record) for trial, record in asked if not record["excluded"]]
    can = [r for _, r in done if r["separable_sigma"] >= LEAST_SIGMA]
    rest = [r for _, r in done if r["separable_sigma"] < LEAST_SIGMA and not r["separated"]]
    goals = (
        Share.of(r["separated"] for r in can).goal(
            "tied: separated by 10 proposed rows at most, of those that can be", 90.0, at_least=True
        ),
        Share.of(right_about_channels(r) for r in rest).goal(
            "tied: of the rest, 'needs channel X' is right", 95.0, at_least=True
        ),
    )
    rows = []
    for pair in dict.fromkeys((t.names[0], t.rival) for t, _ in asked):
        left_out = sum((t.names[0], t.rival) == pair and r["excluded"] for t, r in asked)
        own = [r for t, r in done if (t.names[0], t.rival) == pair]
        able = [r for r in own if r["separable_sigma"] >= LEAST_SIGMA]
        spent = [r["rows"] for r in able if r["separated"]]
        rows.append((
            pair[0], pair[1], len(own), left_out, len(able), sum(r["separated"] for r in able),
            sum(r["alone"] for r in able), sum(r not in able and r["separated"] for r in own),
            float(np.median(spent)) if spent else None, _most_common([r["first"] for r in own]) if own else None,
        ))  # fmt: skip
    columns = (
        "hidden",
        "rival",
        "trials",
        "excluded",
        "can be separated",
        "separated",
        "named alone",
        "of the rest, told apart all the same",
        "rows, median",
        "first verdict",
    )
    return Outcome(goals=goals, tables=(Table(title="Tied pairs", columns=columns, rows=tuple(rows)),))


def _most_common(words: Sequence[str]) -> str:
    return max(set(words), key=words.count)


TIED_PART = Part(name="tied", says="tied pairs with proposed measurements carried out", run=_tied)
