"""A campaign whose rows are chosen: points far from each other first, then those that decide where the optimum is.

They are chosen as by an adaptive plan of the bench (:mod:`models.space_filling`, :mod:`models.rival_hills`), the last
ones from what was measured before and nothing else. A round of them goes on in time where the rows before it ended.
"""

from functools import lru_cache
from itertools import islice

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from drivers.mocks.lab.laboratory import Laboratory
from drivers.mocks.lab.survey import Schedule, schedule, survey
from experiments.harness.lab_data import REFERENCE_EVERY, random_set_points
from models.calibrated import CalibratedPhysics
from models.dataset import load_measurements
from models.diagnosis.diagnose import Diagnosis, diagnose
from models.rival_hills import RivalHills
from models.space_filling import farthest

Array = NDArray[np.float64]

_MANY = 1000  # random points, of which the first are taken
_SHARE, _MOST = 0.5, 128  # of the points are chosen where the optimum is decided
_ROUNDS = 9
DESIGN = 29
_ANOTHER = 1_000_000  # between the seeds of the noise of one round and the next


def _count(size: int) -> int:
    """So many points that with their references there are ``size`` rows at most."""
    return next(n for n in range(size, 0, -1) if n + -(-n // REFERENCE_EVERY) <= size)


def _random(count: int) -> Array:
    """Random points (count, 3), the first with power to spare: the reference."""
    return random_set_points(count, np.random.default_rng([DESIGN, 10]))


@lru_cache(maxsize=2)
def _apart(count: int) -> Array:
    """Points (count, 3) far from each other, of many random ones; the reference is the first."""
    many = _random(_MANY)
    others = islice(farthest(many, many[:1], np.ptp(many, axis=0)), count - 1)
    return many[[0, *others]]


def _schedule(points: Array) -> Schedule:
    """Standby, no load, and points (N, 3) with their references."""
    D1, D2, power_W = points.T
    return schedule(D1, D2, power_W, reference_every=REFERENCE_EVERY)


def campaign(size: int) -> Schedule:
    """A campaign of random points."""
    return _schedule(_random(_count(size)))


def measured(lab: Laboratory, size: int, loads_W: Array, *, seed: int) -> Diagnosis:
    """What the diagnosis makes of a lab after ``size`` rows with load, the last of them chosen for its optimum.

    It lasts as long as the campaign of random points of that size.
    """
    count = _count(size)
    each = round(min(_SHARE * count, _MOST) / _ROUNDS)
    points = _apart(count - _ROUNDS * each)
    table = survey(lab, _schedule(points), seed=seed)
    for turn in range(1, _ROUNDS + 1):
        chosen = _deciding(diagnose(load_measurements(table)).calibrated, loads_W, points, each)
        points = np.concatenate([points, chosen])
        whole = survey(lab, _schedule(points), seed=seed + _ANOTHER * turn)
        table = pd.concat([table, whole[whole["time_s"] > table["time_s"].max()]], ignore_index=True)
    return diagnose(load_measurements(table))


def _deciding(model: CalibratedPhysics, loads_W: Array, tried: Array, count: int) -> Array:
    """So many points (count, 3) that decide the optimum: loads that may be carried, then hills that may be highest."""
    may = model.worth_a_try(loads_W)
    untried = may[~np.any(np.all(may[:, None] == tried, axis=2), axis=1)][:count]
    rivals = RivalHills.of(model, loads_W)
    return np.concatenate([untried, rivals.place[rivals.chosen(count - len(untried))]])
