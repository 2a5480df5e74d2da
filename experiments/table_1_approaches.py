"""Table I: modelling approaches compared: piecewise, harmonics, a network on simulation alone, and D²EA, measured.

The paper rates manpower, data size and deviation in words. Deviation is measured here: mean difference from each lab's
readings on its validation points. Data size is counted. Manpower cannot be measured; how many lines of closed-form
derivation an approach needs stands for it, beside whether it needs a simulation and a bench.
"""

import inspect
from types import ModuleType

import numpy as np
import pandas as pd

import sim.harmonic
import sim.knowledge
import sim.piecewise
from experiments.harness.registry import Experiment
from experiments.harness.result import POINTS, Cell, Goal, Picture, Result, Table
from experiments.harness.settings import Countdown, Settings
from experiments.study.labs import ASSUMED, campaign, campaign_points, lab_numbers, loads_of, seed_of
from experiments.study.learners import Lesson, learned
from experiments.study.lessons import mean_and_spread, training_rows
from experiments.study.pictures import COLOURS, dress, panels, picture, rotated
from models.baselines import Baseline, train_baseline
from models.boosting import Floats
from models.splits import split_experiment
from models.surrogate import D2EA, inputs_of
from sim.knowledge import harmonic_method, piecewise_method
from sim.model import Model
from sim.simulate import Points

PIECEWISE, HARMONICS, NETWORK = "piecewise", "harmonics", "network on simulation"
WORDS = {  # of Table I: manpower, data size, deviation
    PIECEWISE: ("large", "–", "large"),
    HARMONICS: ("medium", "–", "large"),
    NETWORK: ("low", "data-intensive", "medium"),
    D2EA: ("low", "data-light", "low"),
}
SAID = {PIECEWISE: "piecewise [9]–[11]", HARMONICS: "harmonics [12]–[14], three of them",
        NETWORK: "data-driven [18]–[21]: network", D2EA: "D²EA"}  # fmt: skip


def run(settings: Settings) -> Result:
    """All approaches against all labs."""
    labs = list(lab_numbers(settings))
    countdown = Countdown(len(labs) + 1, settings)
    simulated = training_rows(settings.out, 0, dense=settings.scale == 1)
    network = train_baseline("nn", simulated, seed=0)
    countdown.finished("network")
    errors: dict[str, list[float]] = {name: [] for name in WORDS}
    counts = {PIECEWISE: (0, 0), HARMONICS: (0, 0), NETWORK: (len(simulated), 0)}
    for lab in labs:
        table = campaign(settings.out, lab, campaign_points(settings))
        loads = loads_of(table)
        rows = split_experiment(loads, seed=seed_of(0))
        judged, fitted = (loads.iloc[part].reset_index(drop=True) for part in (rows.validation, rows.train))
        lesson = Lesson(
            simulated=training_rows(settings.out, 0), fitted=fitted, judged=judged, idle=table, seed=0
        )
        counts[D2EA] = (len(lesson.simulated), len(fitted))
        predictions = knowledge_based(judged) | _learned(network, lesson)
        for name, predicted in predictions.items():
            off = predicted - judged["efficiency"].to_numpy(dtype=np.float64)
            errors[name].append(POINTS * float(np.nanmean(np.abs(off))))
        countdown.finished(f"lab {lab}")
    return Result(
        virtual=True,
        goals=_goals(errors),
        tables=(_table(errors, counts),),
        pictures=(_picture(errors),),
        notes=(
            "lines of derivation are those of code, without comments, in the modules of the closed forms; they serve "
            "all working modes of every modulation at once, which the paper derives one by one",
            "piecewise and harmonics use the same datasheet values as the simulation; they leave out dead times, "
            "commutation by charge, and losses' influence on D0 and on temperatures",
        ),
        assumed=(*ASSUMED, "how many harmonics: three", "the network: two hidden layers of 32, on simulation alone"),
    )  # fmt: skip


def knowledge_based(judged: pd.DataFrame) -> dict[str, Floats]:
    """Efficiency by both closed-form methods; NaN where they see no solution."""
    D1, D2, power_W = inputs_of(judged)
    points = Points(D1=D1, D2=D2, power_W=power_W)
    model = Model.baseline()
    return {
        PIECEWISE: piecewise_method(model, points)["efficiency"],
        HARMONICS: harmonic_method(model, points)["efficiency"],
    }


def _learned(network: Baseline, lesson: Lesson) -> dict[str, Floats]:
    return {NETWORK: network.predict(*inputs_of(lesson.judged)), D2EA: learned(D2EA, lesson)}


def derivation_lines(*modules: ModuleType) -> int:
    """Lines of code of modules, without blank ones and comments."""
    texts = (inspect.getsource(module) for module in modules)
    return sum(
        bool(line.strip()) and not line.strip().startswith("#")
        for text in texts
        for line in text.splitlines()
    )


def _goals(errors: dict[str, list[float]]) -> tuple[Goal, ...]:
    mean = {name: float(np.mean(values)) for name, values in errors.items()}
    order = ((D2EA, NETWORK), (NETWORK, PIECEWISE), (NETWORK, HARMONICS))
    return tuple(
        Goal(
            name=f"{SAID[better]} deviates less than {SAID[worse]}: difference", value=mean[worse] - mean[better],
            bar=0.0, at_least=True, unit="points",
        )
        for better, worse in order
    )  # fmt: skip


def _table(errors: dict[str, list[float]], counts: dict[str, tuple[int, int]]) -> Table:
    lines = {
        PIECEWISE: derivation_lines(sim.piecewise, sim.knowledge),
        HARMONICS: derivation_lines(sim.harmonic, sim.knowledge),
    }
    rows: list[tuple[Cell, ...]] = []
    for name, words in WORDS.items():
        mean, spread = mean_and_spread(errors[name])
        simulated, measured = counts[name]
        rows.append((SAID[name], *words, lines.get(name, 0), simulated, measured, mean, spread))
    columns = (
        "approach", "manpower, the paper", "data, the paper", "deviation, the paper", "lines of derivation",
        "simulated points", "measured points", "mean difference from measured, points", "± between labs",
    )  # fmt: skip
    return Table(title="Approaches, in the paper's words and measured", columns=columns, rows=tuple(rows))


def _picture(errors: dict[str, list[float]]) -> Picture:
    figure, (axis,) = panels(1, 1, width_in=6.2, height_in=3.6)
    for place, values in enumerate(errors.values()):
        axis.bar(place, float(np.mean(values)), 0.6, color=COLOURS[0])
        axis.scatter(np.full(len(values), place), values, s=14, color=COLOURS[3], edgecolors="#333333", linewidths=0.4,
                     zorder=3)  # fmt: skip
    dress(axis, "Deviation from practice", "", "mean |predicted − measured| (points)")
    rotated(axis, [SAID[name] for name in errors])
    return picture(
        figure,
        "deviation",
        "Deviation of each approach from the labs' readings: bars are means, points labs.",
    )


EXPERIMENT = Experiment(title="Table I: modelling approaches compared", run=run)
