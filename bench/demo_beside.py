"""What the demo's second process works out: the grid and all else that needs no measurement while the bench measures,
then the diagnosis while the first process trains.

It loads neither the virtual lab nor the instruments.
"""

import time

import numpy as np
import pandas as pd

from bench.training import feasible_map
from models.dataset import load_measurements
from models.diagnosis.diagnose import Diagnosis, diagnose
from models.feasibility import FeasibleMap
from sim.model import Model
from sim.simulate import Points, grid, simulate

Table = pd.DataFrame

LOADS_W = np.arange(200.0, 2001.0, 100.0)
_UNSEEN = 300  # points on which every model is judged; none of them was measured
_FEASIBLE_SHARE = 0.35  # of the box that they are drawn from; where it is less, more are drawn


def simulated_grid() -> tuple[Table, float]:
    """The 12,500-point table of the baseline, and the seconds it took."""
    started = time.perf_counter()
    table = pd.DataFrame(simulate(Model.baseline(), grid()).columns())
    return table, time.perf_counter() - started


def carried_loads() -> FeasibleMap:
    """Where in (D1, D2) the baseline carries each load."""
    return feasible_map(Model.baseline(), LOADS_W)


def unseen_points(seed: int) -> Points:
    """Set points that were not measured, feasible for the baseline as those of the campaign are."""
    rng = np.random.default_rng([seed, 4])
    size = int(_UNSEEN / _FEASIBLE_SHARE)
    found = np.empty((3, 0))
    while found.shape[1] < _UNSEEN:
        drawn = np.stack([rng.uniform(*ends, size) for ends in ((0.3, 1.0), (0.0, 0.6), (200.0, 2000.0))])
        D1, D2, power_W = drawn
        runs = simulate(Model.baseline(), Points(D1=D1, D2=D2, power_W=power_W)).feasible
        found = np.hstack([found, drawn[:, runs]])
    D1, D2, power_W = found[:, :_UNSEEN]
    return Points(D1=D1, D2=D2, power_W=power_W)


def diagnosed(frame: Table, seed: int) -> tuple[Diagnosis, float]:
    """The diagnosis of a measurement table, and the seconds it took."""
    started = time.perf_counter()
    return diagnose(load_measurements(frame), seed=seed), time.perf_counter() - started
