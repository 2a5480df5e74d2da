r"""Inner products of readings under every covariance that a hypothesis may have.

With C the covariance of noise, everyday spreads and the simulation's own accuracy, a hypothesis changes it in few
directions: it takes the everyday spread of the parameters that it explains out (J), and may put a leftover in (F),

.. math:: C' = C + F F^T - J J^T,

so that Woodbury's identity gives :math:`A^T C'^{-1} A` and :math:`\ln\det C'` from inner products under C alone.
"""

from collections.abc import Sequence
from dataclasses import dataclass
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

    def project(self, vectors: Array) -> Projection:
        """Products of vectors (k, M)."""
        return self.project_all([vectors])[0]

    def project_all(self, groups: Sequence[Array], *, basis: bool = True) -> list[Projection]:
        """Products of vectors (k, M), group by group; with no leftover in question they need no ``basis``."""
        if not groups:
            return []
        vectors = np.concatenate(list(groups))
        solved = self.whitener.solve(vectors.T)
        on_spreads = self.spreads_solved @ vectors.T
        on_basis = self.leftovers.basis @ solved if basis else np.empty((0, len(vectors)))
        ends = np.cumsum([0, *map(len, groups)]).tolist()
        return [
            Projection(
                each_other=vectors[a:b] @ solved[:, a:b],
                on_spreads=on_spreads[:, a:b],
                on_basis=on_basis[:, a:b],
            )
            for a, b in pairwise(ends)
        ]

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


def _admitted(leftover: Leftover, inner: Array, size: int) -> _Admitted:
    at, scale = size + leftover.columns, leftover.amplitude_W
    root = np.asarray(
        np.linalg.cholesky(np.eye(at.size) + scale**2 * inner[np.ix_(at, at)]), dtype=np.float64
    )
    spreads = solve_triangular(root, scale * inner[at, :size], lower=True, check_finite=False)
    return _Admitted(root=root, spreads=spreads, log_det=2 * float(np.sum(np.log(np.diag(root)))))
