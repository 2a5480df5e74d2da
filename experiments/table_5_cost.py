"""Table V: time and processor use of each step of D²EA, here and in the paper.

Step 1 simulates the 12,500 points and measures a campaign over the wires; how long the bench itself would have taken,
on its own clock, stands beside the wall clock, since a virtual bench need not wait. Step 2 trains the three models of
Fig. 13 once, without the enumeration of Table III; step 3 searches 19 loads. Times belong to the machine.
"""

import math
import os

import numpy as np

from experiments.harness.registry import Experiment
from experiments.harness.result import Cell, Comparison, Goal, Result, Table
from experiments.harness.settings import Countdown, Settings
from experiments.harness.timing import Cost, timed
from experiments.study.labs import CAMPAIGN_POINTS, campaign, campaign_points, set_points
from experiments.study.on_bench import bench_seconds_a_point, measured_on_bench
from experiments.study.optima import LOADS_W, SEARCH_SEED, carried, problems_of, trained
from models.pso import PSO_SAVL
from models.surrogate import D2EA
from sim.model import Model
from sim.simulate import grid, simulate

PAPER_S = {1: 9 * 3600 + 17 * 60.0, 2: 114.7, 3: 12 * 60 + 25.0}
PAPER_USE = {1: 20.2, 2: 68.9, 3: 43.9}
SAID = {1: "collect simulation and experimental data", 2: "train both models", 3: "search for the optimum"}
WIRED_POINTS, LEAST_WIRED = 60, 4
_MACHINE = "the paper's is a 4-core Xeon E5-1630, this is another: shown, not judged"


def run(settings: Settings) -> Result:
    """Each step once, on one core."""
    countdown = Countdown(4, settings)
    _, simulated = timed(lambda: simulate(Model.baseline(), grid()))
    countdown.finished("grid")
    count = max(LEAST_WIRED, settings.thinned(WIRED_POINTS))
    points = set_points(4 * count, np.random.default_rng(24))
    points = points[points[:, 2] < 1500][:count]  # without heat margins: what every lab carries
    table, wired = timed(lambda: measured_on_bench(0, points, name="Table V"))
    countdown.finished("campaign over the wires")
    rows = campaign_points(settings)
    campaign(settings.out, 0, rows)  # made before the clock starts: it stands for a campaign already measured
    models, training = timed(lambda: trained(settings.out, 0, rows))
    countdown.finished("training")
    loads = tuple(LOADS_W.tolist())
    carried(loads)
    problems = problems_of(models[D2EA], loads)
    _, search = timed(lambda: PSO_SAVL.maximise(problems, seed=SEARCH_SEED))
    countdown.finished("search")
    whole = Cost(
        simulated.wall_s + wired.wall_s * CAMPAIGN_POINTS / len(table),
        simulated.cpu_s + wired.cpu_s * CAMPAIGN_POINTS / len(table),
    )
    costs = {1: whole, 2: training, 3: search}
    bench_s = bench_seconds_a_point() * CAMPAIGN_POINTS
    return Result(
        virtual=True,
        comparisons=tuple(
            Comparison(
                name=f"step {step}, {SAID[step]}: {what}", paper=paper, ours=ours, unit=unit, tolerance=math.inf,
                reason=_MACHINE,
            )
            for step, cost in costs.items()
            for what, paper, ours, unit in (
                ("time", PAPER_S[step], cost.wall_s, "s"), ("processor use", PAPER_USE[step], cost.use, "%"),
            )
        ),
        goals=tuple(
            Goal(name=f"step {step} here, no longer than in the paper", value=costs[step].wall_s, bar=PAPER_S[step],
                 at_least=False, unit="s")
            for step in PAPER_S
        ),
        tables=(_table(simulated, wired, len(table), bench_s, costs),),
        notes=(
            f"{os.cpu_count()} cores, of which each step uses one; processor use is of all of them",
            f"step 1 measured {len(table)} points over the wires and is scaled to {CAMPAIGN_POINTS}",
            f"on the bench's own clock, with its settling and averaging, {CAMPAIGN_POINTS} points take "
            f"{bench_s / 3600:.1f} h: a real bench cannot be hurried, the simulation beside it is negligible",
        ),
        assumed=("what the paper's step 2 includes; here one training of the three models of Fig. 13",),
    )  # fmt: skip


def _table(simulated: Cost, wired: Cost, measured: int, bench_s: float, costs: dict[int, Cost]) -> Table:
    rows: tuple[tuple[Cell, ...], ...] = (
        ("12,500 points simulated", simulated.wall_s, simulated.cpu_s, simulated.use),
        (f"{measured} points measured over the wires", wired.wall_s, wired.cpu_s, wired.use),
        (f"{CAMPAIGN_POINTS} points on the bench's own clock", bench_s, None, None),
        ("three models trained", costs[2].wall_s, costs[2].cpu_s, costs[2].use),
        ("PSO-SAVL, 19 loads", costs[3].wall_s, costs[3].cpu_s, costs[3].use),
    )
    return Table(title="What each part took", columns=("part", "s", "CPU s", "processor use, %"), rows=rows)


EXPERIMENT = Experiment(title="Table V: cost of each step", run=run)
