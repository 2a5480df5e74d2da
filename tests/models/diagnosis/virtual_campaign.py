"""Campaigns for the tests: measured in a virtual lab, or made by the simulator itself."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.stats import qmc

from drivers.mocks.lab.laboratory import Laboratory
from drivers.mocks.lab.survey import schedule, survey
from models.dataset import Measurements, load_measurements
from models.diagnosis.diagnose import Diagnosis, diagnose
from models.diagnosis.onset import Onset
from sim.model import Model
from sim.simulate import Points, simulate

Array = NDArray[np.float64]
COLUMNS = (
    "D0", "P1_W", "P2_W", "efficiency", "I_L_rms_A", "P_link1_W", "P_link2_W",
    "T_heatsink_C", "T_transformer_C", "T_inductor_C",
)  # fmt: skip


def set_points(count: int, seed: int) -> tuple[Array, Array, Array]:
    """D1, D2 and power of so many points of a Latin hypercube that the baseline can carry."""
    low, high = np.array([0.4, 0.0, 200.0]), np.array([1.0, 0.5, 1800.0])
    unit = qmc.LatinHypercube(d=3, rng=np.random.default_rng(seed)).random(3 * count)
    D1, D2, power = (low + unit * (high - low)).T
    kept = np.flatnonzero(simulate(Model.baseline(), Points(D1=D1, D2=D2, power_W=power)).feasible)[:count]
    return D1[kept], D2[kept], power[kept]


def lab_table(
    hidden: Mapping[str, float | None], *, seed: int, count: int = 60, supply_V: float = 300.0
) -> pd.DataFrame:
    """What the instruments of a virtual lab show of a whole campaign, in random order."""
    lab, plan = Laboratory.draw(seed=seed, hidden=hidden), schedule(*set_points(count, seed))
    return survey(lab, replace(plan, supply_V=supply_V), seed=seed)


def lab_campaign(hidden: Mapping[str, float | None], *, seed: int, count: int = 60) -> Measurements:
    """The same, loaded."""
    return load_measurements(lab_table(hidden, seed=seed, count=count))


def seen(frame: pd.DataFrame) -> Diagnosis:
    """What the diagnosis says of a table."""
    return diagnose(load_measurements(frame))


def onset_of(found: Diagnosis) -> Onset:
    """What is not there all the time."""
    assert found.unexplained is not None
    assert found.unexplained.onset is not None
    return found.unexplained.onset


def simulated_campaign(model: Model, *, seed: int, count: int = 60, every_s: float = 180.0) -> pd.DataFrame:
    """What a model says of a campaign, without any noise, every fifth row measured twice."""
    D1, D2, power = set_points(count, seed)
    order = np.sort(np.concatenate([np.arange(D1.size), np.arange(0, D1.size, 5)]))
    D1, D2, power, time_s = D1[order], D2[order], power[order], every_s * np.arange(order.size)
    result = simulate(model, Points(D1=D1, D2=D2, power_W=power, time_s=time_s))
    frame = pd.DataFrame({name: result[name] for name in COLUMNS})
    frame = frame.assign(kind="load", D1=D1, D2=D2, time_s=time_s)
    return frame[result.feasible].reset_index(drop=True)
