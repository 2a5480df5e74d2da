r"""What the simulator's loss laws may be wrong by at a point, and how alike two points are in it.

A law is one error all over the map, smooth over it; one of edges changes over a shorter way. What a swing that is cut
short loses is a curve over the share of the swing that is missing: two points with the same share are off by as much,
wherever on the map they lie,

.. math:: k(x, x') = a\,a' \exp\Bigl(-\frac{|m - m'|^2}{2 \ell^2}\Bigr)

with a the sigma of that loss at a bridge and m the shares that its edges miss.
"""

import numpy as np
from numpy.typing import NDArray

from models.diagnosis.inaccuracy import BRIDGES, law_errors
from sim.modulation import EDGES
from sim.simulate import Result

Array = NDArray[np.float64]

_LEFT = 0.5  # Assumption: of a law's doubt, what is left once the spreads of its own constants are fitted
_SHARE = 0.2  # of a swing: over what a cut-short edge's loss is smooth
_FIRST = 2 + len(BRIDGES)
COLUMNS = _FIRST + len(EDGES)
_OF_BRIDGE = [[_FIRST + k for k, edge in enumerate(EDGES) if edge.startswith(bridge)] for bridge in BRIDGES]


def law_doubts(result: Result) -> Array:
    """At N points, (N, COLUMNS): W by smooth laws, laws of edges, cut swings of each bridge; shares missing by edge."""
    smooth_W, edges_W, cut_W = law_errors(result)
    missing = [result[f"missing_{edge}"] for edge in EDGES]
    return np.asarray(np.nan_to_num(np.stack([_LEFT * smooth_W, _LEFT * edges_W, *cut_W, *missing], axis=1)))


def law_covariance(a: Array, b: Array, alike: tuple[Array, Array], doubt: float = 1.0) -> Array:
    """Covariance (N, K) in W^2 of points with doubts (N, COLUMNS) and (K, COLUMNS).

    ``alike`` are the correlations (N, K) over the map of smooth laws and of laws of edges, known to a share ``doubt``.
    """
    found = sum(np.outer(doubt * a[:, k], doubt * b[:, k]) * same for k, same in enumerate(alike))
    for k, edges in enumerate(_OF_BRIDGE, start=2):
        apart = np.sum((a[:, None, edges] - b[None, :, edges]) ** 2, axis=2)
        found = found + np.outer(a[:, k], b[:, k]) * np.exp(-0.5 * apart / _SHARE**2)
    return np.asarray(found)
