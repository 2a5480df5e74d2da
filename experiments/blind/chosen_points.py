"""A campaign whose last rows are chosen: random points first, then those that decide where the optimum is.

They are chosen as by an adaptive plan of the bench (:mod:`models.rival_hills`), from what was measured before and
nothing else. A round of them goes on in time where the rows before it ended.
"""

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from drivers.mocks.lab.laboratory import Laboratory
from drivers.mocks.lab.survey import Schedule, schedule, survey
from experiments.harness.lab_data import REFERENCE_EVERY, random_set_points
from models.dataset import load_measurements
from models.diagnosis.diagnose import Diagnosis, diagnose
from models.rival_hills import RivalHills

Array = NDArray[np.float64]

_SHARE, _MOST = 0.4, 128  # of the points are chosen
_ROUNDS = 7
DESIGN = 29
_ANOTHER = 1_000_000  # between the seeds of the noise of one round and the next


def _set_points(size: int) -> Array:
    """Random points (count, 3): so many that with their references there are ``size`` rows at most."""
    count = next(n for n in range(size, 0, -1) if n + -(-n // REFERENCE_EVERY) <= size)
    return random_set_points(count, np.random.default_rng([DESIGN, 10]))


def _schedule(points: Array) -> Schedule:
    """Standby, no load, and points (N, 3) with their references."""
    D1, D2, power_W = points.T
    return schedule(D1, D2, power_W, reference_every=REFERENCE_EVERY)


def campaign(size: int) -> Schedule:
    """A campaign of random points."""
    return _schedule(_set_points(size))


def measured(lab: Laboratory, size: int, loads_W: Array, *, seed: int) -> Diagnosis:
    """What the diagnosis makes of a lab after ``size`` rows with load, the last of them chosen for its optimum.

    It lasts as long as the campaign of random points of that size.
    """
    everything = _set_points(size)
    each = round(min(_SHARE * len(everything), _MOST) / _ROUNDS)
    points = everything[: len(everything) - _ROUNDS * each]
    table = survey(lab, _schedule(points), seed=seed)
    for turn in range(1, _ROUNDS + 1):
        rivals = RivalHills.of(diagnose(load_measurements(table)).calibrated, loads_W)
        points = np.concatenate([points, rivals.place[rivals.chosen(each)]])
        whole = survey(lab, _schedule(points), seed=seed + _ANOTHER * turn)
        table = pd.concat([table, whole[whole["time_s"] > table["time_s"].max()]], ignore_index=True)
    return diagnose(load_measurements(table))
