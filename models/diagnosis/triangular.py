"""Systems with a lower root, from the side on which LAPACK copies nothing."""

import numpy as np
from numpy.typing import NDArray
from scipy.linalg.blas import dtrsm

Array = NDArray[np.float64]


def root_solved(root: Array, right: Array, *, transposed: bool = False) -> Array:
    """``root^-1 right`` (n, k) of a lower root (n, n), or that of its transpose.

    In Fortran's order of memory it is the same system seen from the right, of transposes that are there already.

    >>> root_solved(np.array([[2.0, 0.0], [1.0, 1.0]]), np.array([[2.0], [3.0]])).tolist()
    [[1.0], [2.0]]
    """
    if not right.size:
        return np.zeros_like(right)
    return np.asarray(dtrsm(1.0, root.T, right.T, side=1, lower=0, trans_a=int(transposed)).T)
