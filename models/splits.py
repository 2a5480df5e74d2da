"""Which rows train and which judge: seeded random splits (whole blocks are held out by :mod:`models.held_blocks`).

A random split asks how well a model interpolates; a block asks whether it holds where it was not fitted.
Repeated readings of one set point always stay together: noise shared by a fit and its judge flatters both.
"""

from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from models.set_points import set_power, together

Rows = NDArray[np.intp]

SIMULATION_SHARES = (0.1, 0.2, 0.7)  # train, test, validation (Table III)
EXPERIMENT_SHARES = (0.4, 0.2, 0.4)
SAME_POWER = 0.02


@dataclass(frozen=True, slots=True, kw_only=True)
class Split:
    """Row numbers of the three sets; together every row once."""

    train: Rows
    test: Rows
    validation: Rows


def split(groups: NDArray[np.generic], shares: tuple[float, float, float], *, seed: int) -> Split:
    """Split rows (N,) at random, whole groups at a time; counts are rounded to the shares of the groups.

    Raises ValueError when the shares do not add up to 1.
    """
    if min(shares) < 0 or abs(sum(shares) - 1) > 1e-9:
        raise ValueError(f"the shares of a split are {shares}; they must be at least 0 and add up to 1")
    names, member = np.unique(groups, return_inverse=True)
    order = np.random.default_rng(seed).permutation(len(names))
    first, second = (round(len(names) * share) for share in (shares[0], shares[0] + shares[1]))
    part = np.full(len(names), 2)
    part[order[:second]] = 1
    part[order[:first]] = 0
    train, test, validation = (np.flatnonzero(part[member] == k) for k in range(3))
    return Split(train=train, test=test, validation=validation)


def split_simulation(simulated: pd.DataFrame, *, seed: int) -> Split:
    """10/20/70 % of a simulation table's rows; hand in the feasible rows only."""
    return split(np.arange(len(simulated)), SIMULATION_SHARES, seed=seed)


def split_experiment(measured: pd.DataFrame, *, seed: int) -> Split:
    """40/20/40 % of a measurement table's set points."""
    return split(set_points(measured), EXPERIMENT_SHARES, seed=seed)


def set_points(measured: pd.DataFrame) -> Rows:
    """A number per row that repeated readings of one set point share.

    Rows of equal D1 and D2 (to 4 decimals) belong together where their set power is the same, or, where none was
    noted, their powers lie within 2 %: further than a set power's readings scatter.
    """
    keys = [measured[name].round(4) for name in ("D1", "D2")]
    power = set_power(measured, np.exp(together(np.log(measured["P2_W"]), keys, SAME_POWER)))
    return np.asarray(measured.groupby([*keys, power], dropna=False).ngroup(), dtype=np.intp)
