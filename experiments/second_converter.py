"""A second converter through the whole chain by its model file alone: a two-level dual-active bridge under TPS.

"Scalable to other applications", says the paper. The converter of ``docs/examples/two_level_dab.toml`` (400 V to 48 V,
1.5 kW, 100 kHz, two-level on both sides) is simulated on its grid, measured in virtual labs of its own, learned, its
modulation optimised by PSO-SAVL and read there, and what is hidden in each lab is looked for by the diagnosis. Nothing
in the code knows this converter.
"""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pandas as pd

from bench.model_file import read_model
from drivers.mocks.lab.laboratory import Laboratory
from drivers.mocks.lab.survey import Schedule, noise_free_efficiency, schedule, survey
from experiments.harness.registry import Experiment
from experiments.harness.result import POINTS, Cell, Goal, Picture, Result, Table
from experiments.harness.settings import Countdown, Settings
from experiments.study.labs import CAMPAIGN_S, REFERENCE_EVERY, Array
from experiments.study.learners import NAMES, SIMULATOR, SIMULATOR_GP, Lesson, learned
from experiments.study.lessons import mean_and_spread
from experiments.study.pictures import COLOURS, MARKERS, dress, legend, panels, picture
from models.accuracy import accuracy_of
from models.boosting import Floats
from models.dataset import load_measurements
from models.diagnosis.diagnose import Diagnosis, diagnose
from models.feasibility import FeasibleMap, edge_gap_of
from models.lattice import optimise_on_lattice
from models.optimise import OptimumTable, optimise
from models.pso import PSO_SAVL
from models.screening import LOADED_KINDS
from models.splits import split_experiment, split_simulation
from models.surrogate import CALIBRATED, D2EA, EXPERIMENT_ONLY, SIMULATION_ONLY, SIMULATOR_FIRST, train_d2ea
from sim.effects.catalogue import CATALOGUE
from sim.model import Model
from sim.operating_points import grid_of
from sim.parameters import ParameterError
from sim.simulate import Points, can_run, simulate

MODEL_FILE = Path(__file__).parents[1] / "docs" / "examples" / "two_level_dab.toml"
# relative: sizes in Ohm or W are the prototype's
HIDDEN = ("leakage_inductance", "core_loss_transformer", "skin_effect")
FIRST_SEED = 440_000
MEASURED, LEAST = 250, 120
KINDS = (SIMULATION_ONLY, SIMULATOR, EXPERIMENT_ONLY, D2EA, SIMULATOR_FIRST, SIMULATOR_GP)
CALIBRATED_BAR = 0.05


@dataclass(frozen=True, slots=True, kw_only=True)
class Chain:
    """What came out of one lab: errors by model, optima with their readings, the diagnosis."""

    hidden: str
    errors: dict[str, float]
    floor: float
    d2ea: OptimumTable
    calibrated: OptimumTable
    read: dict[str, Floats]
    diagnosis: Diagnosis

    @property
    def found(self) -> bool:
        """What is hidden is the named cause, or in the stated group."""
        verdict = self.diagnosis.verdict
        named = [verdict.causes[0].effect] if verdict.kind == "named" else []
        return self.hidden in [*named, *(name for group in verdict.groups for name in group)]


@dataclass(frozen=True, slots=True)
class Bench:
    """One lab of the converter and its simulation."""

    model: Model
    lab: Laboratory
    seed: int

    def at(self, points: Array) -> Points:
        """Set points (N, 3) at the converter's own voltages."""
        D1, D2, power_W = points.T
        return Points(D1=D1, D2=D2, power_W=power_W)

    def simulated(self, D1: Floats, D2: Floats, power_W: Floats) -> Floats:
        """The baseline's efficiency."""
        return np.asarray(simulate(self.model, self.at(np.stack([D1, D2, power_W], axis=1)))["efficiency"])

    def drawn(self, count: int) -> Array:
        """Random set points that the simulation can carry."""
        rng, rated_W = np.random.default_rng([self.seed, 21]), self.model.converter.rated_power_W
        found = np.empty((0, 3))
        while len(found) < count:
            box = np.stack(
                [rng.random(4 * count), rng.random(4 * count), rng.uniform(0.1, 1, 4 * count) * rated_W]
            )
            found = np.concatenate([found, box.T[can_run(self.model, self.at(box.T))]])
        return found[:count]

    def campaign(self, count: int) -> pd.DataFrame:
        """A measurement table with the columns ``simulated`` and ``true`` where loaded."""
        plan = schedule(*self.drawn(count).T, reference_every=REFERENCE_EVERY)
        plan = replace(plan, time_s=np.linspace(0.0, CAMPAIGN_S / 4, plan.time_s.size))
        table = self.read(plan)
        loaded = table["kind"].isin(LOADED_KINDS).to_numpy()
        D1, D2, power_W = table.loc[loaded, ["D1", "D2", "P2_W"]].to_numpy(dtype=np.float64).T
        table[["simulated", "true"]] = np.nan
        table.loc[loaded, "simulated"] = self.simulated(D1, D2, power_W)
        set_W = table.loc[loaded, "P_set_W"].to_numpy(dtype=np.float64)
        table.loc[loaded, "true"] = self.true(np.stack([D1, D2, set_W], axis=1))
        return table

    def read(self, plan: Schedule) -> pd.DataFrame:
        """Readings of a schedule."""
        return survey(self.lab, replace(plan, supply_V=self.model.converter.V1_V), seed=self.seed)

    def true(self, points: Array) -> Floats:
        """Noise-free readings."""
        return noise_free_efficiency(self.lab, *points.T, supply_V=self.model.converter.V1_V)


def run(settings: Settings) -> Result:
    """Every lab through the whole chain."""
    model = read_model(MODEL_FILE)
    hidden = HIDDEN[: max(1, round(len(HIDDEN) * min(1.0, 3 * settings.scale)))]
    countdown = Countdown(len(hidden) + 1, settings)
    grid = pd.DataFrame(simulate(model, grid_of(model.converter)).columns())
    grid = grid[grid["feasible"]].reset_index(drop=True)
    countdown.finished("grid")
    count = max(LEAST, round(MEASURED * min(1.0, 4 * settings.scale)))
    chains = []
    for number, name in enumerate(hidden):
        seed = FIRST_SEED + number
        lab = Laboratory.draw(seed=seed, hidden={name: None}, converter=model.converter)
        chains.append(_chain(Bench(model, lab, seed), name, grid, count))
        countdown.finished(f"{name} hidden")
    return Result(
        virtual=True,
        goals=_goals(chains),
        tables=(_optima(chains[0]), _diagnoses(chains), _errors(chains)),
        pictures=(_picture(chains[0]),),
        notes=(
            f"{len(grid)} of 12,500 grid points of {model.converter.name} can carry their power; {count} points are "
            "measured in each lab, through the instruments' model without the wire",
            "this converter is an illustration: no part of it was built, and the paper gives no figure for another one",
        ),
        assumed=("everything about this converter: see its file",),
    )  # fmt: skip


def _chain(bench: Bench, hidden: str, grid: pd.DataFrame, count: int) -> Chain:
    table = bench.campaign(count)
    loads = table[(table["kind"] == "load") & table["simulated"].notna() & table["true"].notna()].reset_index(
        drop=True
    )
    rows = split_experiment(loads, seed=0)
    idle, fitted = table[table["kind"] != "load"], loads.iloc[rows.train].reset_index(drop=True)
    judged = loads.iloc[rows.validation].reset_index(drop=True)
    chosen = grid.iloc[split_simulation(grid, seed=0).train]
    lesson = Lesson(simulated=chosen, fitted=fitted, judged=judged, idle=idle, seed=0, baseline=bench.model)
    truth = judged["efficiency"].to_numpy(dtype=np.float64)
    errors = {kind: POINTS * accuracy_of(learned(kind, lesson), truth).mean_abs for kind in KINDS}
    whole = pd.concat([idle, fitted]).sort_values("time_s", ignore_index=True)
    diagnosis = diagnose(load_measurements(whole), bench.model, without=absent_effects(bench.model))
    place = (judged[name].to_numpy(dtype=np.float64) for name in ("D1", "D2", "P2_W"))
    errors[CALIBRATED] = POINTS * accuracy_of(diagnosis.calibrated.predict(*place), truth).mean_abs
    rated_W = bench.model.converter.rated_power_W
    loads_W = rated_W * np.linspace(0.2, 0.9, 8)
    optima = {
        D2EA: optimise(
            train_d2ea(chosen, fitted), loads_W, _mask(bench, loads_W), seed=1, optimiser=PSO_SAVL
        ),
        CALIBRATED: optimise_on_lattice(diagnosis.calibrated.vouched(), loads_W),
    }
    sps = np.stack([np.ones(loads_W.size), np.zeros(loads_W.size), loads_W], axis=1)
    read = {kind: bench.true(np.stack([o.D1, o.D2, o.power_W], axis=1)) for kind, o in optima.items()}
    return Chain(
        hidden=hidden, errors=errors,
        floor=POINTS * float((judged["efficiency"] - judged["true"]).abs().mean()),
        d2ea=optima[D2EA], calibrated=optima[CALIBRATED], read=read | {"sps": bench.true(sps)}, diagnosis=diagnosis,
    )  # fmt: skip


def absent_effects(model: Model) -> list[str]:
    """Effects of parts that a converter does not have."""
    absent = []
    for name, entry in CATALOGUE.items():
        try:
            head = entry.at(model.converter).headline
            model.with_effect(name, **{head.name: head.upper})
        except ParameterError:
            absent.append(name)
    return absent


def _mask(bench: Bench, loads_W: Floats) -> FeasibleMap:
    return FeasibleMap.build(
        lambda D1, D2, power_W: can_run(bench.model, bench.at(np.stack([D1, D2, power_W], axis=1))),
        loads_W, edge_gap=edge_gap_of(bench.model),
    )  # fmt: skip


def _goals(chains: list[Chain]) -> tuple[Goal, ...]:
    def mean(kind: str) -> float:
        return float(np.mean([chain.errors[kind] for chain in chains]))

    gain = np.mean([np.nanmean(c.read[CALIBRATED] - c.read["sps"]) for c in chains])
    return (
        Goal(name="labs in which what is hidden is named, or in the stated group",
             value=100 * float(np.mean([c.found for c in chains])), bar=100.0, at_least=True, unit="%"),
        Goal(name="D²EA's error as a share of experiment only's", value=mean(D2EA) / mean(EXPERIMENT_ONLY), bar=1.0,
             at_least=False),
        Goal(name="calibrated physics, mean error", value=mean(CALIBRATED), bar=CALIBRATED_BAR, at_least=False,
             unit="points"),
        Goal(name="optimal TPS above SPS, mean over loads and labs", value=POINTS * float(gain), bar=0.0,
             at_least=True, unit="points"),
    )  # fmt: skip


def _errors(chains: list[Chain]) -> Table:
    rows: list[tuple[Cell, ...]] = []
    for kind in (*KINDS, CALIBRATED):
        mean, spread = mean_and_spread([chain.errors[kind] for chain in chains])
        rows.append((NAMES[kind], mean, spread))
    rows.append(("noise floor", *mean_and_spread([chain.floor for chain in chains])))
    columns = ("model", "mean |predicted − measured|, points", "± between labs")
    return Table(title="Error on validation points", columns=columns, rows=tuple(rows))


def _diagnoses(chains: list[Chain]) -> Table:
    rows: list[tuple[Cell, ...]] = []
    for chain in chains:
        verdict = chain.diagnosis.verdict
        first = verdict.causes[0] if verdict.causes else None
        rows.append((chain.hidden, verdict.kind, first.effect if first else None,
                     first.probability if first else None, chain.found))  # fmt: skip
    columns = ("hidden", "verdict", "first cause", "probability", "found")
    return Table(title="Diagnosis of each lab", columns=columns, rows=tuple(rows))


def _optima(chain: Chain) -> Table:
    rows = tuple(
        (float(load), float(chain.d2ea.D1[k]), float(chain.d2ea.D2[k]), POINTS * float(chain.d2ea.predicted[k]),
         POINTS * float(chain.read[D2EA][k]), POINTS * float(chain.read[CALIBRATED][k]),
         POINTS * float(chain.read["sps"][k]))
        for k, load in enumerate(chain.d2ea.power_W)
    )  # fmt: skip
    columns = (
        "load, W",
        "D1",
        "D2",
        "D²EA predicts, %",
        "read there, %",
        "calibrated's optimum reads, %",
        "SPS reads, %",
    )
    return Table(title=f"Optimal TPS of the first lab ({chain.hidden} hidden)", columns=columns, rows=rows)


def _picture(chain: Chain) -> Picture:
    figure, (left, right) = panels(1, 2, width_in=8.4, height_in=3.4)
    loads = chain.d2ea.power_W
    for (kind, said), colour, marker in zip(
        ((CALIBRATED, "optimal TPS, calibrated"), (D2EA, "optimal TPS, D²EA"), ("sps", "SPS")), COLOURS, MARKERS,
        strict=False,
    ):  # fmt: skip
        left.plot(loads, POINTS * chain.read[kind], color=colour, marker=marker, ms=4, label=said)
    for column, colour in (("D1", COLOURS[2]), ("D2", COLOURS[3])):
        right.plot(
            loads,
            getattr(chain.calibrated, column),
            color=colour,
            marker="o",
            ms=4,
            label=f"{column}, calibrated",
        )
        right.plot(loads, getattr(chain.d2ea, column), color=colour, ls=":", label=f"{column}, D²EA")
    dress(left, "Efficiency, two-level bridge", "output power (W)", "efficiency (%)")
    dress(right, "Optimal modulation", "output power (W)", "D1, D2 (half periods)")
    legend(left)
    legend(right)
    return picture(
        figure, "optimum", "A 48-V, 100-kHz two-level bridge under TPS: efficiency at the optima, and D1, D2."
    )


EXPERIMENT = Experiment(title="A second converter: a two-level bridge under TPS", run=run)
