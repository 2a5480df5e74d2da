"""One lab, one plan: a whole campaign over the wires, and the diagnosis as the campaign goes on."""

import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import pandas as pd

from bench.adaptive import Choice, Chooses
from bench.campaign import Surroundings, run_campaign
from bench.config import BenchConfig, CampaignConfig, check
from bench.errors import LimitReached
from bench.job import Job
from bench.plan import PlannedPoint
from bench.store import Store
from drivers.clock import StepClock
from drivers.mocks.lab.laboratory import Laboratory
from drivers.mocks.plant import Plant
from drivers.mocks.rack import Rack
from models.dataset import load_measurements
from models.diagnosis.diagnose import diagnose

ADAPTIVE, RANDOM = "adaptive", "random"
START, AT_ONCE, MOST = 10, 5, 62
POWERS = "dc powers only"
ALL = "all channels"
_REFERENCE_EVERY = 6
_KEPT = (
    "point", "repeat", "kind", "time_s", "P_set_W", "D1", "D2", "V1_V", "P1_W", "V2_V", "P2_W", "efficiency",
    "T_ambient_C", "quality", "settled",
)  # fmt: skip


@dataclass(frozen=True, slots=True, kw_only=True)
class Race:
    """What a lab hides, which channels its bench has, and how its points are chosen."""

    hidden: tuple[tuple[str, float], ...]
    seed: int
    channels: str
    plan: str

    @property
    def key(self) -> str:
        """Everything that the outcome depends on."""
        what = " + ".join(f"{name} = {value!r}" for name, value in self.hidden) or "nothing"
        return f"{what}, seed {self.seed}, {self.channels}, {self.plan}"

    @property
    def names(self) -> tuple[str, ...]:
        """The hidden effects."""
        return tuple(name for name, _ in self.hidden)

    def seen(self, table: pd.DataFrame) -> pd.DataFrame:
        """What this bench's channels show of a measurement table."""
        return table if self.channels == ALL else table[[name for name in _KEPT if name in table]]


@dataclass(slots=True)
class _Watched:
    """Chooses with the channels of a race, and notes what was stated when, and how long each choice took."""

    race: Race
    choose: Chooses
    moments: list[dict[str, Any]]

    def __call__(self, table: pd.DataFrame, planned: Sequence[PlannedPoint]) -> Choice:
        began_s = time.process_time()
        choice = self.choose(self.race.seen(table), planned)
        cpu_s = time.process_time() - began_s
        if choice.verdict:
            self.moments.append(_moment(table, choice.verdict, choice.stated, cpu_s))
        return choice


def _moment(table: pd.DataFrame, verdict: str, stated: Sequence[str], cpu_s: float) -> dict[str, Any]:
    minutes = float(table["time_s"].iloc[-1]) / 60.0
    return {
        "rows": len(table),
        "minutes": minutes,
        "verdict": verdict,
        "stated": list(stated),
        "cpu_s": cpu_s,
    }


def run_race(race: Race) -> dict[str, Any]:
    """The verdict at each look, with the rows and bench minutes that it took."""
    clock, moments = StepClock(), list[dict[str, Any]]()
    plant = Plant(Laboratory.draw(seed=race.seed, hidden=dict(race.hidden)), clock=clock, seed=race.seed)
    with tempfile.TemporaryDirectory() as folder, Rack(plant) as rack:
        job = Job.prepare(_campaign(race), check(rack.bench_config(), BenchConfig, file="the mock rack"))
        if job.choose is not None:
            job = replace(job, choose=_Watched(race, job.choose, moments))
        with Store(f"sqlite:///{Path(folder) / 'race.sqlite'}") as store:
            stopped = ""
            try:
                run_campaign(job, store, clock, around=Surroundings(think=_here))
            except (
                LimitReached
            ) as limit:  # a part got hotter than predicted; the bench is off, and its rows count
                stopped = str(limit)
            (campaign,) = store.campaigns()
            table = store.measurement_table(campaign["id"])
    looks = [len(table)] if race.plan == ADAPTIVE else range(_begun(job), len(table) + 1, AT_ONCE)
    moments += [_look(race, table.iloc[:rows]) for rows in looks if rows > _last(moments)]
    return {
        "moments": moments,
        "rows": len(table),
        "minutes": float(table["time_s"].iloc[-1]) / 60.0,
        "stopped": stopped,
    }


def _last(moments: Sequence[dict[str, Any]]) -> int:
    return max((m["rows"] for m in moments), default=0)


def _begun(job: Job) -> int:
    """Rows of a random plan after which the adaptive one would look first."""
    idle = job.campaign.plan.standby + job.campaign.plan.no_load
    return idle + START + 2 + START // _REFERENCE_EVERY


def _look(race: Race, table: pd.DataFrame) -> dict[str, Any]:
    began_s = time.process_time()
    try:
        verdict = diagnose(load_measurements(race.seen(table))).verdict
    except ValueError as error:  # too few usable rows: no verdict is a verdict here
        return _moment(table, f"none: {error}", (), time.process_time() - began_s)
    return _moment(table, verdict.kind, verdict.stated, time.process_time() - began_s)


def _here(work: Callable[[], Choice], meanwhile: Callable[[], None], every_s: float) -> Choice:
    """In this process: the lab's clock stands still meanwhile."""
    return work()


def _campaign(race: Race) -> CampaignConfig:
    plan: dict[str, Any] = {"kind": "latin_hypercube", "points": _random_points()}
    if race.plan == ADAPTIVE:
        plan = {"kind": "adaptive", "points": MOST, "adaptive": {"start": START, "at_once": AT_ONCE}}
    plan |= {"reference_every": _REFERENCE_EVERY}
    return check({"name": race.plan, "seed": race.seed, "plan": plan}, CampaignConfig, file=race.key)


def _random_points() -> int:
    """Points with load that fill the budget together with standby, no load and references."""
    return next(n for n in range(MOST, 0, -1) if 4 + 1 + n + -(-n // _REFERENCE_EVERY) <= MOST)
