r"""Inner products of readings under every covariance that a hypothesis may have.

With C the covariance of noise, everyday spreads and the simulation's own accuracy, a hypothesis changes it in few
directions: it takes the everyday spread of the parameters that it explains out (J), and may put a leftover in (F),

.. math:: C' = C + F F^T - J J^T,

so that Woodbury's identity gives :math:`A^T C'^{-1} A` and :math:`\ln\det C'` from inner products under C alone.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Self

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_triangular

from models.diagnosis.leftover import Leftover, Leftovers
from models.diagnosis.whitener import Whitener

Array = NDArray[np.float64]
Rows = NDArray[np.intp]

_LEAST_LEFT = 1e-9  # of a direction known ten thousand times better than its spread: rounding


@dataclass(frozen=True, slots=True, kw_only=True)
class Projection:
    """Vectors (k, M) seen from the geometry: products with each other, the spreads and the leftovers' basis."""

    each_other: Array
    on_spreads: Array
    on_basis: Array

    def of(self, chosen: Sequence[int]) -> Self:
        """Some of the vectors."""
        return replace(
            self,
            each_other=self.each_other[np.ix_(chosen, chosen)],
            on_spreads=self.on_spreads[:, chosen],
            on_basis=self.on_basis[:, chosen],
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class Directions:
    """Vectors (k, M) that are used again and again, with C^-1 of them and how they are seen."""

    vectors: Array
    solved: Array
    seen: Projection

    def scaled(self, factor: float) -> Self:
        """All of them, this many times as long."""
        seen = Projection(
            each_other=factor**2 * self.seen.each_other,
            on_spreads=factor * self.seen.on_spreads,
            on_basis=factor * self.seen.on_basis,
        )
        return replace(self, vectors=factor * self.vectors, solved=factor * self.solved, seen=seen)


@dataclass(frozen=True, slots=True, kw_only=True)
class _Admitted:
    """A leftover let in: the root of I + F^T C^-1 F, the spreads seen through it, and its log-determinant."""

    root: Array
    spreads: Array
    log_det: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Geometry:
    """C factored, and the products under C of the spreads (K, M) and the leftovers' basis (Q, M)."""

    whitener: Whitener
    leftovers: Leftovers
    spreads_solved: Array
    basis_solved: Array
    between_spreads: Array
    admitted: dict[tuple[str, float], _Admitted]

    @classmethod
    def of(cls, whitener: Whitener, spreads: Array, leftovers: Leftovers) -> Self:
        """The geometry of a covariance that contains the ``spreads`` and none of the ``leftovers``."""
        size = len(spreads)
        joined = np.concatenate([spreads, leftovers.basis])
        solved = whitener.solve(joined.T).T
        inner = joined @ solved.T
        return cls(
            whitener=whitener,
            leftovers=leftovers,
            spreads_solved=solved[:size],
            basis_solved=solved[size:],
            between_spreads=inner[:size, :size],
            admitted={c.key: _admitted(c, inner, size) for c in leftovers.configurations},
        )

    def project(self, vectors: Array, beside: Sequence[Directions] = ()) -> Projection:
        """Products of vectors (k, M), followed by the directions ``beside`` them."""
        return self.project_all([vectors], [beside])[0]

    def project_all(
        self, groups: Sequence[Array], beside: Sequence[Sequence[Directions]] = (), *, basis: bool = True
    ) -> list[Projection]:
        """Products of vectors (k, M) with the directions ``beside`` them, group by group.

        With no leftover in question they need no ``basis``.
        """
        if not groups:
            return []
        vectors = np.concatenate(list(groups))
        solved = self.whitener.solve(vectors.T)
        on_spreads = self.spreads_solved @ vectors.T
        on_basis = self.leftovers.basis @ solved if basis else np.empty((0, len(vectors)))
        ends = np.cumsum([0, *map(len, groups)]).tolist()
        own = [
            Projection(
                each_other=vectors[a:b] @ solved[:, a:b],
                on_spreads=on_spreads[:, a:b],
                on_basis=on_basis[:, a:b],
            )
            for a, b in pairwise(ends)
        ]
        if not beside:
            return own
        return [_joined(v, seen, more) for v, seen, more in zip(groups, own, beside, strict=True)]

    def directions(self, vectors: Array) -> Directions:
        """Vectors (k, M) with all that does not change from one use to the next."""
        solved = self.whitener.solve(vectors.T)
        seen = Projection(
            each_other=vectors @ solved,
            on_spreads=self.spreads_solved @ vectors.T,
            on_basis=self.leftovers.basis @ solved,
        )
        return Directions(vectors=vectors, solved=solved.T, seen=seen)

    def products(self, seen: Projection, own: Rows, leftover: Leftover | None = None) -> tuple[Array, float]:
        """``A^T C'^-1 A`` (k, k) and ``ln det C' - ln det C``, without the spreads ``own``, with a leftover."""
        inner, outer, log_det = seen.each_other, seen.on_spreads[own], 0.0
        between = self.between_spreads[np.ix_(own, own)]
        if leftover is not None:
            let_in = self.admitted[leftover.key]
            on = leftover.amplitude_W * seen.on_basis[leftover.columns]
            on, aside = (
                solve_triangular(let_in.root, on, lower=True, check_finite=False),
                let_in.spreads[:, own],
            )
            inner, outer, between = inner - on.T @ on, outer - aside.T @ on, between - aside.T @ aside
            log_det = let_in.log_det
        if own.size:
            remaining, vectors = np.linalg.eigh(np.eye(own.size) - 0.5 * (between + between.T))
            remaining = np.maximum(remaining, _LEAST_LEFT)
            turned = vectors.T @ outer
            inner = inner + turned.T @ (turned / remaining[:, None])
            log_det += float(np.sum(np.log(remaining)))
        return inner, log_det

    def solve(self, vectors: Array, own: Rows, leftover: Leftover | None = None) -> Array:
        """``C'^-1`` of vectors (k, M), without the spreads ``own``, with a leftover."""
        solved, spreads = self.whitener.solve(vectors.T).T, self.spreads_solved[own]
        between = self.between_spreads[np.ix_(own, own)]
        if leftover is not None:
            let_in, scale = self.admitted[leftover.key], leftover.amplitude_W
            basis = scale * solve_triangular(
                let_in.root, self.basis_solved[leftover.columns], lower=True, check_finite=False
            )
            aside = let_in.spreads[:, own]
            solved = solved - (vectors @ basis.T) @ basis
            spreads, between = spreads - aside.T @ basis, between - aside.T @ aside
        if own.size:
            inner = np.eye(own.size) - between
            solved = solved + np.linalg.lstsq(inner, spreads @ vectors.T, rcond=_LEAST_LEFT)[0].T @ spreads
        return np.asarray(solved)


def _joined(vectors: Array, seen: Projection, beside: Sequence[Directions]) -> Projection:
    """The projection of vectors (k, M) followed by directions."""
    if not beside:
        return seen
    parts, heads = [seen, *(d.seen for d in beside)], [vectors, *(d.vectors for d in beside)]
    ends = np.cumsum([0, *map(len, heads)]).tolist()
    each_other = np.zeros((ends[-1], ends[-1]))
    for j, (part, (a, b)) in enumerate(zip(parts, pairwise(ends), strict=True)):
        each_other[a:b, a:b] = part.each_other
        for i in range(j):
            each_other[ends[i] : ends[i + 1], a:b] = heads[i] @ beside[j - 1].solved.T
            each_other[a:b, ends[i] : ends[i + 1]] = each_other[ends[i] : ends[i + 1], a:b].T
    return Projection(
        each_other=each_other,
        on_spreads=np.concatenate([p.on_spreads for p in parts], axis=1),
        on_basis=np.concatenate([p.on_basis[: len(seen.on_basis)] for p in parts], axis=1),
    )


def _admitted(leftover: Leftover, inner: Array, size: int) -> _Admitted:
    at, scale = size + leftover.columns, leftover.amplitude_W
    root = np.asarray(
        np.linalg.cholesky(np.eye(at.size) + scale**2 * inner[np.ix_(at, at)]), dtype=np.float64
    )
    spreads = solve_triangular(root, scale * inner[at, :size], lower=True, check_finite=False)
    return _Admitted(root=root, spreads=spreads, log_det=2 * float(np.sum(np.log(np.diag(root)))))
