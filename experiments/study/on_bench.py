"""Measurements of a study's lab on its bench: mock instruments on real ports, reached through the drivers."""

import tempfile
from pathlib import Path

import pandas as pd

from bench.campaign import Job, measurement_table, run_campaign
from bench.config import BenchConfig, CampaignConfig, check
from bench.store import Store
from drivers.clock import StepClock
from drivers.mocks.plant import Plant
from drivers.mocks.rack import Rack
from experiments.study.labs import Array, laboratory, seed_of


def measured_on_bench(number: int, points: Array, *, name: str) -> pd.DataFrame:
    """A campaign over the wires at (D1, D2, power_W) rows, in their order; the measurement table as stored.

    A point that the bench could not run is absent.
    """
    clock = StepClock()
    plant = Plant(laboratory(number), clock=clock, seed=seed_of(number))
    with tempfile.TemporaryDirectory() as folder, Rack(plant) as rack:
        bench = check(rack.bench_config(), BenchConfig, file="the mock rack")
        job = Job.prepare(_config(points, name, seed_of(number)), bench, file=name)
        with Store(f"sqlite:///{Path(folder) / 'study.sqlite'}") as store:
            outcome = run_campaign(job, store, clock, progress=lambda _: None)
            table = measurement_table(store, outcome)
    return table[table["kind"] == "load"].reset_index(drop=True)


def _config(points: Array, name: str, seed: int) -> CampaignConfig:
    rows = [{"D1": float(a), "D2": float(b), "power_W": float(p)} for a, b, p in points]
    return CampaignConfig.model_validate(
        {
            "name": name,
            "seed": seed,
            "plan": {
                "kind": "points", "set_points": rows, "order": "given",
                "standby": 0, "no_load": 0, "heat_margin": 0.0,
            },
        }
    )  # fmt: skip
