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

from models.diagnosis.leftover import Leftover, Leftovers
from models.diagnosis.triangular import root_solved
from models.diagnosis.whitener import Block, Whitener

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
            on_spreads=self.on_spreads.take(chosen, axis=1),
            on_basis=self.on_basis.take(chosen, axis=1),
        )

    def less(self, shares: Array) -> Self:
        """The same with the last vector less these shares (k - 1,) of the others."""
        change = np.eye(1 + shares.size)
        change[-1, :-1] = -shares
        return replace(
            self,
            each_other=change @ self.each_other @ change.T,
            on_spreads=self.on_spreads @ change.T,
            on_basis=self.on_basis @ change.T,
        )

    def with_directions(self, vectors: Array, beside: "Sequence[Directions]") -> "Projection":
        """Of these vectors (k, M), followed by the directions ``beside`` them."""
        return _joined(vectors, self, beside)


@dataclass(frozen=True, slots=True, kw_only=True)
class Directions:
    """Vectors (k, M) that are used again and again, with C^-1 of them and how they are seen.

    They are meant ``factor`` times as long.
    """

    vectors: Array
    solved: Array
    seen: Projection
    factor: float = 1.0

    def scaled(self, factor: float) -> Self:
        """All of them, this many times as long."""
        return replace(self, factor=factor * self.factor)


@dataclass(frozen=True, slots=True, kw_only=True)
class _Admitted:
    """A leftover let in: the root of I + F^T C^-1 F, the spreads (K) seen by F, and its log-determinant."""

    root: Array
    on_spreads: Array
    log_det: float

    def through(self, spreads: Rows) -> Array:
        """Some of the spreads seen through it."""
        return root_solved(self.root, self.on_spreads[:, spreads])


@dataclass(frozen=True, slots=True, kw_only=True)
class Geometry:
    """C factored, and the products under C of the spreads (K, M) and the leftovers' basis (Q, M).

    Most of the basis is zero in most blocks of C: ``basis_by_blocks`` are a block's readings (m,), the columns (q,)
    that are there, and these alone (q, m). ``spreads_on_basis`` (Q, K) are the spreads seen by all of it.
    """

    whitener: Whitener
    leftovers: Leftovers
    spreads_solved: Array
    between_spreads: Array
    admitted: dict[tuple[str, float], _Admitted]
    basis_by_blocks: tuple[tuple[Block, Rows, Array], ...]
    spreads_on_basis: Array

    @classmethod
    def of(cls, whitener: Whitener, spreads: Array, leftovers: Leftovers) -> Self:
        """The geometry of a covariance that contains the ``spreads`` and none of the ``leftovers``."""
        solved, by_blocks = whitener.solve_directions(spreads), _by_blocks(leftovers.basis, whitener.blocks)
        on_basis = _seen(by_blocks, len(leftovers.basis), solved.T)
        return cls(
            whitener=whitener,
            leftovers=leftovers,
            spreads_solved=solved,
            between_spreads=spreads @ solved.T,
            admitted=_admitted(leftovers, whitener.inner(leftovers.basis), on_basis),
            basis_by_blocks=by_blocks,
            spreads_on_basis=on_basis,
        )

    def project(self, vectors: Array, *, basis: bool = True) -> Projection:
        """Products of vectors (k, M); with no leftover in question they need no ``basis``."""
        solved = self.whitener.solve(vectors.T)
        return Projection(
            each_other=vectors @ solved,
            on_spreads=self.spreads_solved @ vectors.T,
            on_basis=self._on_basis(solved) if basis else np.empty((0, len(vectors))),
        )

    def with_spreads(self, seen: Projection, own: Rows) -> Projection:
        """Of vectors seen, followed by the spreads ``own``."""
        across, between = seen.on_spreads[own], self.between_spreads[:, own]
        each_other = np.block([[seen.each_other, across.T], [across, between[own]]])
        on_basis = self.spreads_on_basis[: len(seen.on_basis), own]
        return Projection(
            each_other=each_other,
            on_spreads=np.concatenate([seen.on_spreads, between], axis=1),
            on_basis=np.concatenate([seen.on_basis, on_basis], axis=1),
        )

    def directions(self, each: Sequence[Array]) -> list[Directions]:
        """Sets of vectors (k, M) with all that does not change from one use to the next, in one look."""
        whole = np.concatenate(each).T
        solved = self.whitener.solve(whole)
        on_spreads, on_basis = self.spreads_solved @ whole, self._on_basis(solved)
        found = []
        for vectors, (a, b) in zip(each, pairwise(np.cumsum([0, *map(len, each)]).tolist()), strict=True):
            own = solved[:, a:b].copy()  # side by side, as products with them run fastest
            seen = Projection(
                each_other=vectors @ own, on_spreads=on_spreads[:, a:b], on_basis=on_basis[:, a:b]
            )
            found.append(Directions(vectors=vectors, solved=own.T, seen=seen))
        return found

    def between(self, directions: Sequence[Directions]) -> Projection:
        """Products of directions with each other and the spreads."""
        none = np.empty((0, 0))
        nothing = Projection(
            each_other=none, on_spreads=np.empty((len(self.spreads_solved), 0)), on_basis=none
        )
        return _joined(np.empty((0, self.spreads_solved.shape[1])), nothing, directions)

    def _on_basis(self, solved: Array) -> Array:
        """Products (Q, k) of the leftovers' basis with solved vectors (M, k)."""
        return _seen(self.basis_by_blocks, len(self.leftovers.basis), solved)

    def products_beside(
        self, seen: Sequence[Projection], own: Sequence[Rows], leftovers: Sequence[Leftover | None]
    ) -> list[tuple[Array, Array]]:
        """``A^T C'^-1 A`` (L, k, k) and ``ln det C' - ln det C`` (L,) of many projections, each beside L leftovers.

        C' is without the spreads ``own`` of each.
        """
        widths = np.array([p.on_spreads.shape[1] for p in seen])
        order = np.argsort(widths, kind="stable")  # those of one width side by side: one call for all of them
        ends = np.cumsum([0, *widths[order]]).tolist()
        first = np.flatnonzero(np.diff(widths[order], prepend=0)).tolist()
        groups = [(order[a:b], slice(ends[a], ends[b])) for a, b in pairwise([*first, order.size])]
        named, place = np.unique(np.concatenate(own), return_inverse=True)
        places = np.split(place, np.cumsum([o.size for o in own])[:-1])
        on_spreads = np.concatenate([seen[n].on_spreads[named] for n in order], axis=1)
        on_basis = np.concatenate([seen[n].on_basis for n in order], axis=1)
        among = self.between_spreads[named[:, None], named]
        count, log_det = len(leftovers), np.zeros(len(leftovers))
        inner = [np.empty((g.size, count, widths[g[0]], widths[g[0]])) for g, _ in groups]
        each_other = [np.stack([seen[n].each_other for n in g]) for g, _ in groups]
        outer, between = np.empty((count, named.size, ends[-1])), np.empty((count, named.size, named.size))
        at: tuple[Rows | None, Array] = None, np.empty((0, 0))
        for k, leftover in enumerate(leftovers):
            outer[k], between[k] = on_spreads, among
            if leftover is None:
                for products, alone in zip(inner, each_other, strict=True):
                    products[:, k] = alone
                continue
            let_in = self.admitted[leftover.key]
            if at[0] is not leftover.columns:
                at = leftover.columns, on_basis[leftover.columns]
            on, through = root_solved(let_in.root, leftover.amplitude * at[1]), let_in.through(named)
            outer[k] -= through.T @ on
            between[k] -= through.T @ through
            log_det[k] = let_in.log_det
            for products, alone, (g, columns) in zip(inner, each_other, groups, strict=True):
                part = on[:, columns].reshape(len(on), g.size, -1).swapaxes(0, 1)
                np.subtract(alone, part.swapaxes(1, 2) @ part, out=products[:, k])
        found: list[tuple[Array, Array, Array]] = [(outer, outer, outer)] * len(seen)
        for products, (g, columns) in zip(inner, groups, strict=True):
            seen_here = np.split(outer[:, :, columns], g.size, axis=2)
            for n, own_products, outside in zip(g.tolist(), products, seen_here, strict=True):
                o = places[n]
                found[n] = own_products, outside[:, o], between[:, o[:, None], o]
        return [_taken_out(*parts, log_det) for parts in found] if count > 1 else _once(found, log_det)

    def products_among(
        self, seen: Projection, chosen: Rows, own: Sequence[Rows]
    ) -> list[tuple[Array, Array]]:
        """The same of many choices (S, k) among vectors seen once, beside no leftover."""
        alike: dict[int, list[int]] = {}
        for n, spreads in enumerate(own):
            alike.setdefault(spreads.size, []).append(n)
        found = [(seen.each_other, np.zeros(1))] * len(own)
        for members in alike.values():
            at, spreads = chosen[members], np.stack([own[n] for n in members])
            inner = seen.each_other[at[:, :, None], at[:, None, :]]
            outside = seen.on_spreads[spreads[:, :, None], at[:, None, :]]
            inside = self.between_spreads[spreads[:, :, None], spreads[:, None, :]]
            products, log_dets = _taken_out(inner, outside, inside, np.zeros(len(members)))
            for n, product, log_det in zip(members, products, log_dets, strict=True):
                found[n] = product[None], log_det[None]
        return found

    def solve(
        self, vectors: Array, own: Rows, leftover: Leftover | None = None, *, bare: Array | None = None
    ) -> Array:
        """``C'^-1`` of vectors (k, M), without the spreads ``own``, with a leftover.

        ``bare`` (k, M) is C^-1 of them, where that is known.
        """
        if bare is None:
            bare = self.whitener.solve(vectors.T).T
        solved = np.concatenate([bare, self.spreads_solved[own]])
        between = self.between_spreads[np.ix_(own, own)]
        if leftover is not None:
            let_in, columns = (
                self.admitted[leftover.key],
                leftover.amplitude * self.leftovers.basis[leftover.columns],
            )
            on = root_solved(let_in.root, columns @ solved.T)
            back = root_solved(let_in.root, on, transposed=True)
            solved = solved - self.whitener.solve(columns.T @ back).T
            through = let_in.through(own)
            between = between - through.T @ through
        solved, spreads = solved[: len(vectors)], solved[len(vectors) :]
        if own.size:
            inner = np.eye(own.size) - between
            solved = solved + np.linalg.lstsq(inner, spreads @ vectors.T, rcond=_LEAST_LEFT)[0].T @ spreads
        return np.asarray(solved)


def _taken_out(inner: Array, outside: Array, inside: Array, log_det: Array) -> tuple[Array, Array]:
    """Products (..., k, k) without spreads that are seen (..., o, k), with products (..., o, o) among each other."""
    if not inside.shape[-1]:
        return inner, log_det
    symmetric = 0.5 * (inside + np.swapaxes(inside, -1, -2))
    remaining, vectors = np.linalg.eigh(np.eye(inside.shape[-1]) - symmetric)
    remaining = np.maximum(remaining, _LEAST_LEFT)
    turned = np.swapaxes(vectors, -1, -2) @ outside
    without = inner + np.swapaxes(turned, -1, -2) @ (turned / remaining[..., None])
    return without, log_det + np.sum(np.log(remaining), axis=-1)


def _once(found: Sequence[tuple[Array, Array, Array]], log_det: Array) -> list[tuple[Array, Array]]:
    """The same of many that are small (a call costs more than its arithmetic), those of one shape together."""
    alike: dict[tuple[int, ...], list[int]] = {}
    for n, (_, outside, _) in enumerate(found):
        alike.setdefault(outside.shape, []).append(n)
    without = [(inner, log_det) for inner, _, _ in found]
    for members in alike.values():
        inner, outside, inside = (np.stack([found[n][part] for n in members]) for part in range(3))
        log_dets = np.broadcast_to(log_det, (len(members), log_det.size))
        products, log_dets = _taken_out(inner, outside, inside, log_dets)
        for n, *pair in zip(members, products, log_dets, strict=True):
            without[n] = pair[0], pair[1]
    return without


def _joined(vectors: Array, seen: Projection, beside: Sequence[Directions]) -> Projection:
    """The projection of vectors (k, M) followed by directions."""
    if not beside:
        return seen
    parts, heads = [seen, *(d.seen for d in beside)], [vectors, *(d.vectors for d in beside)]
    ends, factors = np.cumsum([0, *map(len, heads)]).tolist(), [1.0, *(d.factor for d in beside)]
    each_other = np.zeros((ends[-1], ends[-1]))
    for j, (part, (a, b)) in enumerate(zip(parts, pairwise(ends), strict=True)):
        each_other[a:b, a:b] = part.each_other
        for i in range(j):
            each_other[ends[i] : ends[i + 1], a:b] = heads[i] @ beside[j - 1].solved.T
            each_other[a:b, ends[i] : ends[i + 1]] = each_other[ends[i] : ends[i + 1], a:b].T
    factor = np.repeat(factors, np.diff(ends))
    return Projection(
        each_other=each_other * np.outer(factor, factor),
        on_spreads=np.concatenate([p.on_spreads for p in parts], axis=1) * factor,
        on_basis=np.concatenate([p.on_basis[: len(seen.on_basis)] for p in parts], axis=1) * factor,
    )


def _by_blocks(basis: Array, blocks: Sequence[Block]) -> tuple[tuple[Block, Rows, Array], ...]:
    """Readings, columns and values of a basis (Q, M) in each block, without what is zero there."""
    found = []
    for readings in blocks:
        part = basis[:, readings]
        columns = np.flatnonzero(np.any(part, axis=1))
        found.append((readings, columns, part[columns]))
    return tuple(found)


def _seen(by_blocks: Sequence[tuple[Block, Rows, Array]], size: int, solved: Array) -> Array:
    """Products (Q, k) of a basis of that size, by blocks, with vectors (M, k)."""
    products = np.zeros((size, solved.shape[1]))
    for readings, columns, own in by_blocks:
        products[columns] += own @ solved[readings]
    return products


def _admitted(leftovers: Leftovers, inner: Array, spreads: Array) -> dict[tuple[str, float], _Admitted]:
    """All leftovers let in, from products of the basis with itself (Q, Q) and the spreads; columns are read once."""
    shared: dict[int, list[Leftover]] = {}
    for leftover in leftovers.configurations:
        shared.setdefault(id(leftover.columns), []).append(leftover)
    found = {}
    for alike in shared.values():
        at, scale = alike[0].columns, np.array([leftover.amplitude for leftover in alike])
        between = scale[:, None, None] ** 2 * inner[at[:, None], at]
        between[:, np.arange(at.size), np.arange(at.size)] += 1.0
        roots, on_spreads = np.linalg.cholesky(between), spreads[at]
        log_det = 2 * np.sum(np.log(np.diagonal(roots, axis1=1, axis2=2)), axis=1)
        for k, leftover in enumerate(alike):
            found[leftover.key] = _Admitted(
                root=roots[k], on_spreads=scale[k] * on_spreads, log_det=float(log_det[k])
            )
    return found
