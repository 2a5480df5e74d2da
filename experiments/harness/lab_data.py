"""Measurement tables of virtual labs, at random set points that the baseline simulation can carry."""

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from drivers.mocks.lab.laboratory import Laboratory
from drivers.mocks.lab.survey import schedule, survey
from sim.model import Model
from sim.simulate import Points, can_run

Array = NDArray[np.float64]

D1_RANGE, D2_RANGE, POWER_RANGE_W = (0.3, 1.0), (0.0, 0.6), (200.0, 2000.0)
REFERENCE_SPARE = 0.12  # of the power: the reference point shall run in whatever lab is drawn
REFERENCE_EVERY = 8
_BATCH = 64


def random_set_points(count: int, rng: np.random.Generator) -> Array:
    """Feasible (D1, D2, power_W) rows (count, 3), uniform in their ranges; the first has power to spare."""
    reference = _drawn(1, REFERENCE_SPARE, rng)
    return np.concatenate([reference, _drawn(count - 1, 0.0, rng)])


def _drawn(count: int, spare: float, rng: np.random.Generator) -> Array:
    found = np.empty((0, 3))
    while len(found) < count:
        batches = [_batch(rng) for _ in range(1 + 2 * (count - len(found)) // _BATCH)]
        drawn = np.concatenate(batches)
        D1, D2, power_W = drawn.T
        runs = can_run(Model.baseline(), Points(D1=D1, D2=D2, power_W=(1 + spare) * power_W))
        found = np.concatenate([found, drawn[runs]])
    return found[:count]


def _batch(rng: np.random.Generator) -> Array:
    return np.stack([rng.uniform(*r, _BATCH) for r in (D1_RANGE, D2_RANGE, POWER_RANGE_W)], axis=1)


def measured_table(lab: Laboratory, count: int, *, seed: int) -> pd.DataFrame:
    """A campaign of ``count`` random points in a lab, with standby, no load and a reference every eight."""
    D1, D2, power_W = random_set_points(count, np.random.default_rng([seed, 10])).T
    return survey(lab, schedule(D1, D2, power_W, reference_every=REFERENCE_EVERY), seed=seed)
