r"""Variants of a solved converter: Newton's rule on orbit, power, losses and temperatures at once.

What a steady state asks of start current, delays, phase, temperatures, bridge power and input current is one set of
equations F(z) = 0. Its Jacobian J is taken by differences once, at the solved points; at a variant nearby it is nearly
the same, and what it is not, the steps themselves teach (Broyden's rule, in the form that needs no other matrix:
Kelley, Solving Nonlinear Equations with Newton's Method, 2003, section 4.3):

.. math:: w = -J^{-1} F(z_k), \quad w \mathrel{+}= s_{j+1} \frac{s_j \cdot w}{s_j \cdot s_j} \; (j < k - 1), \quad
          s_k = \frac{w}{1 - s_{k-1} \cdot w / s_{k-1} \cdot s_{k-1}}

Two looks at a point do, where the rounds of :mod:`sim.fixed_point` need six to eight: a last step that is short is not
looked at again, the columns take it along how they respond. Where states bend on the way (an edge loses zero voltage,
two edges pass each other) steps stop getting shorter; such points are put aside and have their own response taken, all
together. What does not settle then is left to those rounds.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from sim.circuit import Temperatures
from sim.columns import FLAGS, columns, impossible
from sim.parameters import Converter
from sim.station import LEAST_W, Slow, Station

Array = NDArray[np.float64]
Rows = NDArray[np.intp]

_ROUNDS = 8
# from the second look on so few have their own response taken: it costs no more than a look
_AGAIN, _HANDFUL = 1, 40
# times that those put aside have their response taken: rounds of a single point cost ten such looks
_ANEW = 4
_FEW, _SHARE = 600, 1 / 30  # of all: more would cost as much as they save
_SHORTER = 0.5  # times the last step: a point whose steps are not is put aside
_LEAST, _MOST = 0.2, 6.0  # how much of a step the last one may make of it
_STATE_UNIT = (1.0, 1e-3, 1e-3, 1e-3, 1e-3, 1e-3)  # A, Th: start current, delays, phase
_RESTS_A = 1e-12  # a current that rests has no sign, which the rounding of a step must not give it
_SLOW_UNIT = {"I1_A": 0.1}  # the others: 1 K, 1 W
_DIFFERENCE = 1e-3  # of the units
_LAST = 2e-3  # of the units, and of a kilowatt: the response is right to some per cent of what a step does
_FRESH = 10.0  # times as long may it be where the response was taken there
_LAST_W = 1e-3  # of the power: the unit of one at that scale
_LEAST_STEP = 2e-5  # the same where no reference is at hand: some losses rise by 50 kW for a Th
_MISSED = 0.2  # of a power that is missed at the phase: as much of a step of power


def _unknowns(station: Station) -> Array:
    """z in its units, (n, N)."""
    slow = station.slow.by_name()
    return np.concatenate([station.known.state(), np.stack(list(slow.values()))]) / _units(station)


def started(station: Station, unknowns: Array) -> Station:
    """The station with other unknowns (n, N), where they are known and leave the dc link a voltage."""
    own, known = _unknowns(station), np.all(np.isfinite(unknowns), axis=0)
    sound = known & _at(station, np.where(known, unknowns, own)).powered()
    return _at(station, np.where(sound, unknowns, own))


def unknowns_of(converter: Converter) -> int:
    """How many unknowns n a converter's points have."""
    return len(_STATE_UNIT) + len(Temperatures.everywhere(converter, np.zeros(1)).by_place()) + 2


def _units(station: Station) -> Array:
    """Units of the unknowns, (n, 1)."""
    return np.array([*_STATE_UNIT, *(_SLOW_UNIT.get(name, 1.0) for name in station.slow.by_name())])[:, None]


def _at(station: Station, unknowns: Array) -> Station:
    """The station with other unknowns (n, N)."""
    z, known = unknowns * _units(station), station.known
    start_A = np.where(np.abs(z[0]) < _RESTS_A, 0.0, z[0])
    orbit = replace(known.orbit, start_A=start_A, delay=z[1:5])
    slow = Slow.of(dict(zip(station.slow.by_name(), z[6:], strict=True)))
    return replace(station, warm=replace(known, phase=z[5], orbit=orbit), slow=slow)


@dataclass(frozen=True, slots=True, kw_only=True)
class Response:
    """J^-1 at N solved points, (N, n, n), the unknowns in their units, and how columns move with them, (N, C, n)."""

    inverse: Array
    columns: Array

    @classmethod
    def of(cls, station: Station) -> "tuple[Response, Look]":
        """By differences about a state near a solution; and what there is at that state."""
        z = _unknowns(station)
        count, size = z.shape
        moved = np.tile(z, count + 1)
        for k in range(count):
            moved[k, (k + 1) * size : (k + 2) * size] += _DIFFERENCE
        look = Look.at(_at(station.take(np.tile(np.arange(size), count + 1)), moved))
        jacobian, change = _slopes(look.missed, size), _slopes(look.columns, size)
        change[:, -FLAGS:] = 0.0
        try:
            inverse = np.linalg.inv(jacobian)
        except np.linalg.LinAlgError:
            inverse = np.linalg.pinv(jacobian)
        response = cls(inverse=np.asarray(inverse, dtype=np.float64), columns=change)
        return response, look.take(np.arange(size))

    def nearer(self, station: Station, look: "Look") -> Station:
        """The station that this is the response of, one last step nearer to the solution."""
        step = self.step(np.arange(len(station.points)), look.missed)
        return _at(station, _unknowns(station) + np.where(_short(station, step, look.missed), step, 0.0))

    def take(self, chosen: Rows) -> "Response":
        """That of some of the points."""
        return Response(inverse=self.inverse[chosen], columns=self.columns[chosen])

    def step(self, chosen: Rows, missed: Array) -> Array:
        """Newton's step (n, M) at some of the points from what they miss, (n, M)."""
        return -_times(self.inverse, chosen, missed)

    def moved(self, chosen: Rows, step: Array) -> Array:
        """What a step (n, M) at some of the points adds to their columns, (C, M)."""
        return _times(self.columns, chosen, step)


def _times(matrices: Array, chosen: Rows, vectors: Array) -> Array:
    """Each vector (n, M) times the matrix (N, k, n) of its point, (k, M): those of a point all at once."""
    count = np.bincount(chosen, minlength=len(matrices))
    place, order = np.empty_like(chosen), np.argsort(chosen, kind="stable")
    place[order] = np.arange(chosen.size) - np.repeat(np.cumsum(count) - count, count)
    together = np.zeros((len(matrices), len(vectors), int(np.max(count, initial=1))))
    together[chosen, :, place] = vectors.T
    return np.ascontiguousarray(np.matmul(matrices, together)[chosen, :, place].T)


def _slopes(values: Array, size: int) -> Array:
    """Differences (N, k, n) that each unknown makes of k quantities, from those (k, (n + 1) N), none moved first."""
    apart = values.reshape(len(values), -1, size)
    return np.moveaxis(apart[:, 1:] - apart[:, :1], 2, 0) / _DIFFERENCE


@dataclass(frozen=True, slots=True, kw_only=True)
class Look:
    """What there is at N points: columns (C, N), why they cannot be, what they miss of a steady state (n, N)."""

    columns: Array
    why: NDArray[np.str_]
    missed: Array

    @classmethod
    def at(cls, station: Station) -> "Look":
        """All of it at a station."""
        state, missed = station.missed()
        told = columns(station.converter, state, station.points)
        return cls(columns=told, why=impossible(state, told), missed=missed)

    def take(self, chosen: Rows) -> "Look":
        """That of some of the points."""
        told, missed = (values.take(chosen, axis=1) for values in (self.columns, self.missed))
        return Look(columns=told, why=self.why[chosen], missed=missed)


def _short(station: Station, step: Array, missed: Array, last: float = _LAST) -> NDArray[np.bool_]:
    """Whether a step (n, N) from what is missed (n, N) is one to end with, ``last`` units at most."""
    kilowatts = _LAST_W * np.maximum(np.abs(np.asarray(station.points.power_W)), LEAST_W)
    power_W = np.maximum(np.abs(step[-2]), _MISSED * np.abs(missed[5]))
    return np.asarray(np.all(np.abs(step) < last, axis=0) & (power_W < last * kilowatts))


@dataclass(frozen=True, slots=True, kw_only=True)
class Found:
    """Points that settled: which ``rows`` (K,) they are, their columns (C, K), why they cannot be ("": they can).

    ``unknowns`` (n, K) are z there.
    """

    rows: Rows
    columns: Array
    why: NDArray[np.str_]
    unknowns: Array


def approach(
    station: Station,
    response: Response,
    origin: Rows,
    look: Look | None = None,
    *,
    anew: int = _ANEW,
    last: float = _LAST,
) -> Iterator[Found]:
    """Look after look at N variants, each of the point ``origin`` (N,) of the response; as they settle, what is found.

    The first look is given where there is one. What strays is put aside until all others are done, and then has its
    response taken ``anew``, so many times. A step below ``last`` of the units is the last one.
    """
    whole, rows, z = station, np.arange(origin.size), _unknowns(station)
    for times in range(anew + 1):
        aside, steps = list[tuple[Rows, Array]](), list[Array]()
        for turn in range(_ROUNDS):
            look = look or Look.at(station)
            step = _taught(response.step(origin, look.missed), steps)
            ends = _short(station, step, look.missed, last)
            if np.any(ends):
                done = np.flatnonzero(ends)
                there = look.take(done)
                further = response.moved(origin[done], step.take(done, axis=1))
                yield Found(
                    rows=rows[done], columns=there.columns + further, why=there.why,
                    unknowns=(z + step).take(done, axis=1),
                )  # fmt: skip
            look = None
            shorter = np.ones(rows.size, dtype=bool)
            if steps:
                shorter = _dot(step, step) < _SHORTER**2 * _dot(steps[-1], steps[-1])
            ahead = _at(station, z + step)
            onward = shorter & ahead.on_branch() & ahead.powered()
            strayed, going = np.flatnonzero(~ends & ~onward), np.flatnonzero(~ends & onward)
            aside.append((rows[strayed], z.take(strayed, axis=1)))
            rows, origin, z = rows[going], origin[going], (z + step).take(going, axis=1)
            if going.size <= (_HANDFUL if turn >= _AGAIN and times < anew else 0):
                break
            steps, station = [s.take(going, axis=1) for s in (*steps, step)], ahead.take(going)
        rows, z = (np.concatenate(parts, axis=-1) for parts in zip((rows, z), *aside, strict=True))
        if not rows.size or rows.size > max(_FEW, _SHARE * len(whole.points)) or times == anew:
            return
        station, origin = _at(whole.take(rows), z), np.arange(rows.size)
        (response, look), last = Response.of(station), _FRESH * _LAST


def settled_alone(station: Station) -> tuple[NDArray[np.bool_], Station]:
    """Which points settle by a response of their own, and the station with those there; the others are as they were."""
    settled, z = np.zeros(len(station.points), dtype=bool), _unknowns(station)
    response, look = Response.of(station)
    for found in approach(station, response, np.arange(settled.size), look, anew=0, last=_LEAST_STEP):
        settled[found.rows], z[:, found.rows] = True, found.unknowns
    return settled, _at(station, z)


def _taught(step: Array, steps: list[Array]) -> Array:
    """Newton's step (n, N) as the steps before have taught it."""
    for before, after in pairwise(steps):
        step = step + after * (_dot(before, step) / _dot(before, before))
    if not steps:
        return step
    return np.asarray(step / np.clip(1.0 - _dot(steps[-1], step) / _dot(steps[-1], steps[-1]), _LEAST, _MOST))


def _dot(a: Array, b: Array) -> Array:
    return np.asarray(np.einsum("kn,kn->n", a, b))
