"""What a diagnosis costs: the whole catalogue and all channels on virtual labs, against its bars.

Every table is that of a lab of its own (parts off by their tolerance, analyzer errors, drift) that hides something:
a resistance, a threshold, an edge, two causes at once, what takes power from rows, nothing. The bar is for the
slowest, on the wall, each lab by the median of a few runs, since machines are shared; the first, the quickest and the
slowest run and processor time are beside it. The other process of two is begun once a lab and kept for its runs, as a
command keeps it for a table and its stretches: the first run pays for it. Seconds depend on the machine and on what
else runs there, so each stands beside a peer of the same run: XGBoost, training D²EA's trees on the same table. A
diagnosis as a process of its own, from a file to page and JSON answer, adds the drawing and what Python takes to begin
with.

``--scale`` thins the labs.
"""

import os
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from bench.training import simulated_table
from experiments.blind.trial import BlindTrial, measured
from experiments.harness.registry import Experiment
from experiments.harness.result import Cell, Goal, Result, Table
from experiments.harness.settings import Countdown, Settings
from experiments.simulator.points import at_most
from experiments.simulator.speed import processor_s
from models.dataset import load_measurements
from models.diagnosis.diagnose import diagnose
from models.splits import split_simulation
from models.surrogate import train_d2ea
from sim.model import Model
from sim.side_by_side import kept

FIRST_SEED = 21_500
PROCESSES = 2  # as the command takes
RUNS = 5  # of each diagnosis
BARS_S = {100: 1.5, 400: 10.0}  # by the points of a table
HIDDEN: tuple[tuple[tuple[str, float], ...], ...] = (
    (),
    (("link_resistance", 0.06),),
    (("fan_step", 3.0),),
    (("output_capacitance", 0.6),),
    (("thermal_resistance", 0.5), ("link_resistance", 0.05)),
    (("leakage_inductance", 0.12),),
)
_LEAST_POINTS = 30  # of the first diagnosis, which is not timed: what is made once only is made there


@dataclass(frozen=True, slots=True, kw_only=True)
class Cost:
    """One diagnosis: points asked, what was hidden, the verdict, and seconds on the wall and on the processor.

    Seconds are those of several runs, in their order; on the processor their mean. ``trees_s`` is the median
    of as many trainings of D²EA's trees on the same table, each after a run.
    """

    points: int
    hidden: str
    verdict: str
    runs_s: tuple[float, ...]
    processor_s: float
    trees_s: float

    @property
    def seconds(self) -> float:
        """The median run."""
        return float(np.median(self.runs_s))

    @property
    def trainings(self) -> float:
        """How many trainings of D²EA's trees a diagnosis takes as long as."""
        return self.seconds / self.trees_s


def run(settings: Settings) -> Result:
    """Every lab with few and with many points, and one of them as a process of its own."""
    chosen = HIDDEN[: settings.thinned(len(HIDDEN))]
    countdown = Countdown(len(BARS_S) * len(chosen) + 1, settings)
    diagnose(load_measurements(measured(_trial(0, min(BARS_S))).head(_LEAST_POINTS)))
    costs = []
    simulated = _simulated()
    for points in BARS_S:
        for number in range(len(chosen)):
            costs.append(cost(_trial(number, points), simulated, settings))
            countdown.finished(f"{points} points, {costs[-1].hidden}")
    whole = process_s(measured(_trial(0, min(BARS_S))), settings)
    countdown.finished("a process of its own")
    return Result(
        virtual=True,
        goals=tuple(_goal(points, costs) for points in BARS_S),
        tables=(_table(costs),),
        notes=(
            f"as a process of its own, 100 points from a file to page and JSON answer: {whole[0]:.1f} s on the wall, "
            f"{whole[1]:.1f} s of processor time",
            f"{os.cpu_count()} cores, load {os.getloadavg()[0]:.1f} at the time; labs from seed {FIRST_SEED}",
        ),
    )


def _trial(number: int, points: int) -> BlindTrial:
    return BlindTrial(row="benchmark", seed=FIRST_SEED + number, hidden=HIDDEN[number], points=points)


def _simulated() -> pd.DataFrame:
    """The paper's grid, and of its feasible points the share that D²EA's first trees learn from."""
    table = simulated_table(Model.baseline())
    return table.iloc[split_simulation(table, seed=FIRST_SEED).train]


def cost(trial: BlindTrial, simulated: pd.DataFrame, settings: Settings) -> Cost:
    """The time of one diagnosis, from the table on, and of D²EA's training on it beside ``simulated`` points."""
    table, runs_s, trees_s, trained_s = measured(trial), list[float](), list[float](), 0.0
    loaded, begun_s = load_measurements(table).loaded(), processor_s()
    with kept(PROCESSES):
        for _ in range(RUNS):
            start_s = settings.now()
            verdict = diagnose(load_measurements(table), processes=PROCESSES).as_plain()["verdict"]
            runs_s.append(settings.now() - start_s)
            start_s, before_s = settings.now(), processor_s()
            train_d2ea(simulated, loaded)
            trees_s.append(settings.now() - start_s)
            trained_s += processor_s() - before_s
    used_s = processor_s() - begun_s - trained_s  # that of the other process is known once it has ended
    return Cost(
        points=trial.points,
        hidden=" + ".join(trial.names) or "nothing",
        verdict=verdict,
        runs_s=tuple(runs_s),
        processor_s=used_s / RUNS,
        trees_s=float(np.median(trees_s)),
    )


def process_s(table: pd.DataFrame, settings: Settings) -> tuple[float, float]:
    """Seconds on the wall and on the processor of ``d2ea diagnose`` on a file with this table."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder, "campaign.csv")
        table.to_csv(file, index=False)
        options = ("diagnose", str(file), "--json", str(Path(folder, "answer.json")), "--out", folder)
        command = [sys.executable, "-c", "from bench.cli import main; main()", *options]
        start_s, before_s = settings.now(), processor_s()
        subprocess.run(command, check=True, capture_output=True)
        return settings.now() - start_s, processor_s() - before_s


def _goal(points: int, costs: list[Cost]) -> Goal:
    seconds = [c.seconds for c in costs if c.points == points]
    return at_most(
        f"{points} points, the slowest of {len(seconds)} labs, each the median of {RUNS}",
        max(seconds),
        BARS_S[points],
        "s",
    )


def _table(costs: list[Cost]) -> Table:
    rows: tuple[tuple[Cell, ...], ...] = tuple(
        (
            c.points, c.hidden, c.verdict, c.seconds, c.runs_s[0], min(c.runs_s), max(c.runs_s), c.processor_s,
            c.trees_s, c.trainings,
        )
        for c in costs
    )  # fmt: skip
    columns = (
        "points", "hidden", "verdict", "s, median", "first", "quickest", "slowest", "s of processor time",
        "D²EA's training, s", "times that",
    )  # fmt: skip
    return Table(title="Diagnoses with the whole catalogue and all channels", columns=columns, rows=rows)


EXPERIMENT = Experiment(title="Benchmark: what a diagnosis costs", run=run, apart=True)
