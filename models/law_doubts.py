r"""What the simulator's loss laws may be wrong by at a point, and how alike two points are in it.

A law is one error all over the map, smooth over it; one of edges changes over a shorter way, and so does what a bridge
switches at a small current where a swing is cut short. What it costs to close on the rest of a swing is a curve over
the share of the swing that is missing, the same one for all edges of a bridge: wherever on the map two edges miss as
much, they are off alike,

.. math:: k(x, x') = \sum_{e, e'} a_e\,a'_{e'} \exp\Bigl(-\frac{(m_e - m'_{e'})^2}{2 \ell^2}\Bigr)

over the edges of one bridge, with a the sigma of that loss and m the share that an edge misses. An edge that is soft
is known: towards it a goes to nothing. A doubt that ended in a step would let the leftover lower the loss just before
it, and an optimum would be found along that step where there is none. Where an edge is hard all the way a switch closes
on a large capacitance against small ones, or on small ones against it: how much of the charge's energy is lost and how
much stays stored is a matter of their curves at low voltage.

About which harmonic the eddy currents of a cause flatten is roughly known, and each place has its own share of what
lies beyond: one error all over the map, and a little another one elsewhere. Pulses as wide as they go have most of it.

What they do in swings is roughly known too (:mod:`models.eddy_doubts`): one error all over the map, along the ridges
where a swing just ends in time.
"""

from itertools import product

import numpy as np
from numpy.typing import NDArray

from models.diagnosis.inaccuracy import BRIDGES, loss_sigmas_W
from models.eddy_doubts import eddy_doubts_W
from sim.model import Model
from sim.modulation import EDGES
from sim.simulate import Result

Array = NDArray[np.float64]

_LEFT = 0.5  # Assumption: of a law's doubt, what is left once the spreads of its own constants are fitted
_ELSEWHERE = 0.4  # Assumption: of that, by how much it is another one elsewhere on the map
_SHARE = 0.2  # of a swing: over what the loss of a cut-short edge is smooth
_HARD = 0.6  # Assumption: of what closing on a swing is doubted by, what is left where an edge is hard all the way
_FLATTENS = 3  # the column of what eddy currents lose less at high harmonics
_IN_SWINGS = 4  # and of what they do in swings
_REST = 5  # the first column of what closing on the rest may be off by
_MISSING = _REST + len(EDGES)  # and of the shares
COLUMNS = _MISSING + len(EDGES)
_OF_BRIDGE = [[k for k, edge in enumerate(EDGES) if edge.startswith(bridge)] for bridge in BRIDGES]


def law_doubts(result: Result, model: Model) -> Array:
    """At N points, (N, COLUMNS): W by smooth laws, laws of edges, small currents, eddy currents (flattening, then in
    swings), the rest by edge; then the shares of swings that are missing.

    ``model`` is the one that was simulated.
    """
    smooth_W, edges_W, small_W, rest_W = loss_sigmas_W(result, model.converter)
    missing = np.stack([result[f"missing_{edge}"] for edge in EDGES])
    halfway = 4 * missing * (1 - missing)  # 1 there, 0 where an edge is soft or hard all the way
    small_W = small_W * [np.max(halfway[edges], axis=0) for edges in _OF_BRIDGE]
    # what closing on the rest costs goes to nothing itself where little is missing
    rest_W = rest_W * np.hypot(2 * (1 - missing), _HARD)
    small_W = np.linalg.norm(small_W, axis=0)
    eddies_W = eddy_doubts_W(result, model)
    known = [_LEFT * smooth_W, _LEFT * edges_W, small_W, *eddies_W, *rest_W, *missing]
    return np.asarray(np.nan_to_num(np.stack(known, axis=1)))


def law_covariance(a: Array, b: Array, alike: tuple[Array, Array], doubt: float = 1.0) -> Array:
    """Covariance (N, K) in W^2 of points with doubts (N, COLUMNS) and (K, COLUMNS).

    ``alike`` are the correlations (N, K) over the map of smooth laws and of laws of edges, known to a share ``doubt``.
    """
    smooth, at_edges = alike
    found = doubt**2 * (np.outer(a[:, 0], b[:, 0]) * smooth + np.outer(a[:, 1], b[:, 1]) * at_edges)
    found = found + np.outer(a[:, 2], b[:, 2]) * at_edges
    found = found + np.outer(a[:, _FLATTENS], b[:, _FLATTENS]) * (1 + _ELSEWHERE**2 * smooth)
    found = found + np.outer(a[:, _IN_SWINGS], b[:, _IN_SWINGS]) * (1 + _ELSEWHERE**2 * at_edges)
    for edges in _OF_BRIDGE:
        for one, other in product(edges, edges):
            apart = a[:, _MISSING + one, None] - b[:, _MISSING + other]
            rest = np.outer(a[:, _REST + one], b[:, _REST + other])
            found = found + rest * np.exp(-0.5 * (apart / _SHARE) ** 2)
    return np.asarray(found)
