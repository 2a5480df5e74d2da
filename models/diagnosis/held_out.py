r"""Readings that are held out, predicted from all others by the covariance of all: no rest is factored for it.

With K = C^-1 of all readings, F those that are held out and R the rest,

.. math:: C_{FR} C_{RR}^{-1} x_R = -K_{FF}^{-1} K_{FR} x_R, \qquad
          (C_{RR}^{-1} x_R, 0) = K \, (x_R, C_{FR} C_{RR}^{-1} x_R) .

K_FF is what each block has there less what blocks share, so it is never written out (:mod:`models.diagnosis.whitener`).
Rasmussen and Williams, *Gaussian Processes for Machine Learning* (2006), section 5.4.2, have it for single readings.
"""

from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cholesky

from models.diagnosis.triangular import root_solved
from models.diagnosis.whitener import Whitener

Array = NDArray[np.float64]
Rows = NDArray[np.intp]

_LEAST_LEFT = (
    1e-10  # of the largest: what only the readings held out tell is known that much worse, or it is rounding
)


@dataclass(frozen=True, slots=True, kw_only=True)
class HeldOut:
    """Readings ``out`` (M,) that are held out of those of a whitener.

    ``blocks`` are, of each block of it, the readings that are, the root of what its inverse has there, and what blocks
    share through that; ``root`` is that of what is left of what they share.
    """

    whitener: Whitener
    out: NDArray[np.bool_]
    blocks: tuple[tuple[Rows, Array, Array], ...]
    root: Array

    @classmethod
    def of(cls, whitener: Whitener, out: NDArray[np.bool_]) -> Self:
        """With all that predictions of these readings have in common."""
        blocks, left = list[tuple[Rows, Array, Array]](), np.eye(len(whitener.across))
        for block, inverse in zip(whitener.blocks, whitener.inverses, strict=True):
            inside = np.flatnonzero(out[block])
            readings = np.arange(out.size)[block][inside]
            root = _root(inverse[np.ix_(inside, inside)])
            shared = root_solved(root, np.ascontiguousarray(whitener.across[:, readings].T))
            left -= shared.T @ shared
            blocks.append((readings, root, shared))
        return cls(whitener=whitener, out=out, blocks=tuple(blocks), root=_root(left))

    def predicted(self, vectors: Array) -> Array:
        """Vectors (k, M) with what is held out of them as the rest predicts it."""
        found = np.where(self.out, 0.0, vectors)
        pulled = self.whitener.solve(found.T)
        seen = [root_solved(root, pulled[readings]) for readings, root, _ in self.blocks]
        on = sum(shared.T @ part for (_, _, shared), part in zip(self.blocks, seen, strict=True))
        back = root_solved(self.root, root_solved(self.root, np.asarray(on)), transposed=True)
        for (readings, root, shared), part in zip(self.blocks, seen, strict=True):
            found[:, readings] = -root_solved(root, part + shared @ back, transposed=True).T
        return np.asarray(found)

    def solve(self, vectors: Array) -> Array:
        """``C_RR^-1`` of what is not held out of vectors (k, M), and 0 for what is."""
        solved = self.whitener.solve(self.predicted(vectors).T).T
        return np.where(self.out, 0.0, solved)


def _root(matrix: Array) -> Array:
    """The lower root of a matrix that is positive but for rounding, of which directions may have nothing left."""
    try:
        return np.asarray(cholesky(matrix, lower=True, check_finite=False))
    except np.linalg.LinAlgError:
        values, vectors = np.linalg.eigh(matrix)
        least = np.maximum(values, _LEAST_LEFT * values[-1])
        return np.asarray(cholesky((vectors * least) @ vectors.T, lower=True, check_finite=False))
