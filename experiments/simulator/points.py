"""Random operating points that run, and what a part of the benchmark hands back."""

from dataclasses import dataclass

import numpy as np

from experiments.harness.result import Goal, Table
from sim.model import Model
from sim.operating_points import Points
from sim.simulate import simulate

D1_RANGE, D2_RANGE, POWER_RANGE_W = (0.2, 1.0), (0.0, 0.7), (200.0, 2000.0)
_BATCH = 400


@dataclass(frozen=True, slots=True, kw_only=True)
class Findings:
    """Goals, tables and notes of one part."""

    goals: tuple[Goal, ...] = ()
    tables: tuple[Table, ...] = ()
    notes: tuple[str, ...] = ()


def drawn_points(
    count: int, rng: np.random.Generator, power_W: tuple[float, float] = POWER_RANGE_W
) -> Points:
    """Points uniform in D1, D2 and power, feasible or not."""
    D1, D2, P = (rng.uniform(*r, count) for r in (D1_RANGE, D2_RANGE, power_W))
    return Points(D1=D1, D2=D2, power_W=P)


def running_points(
    count: int, rng: np.random.Generator, power_W: tuple[float, float] = POWER_RANGE_W
) -> Points:
    """The first so many of drawn points that the baseline can run."""
    found: list[Points] = []
    while sum(map(len, found)) < count:
        batch = drawn_points(_BATCH, rng, power_W)
        found.append(batch.take(np.flatnonzero(simulate(Model.baseline(), batch).feasible)))
    return Points.join(found).take(np.arange(count))


def at_most(name: str, value: float, bar: float, unit: str = "") -> Goal:
    """A goal that a value must not exceed."""
    return Goal(name=name, value=float(value), bar=bar, at_least=False, unit=unit)


def at_least(name: str, value: float, bar: float, unit: str = "") -> Goal:
    """A goal that a value must reach."""
    return Goal(name=name, value=float(value), bar=bar, at_least=True, unit=unit)
