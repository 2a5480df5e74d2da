r"""A covariance by its parts, and its inverse by them.

Blocks of readings (a channel each) have nothing in common but a few directions J (K, M):

.. math:: C = B + J^T J, \qquad B \text{ block by block}

so that, with Woodbury's identity, blocks alone are inverted, and all channels cost no more than the sum of each:

.. math:: C^{-1} = B^{-1} - B^{-1} J^T (I + J B^{-1} J^T)^{-1} J B^{-1}, \quad
          \ln\det C = \ln\det B + \ln\det (I + J B^{-1} J^T) .
"""

from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cholesky
from scipy.linalg.lapack import dpotri

from models.diagnosis.triangular import root_solved

Array = NDArray[np.float64]
Rows = NDArray[np.intp]
Block = Rows | slice


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

    def noisier(self, variance: Array) -> Self:
        """The covariance with independent noise of such variances (M,) on top."""
        own = tuple(block + np.diag(variance[rows]) for rows, block in zip(self.rows, self.own, strict=True))
        return replace(self, own=own)

    def wider(self, directions: Array) -> Self:
        """The covariance with more directions (k, M); what lies in one block alone becomes part of it."""
        parts = [directions[:, rows] for rows in self.rows]
        inside = np.sum([np.any(part, axis=1) for part in parts], axis=0) < 2
        own = tuple(
            block + part[inside].T @ part[inside] for part, block in zip(parts, self.own, strict=True)
        )
        return replace(self, own=own, common=np.concatenate([self.common, directions[~inside]]))


@dataclass(frozen=True, slots=True, kw_only=True)
class Whitener:
    """A factored covariance: solves, and its log-determinant.

    ``inverses`` are those of each block; ``common`` (K, M) are J, and ``across`` (K, M) is J B^-1 through the ``root``
    (K, K) of I + J B^-1 J^T: what blocks share.
    """

    blocks: tuple[Block, ...]
    inverses: tuple[Array, ...]
    common: Array
    root: Array
    across: Array
    log_determinant: float

    @classmethod
    def of(cls, covariance: Covariance | Array) -> Self:
        """Factor a covariance, or a plain matrix (M, M)."""
        parts = covariance if isinstance(covariance, Covariance) else Covariance.whole(covariance)
        roots = [cholesky(own, lower=True, check_finite=False) for own in parts.own]
        blocks, inverses = tuple(map(_stretch, parts.rows)), tuple(map(_inverse, roots))
        common, pulled = parts.common, np.empty_like(parts.common)
        for block, inverse in zip(blocks, inverses, strict=True):
            pulled[:, block] = common[:, block] @ inverse
        root = cholesky(np.eye(len(common)) + common @ pulled.T, lower=True, check_finite=False)
        return cls(
            blocks=blocks,
            inverses=inverses,
            common=common,
            root=root,
            across=root_solved(root, pulled),
            log_determinant=2 * float(sum(np.sum(np.log(np.diag(factor))) for factor in [*roots, root])),
        )

    def solve(self, right: Array) -> Array:
        """C^-1 right, (M,) or (M, k)."""
        solved = np.empty_like(right)
        for block, inverse in zip(self.blocks, self.inverses, strict=True):
            solved[block] = inverse @ right[block]
        return np.asarray(solved - self.across.T @ (self.across @ right))

    def squares(self, vectors: Array) -> Array:
        """v C^-1 v (k,) of each of the vectors (k, M): in less than their :meth:`solve` takes."""
        squares = -np.sum(np.square(vectors @ self.across.T), axis=1)
        for block, inverse in zip(self.blocks, self.inverses, strict=True):
            part = vectors[:, block]
            squares += np.sum(part @ inverse * part, axis=1)
        return np.asarray(squares)

    def solve_directions(self, directions: Array) -> Array:
        """C^-1 of directions (k, M), a row each; of the first that blocks have in common it is all but there."""
        if np.array_equal(directions, self.common[: len(directions)]):
            return root_solved(self.root, self.across, transposed=True)[: len(directions)]
        return self.solve(directions.T).T

    def diagonal(self) -> Array:
        """The diagonal of C^-1, (M,)."""
        found = np.empty(self.common.shape[1])
        for block, inverse in zip(self.blocks, self.inverses, strict=True):
            found[block] = np.diag(inverse)
        return np.asarray(found - np.sum(self.across**2, axis=0))

    def inner(self, vectors: Array) -> Array:
        """V C^-1 V^T (k, k) of vectors (k, M), most of which are zero in most blocks."""
        products = np.zeros((len(vectors), len(vectors)))
        onto = np.zeros((len(self.across), len(vectors)))
        for block, inverse in zip(self.blocks, self.inverses, strict=True):
            part = vectors[:, block]
            there = np.flatnonzero(np.any(part, axis=1))
            part = part[there]
            products[np.ix_(there, there)] += part @ inverse @ part.T
            onto[:, there] += self.across[:, block] @ part.T
        products -= onto.T @ onto
        return products


def _stretch(rows: Rows) -> Block:
    """Rows that follow each other, as they do channel by channel, as a slice: nothing is copied for it."""
    if rows.size and np.array_equal(rows, np.arange(rows[0], rows[0] + rows.size)):
        return slice(int(rows[0]), int(rows[0]) + rows.size)
    return rows


def _inverse(root: Array) -> Array:
    """The inverse of a matrix from its lower root."""
    if not root.size:
        return root
    lower = dpotri(root, lower=1)[0]  # LAPACK leaves the other triangle as it was
    return np.asarray(np.tril(lower) + np.tril(lower, -1).T)
