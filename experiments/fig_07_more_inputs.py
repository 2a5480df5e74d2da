"""Fig. 7: a surrogate with more inputs: beside D1, D2 and power the voltage ratio and the leakage inductance.

The simulation is drawn at random over all five; the lab is measured at other input voltages, and with inductors of
another value in it. D²EA of five inputs is compared with D²EA of three, trained on the same points, which cannot see
what moved, and with the three-input one under nominal conditions. The paper shows the idea and no number.
"""

from dataclasses import replace

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from numpy.typing import ArrayLike, NDArray

from drivers.mocks.lab.survey import schedule, survey
from experiments.harness.registry import Experiment
from experiments.harness.result import POINTS, Goal, Picture, Result, Table
from experiments.harness.settings import Countdown, Settings
from experiments.study.labs import POWER_RANGE_W, SUPPLY_V, Array, lab_numbers, laboratory, seed_of
from experiments.study.lessons import mean_and_spread
from experiments.study.pictures import COLOURS, dress, panels, picture
from models.boosting import XGBOOST_I, XGBOOST_II, BoostedTrees, Floats
from sim.model import Model
from sim.prototype import prototype
from sim.simulate import Points, can_run, simulate

MORE = ("voltage_ratio", "inductance")
INPUTS = ("D1", "D2", "P2_W", *MORE)
VOLTAGES_V = (270.0, 300.0, 330.0)
INDUCTANCES = (-0.15, 0.0, 0.15)
SIMULATED, MEASURED = 1250, 400
JUDGED = 600


def voltage_ratio(V1_V: ArrayLike) -> Floats:
    """n V2 / V1 of the prototype."""
    converter = prototype()
    return np.asarray(converter.transformer.turns_ratio * converter.V2_V / np.asarray(V1_V))


def run(settings: Settings) -> Result:
    """All labs."""
    labs = list(lab_numbers(settings))
    countdown = Countdown(len(labs) + 1, settings)
    thin = min(1.0, 5 * settings.scale)
    simulated = simulated_rows(round(SIMULATED * max(thin, 0.3)), np.random.default_rng(31))
    fixed = simulated_rows(round(SIMULATED * max(thin, 0.3)), np.random.default_rng(32), nominal=True)
    countdown.finished("simulation")
    rows = []
    for lab in labs:
        measured = measured_rows(lab, round(MEASURED * max(thin, 0.3)), np.random.default_rng([33, lab]))
        judged = measured_rows(lab, round(JUDGED * max(thin, 0.2)), np.random.default_rng([34, lab]))
        rows.append((lab, *_errors(simulated, fixed, measured, judged)))
        countdown.finished(f"lab {lab}")
    columns = (
        "lab",
        "five inputs",
        "three inputs, same data",
        "three inputs, nominal simulation",
        "simulation only, five",
    )
    means = [mean_and_spread([float(row[k]) for row in rows]) for k in range(1, len(columns))]
    return Result(
        virtual=True,
        goals=(
            Goal(name="D²EA of five inputs: mean error over labs, as a share of that of three", bar=1.0,
                 value=means[0][0] / means[1][0], at_least=False),
        ),
        tables=(
            Table(title="Mean absolute error where voltage and inductance vary, points", columns=columns,
                  rows=(*rows, ("mean", *(m for m, _ in means)), ("± between labs", *(s for _, s in means)))),
        ),
        pictures=(_sensitivity(simulated),),
        notes=(
            f"{len(simulated)} simulated points, {len(VOLTAGES_V)} input voltages and {len(INDUCTANCES)} inductances; "
            "the voltage ratio is n V2 / V1, the inductance its relative deviation",
        ),
        assumed=("which further inputs, and how far they move: 270 to 330 V at the input, 15 % of inductance",),
    )  # fmt: skip


def _drawn(count: int, rng: np.random.Generator) -> tuple[Floats, Floats, Floats]:
    return rng.random(count), rng.random(count), rng.uniform(*POWER_RANGE_W, count)


def simulated_rows(count: int, rng: np.random.Generator, *, nominal: bool = False) -> pd.DataFrame:
    """Feasible simulated points with their inputs and efficiency; under nominal conditions, or all of them."""
    conditions = [(SUPPLY_V, 0.0)] if nominal else [(V, L) for V in VOLTAGES_V for L in INDUCTANCES]
    parts = []
    for V1_V, deviation in conditions:
        D1, D2, power_W = _drawn(6 * count // len(conditions) + 12, rng)
        model = Model.baseline().with_effect("leakage_inductance", relative_error=deviation)
        found = simulate(model, Points(D1=D1, D2=D2, power_W=power_W, V1_V=V1_V))
        part = pd.DataFrame({"D1": D1, "D2": D2, "P2_W": power_W, "efficiency": found["efficiency"]})
        part = part[found.feasible].head(max(1, round(count / len(conditions))))
        parts.append(_under(part, V1_V, deviation))
    return pd.concat(parts, ignore_index=True)


def _under(part: pd.DataFrame, V1_V: float, deviation: float) -> pd.DataFrame:
    return part.assign(voltage_ratio=voltage_ratio(V1_V), inductance=deviation)


def measured_rows(number: int, count: int, rng: np.random.Generator) -> pd.DataFrame:
    """A lab's readings at random points under all conditions, one campaign."""
    lab = laboratory(number)
    each = max(2, round(count / len(VOLTAGES_V) / len(INDUCTANCES)))
    points = np.concatenate([_feasible(each, L, rng) for L in INDUCTANCES for _ in VOLTAGES_V])
    V1_V = np.tile(np.repeat(VOLTAGES_V, each), len(INDUCTANCES))
    deviation = np.repeat(INDUCTANCES, each * len(VOLTAGES_V))
    plan = schedule(*points.T, standby=0, no_load=0, reference_every=len(points) + 1)
    row = np.concatenate([[0], np.arange(len(points))])  # the reference comes first
    inductor = lab.converter.inductor
    other = replace(inductor, inductance_H=float(inductor.inductance_H) * (1 + deviation[row]))
    changed = replace(lab, converter=replace(lab.converter, inductor=other))
    still = replace(plan, time_s=np.zeros(row.size), supply_V=V1_V[row])
    table = survey(changed, still, seed=seed_of(number))
    kept = table[table["kind"] == "load"]
    place = _rows_of(kept, points)
    return kept.assign(voltage_ratio=voltage_ratio(V1_V[place]), inductance=deviation[place]).reset_index(
        drop=True
    )


def _rows_of(table: pd.DataFrame, points: Array) -> NDArray[np.intp]:
    """Which point each row is of, by the power that was set."""
    order = np.argsort(points[:, 2])
    return np.asarray(order[np.searchsorted(points[order, 2], table["P_set_W"].to_numpy(dtype=np.float64))])


def _feasible(count: int, deviation: float, rng: np.random.Generator) -> Array:
    """Points that run at the lowest voltage."""
    model, found = (
        Model.baseline().with_effect("leakage_inductance", relative_error=deviation),
        np.empty((0, 3)),
    )
    while len(found) < count:
        drawn = np.stack(_drawn(4 * count + 12, rng), axis=1)
        D1, D2, power_W = drawn.T
        runs = can_run(model, Points(D1=D1, D2=D2, power_W=power_W, V1_V=min(VOLTAGES_V)))
        found = np.concatenate([found, drawn[runs]])
    return found[:count]


def columns(table: pd.DataFrame, names: tuple[str, ...]) -> list[Floats]:
    """Columns as arrays."""
    return [table[name].to_numpy(dtype=np.float64) for name in names]


def _errors(
    simulated: pd.DataFrame, fixed: pd.DataFrame, measured: pd.DataFrame, judged: pd.DataFrame
) -> tuple[float, float, float, float]:
    truth = judged["efficiency"].to_numpy(dtype=np.float64)

    def d2ea(source: pd.DataFrame, names: tuple[str, ...]) -> tuple[float, float]:
        """Error of both stages, and of the first alone."""
        more = names[3:]
        first = BoostedTrees.fit(columns(source, names), source["efficiency"], XGBOOST_I, more)
        gap = measured["efficiency"].to_numpy(dtype=np.float64) - first.predict(*columns(measured, names))
        second = BoostedTrees.fit(columns(measured, names), gap, XGBOOST_II, more)
        alone = first.predict(*columns(judged, names))
        both = alone + second.predict(*columns(judged, names))
        return tuple(POINTS * float(np.mean(np.abs(x - truth))) for x in (both, alone))  # type: ignore[return-value]

    five, alone = d2ea(simulated, INPUTS)
    return five, d2ea(simulated, INPUTS[:3])[0], d2ea(fixed, INPUTS[:3])[0], alone


def _sensitivity(simulated: pd.DataFrame) -> Picture:
    """What the five-input first stage says of both further inputs at one set point, beside the simulator."""
    trees = BoostedTrees.fit(columns(simulated, INPUTS), simulated["efficiency"], XGBOOST_I, MORE)
    figure, axes = panels(1, 2, width_in=8.2, height_in=3.2)
    D1, D2 = 0.85, 0.1
    for colour, power_W in zip(COLOURS, (600.0, 1000.0, 1600.0), strict=False):
        V1_V = np.linspace(270, 330, 25)
        known = simulate(Model.baseline(), Points(D1=D1, D2=D2, power_W=power_W, V1_V=V1_V))["efficiency"]
        ratio = voltage_ratio(V1_V)
        _pair(axes[0], ratio, known, trees.predict(D1, D2, power_W, ratio, 0.0), (colour, power_W))
        off = np.linspace(-0.15, 0.15, 13)
        known = np.array([
            float(simulate(Model.baseline().with_effect("leakage_inductance", relative_error=float(x)),
                           Points(D1=D1, D2=D2, power_W=power_W))["efficiency"][0])
            for x in off
        ])  # fmt: skip
        _pair(
            axes[1],
            100 * off,
            known,
            trees.predict(D1, D2, power_W, voltage_ratio(SUPPLY_V), off),
            (colour, power_W),
        )
    dress(axes[0], f"D1 = {D1}, D2 = {D2}", "voltage ratio n V2 / V1", "efficiency (%)")
    dress(axes[1], "", "deviation of the inductance (%)", "efficiency (%)")
    axes[0].legend(fontsize=7, frameon=False)
    caption = "Five inputs: lines are the simulator, steps XGBoost-I trained on random points over all five."
    return picture(figure, "inputs", caption, virtual=False)


def _pair(axis: Axes, x: Floats, known: Floats, learned: Floats, drawn: tuple[str, float]) -> None:
    colour, power_W = drawn
    axis.plot(x, POINTS * known, color=colour, lw=1.6, label=f"{power_W:.0f} W, simulator")
    axis.plot(x, POINTS * learned, color=colour, lw=1.1, ls="--", label=f"{power_W:.0f} W, XGBoost-I")


EXPERIMENT = Experiment(title="Fig. 7: voltage ratio and leakage inductance as further inputs", run=run)
