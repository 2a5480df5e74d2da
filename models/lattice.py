"""The best modulation of a model that is not made of trees: a lattice over (D1, D2), refined around its best hills.

The simulator as a model costs a solution per point, so a swarm that asks for a few hundred at a time is slow; one
large lattice in one call and small ones around the best hills of each load are fast. Which hill is the highest shows
only near its top: at light load some narrow ones, where an edge just switches softly, lie within hundredths of a
point of each other.
"""

import numpy as np
from numpy.typing import NDArray

from models.boosting import Floats
from models.optimise import OptimumTable
from models.surrogate import EfficiencyModel

_FIRST = 26  # nodes along D1 and along D2: steps of 0.04
_HILLS = (12, 12, 6, 6)  # of each load that are climbed, round by round: a narrow one is low at first
_AROUND = np.linspace(-1.0, 1.0, 5)
_NARROWER = 0.4


def optimise_on_lattice(model: EfficiencyModel, loads_W: Floats) -> OptimumTable:
    """D1 and D2 of the highest predicted efficiency at each load (L,); NaN where nothing carries it.

    ``regret`` is NaN: there is no exact optimum to compare with. The model's own NaN marks what cannot run.
    """
    loads = np.asarray(loads_W, dtype=np.float64)
    nodes = np.linspace(0.0, 1.0, _FIRST)
    D1, D2 = (x.ravel() for x in np.meshgrid(nodes, nodes, indexing="ij"))
    value = _values(model, loads, np.tile(D1, (loads.size, 1)), np.tile(D2, (loads.size, 1)))
    tops = _tops(value.reshape(loads.size, _FIRST, _FIRST))  # (L, hills)
    best, first, second = np.take_along_axis(value, tops, axis=1), D1[tops], D2[tops]
    near = np.stack(np.meshgrid(_AROUND, _AROUND, indexing="ij")).reshape(2, -1)
    step = nodes[1]
    for hills in _HILLS:
        kept = np.argsort(-best, axis=1, kind="stable")[:, :hills]
        best, first, second = (np.take_along_axis(a, kept, axis=1) for a in (best, first, second))
        x = np.clip(first[:, :, None] + step * near[0], 0.0, 1.0)
        y = np.clip(second[:, :, None] + step * near[1], 0.0, 1.0)
        found = _values(model, np.repeat(loads, hills), *(a.reshape(-1, near[0].size) for a in (x, y)))
        found = _beside(best, found.reshape(x.shape))
        k = np.argmax(found, axis=2)[:, :, None]
        best, first, second = (
            np.take_along_axis(a, k, axis=2)[:, :, 0] for a in (found, _beside(first, x), _beside(second, y))
        )
        step *= _NARROWER
    highest = np.arange(loads.size), np.argmax(best, axis=1)
    reached = np.isfinite(best[highest])
    return OptimumTable(
        power_W=loads,
        D1=np.where(reached, first[highest], np.nan),
        D2=np.where(reached, second[highest], np.nan),
        predicted=np.where(reached, best[highest], np.nan),
        regret=np.full(loads.size, np.nan),
        confirmed=reached,
        optimiser="lattice, refined",
        evaluations=_FIRST**2 + sum(_HILLS) * _AROUND.size**2,
    )


def _beside(one: Floats, more: Floats) -> Floats:
    """One candidate (L, hills) before more of them (L, hills, K)."""
    return np.concatenate([one[:, :, None], more], axis=2)


def _values(model: EfficiencyModel, loads: Floats, D1: Floats, D2: Floats) -> Floats:
    """Efficiency at candidates (L, K) of each load, -inf where it is not carried."""
    value = model.predict(D1.ravel(), D2.ravel(), np.repeat(loads, D1.shape[1])).reshape(D1.shape)
    return np.where(np.isfinite(value), value, -np.inf)


def _tops(value: Floats) -> NDArray[np.intp]:
    """The highest nodes of (L, n, n) that no neighbour tops, then the highest of all others, (L, hills)."""
    count = value.shape[1]
    padded = np.pad(value, ((0, 0), (1, 1), (1, 1)), constant_values=-np.inf)
    shifts = [(i, j) for i in range(3) for j in range(3)]
    highest = np.max([padded[:, i : i + count, j : j + count] for i, j in shifts], axis=0)
    top = (value >= highest) & np.isfinite(value)
    ranked = np.lexsort((-value.reshape(len(value), -1), ~top.reshape(len(value), -1)), axis=1)
    return np.asarray(ranked[:, : _HILLS[0]])
