"""The exact optimum of a sum of tree ensembles at given loads, to judge a search by.

At one power the ensembles are constant on the rectangles between the thresholds that their trees use
there. Each leaf adds its value to a block of rectangles: four corner entries in a difference array, whose
double cumulative sum is the whole efficiency map of that power. Laid over the feasible rectangles of
:class:`models.feasibility.FeasibleMap`, the largest entry is the optimum: no point of the square is better,
except within the single-precision rounding of thresholds (1e-7 of D1, D2) and of sums (about 1e-6).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from models.boosting import BoostedTrees, Floats, LeafBoxes
from models.feasibility import FeasibleMap
from models.surrogate import EfficiencyModel, StagedModel

Indices = NDArray[np.intp]
NEAR = 1e-4  # of efficiency: 0.01 points


@dataclass(frozen=True, slots=True, kw_only=True)
class ExactOptimum:
    """Best D1, D2 and the model's value per load (L,); NaN where no rectangle carries the load.

    ``near_share`` (L,) is the share of the square whose value is within ``NEAR`` of the best: the target that a search
    has to hit. ``cells`` counts the rectangles looked at, over all loads.
    """

    D1: Floats
    D2: Floats
    value: Floats
    near_share: Floats
    cells: int


def ensembles(model: EfficiencyModel) -> tuple[BoostedTrees, ...] | None:
    """The ensembles that ``model`` is the sum of, or None when it is not such a sum."""
    stages = model.stages if isinstance(model, StagedModel) else (model,)
    trees = tuple(stage for stage in stages if isinstance(stage, BoostedTrees))
    return trees if len(trees) == len(stages) else None


def exact_optimum(model: EfficiencyModel, feasible: FeasibleMap) -> ExactOptimum:
    """Best point of ``model`` over the allowed rectangles at each load of ``feasible``.

    Raises TypeError when the model is not made of tree ensembles alone.
    """
    trees = ensembles(model)
    if trees is None:
        raise TypeError("the exact optimum needs a model whose stages are all tree ensembles")
    boxes = [ensemble.boxes() for ensemble in trees]
    best = [_best_at(boxes, feasible, load) for load in range(len(feasible.loads_W))]
    D1, D2, near_share = (np.array([row[k] for row in best]) for k in range(3))
    reached = np.isfinite(D1)
    value = np.full(len(D1), np.nan)
    value[reached] = model.predict(D1[reached], D2[reached], feasible.loads_W[reached])
    return ExactOptimum(D1=D1, D2=D2, value=value, near_share=near_share, cells=sum(row[3] for row in best))


def _best_at(boxes: Sequence[LeafBoxes], feasible: FeasibleMap, load: int) -> tuple[float, float, float, int]:
    """D1 and D2 of the best, the share of the square that is as good, and rectangles looked at."""
    low, high, value, base = _merged([b.at_power(feasible.loads_W[load]) for b in boxes])
    D1_thresholds, D2_thresholds = (_thresholds(low[:, k], high[:, k]) for k in (0, 1))
    table = base + _table((low, high, value), D1_thresholds, D2_thresholds)
    breaks = [_breaks(D1_thresholds, feasible.D1_edges), _breaks(D2_thresholds, feasible.D2_edges)]
    D1, D2 = ((b[:-1] + b[1:]) / 2 for b in breaks)  # one point in every interval
    rows, columns = feasible.index(D1, D2)
    D1, D2 = feasible.snap(D1, D2)
    efficiency = table[np.ix_(_in_trees(D1_thresholds, D1), _in_trees(D2_thresholds, D2))]
    allowed = feasible.cells[load][np.ix_(rows, columns)]
    if not allowed.any():
        return np.nan, np.nan, 0.0, efficiency.size
    reachable = np.where(allowed, efficiency, -np.inf)
    i, j = np.unravel_index(np.argmax(reachable), efficiency.shape)
    near = np.outer(*map(np.diff, breaks))[reachable >= reachable[i, j] - NEAR]
    return float(D1[i]), float(D2[j]), float(near.sum()), efficiency.size


def _merged(boxes: Sequence[LeafBoxes]) -> tuple[Floats, Floats, Floats, float]:
    low, high, value = (
        np.concatenate([getattr(b, name) for b in boxes]) for name in ("low", "high", "value")
    )
    return low, high, value, sum(b.base for b in boxes)


def _thresholds(low: Floats, high: Floats) -> Floats:
    edges = np.concatenate([low, high])
    return np.unique(edges[np.isfinite(edges)])


def _table(leaves: tuple[Floats, Floats, Floats], D1_thresholds: Floats, D2_thresholds: Floats) -> Floats:
    """Sum of leaf values on every rectangle between thresholds, unbounded at the sides."""
    low, high, value = leaves
    edges = (D1_thresholds, D2_thresholds)
    first = [_start_cell(edges[k], low[:, k]) for k in (0, 1)]
    last = [_end_cell(edges[k], high[:, k]) for k in (0, 1)]
    shape = (len(D1_thresholds) + 2, len(D2_thresholds) + 2)
    corners = np.zeros(shape)
    for i, j, sign in ((first, first, 1), (first, last, -1), (last, first, -1), (last, last, 1)):
        np.add.at(corners, (i[0], j[1]), sign * value)
    return np.asarray(corners.cumsum(axis=0).cumsum(axis=1)[:-1, :-1], dtype=np.float64)


def _start_cell(edges: Floats, low: Floats) -> Indices:
    return np.where(np.isfinite(low), np.searchsorted(edges, low) + 1, 0)


def _end_cell(edges: Floats, high: Floats) -> Indices:
    return np.where(np.isfinite(high), np.searchsorted(edges, high) + 1, len(edges) + 1)


def _in_trees(thresholds: Floats, x: Floats) -> Indices:
    return np.searchsorted(thresholds, x.astype(np.float32).astype(np.float64), side="right")


def _breaks(thresholds: Floats, edges: Floats) -> Floats:
    """Thresholds and lattice edges inside the box, sorted."""
    inside = thresholds[(thresholds > edges[0]) & (thresholds < edges[-1])]
    return np.unique(np.concatenate([edges, inside]))
