r"""Variants of a solved converter: Newton's rule on orbit, power, losses and temperatures at once.

What a steady state asks of start current, delays, phase, temperatures, bridge power and input current is one set of
equations F(z) = 0. Its Jacobian J is taken by differences once, at the solved points; at a variant nearby it is nearly
the same, and what it is not, the steps themselves teach (Broyden's rule, in the form that needs no other matrix:
Kelley, Solving Nonlinear Equations with Newton's Method, 2003, section 4.3):

.. math:: w = -J^{-1} F(z_k), \quad w \mathrel{+}= s_{j+1} \frac{s_j \cdot w}{s_j \cdot s_j} \; (j < k - 1), \quad
          s_k = \frac{w}{1 - s_{k-1} \cdot w / s_{k-1} \cdot s_{k-1}}

Three or four looks at a point do, where the rounds of :mod:`sim.fixed_point` need six to eight. Where states bend (an
edge loses zero voltage, two edges pass each other) this may not settle: such points are left to those rounds.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from sim.station import OperatingState, Slow, Station

Array = NDArray[np.float64]
Rows = NDArray[np.intp]

_ROUNDS = 14
_WORSE = 10.0  # times the last step: a point that strays so far is left to others
_LEAST, _MOST = 0.2, 6.0  # how much of a step the last one may make of it
_STATE_UNIT = (1.0, 1e-3, 1e-3, 1e-3, 1e-3, 1e-3)  # A, Th: start current, delays, phase
_SLOW_UNIT = {"I1_A": 0.1}  # the others: 1 K, 1 W
_DIFFERENCE = 1e-3  # of the units
_LAST = 1e-2  # of the units: a longer step is none to end with


def _unknowns(station: Station) -> Array:
    """z in its units, (n, N)."""
    slow = station.slow.by_name()
    return np.concatenate([station.known.state(), np.stack(list(slow.values()))]) / _units(station)


def _units(station: Station) -> Array:
    """Units of the unknowns, (n, 1)."""
    return np.array([*_STATE_UNIT, *(_SLOW_UNIT.get(name, 1.0) for name in station.slow.by_name())])[:, None]


def _at(station: Station, unknowns: Array) -> Station:
    """The station with other unknowns (n, N)."""
    z, known = unknowns * _units(station), station.known
    orbit = replace(known.orbit, start_A=z[0], delay=z[1:5])
    slow = Slow.of(dict(zip(station.slow.by_name(), z[6:], strict=True)))
    return replace(station, warm=replace(known, phase=z[5], orbit=orbit), slow=slow)


@dataclass(frozen=True, slots=True, kw_only=True)
class Response:
    """J^-1 at N solved points, (N, n, n), the unknowns in their units."""

    inverse: Array

    @classmethod
    def of(cls, station: Station) -> "tuple[Response, Station]":
        """By differences about a solution; and the solution, one last step nearer."""
        z, (_, left) = _unknowns(station), station.missed()
        count, size = z.shape
        moved = np.tile(z, count)
        for k in range(count):
            moved[k, k * size : (k + 1) * size] += _DIFFERENCE
        everywhere = np.arange(size)
        _, missed = _at(station.take(np.tile(everywhere, count)), moved).missed()
        change = missed.reshape(count, count, size) - left[:, None]  # equation, unknown, point
        jacobian = np.moveaxis(change, 2, 0) / _DIFFERENCE
        try:
            inverse = np.linalg.inv(jacobian)
        except np.linalg.LinAlgError:
            inverse = np.linalg.pinv(jacobian)
        response = cls(inverse=np.asarray(inverse, dtype=np.float64))
        step = response.step(everywhere, left)
        return response, _at(station, z + np.where(np.sum(step**2, axis=0) < _LAST**2, step, 0.0))

    def take(self, chosen: Rows) -> "Response":
        """That of some of the points."""
        return Response(inverse=self.inverse[chosen])

    def step(self, chosen: Rows, missed: Array) -> Array:
        """Newton's step (n, M) at some of the points from what they miss, (n, M)."""
        return np.asarray(-np.matmul(self.inverse[chosen], missed.T[..., None])[..., 0].T)


def approach(
    station: Station, response: Response, origin: Rows
) -> Iterator[tuple[Rows, NDArray[np.bool_], OperatingState]]:
    """Look after look at N variants, each of the point ``origin`` (N,) of the response.

    Every time some have settled, the rows that were looked at, which of them settled, and the state of all of them.
    """
    rows, z, steps = np.arange(len(station.points)), _unknowns(station), list[Array]()
    for _ in range(_ROUNDS):
        state, missed = station.missed()
        settled = station.settled(state, missed)
        if np.any(settled):
            yield rows, settled, state
        step = _taught(response.step(origin[rows], missed), steps)
        nearer = np.ones(rows.size, dtype=bool)
        if steps:
            nearer = np.sum(step**2, axis=0) < _WORSE**2 * np.sum(steps[-1] ** 2, axis=0)
        ahead = _at(station, z + step)
        going = np.flatnonzero(~settled & nearer & ahead.on_branch())
        if not going.size:
            return
        rows, z = rows[going], (z + step)[:, going]
        steps = [s[:, going] for s in (*steps, step)]
        station = ahead.take(going)


def _taught(step: Array, steps: list[Array]) -> Array:
    """Newton's step (n, N) as the steps before have taught it."""
    for before, after in pairwise(steps):
        step = step + after * (_dot(before, step) / _dot(before, before))
    if not steps:
        return step
    return np.asarray(step / np.clip(1.0 - _dot(steps[-1], step) / _dot(steps[-1], steps[-1]), _LEAST, _MOST))


def _dot(a: Array, b: Array) -> Array:
    return np.asarray(np.einsum("kn,kn->n", a, b))
