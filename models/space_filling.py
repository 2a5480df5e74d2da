"""Points far from each other and from all that was measured (a maximin design: Johnson, Moore and Ylvisaker, 1990)."""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def farthest(candidates: Array, known: Array, span: Array) -> Iterator[int]:
    """Which of the candidates (N, k) comes next, each the farthest from the ``known`` (M, k) and those before it.

    Distances count in the ``span`` (k,) of each axis, an axis without any in its own unit.

    >>> line = np.array([[0.0], [1.0], [4.0], [9.0]])
    >>> list(farthest(line, known=line[:1], span=np.array([9.0])))[:3]
    [3, 2, 1]
    """
    scale = np.where(span > 0, span, 1.0)
    nearest = np.full(len(candidates), np.inf)
    for place in known:
        nearest = np.minimum(nearest, _apart(candidates, place, scale))
    for _ in range(len(candidates)):
        row = int(np.argmax(nearest))
        yield row
        nearest = np.minimum(nearest, _apart(candidates, candidates[row], scale))


def _apart(places: Array, one: Array, scale: Array) -> Array:
    """Squared distances (N,) of places from one."""
    return np.asarray((((places - one) / scale) ** 2).sum(axis=1))
