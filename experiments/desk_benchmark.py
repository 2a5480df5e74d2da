"""The operator's desk: how fast a model follows the measurements, and what looking costs.

Retraining on 1000 measured points of a virtual lab and the 12,500-point grid: both stages, the judging on held-out
blocks, the optimum over 19 loads, and the table checked between its rows.

The dashboard, in a process of its own: the first page in a browser, how long after a row is stored a viewer is told of
it (with a campaign of 10,000 rows, too), and what eight viewers cost a campaign that runs as fast as it can, in processor
time of its process and in wall time. Viewers load the page and keep its live connection, but draw nothing: eight
browsers on the bench's own computer would compete with it for its cores.

Seconds depend on the machine, and on what else it does; wall times say the latter, processor times do not.
"""

import os
import shutil
import statistics
import subprocess
import sys
import time
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import UTC, datetime
from multiprocessing import get_context
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pandas as pd

from bench.campaign import run_campaign
from bench.config import BenchConfig, CampaignConfig, check
from bench.job import Job
from bench.plan import Kind, PlannedPoint
from bench.process import Owner
from bench.retrain import Retrainer, Retraining
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
from experiments.harness.viewers import watching
from models.dataset import load_measurements
from models.registry import Registry
from sim.model import Model

SEED = 31_000
MEASURED, LONG, FOLLOWED, VIEWERS = 1000, 10_000, 30, 8
CAMPAIGN_ROWS, ROUNDS = 24, 3
RETRAIN_BAR_S, PAGE_BAR_S, POINT_BAR_S, COST_BAR = 5.0, 2.0, 1.0, 0.02
BENCH = "benchmark bench"


def run(settings: Settings) -> Result:
    """All of it; ``scale`` thins measured rows, the long campaign and the rounds."""
    countdown = Countdown(4, settings)
    with TemporaryDirectory(dir=settings.out) as name:
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
    table = measured_table(Laboratory.virtual(seed=SEED, hidden={"link_resistance": None}), settings.thinned(MEASURED), seed=SEED)
    data = TrainingData.of_file(Path("lab.csv"), load_measurements(table).frame)
    simulator = Model.baseline()
    retrainer = Retrainer(registry=Registry(folder / "models"), simulator=simulator, now=_now)
    simulated, simulate_s, simulate_cpu_s = _timed(lambda: retrainer.simulated)
    done, wall_s, cpu_s = _timed(lambda: retrainer.retrain(data))
    assert isinstance(done, Retraining)
    said = done.decision.decision.replace("_", " ") if done.decision else done.said
    rows: tuple[tuple[Cell, ...], ...] = (
        ("the grid, simulated once", simulate_s, simulate_cpu_s, f"{len(simulated)} of 12500 feasible"),
        ("both stages, judged, optimum and table", wall_s, cpu_s, f"{len(data)} measured rows; {said}"),
    )
    columns = ("step", "wall (s)", "processor (s)", "what")
    goal = Goal(name="retraining, both stages and the optimum", value=wall_s, bar=RETRAIN_BAR_S, at_least=False, unit="s")
    return Table(title="Retraining", columns=columns, rows=rows), goal


def _now() -> str:
    return datetime.now(UTC).isoformat()


def _timed(work):  # type: ignore[no-untyped-def]
    wall_s, cpu_s = time.perf_counter(), time.process_time()
    made = work()
    return made, time.perf_counter() - wall_s, time.process_time() - cpu_s
