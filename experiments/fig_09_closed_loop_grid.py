"""Fig. 9, Fig. 11, and the partition of Table III: 12,500 closed-loop simulations, and what can be learned from.

Every point of the 25 x 25 x 20 grid over D1, D2 and power is simulated with D0 solved for its power. About 60 % of
them cannot carry it at any D0, which the paper does not say: those have no efficiency, so the percentages of
Table III are taken of the rest, and a denser grid gives the number of training points that the paper names.
"""

import time

import numpy as np
import pandas as pd

from experiments.harness.registry import Experiment
from experiments.harness.result import Comparison, Picture, Result, Table
from experiments.harness.settings import Countdown, Settings
from experiments.study.labs import DENSE_GRID, PAPER_GRID, campaign, campaign_points, grid_table, loads_of
from experiments.study.pictures import COLOURS, MAP, colour_bar, dress, panels, picture
from models.splits import Split, split_experiment, split_simulation
from sim.model import Model
from sim.simulate import grid, simulate

PAPER_POINTS, PAPER_MEASURED = 12_500, 1000
PAPER_SIMULATION, PAPER_EXPERIMENT = (1250, 2500, 8750), (400, 200, 400)
SETS = ("training", "test", "validation")
SHOWN_W = (600.0, 1000.0, 1600.0)
LOSSLESS_SHARE = 0.41
POWER_TOLERANCE = 1e-6
SEED = 0
_REAL = "the percentages are the paper's; it counts points that cannot carry their power, which have no efficiency"


def run(settings: Settings) -> Result:
    """Simulate, count, split."""
    countdown = Countdown(3, settings)
    start_s = time.process_time()
    solved = simulate(Model.baseline(), grid(PAPER_GRID))
    cpu_s = time.process_time() - start_s
    countdown.finished("grid")
    table = pd.DataFrame(solved.columns())
    feasible = table[table["feasible"]].reset_index(drop=True)
    dense = grid_table(settings.out, DENSE_GRID)
    dense_feasible = dense[dense["feasible"]].reset_index(drop=True)
    countdown.finished("denser grid")
    loads = loads_of(campaign(settings.out, 0, campaign_points(settings)))
    countdown.finished("campaign")
    simulation, experiment = split_simulation(feasible, seed=SEED), split_experiment(loads, seed=SEED)
    denser = split_simulation(dense_feasible, seed=SEED)
    missed_W = np.abs(feasible["P2_W"] / feasible["P_set_W"] - 1)
    return Result(
        virtual=True,
        comparisons=(
            _counted("simulated points", PAPER_POINTS, len(table), "the same grid"),
            *(
                _counted(f"simulated points, {name}", paper, ours, _REAL)
                for name, paper, ours in zip(SETS, PAPER_SIMULATION, _sizes(simulation), strict=True)
            ),
            Comparison(
                name=f"simulated points, training, of {len(dense)}", paper=PAPER_SIMULATION[0],
                ours=len(denser.train), unit="", tolerance=0.05 * PAPER_SIMULATION[0],
                reason="a grid so dense that 10 % of its feasible points are the paper's number, within 5 %",
            ),
            *(
                Comparison(
                    name=f"measured points, {name}", paper=paper, ours=ours, unit="",
                    tolerance=0.03 * PAPER_MEASURED,
                    reason="points that the simulation carries and this lab does not are left out",
                )
                for name, paper, ours in zip(SETS, PAPER_EXPERIMENT, _sizes(experiment), strict=True)
            ),
            Comparison(
                name="share of the grid that can carry its power", paper=LOSSLESS_SHARE,
                ours=len(feasible) / len(table), unit="", tolerance=0.03,
                reason="derived for a converter without losses, which take a little of it; not said in the paper",
            ),
            Comparison(
                name="worst relative error of the regulated power", paper=0.0, ours=float(missed_W.max()), unit="",
                tolerance=POWER_TOLERANCE, reason="the closed loop holds the demanded power",
            ),
        ),
        tables=(_by_power(table),),
        pictures=(_maps(table), _partition(simulation, experiment)),
        notes=(f"the grid took {cpu_s:.1f} s of processor time on one core",),
        assumed=("the grid's ends are in it: D1 and D2 from 0 to 1, power from 200 to 2000 W",),
    )  # fmt: skip


def _counted(name: str, paper: int, ours: int, reason: str) -> Comparison:
    return Comparison(name=name, paper=paper, ours=ours, unit="", tolerance=0.0, reason=reason)


def _sizes(split: Split) -> tuple[int, int, int]:
    return len(split.train), len(split.test), len(split.validation)


def _by_power(table: pd.DataFrame) -> Table:
    rows = []
    for power_W, part in table.groupby("P_set_W"):
        runs = part[part["feasible"]]
        best = runs.iloc[int(runs["efficiency"].argmax())]
        rows.append(
            (float(str(power_W)), len(runs), len(runs) / len(part),
             float(best["efficiency"]), float(best["D1"]), float(best["D2"]))
        )  # fmt: skip
    columns = ("power, W", "feasible", "share", "best efficiency", "at D1", "at D2")
    return Table(title="The simulated grid by power", columns=columns, rows=tuple(rows))


def _maps(table: pd.DataFrame) -> Picture:
    figure, axes = panels(1, len(SHOWN_W), width_in=9.0, height_in=3.2)
    powers = np.unique(table["P_set_W"])
    for axis, wanted_W in zip(axes, SHOWN_W, strict=True):
        power_W = powers[np.argmin(np.abs(powers - wanted_W))]
        part = table[table["P_set_W"] == power_W].pivot(index="D2", columns="D1", values="efficiency")
        mesh = axis.pcolormesh(
            part.columns, part.index, 100 * part, cmap=MAP, vmin=90, vmax=98.5, shading="nearest"
        )
        dress(axis, f"{power_W:.0f} W", "D1 (half periods)", "D2 (half periods)")
    colour_bar(figure, mesh, axes, "simulated efficiency (%)")
    caption = "The closed-loop grid at three powers; white points cannot carry their power at any D0."
    return picture(figure, "grid", caption, virtual=False)


def _partition(simulation: Split, experiment: Split) -> Picture:
    figure, (axis,) = panels(1, 1, width_in=7.2, height_in=2.4)
    for place, sizes in enumerate((_sizes(experiment), _sizes(simulation))):
        left = 0.0
        for colour, name, size in zip(COLOURS, SETS, sizes, strict=False):
            share = 100 * size / sum(sizes)
            axis.barh(place, share, left=left, color=colour, height=0.6, label=name if place else None)
            axis.text(left + share / 2, place, str(size), ha="center", va="center", color="white", fontsize=9)
            left += share
    dress(axis, "Partition of the data", "share of the points (%)", "")
    axis.set_yticks([0, 1], ["measured", "simulated,\nfeasible"], fontsize=9)
    axis.set_xlim(0, 100)
    figure.legend(loc="outside upper right", ncols=3, fontsize=8, frameon=False)
    caption = "Training, test and validation sets as in Table III, of the points that can carry their power."
    return picture(figure, "partition", caption, virtual=False)


EXPERIMENT = Experiment(
    title="Fig. 9, Fig. 11, Table III: closed-loop grid and partition of the data", run=run
)
