"""The best modulation over load: D1 and D2 of highest predicted efficiency, with the search's regret."""

from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike

from models.boosting import Floats
from models.exhaustive import ensembles, exact_optimum
from models.feasibility import Bools, Feasible, FeasibleMap
from models.pso import PSO_SAVL, Optimiser
from models.surrogate import EfficiencyModel


@dataclass(frozen=True, slots=True, kw_only=True)
class OptimumTable:
    """Best modulation per load, all (L,).

    ``predicted`` is the model's efficiency there. ``regret`` is how much better the model's exact optimum
    is (fraction of efficiency), NaN for a model that is not made of trees alone. ``confirmed`` is the
    simulator's own word that the point carries its load. Loads that nothing carries have NaN throughout.
    """

    power_W: Floats
    D1: Floats
    D2: Floats
    predicted: Floats
    regret: Floats
    confirmed: Bools
    optimiser: str
    evaluations: int

    @property
    def worst_regret(self) -> float:
        """The largest regret over the loads; NaN when it is known for none."""
        known = self.regret[np.isfinite(self.regret)]
        return float(known.max()) if len(known) else float("nan")

    def with_loads_of(self, other: Self) -> Self:
        """One table of the loads of two that were searched alike, in the order of power."""
        order = np.argsort(np.concatenate([self.power_W, other.power_W]))

        def both(name: str) -> Any:
            return np.concatenate([getattr(self, name), getattr(other, name)])[order]

        names = ("power_W", "D1", "D2", "predicted", "regret", "confirmed")
        return replace(self, **{name: both(name) for name in names})

    def frame(self) -> pd.DataFrame:
        """One row per load."""
        names = ("power_W", "D1", "D2", "predicted", "regret", "confirmed")
        return pd.DataFrame({name: getattr(self, name) for name in names})


@dataclass(frozen=True, slots=True, kw_only=True)
class LoadProblems:
    """One problem per load: the model's efficiency over (D1, D2), -inf where the load is not carried."""

    model: EfficiencyModel
    feasible: FeasibleMap
    loads: tuple[int, ...]

    @property
    def count(self) -> int:
        """How many loads."""
        return len(self.loads)

    def allowed(self, x: Floats) -> Bools:
        """Whether points (count, n, 2) carry their loads."""
        return self.feasible.allowed(x[..., 0], x[..., 1], np.asarray(self.loads)[:, None])

    def value(self, x: Floats) -> Floats:
        """Predicted efficiency of points (count, n, 2), in one call of the model."""
        D1, D2 = self.feasible.snap(x[..., 0], x[..., 1])
        power_W = self.feasible.loads_W[list(self.loads)][:, None]
        efficiency = self.model.predict(D1, D2, power_W)
        return np.where(self.allowed(x) & np.isfinite(efficiency), efficiency, -np.inf)

    def one(self, number: int) -> Self:
        """The problem of one load."""
        return type(self)(model=self.model, feasible=self.feasible, loads=(self.loads[number],))


def optimise(
    model: EfficiencyModel,
    loads_W: ArrayLike,
    feasible: Feasible | FeasibleMap,
    *,
    seed: int,
    optimiser: Optimiser = PSO_SAVL,
) -> OptimumTable:
    """Search D1 and D2 of highest predicted efficiency at each load.

    Parameters
    ----------
    loads_W : output powers (L,), W
    feasible : the simulator's mask; hand in a ``FeasibleMap`` of the same loads to use it for several models
    seed : of the search
    """
    mask = _mask(feasible, loads_W)
    problems = LoadProblems(model=model, feasible=mask, loads=tuple(range(len(mask.loads_W))))
    found = optimiser.maximise(problems, seed=seed)
    reached = np.isfinite(found.value)
    D1, D2 = (np.where(reached, x, np.nan) for x in mask.snap(found.x[:, 0], found.x[:, 1]))
    predicted = np.where(reached, found.value, np.nan)
    exact = exact_optimum(model, mask).value if ensembles(model) else np.full(len(reached), np.nan)
    return OptimumTable(
        power_W=mask.loads_W,
        D1=D1,
        D2=D2,
        predicted=predicted,
        regret=exact - predicted,
        confirmed=_confirmed(mask, D1, D2),
        optimiser=optimiser.name,
        evaluations=found.evaluations,
    )


def optimise_exactly(
    model: EfficiencyModel, loads_W: ArrayLike, feasible: Feasible | FeasibleMap
) -> OptimumTable:
    """The same table from the exact optimum of a model made of trees alone: no search, no regret."""
    mask = _mask(feasible, loads_W)
    best = exact_optimum(model, mask)
    return OptimumTable(
        power_W=mask.loads_W,
        D1=best.D1,
        D2=best.D2,
        predicted=best.value,
        regret=np.where(np.isfinite(best.value), 0.0, np.nan),
        confirmed=_confirmed(mask, best.D1, best.D2),
        optimiser="exact: every cell of the trees",
        evaluations=best.cells // len(mask.loads_W),
    )


def _mask(feasible: Feasible | FeasibleMap, loads_W: ArrayLike) -> FeasibleMap:
    loads = np.atleast_1d(np.asarray(loads_W, dtype=np.float64))
    mask = feasible if isinstance(feasible, FeasibleMap) else FeasibleMap.build(feasible, loads)
    if not np.array_equal(mask.loads_W, loads):
        raise ValueError(f"the feasible map was built for {mask.loads_W} W, not for {loads} W")
    return mask


def _confirmed(mask: FeasibleMap, D1: Floats, D2: Floats) -> Bools:
    reached = np.isfinite(D1)
    out = np.zeros(len(D1), dtype=bool)
    out[reached] = mask.confirm(D1[reached], D2[reached], mask.loads_W[reached])
    return out
