"""The best modulation of a model that is not made of trees: a lattice over (D1, D2), refined around its best.

The simulator as a model costs a solution per point, so a swarm that asks for a few hundred at a time is slow;
one large lattice in one call and a few small ones around each load's best are fast and miss only a second,
narrower hill.
"""

import numpy as np

from models.boosting import Floats
from models.optimise import OptimumTable
from models.surrogate import EfficiencyModel

_FIRST = 26  # nodes along D1 and along D2: steps of 0.04
_AROUND = np.linspace(-1.0, 1.0, 5)
_ROUNDS = 3
_NARROWER = 0.4


def optimise_on_lattice(model: EfficiencyModel, loads_W: Floats) -> OptimumTable:
    """D1 and D2 of the highest predicted efficiency at each load (L,); NaN where nothing carries it.

    ``regret`` is NaN: there is no exact optimum to compare with. The model's own NaN marks what cannot run.
    """
    loads = np.asarray(loads_W, dtype=np.float64)
    nodes = np.linspace(0.0, 1.0, _FIRST)
    D1, D2 = (x.ravel() for x in np.meshgrid(nodes, nodes, indexing="ij"))
    best, (first, second), evaluations = _best(
        model, loads, np.tile(D1, (loads.size, 1)), np.tile(D2, (loads.size, 1))
    )
    step = nodes[1]
    for _ in range(_ROUNDS):
        near = np.stack(np.meshgrid(_AROUND, _AROUND, indexing="ij")).reshape(2, -1) * step
        D1 = np.clip(first[:, None] + near[0], 0.0, 1.0)
        D2 = np.clip(second[:, None] + near[1], 0.0, 1.0)
        found, place, asked = _best(model, loads, D1, D2)
        better = found > best
        best = np.where(better, found, best)
        first, second = np.where(better, place[0], first), np.where(better, place[1], second)
        evaluations += asked
        step *= _NARROWER
    reached = np.isfinite(best)
    return OptimumTable(
        power_W=loads,
        D1=np.where(reached, first, np.nan),
        D2=np.where(reached, second, np.nan),
        predicted=np.where(reached, best, np.nan),
        regret=np.full(loads.size, np.nan),
        confirmed=reached,
        optimiser="lattice, refined",
        evaluations=evaluations,
    )


def _best(
    model: EfficiencyModel, loads: Floats, D1: Floats, D2: Floats
) -> tuple[Floats, tuple[Floats, Floats], int]:
    """The best of candidates (L, K) at each load: its efficiency, its place, and how many were asked a load."""
    value = model.predict(D1.ravel(), D2.ravel(), np.repeat(loads, D1.shape[1])).reshape(D1.shape)
    value = np.where(np.isfinite(value), value, -np.inf)
    rows, best = np.arange(loads.size), np.argmax(value, axis=1)
    return value[rows, best], (D1[rows, best], D2[rows, best]), D1.shape[1]
