"""Where in (D1, D2) a load can be carried: a mask of rectangles, asked of the simulator once.

A search asks thousands of times whether a point is feasible, and an exact optimum needs to know it for
whole cells. So the mask is piecewise constant: the simulator is asked at the nodes of a lattice, and a
rectangle is allowed when all of its corners are. That errs on the safe side by less than one lattice step.

Pulses and zero states shorter than the dead time are infeasible, but D1 = 1 and D2 = 0 have none and are
fine. These two edges have no area, and a search that draws real numbers never meets them. The strip that
the dead time swallows, ``edge_gap`` wide, therefore *stands for its edge*: D1 in [1 - gap, 1] is taken as
1 and D2 in [0, gap) as 0, by :meth:`FeasibleMap.snap`.

Assumption: what carries a power carries every smaller one, so the loads of a node are found by bisection.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from models.boosting import Floats
from sim.model import Model

Bools = NDArray[np.bool_]
Feasible = Callable[[Floats, Floats, Floats], Bools]
"""Whether D1, D2, power_W, all (N,), can be reached: (N,) of bool."""

LONGER = 1.1  # Assumption: a real dead time is at most a tenth longer than the nominal one
LATTICE = 50  # rectangles per axis: steps of 0.02, about half the step of the 25-point simulation grid


def edge_gap_of(simulator: Model) -> float:
    """The dead time of a simulated converter in half periods."""
    return float(np.max(simulator.altered_converter().dead_share))


@dataclass(frozen=True, slots=True, kw_only=True)
class FeasibleMap:
    """Rectangles of (D1, D2) that carry each load: ``cells`` (loads, rectangles along D1, along D2)."""

    loads_W: Floats
    D1_edges: Floats
    D2_edges: Floats
    cells: Bools
    edge_gap: float
    feasible: Feasible

    @classmethod
    def build(
        cls, feasible: Feasible, loads_W: ArrayLike, *, edge_gap: float = 0.0, lattice: int = LATTICE
    ) -> Self:
        """Ask ``feasible`` at the lattice's nodes for every load.

        ``edge_gap`` is the dead time in half periods.
        """
        if not 0 <= edge_gap < 0.5:
            raise ValueError(f"edge_gap is {edge_gap}; it must be in [0, 0.5): dead time over half period")
        loads = np.atleast_1d(np.asarray(loads_W, dtype=np.float64))
        # a pulse of exactly the dead time is fine; rounding must not make it shorter
        gap = edge_gap * (1 + 1e-6)
        edges = np.linspace(0.0, 1.0 - gap, lattice + 1)
        D1_edges = np.append(edges, 1.0) if gap else edges
        D2_edges = 1.0 - D1_edges[::-1]
        D1, D2 = np.meshgrid(D1_edges, D2_edges, indexing="ij")
        nodes = _carried(feasible, D1.ravel(), D2.ravel(), loads).reshape(len(loads), *D1.shape)
        along_D1 = nodes[:, :-1] & nodes[:, 1:]
        cells = along_D1[:, :, :-1] & along_D1[:, :, 1:]
        return cls(
            loads_W=loads, D1_edges=D1_edges, D2_edges=D2_edges, cells=cells, edge_gap=gap, feasible=feasible
        )

    def snap(self, D1: Floats, D2: Floats) -> tuple[Floats, Floats]:
        """Points with the strips that the dead time swallows moved to their edges."""
        return np.where(1.0 - self.edge_gap <= D1, 1.0, D1), np.where(self.edge_gap > D2, 0.0, D2)

    def index(self, D1: Floats, D2: Floats) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """Which rectangle along D1 and along D2 a point lies in."""
        return _cell(self.D1_edges, D1), _cell(self.D2_edges, D2)

    def allowed(self, D1: Floats, D2: Floats, load: NDArray[np.intp] | int) -> Bools:
        """Whether points carry the loads numbered ``load``; all three broadcast."""
        i, j = self.index(D1, D2)
        out: Bools = self.cells[load, i, j]
        return out

    def confirm(self, D1: Floats, D2: Floats, power_W: Floats) -> Bools:
        """Ask the simulator itself about a few points (N,)."""
        return np.asarray(self.feasible(D1, D2, power_W), dtype=bool)


def _cell(edges: Floats, x: Floats) -> NDArray[np.intp]:
    return np.clip(np.searchsorted(edges, x, side="right") - 1, 0, len(edges) - 2)


def _carried(feasible: Feasible, D1: Floats, D2: Floats, loads_W: Floats) -> Bools:
    """Whether each node (N,) carries each load (L,): (L, N), by bisection over the sorted loads."""
    order = np.argsort(loads_W)
    ranked = loads_W[order]
    low = np.zeros(len(D1), dtype=np.intp)
    high = np.full(len(D1), len(ranked), dtype=np.intp)
    while (open_ := np.flatnonzero(low < high)).size:
        middle = (low[open_] + high[open_]) // 2
        carries = np.asarray(feasible(D1[open_], D2[open_], ranked[middle]), dtype=bool)
        low[open_] = np.where(carries, middle + 1, low[open_])
        high[open_] = np.where(carries, high[open_], middle)
    out = np.empty((len(ranked), len(D1)), dtype=bool)
    out[order] = np.arange(len(ranked))[:, None] < low[None, :]
    return out
