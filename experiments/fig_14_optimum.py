"""Fig. 14: the best D1 and D2 over load by D²EA and PSO-SAVL, and predicted against measured efficiency there.

The optimum of lab 0 is set and measured over the wires, through the drivers; that of the other labs through their
instruments' model. What the lab itself would call best stands beside it.
"""

import numpy as np
import pandas as pd

from experiments.harness.registry import Experiment
from experiments.harness.result import POINTS, Cell, Comparison, Goal, Picture, Result, Table
from experiments.harness.settings import Settings
from experiments.study.labs import ASSUMED
from experiments.study.on_bench import measured_on_bench
from experiments.study.optima import METHODS, SAID, THE_LAB, Optimum, of_method, optima
from experiments.study.pictures import COLOURS, dress, legend, panels, picture
from models.boosting import Floats
from models.surrogate import D2EA

PEAK, PEAK_W = 98.45, 600.0
PREDICTED_BAR = 0.08
_PROTOTYPE = (
    "core, windings and cooling of the prototype are assumed, and every lab has another loss hidden in it"
)


def run(settings: Settings) -> Result:
    """Search all labs; measure lab 0 over the wires."""
    found = optima(settings)
    d2ea, own = of_method(found, D2EA), of_method(found, THE_LAB)
    at = np.isfinite(d2ea[0].measured)
    points = np.stack([d2ea[0].D1, d2ea[0].D2, d2ea[0].power_W], axis=1)[at]
    wired = measured_on_bench(d2ea[0].lab, points, name="optimum by D²EA")
    over_wires = _by_load(wired, d2ea[0])
    peak = np.array([POINTS * np.interp(PEAK_W, one.power_W, one.measured) for one in d2ea])
    missed = [POINTS * np.abs(one.predicted - one.measured) for one in d2ea]
    return Result(
        virtual=True,
        comparisons=(
            Comparison(
                name=f"efficiency at {PEAK_W:.0f} W, D²EA's optimum, mean over labs", paper=PEAK,
                ours=float(np.mean(peak)), unit="%", tolerance=0.5, reason=_PROTOTYPE,
                spread=float(np.std(peak, ddof=1)),
            ),
        ),
        goals=(
            Goal(
                name="D²EA predicted against measured at its optima, mean over labs (the paper's modelling error)",
                value=float(np.nanmean(missed)), bar=PREDICTED_BAR, at_least=False, unit="points",
            ),
            Goal(
                name="over the wires against the instruments' model, lab 0: largest difference",
                value=float(np.nanmax(POINTS * np.abs(over_wires - d2ea[0].measured))), bar=0.05, at_least=False,
                unit="points",
            ),
        ),
        tables=(_methods(found), _by_load_table(d2ea[0], own[0], over_wires)),
        pictures=(_picture(d2ea[0], own[0], over_wires),),
        notes=(
            "predicted less measured at an optimum is positive on average: a search finds where a model errs upwards",
            "0.05 points between the two ways to measure: noise of single campaigns, temperatures that settle from the "
            "point before, and PWM counts",
        ),
        assumed=(*ASSUMED, "between 200 W and 2 kW a load every 100 W"),
    )  # fmt: skip


def _by_load(wired: pd.DataFrame, one: Optimum) -> Floats:
    """Readings over the wires at the loads of an optimum; NaN where there is none."""
    read = dict(zip(wired["P_set_W"].round(3), wired["efficiency"], strict=True))
    return np.array([read.get(round(float(load), 3), np.nan) for load in one.power_W])


def _by_load_table(one: Optimum, own: Optimum, over_wires: Floats) -> Table:
    columns = (
        "load, W", "D1", "D2", "predicted, %", "measured over the wires, %", "predicted less measured, points",
        "the lab's own best, %", "at D1", "at D2",
    )  # fmt: skip
    rows = tuple(
        (float(one.power_W[k]), _cell(one.D1[k]), _cell(one.D2[k]), _cell(POINTS * one.predicted[k]),
         _cell(POINTS * over_wires[k]), _cell(POINTS * (one.predicted[k] - over_wires[k])),
         _cell(POINTS * own.true[k]), _cell(own.D1[k]), _cell(own.D2[k]))
        for k in range(len(one.power_W))
    )  # fmt: skip
    return Table(title=f"Optimum of lab {one.lab} over load", columns=columns, rows=rows)


def _cell(value: float) -> Cell:
    return float(value) if np.isfinite(value) else None


def _methods(found: list[Optimum]) -> Table:
    rows: list[tuple[Cell, ...]] = []
    for method in METHODS:
        own = of_method(found, method)
        errors = [POINTS * (one.predicted - one.measured) for one in own]
        spread = [float(np.nanmean(np.abs(e))) for e in errors]
        rows.append(
            (SAID[method], float(np.mean(spread)), float(np.std(spread, ddof=1)), float(np.nanmean(errors)),
             float(np.nanmax(np.abs(errors))))
        )  # fmt: skip
    columns = ("optimum by", "mean |predicted − measured|, points", "± between labs", "mean of it", "worst")
    return Table(
        title="Predicted against measured at the optima of all labs", columns=columns, rows=tuple(rows)
    )


def _picture(one: Optimum, own: Optimum, over_wires: Floats) -> Picture:
    figure, (upper, lower) = panels(2, 1, width_in=7.0, height_in=5.4)
    upper.plot(own.power_W, POINTS * own.true, color=COLOURS[6], lw=1.3, ls=":", label="the lab's own best")
    upper.plot(
        one.power_W,
        POINTS * one.predicted,
        color=COLOURS[0],
        ls="--",
        marker="o",
        ms=4,
        label="D²EA predicts",
    )
    upper.plot(
        one.power_W, POINTS * over_wires, color=COLOURS[1], marker="D", ms=4, label="measured over the wires"
    )
    dress(upper, f"Best modulation of lab {one.lab} by D²EA and PSO-SAVL", "", "efficiency (%)")
    legend(upper)
    for column, colour, marker in (("D1", COLOURS[2], "o"), ("D2", COLOURS[3], "s")):
        lower.plot(
            one.power_W, getattr(one, column), color=colour, marker=marker, ms=4, label=f"{column}, D²EA"
        )
        lower.plot(
            own.power_W,
            getattr(own, column),
            color=colour,
            lw=1.2,
            ls=":",
            label=f"{column}, the lab's own best",
        )
    dress(lower, "", "output power (W)", "D1, D2 (half periods)")
    lower.set_ylim(-0.05, 1.08)
    legend(lower, columns=2)
    caption = "Optimal D1 and D2 over load, and predicted and measured efficiency there."
    return picture(figure, "optimum", caption)


EXPERIMENT = Experiment(title="Fig. 14: optimal D1 and D2 over load, predicted and measured", run=run)
