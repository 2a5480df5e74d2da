"""The main loop on the mock bench, start to end, for ``d2ea demo``.

Rack up, simulate the grid while a campaign runs over the wires, diagnose, train, optimise, measure the
optimum, extend the model. What was hidden is looked at only after the verdict is in the database.
"""

import math
import time
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from bench.campaign import CampaignOutcome, Job, Surroundings, measurement_table, run_campaign
from bench.config import BenchConfig, CampaignConfig, check
from bench.demo_beside import LOADS_W, carried_loads, diagnosed, simulated_grid, unseen_points
from bench.errors import InputError
from bench.model_file import rests_on, write_model
from bench.processes import pool_of
from bench.progress import Progress
from bench.store import DEFAULT_URL, Store
from bench.training import efficiency_of
from drivers.clock import StepClock
from drivers.mocks.lab.laboratory import Laboratory
from drivers.mocks.lab.survey import noise_free_efficiency
from drivers.mocks.plant import Plant
from drivers.mocks.rack import Rack
from models.accuracy import accuracy_of
from models.dataset import load_measurements
from models.diagnosis.observations import points_of
from models.feasibility import FeasibleMap
from models.lattice import optimise_on_lattice
from models.optimise import OptimumTable, optimise
from models.pso import PSO_SAVL, PSO_SAVL_POLISHED
from models.splits import split_simulation
from models.surrogate import (
    CALIBRATED,
    D2EA,
    EXPERIMENT_ONLY,
    SIMULATION_ONLY,
    SIMULATOR_FIRST,
    EfficiencyModel,
    train_d2ea,
    train_experiment_only,
    train_simulation_only,
    train_simulator_first,
)
from sim.model import Model
from sim.simulate import Points, simulate

Table = pd.DataFrame
Say = Callable[[str], None]
DATABASE = "demo.sqlite"  # in the folder of results
_OPERATORS = Path(DEFAULT_URL).name  # the database that other verbs make where none is named
_LISTENS_EVERY_S = 0.5  # on the wall: a bench on a stepped clock lives through minutes of its own meanwhile


@dataclass(frozen=True, slots=True, kw_only=True)
class DemoPlan:
    """What to run: rows, the seed of lab and plan, what to hide (empty: nothing), and where results go."""

    out: Path
    points: int
    seed: int
    hidden: Mapping[str, float | None]


@dataclass(slots=True)
class Stopwatch:
    """Seconds by step, in the order they were taken."""

    seconds: dict[str, float] = field(default_factory=dict)

    @contextmanager
    def step(self, name: str) -> Iterator[None]:
        """Time one step."""
        started = time.perf_counter()
        try:
            yield
        finally:
            self.seconds[name] = self.seconds.get(name, 0.0) + time.perf_counter() - started


@dataclass(frozen=True, slots=True, kw_only=True)
class DemoResult:
    """All that the report and the summary are made of."""

    bench: BenchConfig
    simulation: Table
    measurements: Table
    losses: Table
    optimum: OptimumTable
    searches: tuple[OptimumTable, ...]
    optimum_measured: dict[float, float]
    diagnosis: dict[str, Any]
    error: dict[str, float | None]
    hidden: dict[str, float]
    found: bool
    power_off: str
    campaigns: tuple[CampaignOutcome, ...]
    seconds: dict[str, float]


def fresh_database(folder: Path) -> Path:
    """Where the campaigns of a demo go; the ones of an earlier demo are gone.

    Raises InputError where somebody keeps measurements of their own.
    """
    if (folder / _OPERATORS).exists():
        allowed = f"holds measurements in {_OPERATORS}; name another folder, or move that file away"
        raise InputError.of("command line", "--out", str(folder), allowed)
    for end in ("", "-wal", "-shm"):
        (folder / f"{DATABASE}{end}").unlink(missing_ok=True)
    return folder / DATABASE


def run_demo(plan: DemoPlan, *, say: Say, progress: Callable[[Progress], None]) -> DemoResult:
    """Run the whole loop; the bench is off when this returns, and when it raises.

    Raises InputError, before anything runs, where the results would stand among somebody's own measurements.
    """
    watch = Stopwatch()
    started = time.perf_counter()
    with watch.step("setup"):
        clock = StepClock()
        plant = Plant.virtual(seed=plan.seed, hidden=plan.hidden, clock=clock)
        plan.out.mkdir(parents=True, exist_ok=True)
        database = fresh_database(plan.out)
    with pool_of(1) as workers, Rack(plant) as rack, Store(f"sqlite:///{database}") as store:
        simulating = workers.submit(simulated_grid)
        mapping, drawing = workers.submit(carried_loads), workers.submit(unseen_points, plan.seed)
        bench = check(rack.bench_config(), BenchConfig, file="the mock rack")
        say(f"campaign of {plan.points} points over the wires, 12,500 simulated points beside it")
        with watch.step("campaign"):
            outcome = _campaign(_map_campaign(plan), bench, store, clock, progress)
        measured = measurement_table(store, outcome)
        simulation, watch.seconds["simulate"] = simulating.result()
        say("diagnosing in a second process; training meanwhile")
        diagnosing = workers.submit(diagnosed, measured, plan.seed)
        with watch.step("train"):
            models = _train(simulation, measured, plan.seed)
        with watch.step("optimise"):
            searches = _search(models[D2EA], mapping.result(), plan.seed)
        diagnosis, watch.seconds["diagnose"] = diagnosing.result()
        models[CALIBRATED] = diagnosis.calibrated
        with watch.step("optimise"):
            optimum = _optimum(diagnosis.calibrated.vouched(), workers)
        say("measuring the optimum over load")
        with watch.step("campaign"):
            verification = _campaign(_optimum_campaign(optimum, plan.seed), bench, store, clock, progress)
        plain = diagnosis.as_plain(str(plan.out / "model.toml"))
        source = f"campaign {outcome.campaign_id}"
        write_model(plan.out / "model.toml", diagnosis.extended, rests_on(plain, measured, source))
        store.add_diagnosis(plain, campaign_id=outcome.campaign_id)
        say("verdict stored; now looking at what was hidden")
        hidden = plant.laboratory.hidden
        with watch.step("judge"):
            error = judged(models, plant.laboratory, drawing.result())
        verified = measurement_table(store, verification)
    watch.seconds["total"] = time.perf_counter() - started
    return DemoResult(
        bench=bench,
        simulation=simulation,
        measurements=_beside_simulation(measured),
        losses=_losses_at(optimum),
        optimum=optimum,
        searches=searches,
        optimum_measured=_by_load(verified),
        diagnosis=plain,
        error=error,
        hidden=hidden,
        found=was_found(plain, hidden),
        power_off=str(verification.power_off),
        campaigns=(outcome, verification),
        seconds=watch.seconds,
    )


def _campaign(
    config: CampaignConfig,
    bench: BenchConfig,
    store: Store,
    clock: StepClock,
    progress: Callable[[Progress], None],
) -> CampaignOutcome:
    job = Job.prepare(config, bench, file=config.name)
    return run_campaign(job, store, clock, progress=progress, around=Surroundings(listens=_now_and_then()))


def _now_and_then() -> Callable[[], bool]:
    """True at most once in half a second on the wall."""
    last_s = -math.inf

    def listens() -> bool:
        nonlocal last_s
        now_s = time.perf_counter()
        if now_s - last_s < _LISTENS_EVERY_S:
            return False
        last_s = now_s
        return True

    return listens


def _map_campaign(plan: DemoPlan) -> CampaignConfig:
    return CampaignConfig.model_validate(
        {
            "name": "demo map",
            "seed": plan.seed,
            "plan": {"kind": "latin_hypercube", "points": plan.points, "reference_every": 12},
        }
    )


def _optimum_campaign(optimum: OptimumTable, seed: int) -> CampaignConfig:
    rows = zip(optimum.D1, optimum.D2, optimum.power_W, strict=True)
    points = [{"D1": float(a), "D2": float(b), "power_W": float(p)} for a, b, p in rows if np.isfinite(a)]
    return CampaignConfig.model_validate(
        {
            "name": "demo optimum",
            "seed": seed,
            "plan": {
                "kind": "points", "set_points": points, "order": "given",
                "standby": 0, "no_load": 0, "heat_margin": 0.0, "power_margin": 0.0,
            },
        }
    )  # fmt: skip


def _train(simulation: Table, measured: Table, seed: int) -> dict[str, EfficiencyModel]:
    """The four models; XGBoost-I on 10 % of the feasible simulated points, all measured points fitted."""
    feasible = simulation[simulation["feasible"].astype(bool)].reset_index(drop=True)
    chosen = feasible.iloc[split_simulation(feasible, seed=seed).train]
    loaded = load_measurements(measured).loaded()
    return {
        SIMULATION_ONLY: train_simulation_only(chosen),
        EXPERIMENT_ONLY: train_experiment_only(loaded),
        D2EA: train_d2ea(chosen, loaded),
        SIMULATOR_FIRST: train_simulator_first(efficiency_of(Model.baseline()), loaded),
    }


def _search(model: EfficiencyModel, mask: FeasibleMap, seed: int) -> tuple[OptimumTable, ...]:
    """The swarm's optimum of a model made of trees: with restarts and a polish, and at the paper's budget."""
    return tuple(
        optimise(model, LOADS_W, mask, seed=seed, optimiser=o) for o in (PSO_SAVL_POLISHED, PSO_SAVL)
    )


def _optimum(model: EfficiencyModel, workers: ProcessPoolExecutor) -> OptimumTable:
    """The optimum of the simulator as a model, every other load in the second process."""
    others = workers.submit(optimise_on_lattice, model, LOADS_W[1::2])
    return optimise_on_lattice(model, LOADS_W[::2]).with_loads_of(others.result())


def judged(models: Mapping[str, EfficiencyModel], lab: Laboratory, p: Points) -> dict[str, float | None]:
    """Mean absolute error of each model against the lab's noise-free reading at unseen points."""
    D1, D2, power = (np.asarray(x) for x in (p.D1, p.D2, p.power_W))
    truth = noise_free_efficiency(lab, D1, D2, power)
    predicted = {name: np.asarray(model.predict(D1, D2, power)) for name, model in models.items()}
    return {name: accuracy_of(value, truth).mean_abs for name, value in predicted.items()}


def was_found(diagnosis: Mapping[str, Any], hidden: Mapping[str, float]) -> bool:
    """Whether every hidden effect is named or in a stated group; with nothing hidden: whether nothing is stated."""
    if not hidden:
        return bool(diagnosis["verdict"] == "consistent")
    stated = {*diagnosis["named"], *(name for group in diagnosis["groups"] for name in group)}
    return stated >= set(hidden)


def _beside_simulation(measured: Table) -> Table:
    """The measurement table with what the baseline says of every channel beside it."""
    result = simulate(
        Model.baseline(), points_of(load_measurements(measured).frame, Model.baseline().converter)
    )
    table = load_measurements(measured).frame.copy()
    for name in ("efficiency", "D0", "P1_W", "I_L_rms_A", "P_link1_W", "P_link2_W",
                 "T_heatsink_C", "T_transformer_C", "T_inductor_C"):  # fmt: skip
        if name in table:
            table[f"sim_{name}"] = result[name]
    return table


def _losses_at(optimum: OptimumTable) -> Table:
    """The baseline's loss parts at the optimum over load."""
    known = np.isfinite(optimum.D1)
    points = Points(D1=optimum.D1[known], D2=optimum.D2[known], power_W=optimum.power_W[known])
    table = pd.DataFrame(simulate(Model.baseline(), points).columns())
    return table[[c for c in table if c == "P_set_W" or str(c).startswith("loss_")]]


def _by_load(verified: Table) -> dict[float, float]:
    """Measured efficiency by set power."""
    rows = verified[verified["kind"] == "load"]
    return {float(p): float(e) for p, e in zip(rows["P_set_W"], rows["efficiency"], strict=True)}


def _swarm(table: OptimumTable) -> dict[str, Any]:
    """A search in the summary, null where a load is carried nowhere: JSON has no NaN."""
    (regret,), D1, D2 = (
        [x if np.isfinite(x) else None for x in found]
        for found in ([table.worst_regret], table.D1.tolist(), table.D2.tolist())
    )
    return {
        "model": D2EA,
        "name": table.optimiser,
        "evaluations": table.evaluations,
        "regret": regret,
        "D1": D1,
        "D2": D2,
    }


def summary_of(result: DemoResult) -> dict[str, Any]:
    """The content of summary.json."""
    seconds = {name: round(value, 3) for name, value in result.seconds.items()}
    o = result.optimum
    return {
        "virtual_lab": True,
        "points": result.campaigns[0].accepted,
        "sim_points": len(result.simulation),
        "sim_feasible": int(result.simulation["feasible"].sum()),
        "seconds": seconds,
        "error": result.error,
        "optimum": [
            {"P_W": float(p), "D1": float(a), "D2": float(b), "predicted": float(e),
             "measured": result.optimum_measured.get(float(p))}
            for p, a, b, e in zip(o.power_W, o.D1, o.D2, o.predicted, strict=True) if np.isfinite(a)
        ],
        "optimiser": {"model": CALIBRATED, "name": o.optimiser, "evaluations": o.evaluations, "regret": None},
        "swarm": [_swarm(table) for table in result.searches],
        "diagnosis": result.diagnosis,
        "hidden": list(result.hidden),
        "hidden_values": result.hidden,
        "found": result.found,
        "power_off": result.power_off,
    }  # fmt: skip
