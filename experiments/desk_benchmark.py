"""The operator's desk: how fast a model follows the measurements, and what looking costs.

Retraining on 1000 measured points of a virtual lab and the 12,500-point grid: both stages, the judging on held-out
blocks, the optimum over 19 loads, and the table checked between its rows.

The dashboard, in a process of its own: the first page in a browser, how long after a row is stored a viewer is told
of it (with a campaign of 10,000 rows, too), and what eight viewers cost a campaign that runs as fast as it can, in
processor time of its process and in wall time. Viewers load the page and keep its live connection, but draw nothing:
eight browsers on the bench's own computer would compete with it for its cores.

Seconds depend on the machine, and on what else it does; wall times say the latter, processor times do not.
"""

import os
import shutil
import statistics
import time
from collections.abc import Mapping
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from datetime import UTC, datetime
from multiprocessing import get_context
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from numpy.typing import NDArray

from bench.campaign import run_campaign
from bench.config import BenchConfig, CampaignConfig, check
from bench.job import Job
from bench.optimum import BestModulation, loads_of
from bench.plan import Kind, PlannedPoint
from bench.process import Owner
from bench.retrain import Retrainer, said_of
from bench.states import PointState, State
from bench.store import Provenance, Store, StoredReading
from bench.training_data import TrainingData
from drivers.clock import StepClock
from drivers.mocks.lab.laboratory import Laboratory
from drivers.mocks.plant import Plant
from drivers.mocks.rack import Rack
from experiments.harness.lab_data import measured_table
from experiments.harness.registry import Experiment
from experiments.harness.result import Cell, Goal, Result, Table
from experiments.harness.settings import Countdown, Settings
from experiments.harness.timing import Cost, timed
from experiments.harness.viewers import dashboard, watching
from models.dataset import load_measurements
from models.registry import Registry
from models.surrogate import train_d2ea
from sim.model import Model

Array = NDArray[np.float64]

SEED = 31_000
MEASURED, LONG, FOLLOWED, VIEWERS = 1000, 10_000, 30, 8
CAMPAIGN_ROWS, ROUNDS = 24, 11
RETRAIN_BAR_S, PAGE_BAR_S, POINT_BAR_S, COST_BAR_PERCENT = 5.0, 2.0, 1.0, 2.0
BENCH = "benchmark bench"
# where there is one: ten thousand rows are fifty thousand commits, each waiting for a disk
MEMORY = Path("/dev/shm")


def run(settings: Settings) -> Result:
    """All of it; ``scale`` thins measured rows, the long campaign and the rounds."""
    countdown = Countdown(4, settings)
    settings.out.mkdir(parents=True, exist_ok=True)
    with TemporaryDirectory(dir=MEMORY if MEMORY.is_dir() else settings.out) as name:
        folder = Path(name)
        retraining, retrain_goal = _retraining(settings, folder)
        countdown.finished("retraining")
        short = _followed(folder, settings.thinned(40))
        countdown.finished("a short campaign followed")
        long = _followed(folder, settings.thinned(LONG))
        countdown.finished("a long campaign followed")
        cost, cost_goals = _cost(settings, folder)
        countdown.finished("what viewers cost")
    rows = tuple(_row(followed) for followed in (short, long))
    columns = ("rows", "page in a browser (s)", "told, median (s)", "told, slowest (s)", "sent per row (kB)")
    return Result(
        virtual=True,
        goals=(retrain_goal, *_follow_goals(short, long), *cost_goals),
        tables=(retraining, Table(title="A campaign followed", columns=columns, rows=rows), cost),
        notes=(f"{os.cpu_count()} cores; load average at the end {os.getloadavg()[0]:.1f}",),
    )


# --- retraining -------------------------------------------------------------------------------------------


def _retraining(settings: Settings, folder: Path) -> tuple[Table, Goal]:
    lab = Laboratory.draw(seed=SEED, hidden={"link_resistance": None})
    table = measured_table(lab, settings.thinned(MEASURED), seed=SEED)
    data = TrainingData.of_file(Path("lab.csv"), load_measurements(table))
    simulator = Model.baseline()
    retrainer = Retrainer(registry=Registry(folder / "models"), simulator=simulator, now=_now)
    simulated, simulation = timed(lambda: retrainer.simulated)
    done, retraining = timed(lambda: retrainer.retrain(data))
    model, stages = timed(lambda: train_d2ea(simulated, data.rows))
    search = BestModulation(simulator=simulator, loads_W=loads_of(simulator))
    _, optimum = timed(lambda: search.table(model, search.exactly(model)))
    said = said_of(done.decision) if done.decision else done.said
    steps: tuple[tuple[str, Cost, str], ...] = (
        ("the grid, simulated once", simulation, f"{len(simulated)} of 12500 feasible"),
        ("D²EA, both stages", stages, f"{len(data)} measured rows"),
        ("its optimum over 19 loads, and the table", optimum, "feasibility asked anew"),
        ("a whole retraining: three kinds, judged, table if promoted", retraining, said),
    )
    rows = tuple((step, cost.wall_s, cost.cpu_s, what) for step, cost, what in steps)
    columns = ("step", "wall (s)", "processor (s)", "what")
    goal = Goal(
        name="retraining, both stages and the optimum",
        value=stages.wall_s + optimum.wall_s,
        bar=RETRAIN_BAR_S,
        at_least=False,
        unit="s",
    )
    return Table(title="Retraining", columns=columns, rows=rows), goal


def _now() -> str:
    return datetime.now(UTC).isoformat()


# --- a campaign followed ----------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True, kw_only=True)
class _Followed:
    """A campaign of so many ``rows`` and its viewers; ``page_s`` is NaN without a browser."""

    rows: int
    page_s: float
    told_s: tuple[float, ...]
    sent_kB: float


def _row(followed: _Followed) -> tuple[Cell, ...]:
    told = followed.told_s
    return followed.rows, followed.page_s, statistics.median(told), max(told), followed.sent_kB


def _follow_goals(*all_of_them: _Followed) -> tuple[Goal, ...]:
    goals = []
    for one in all_of_them:
        goals.append(_at_most(f"first page, {one.rows} rows", one.page_s, PAGE_BAR_S))
        goals.append(_at_most(f"new point told, {one.rows} rows", max(one.told_s), POINT_BAR_S))
    return tuple(goals)


def _at_most(name: str, value: float, bar: float, unit: str = "s") -> Goal:
    return Goal(name=name, value=value, bar=bar, at_least=False, unit=unit)


def _followed(folder: Path, rows: int) -> _Followed:
    """Write ``rows`` rows, then look while some more are written."""
    url = f"sqlite:///{folder}/followed-{rows}.sqlite"
    with Store(url) as store:
        writer = _Writer.begin(store, rows + FOLLOWED)
        writer.write(rows)
        with dashboard(url) as address:
            page_s = _first_page(address)
            with watching(address, VIEWERS) as viewers:
                written = {}
                before = [viewer.received for viewer in viewers]
                for _ in range(FOLLOWED):
                    written[writer.write(1)] = time.perf_counter()
                    time.sleep(0.4)
                time.sleep(POINT_BAR_S)  # who has not been told by then has missed the bar
                told_s = tuple(late for viewer in viewers for late in told_after(viewer.seen, written))
                sent = [viewer.received - start for viewer, start in zip(viewers, before, strict=True)]
    return _Followed(rows=rows, page_s=page_s, told_s=told_s, sent_kB=statistics.mean(sent) / FOLLOWED / 1e3)


def told_after(seen: Mapping[int, float], written: Mapping[int, float]) -> tuple[float, ...]:
    """Seconds from each row's writing until a viewer was told of so many rows or more; infinite where it never was.

    Both map a number of rows to a time. A look may skip a number: whoever is told of ten rows is told of the ninth.

    >>> told_after({9: 1.5, 11: 2.25}, {9: 1.0, 10: 1.5, 12: 2.0})
    (0.5, 0.75, inf)
    """
    return tuple(
        min((when for rows, when in seen.items() if rows >= done), default=float("inf")) - at
        for done, at in written.items()
    )


@dataclass(slots=True)
class _Writer:
    """Writes a campaign's rows as a run does, without a bench."""

    store: Store
    campaign: int
    ids: list[int]
    plan: list[PlannedPoint]
    done: int = 0

    @classmethod
    def begin(cls, store: Store, rows: int) -> "_Writer":
        rng = np.random.default_rng(SEED)
        D1, D2, P_W = rng.uniform(0.3, 1, rows), rng.uniform(0, 0.6, rows), rng.uniform(200, 2000, rows)
        plan = [
            PlannedPoint(point=k, repeat=0, kind=Kind.LOAD, D1=D1[k], D2=D2[k], power_W=P_W[k])
            for k in range(rows)
        ]
        provenance = Provenance(config={}, config_hash="0", virtual=True, bench=BENCH)
        campaign = store.create_campaign("followed", provenance, plan)
        store.benches.take(BENCH, virtual=True, campaign_id=campaign, owner=Owner.here())
        store.move(campaign, State.PLANNED, State.CHECKING, time_s=0.0)
        ids = [row["id"] for row in store.planned(campaign)]
        store.predict(campaign, {id: {"efficiency": 0.98} for id in ids}, time_s=0.0)
        store.move(campaign, State.CHECKING, State.RUNNING, time_s=0.0)
        return cls(store, campaign, ids, plan)

    def write(self, rows: int) -> int:
        """So many rows more, each with all its steps; returns how many there are."""
        for _ in range(rows):
            row, id = self.plan[self.done], self.ids[self.done]
            for state in (PointState.SET, PointState.SETTLED):
                self.store.advance(self.campaign, id, state, time_s=0.0)
            told = {
                "D1": row.D1,
                "D2": row.D2,
                "P_set_W": row.power_W,
                "P2_W": row.power_W,
                "efficiency": 0.97,
            }
            reading = StoredReading(numbers=told | {"time_s": 0.0}, settled=True, quality="good")
            self.store.add_reading(self.campaign, id, reading)
            self.store.advance(self.campaign, id, PointState.ACCEPTED, time_s=0.0)
            self.done += 1
        return self.done


def _first_page(address: str) -> float:
    """Seconds until a browser shows bench and progress: the slowest of three visits, the first one without scripts."""
    chromium = shutil.which("chromium")
    if chromium is None:
        return float("nan")
    from playwright.sync_api import sync_playwright  # here: it is a development dependency

    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=chromium, args=["--no-sandbox"])
        page = browser.new_page()
        seconds = []
        for _ in range(3):
            start_s = time.perf_counter()
            page.goto(address)
            page.wait_for_selector(".progress", timeout=60_000)
            seconds.append(time.perf_counter() - start_s)
        browser.close()
    return max(seconds)


# --- what viewers cost ------------------------------------------------------------------------------------


def _cost(settings: Settings, folder: Path) -> tuple[Table, tuple[Goal, ...]]:
    """Campaigns with and without viewers side by side, in turns of who is first; the median ratio of the pairs."""
    rounds = settings.thinned(ROUNDS)
    runs: dict[int, list[tuple[float, float]]] = {0: [], VIEWERS: []}
    workers = ProcessPoolExecutor(max_workers=1, mp_context=get_context("spawn"))
    with workers:
        workers.submit(_campaign, f"sqlite:///{folder}/warm.sqlite", 4).result()  # imports and caches
        for number in range(rounds):
            for viewers in (0, VIEWERS) if number % 2 else (VIEWERS, 0):
                url = f"sqlite:///{folder}/cost-{number}-{viewers}.sqlite"
                with Store(url), dashboard(url) as address, watching(address, viewers):
                    runs[viewers].append(workers.submit(_campaign, url, CAMPAIGN_ROWS).result())
    without, beside = np.array(runs[0]), np.array(runs[VIEWERS])
    more = beside / without - 1
    low, high = _median_between(more)
    rows: list[tuple[Cell, ...]] = [
        (k, *np.median(found, axis=0).tolist()) for k, found in ((0, without), (VIEWERS, beside))
    ]
    names = ("campaign's wall time, eight viewers", "campaign's processor time, eight viewers")
    goals = tuple(
        cost_of_viewers(*numbers) for numbers in zip(names, np.median(more, axis=0), low, high, strict=True)
    )
    columns = ("viewers", "wall (s)", "processor (s)")
    return Table(
        title=f"A campaign of {CAMPAIGN_ROWS} points, {rounds} pairs", columns=columns, rows=tuple(rows)
    ), goals


def cost_of_viewers(name: str, more: float, low: float, high: float) -> Goal:
    """How much more something takes, in per cent; one pair alone has no interval."""
    between = (100 * float(low), 100 * float(high)) if high > low else None
    return Goal(
        name=f"{name}: more",
        value=100 * float(more),
        bar=COST_BAR_PERCENT,
        at_least=False,
        unit="%",
        ci95=between,
    )


def _median_between(values: Array) -> tuple[Array, Array]:
    """95 % interval (2,) of the median of values (pairs, 2), by bootstrap."""
    picks = np.random.default_rng(SEED).integers(0, len(values), (2000, len(values)))
    medians = np.median(values[picks], axis=1)
    return np.quantile(medians, 0.025, axis=0), np.quantile(medians, 0.975, axis=0)


def _campaign(url: str, points: int) -> tuple[float, float]:
    """A campaign as fast as this process can run it: wall and processor seconds."""
    plan = {"kind": "latin_hypercube", "points": points, "standby": 1, "no_load": 1}
    campaign = check({"name": "cost", "plan": plan}, CampaignConfig, file="cost")
    clock = StepClock()
    with Rack(Plant.virtual(seed=SEED, hidden={}, clock=clock)) as rack, Store(url) as store:
        job = Job.prepare(campaign, check(rack.bench_config(), BenchConfig, file="rack"))
        _, cost = timed(lambda: run_campaign(job, store, clock))
    return cost.wall_s, cost.cpu_s


EXPERIMENT = Experiment(title="The operator's desk: retraining, and what looking costs", run=run, apart=True)
