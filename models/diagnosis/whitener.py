r"""A covariance by its parts, and its inverse by them.

Blocks of readings (a channel each) have nothing in common but a few directions J (K, M):

.. math:: C = B + J^T J, \qquad B = L L^T \text{ block by block}, \qquad W = L^{-1} J^T

so that, with Woodbury's identity, blocks alone are factored, and all channels cost no more than the sum of each:

.. math:: C^{-1} = L^{-T} (I - W (I + W^T W)^{-1} W^T) L^{-1}, \quad
          \ln\det C = \ln\det B + \ln\det (I + W^T W) .
"""

from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cholesky, solve_triangular
from scipy.linalg.lapack import dtrtri

Array = NDArray[np.float64]
Rows = NDArray[np.intp]


@dataclass(frozen=True, slots=True, kw_only=True)
class Covariance:
    """Blocks ``own`` (n, n) of the readings ``rows`` (n,), which together are all, and ``common`` directions (K, M)."""

    rows: tuple[Rows, ...]
    own: tuple[Array, ...]
    common: Array

    @classmethod
    def whole(cls, matrix: Array) -> Self:
        """A matrix (M, M) of which no parts are known."""
        return cls(rows=(np.arange(len(matrix)),), own=(matrix,), common=np.empty((0, len(matrix))))

    def take(self, chosen: Rows) -> Self:
        """Some of the readings, in their order."""
        place = np.full(self.common.shape[1], -1)
        place[chosen] = np.arange(chosen.size)
        kept = [np.flatnonzero(place[rows] >= 0) for rows in self.rows]
        return replace(
            self,
            rows=tuple(place[rows[k]] for rows, k in zip(self.rows, kept, strict=True)),
            own=tuple(own[np.ix_(k, k)] for own, k in zip(self.own, kept, strict=True)),
            common=self.common[:, chosen],
        )

    def noisier(self, variance: Array) -> Self:
        """The covariance with independent noise of such variances (M,) on top."""
        own = tuple(block + np.diag(variance[rows]) for rows, block in zip(self.rows, self.own, strict=True))
        return replace(self, own=own)

    def times(self, vector: Array) -> Array:
        """C times a vector (M,)."""
        total = self.common.T @ (self.common @ vector)
        for rows, own in zip(self.rows, self.own, strict=True):
            total[rows] += own @ vector[rows]
        return np.asarray(total)


@dataclass(frozen=True, slots=True, kw_only=True)
class Whitener:
    """A factored covariance: solves, and its log-determinant.

    ``inverse_roots`` are L^-1 of each block, and ``of_blocks`` is ln det B; ``seen`` (K, M) is W^T, ``root`` (K, K)
    the root of I + W^T W.
    """

    rows: tuple[Rows, ...]
    inverse_roots: tuple[Array, ...]
    of_blocks: float
    seen: Array
    root: Array
    log_determinant: float

    @classmethod
    def of(cls, covariance: Covariance | Array) -> "Whitener":
        """Factor a covariance, or a plain matrix (M, M)."""
        parts = covariance if isinstance(covariance, Covariance) else Covariance.whole(covariance)
        roots = [cholesky(own, lower=True, check_finite=False) for own in parts.own]
        blocks = cls(
            rows=parts.rows,
            inverse_roots=tuple(np.asarray(dtrtri(root, lower=1)[0]) for root in roots),
            of_blocks=2 * float(sum(np.sum(np.log(np.diag(root))) for root in roots)),
            seen=np.empty((0, parts.common.shape[1])),
            root=np.empty((0, 0)),
            log_determinant=0.0,
        )
        return blocks.beside(parts.common)

    def beside(self, directions: Array) -> "Whitener":
        """The same with more directions (k, M) in common; blocks are not factored again."""
        more = np.empty_like(directions)
        for rows, root in zip(self.rows, self.inverse_roots, strict=True):
            more[:, rows] = directions[:, rows] @ root.T
        seen = np.concatenate([self.seen, more])
        root = cholesky(np.eye(len(seen)) + seen @ seen.T, lower=True, check_finite=False)
        log_determinant = self.of_blocks + 2 * float(np.sum(np.log(np.diag(root))))
        return replace(self, seen=seen, root=root, log_determinant=log_determinant)

    def solve(self, right: Array) -> Array:
        """C^-1 right, (M,) or (M, k)."""
        white = np.empty_like(right)
        for rows, root in zip(self.rows, self.inverse_roots, strict=True):
            white[rows] = root @ right[rows]
        if len(self.root):
            onto = solve_triangular(self.root, self.seen @ white, lower=True, check_finite=False)
            onto = solve_triangular(self.root, onto, lower=True, trans=1, check_finite=False)
            white -= self.seen.T @ onto
        solved = np.empty_like(white)
        for rows, root in zip(self.rows, self.inverse_roots, strict=True):
            solved[rows] = root.T @ white[rows]
        return solved

    def inner(self, vectors: Array) -> Array:
        """V C^-1 V^T (k, k) of vectors (k, M), most of which are zero in most blocks."""
        products = np.zeros((len(vectors), len(vectors)))
        onto = np.zeros((len(self.root), len(vectors)))
        for rows, root in zip(self.rows, self.inverse_roots, strict=True):
            part = vectors[:, rows]
            there = np.flatnonzero(np.any(part, axis=1))
            white = part[there] @ root.T
            products[np.ix_(there, there)] += white @ white.T
            onto[:, there] += self.seen[:, rows] @ white.T
        onto = solve_triangular(self.root, onto, lower=True, check_finite=False) if len(onto) else onto
        return np.asarray(products - onto.T @ onto)
