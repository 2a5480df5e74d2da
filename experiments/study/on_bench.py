"""Measurements of a study's lab on its bench: mock instruments on real ports, reached through the drivers."""

import tempfile
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from bench.campaign import Job, measurement_table, run_campaign
from bench.config import BenchConfig, CampaignConfig, check
from bench.store import Store
from drivers.clock import StepClock
from drivers.mocks.plant import Plant
from drivers.mocks.rack import Rack
from experiments.study.labs import Array, laboratory, seed_of


def measured_on_bench(number: int, points: Array, *, name: str, modulation: str = "hybrid") -> pd.DataFrame:
    """A campaign over the wires at (D1, D2, power_W) rows, in their order; the measurement table as stored.

    Only the bench file says which modulation it is. A point that the bench could not run is absent.
    """
    clock = StepClock()
    plant = Plant(laboratory(number), clock=clock, seed=seed_of(number))
    with tempfile.TemporaryDirectory() as folder, Rack(plant) as rack:
        bench = check(_bench(rack, modulation), BenchConfig, file="the mock rack")
        job = Job.prepare(_config(points, name, seed_of(number)), bench, file=name)
        with Store(f"sqlite:///{Path(folder) / 'study.sqlite'}") as store:
            outcome = run_campaign(job, store, clock, progress=lambda _: None)
            table = measurement_table(store, outcome)
    return table[table["kind"] == "load"].reset_index(drop=True)


def bench_seconds_a_point() -> float:
    """What a point takes on a bench's own clock by the usual settings: settling at the least, and averaging."""
    probe = np.array([[0.9, 0.1, 600.0], [0.8, 0.1, 900.0], [0.9, 0.05, 400.0]])
    table = measured_on_bench(0, probe, name="the bench's clock")
    return float(np.diff(table["time_s"]).mean())


def _bench(rack: Rack, modulation: str) -> dict[str, Any]:
    """The rack's bench file, with a start that every modulation has."""
    written: dict[str, Any] = rack.bench_config()
    converter = written["converter"] | {"modulation": modulation, "start_D1": 1.0, "start_D2": 0.0}
    return written | {"converter": converter}


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
