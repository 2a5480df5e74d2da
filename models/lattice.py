"""The best modulation of a model that is not made of trees: a lattice over (D1, D2), refined around its best hills.

The simulator as a model costs a solution per point, so a swarm that asks for a few hundred at a time is slow; one
large lattice in one call and small ones around the best hills of each load are fast. Which hill is the highest shows
only near its top: at light load some narrow ones, where an edge just switches softly, lie within hundredths of a
point of each other. One that is too narrow for the nodes at one load is found at the next: loads side by side have
optima side by side, so each is offered the tops of its neighbours.

A model that knows its own edges only so well has its optimum where it is highest on average over as much in D1 and D2.
The top of a hill is often the very line along which an edge just switches softly, with a slope on one side of it and
next to none on the other: half of the time the top of the bench lies a little further, and it is the slope that was
chosen.
"""

from dataclasses import dataclass
from itertools import product
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from models.boosting import Floats
from models.optimise import OptimumTable
from models.surrogate import EfficiencyModel

_FIRST = 26  # nodes along D1 and along D2: steps of 0.04
_HILLS = (12, 12, 10, 10)  # of each load that are climbed, round by round: a narrow one is low at first
_HIGHEST = 6  # of them; the others lie apart, so that one long ridge does not take all places
_OFFERED = (0, 3, 2, 0)  # of the best tops of either neighbour in load, whose optimum is seldom far
_SAME, _APART = 0.03, 0.08  # in D1 and D2: tops nearer to each other are one top, or on one ridge
_AROUND = np.linspace(-1.0, 1.0, 5)
_NARROWER = 0.4
# of efficiency: by how much a hill may stay below the highest that is the better one on average
_LOWER = 1e-3
_ASIDE = np.array(list(product((-1, 0, 1), repeat=2)))  # from a place to those that it is averaged over
_DIGITS = 9  # of D1, D2 and W: points that differ by less are one


@runtime_checkable
class UnsureOfEdges(Protocol):
    """An efficiency model that knows where edges switch softly to ``edges_known_to`` in D1 and D2."""

    @property
    def edges_known_to(self) -> float:
        """One sigma, as a share of the half period."""
        ...


@dataclass(frozen=True, slots=True, kw_only=True)
class Hills:
    """The tops of the best hills of each load, all (L, hills), in no order; -inf where there is none."""

    efficiency: Floats
    D1: Floats
    D2: Floats


def hills_on_lattice(model: EfficiencyModel, loads_W: Floats) -> Hills:
    """The best hills of the predicted efficiency at each load (L,); some may be the same one.

    The model's own NaN marks what cannot run.
    """
    loads, seen = np.asarray(loads_W, dtype=np.float64), _Seen(model)
    nodes = np.linspace(0.0, 1.0, _FIRST)
    D1, D2 = (x.ravel() for x in np.meshgrid(nodes, nodes, indexing="ij"))
    value = seen.values(loads, np.tile(D1, (loads.size, 1)), np.tile(D2, (loads.size, 1)))
    tops = _tops(value.reshape(loads.size, _FIRST, _FIRST))  # (L, hills)
    best, first, second = np.take_along_axis(value, tops, axis=1), D1[tops], D2[tops]
    near = np.stack(np.meshgrid(_AROUND, _AROUND, indexing="ij")).reshape(2, -1)
    step, by_power = nodes[1], np.argsort(loads, kind="stable")
    for hills, offered in zip(_HILLS, _OFFERED, strict=True):
        kept = _ranked(best, first, second)[:, :hills]
        best, first, second = (np.take_along_axis(a, kept, axis=1) for a in (best, first, second))
        first, second = (_with_neighbours(a, by_power, offered) for a in (first, second))
        best = np.pad(best, ((0, 0), (0, 2 * offered)), constant_values=-np.inf)
        x = np.clip(first[:, :, None] + step * near[0], 0.0, 1.0)
        y = np.clip(second[:, :, None] + step * near[1], 0.0, 1.0)
        each = np.repeat(loads, first.shape[1])
        found = seen.values(each, *(a.reshape(-1, near[0].size) for a in (x, y)))
        found = _beside(best, found.reshape(x.shape))
        k = np.argmax(found, axis=2)[:, :, None]
        best, first, second = (
            np.take_along_axis(a, k, axis=2)[:, :, 0] for a in (found, _beside(first, x), _beside(second, y))
        )
        step *= _NARROWER
    return Hills(efficiency=best, D1=first, D2=second)


def optimise_on_lattice(model: EfficiencyModel, loads_W: Floats) -> OptimumTable:
    """D1 and D2 of the highest predicted efficiency at each load (L,); NaN where nothing carries it.

    Of a model that is :class:`UnsureOfEdges` it is the highest on average over as much. ``regret`` is NaN: there is no
    exact optimum to compare with. The model's own NaN marks what cannot run.
    """
    loads = np.asarray(loads_W, dtype=np.float64)
    hills = hills_on_lattice(model, loads)
    if isinstance(model, UnsureOfEdges):
        hills = _averaged(model, model.edges_known_to, hills, loads)
    highest = np.arange(loads.size), np.argmax(hills.efficiency, axis=1)
    D1, D2 = hills.D1[highest], hills.D2[highest]
    reached = np.isfinite(hills.efficiency[highest])
    predicted = np.full(loads.size, np.nan)
    if np.any(reached):
        predicted[reached] = model.predict(D1[reached], D2[reached], loads[reached])
    return OptimumTable(
        power_W=loads,
        D1=np.where(reached, D1, np.nan),
        D2=np.where(reached, D2, np.nan),
        predicted=predicted,
        regret=np.full(loads.size, np.nan),
        confirmed=reached,
        optimiser="lattice, refined",
        evaluations=_FIRST**2 + (sum(_HILLS) + 2 * sum(_OFFERED)) * _AROUND.size**2,
    )


def _averaged(model: EfficiencyModel, aside: float, hills: Hills, loads: Floats) -> Hills:
    """About the best tops of each load the places (L, hills) that are highest on average over so much aside.

    A place is averaged where all of that can run. A load that has none such keeps its tops.
    """
    best = np.max(hills.efficiency, axis=1, keepdims=True)
    load, hill = np.nonzero(np.isfinite(hills.efficiency) & (hills.efficiency >= best - _LOWER))
    top = np.stack([hills.D1[load, hill], hills.D2[load, hill]], axis=1)
    place = np.clip(top[:, None] + aside * _ASIDE, 0.0, 1.0)  # (K, 9, 2)
    movable = ((place > 0.0) & (place < 1.0))[:, :, None]  # there is no edge at the ends
    beside = np.clip(place[:, :, None] + aside * _ASIDE * movable, 0.0, 1.0)  # (K, 9, 9, 2)
    power_W = np.broadcast_to(loads[load][:, None, None], beside.shape[:-1])
    mean = _Seen(model).values_at(beside[..., 0], beside[..., 1], power_W).mean(axis=2)
    chosen = np.arange(load.size), np.argmax(mean, axis=1)
    value = np.full_like(hills.efficiency, -np.inf)
    value[load, hill] = mean[chosen]
    D1, D2 = hills.D1.copy(), hills.D2.copy()
    D1[load, hill], D2[load, hill] = place[chosen].T
    kept = ~np.any(np.isfinite(value), axis=1, keepdims=True)
    return Hills(
        efficiency=np.where(kept, hills.efficiency, value),
        D1=np.where(kept, hills.D1, D1),
        D2=np.where(kept, hills.D2, D2),
    )


def _ranked(value: Floats, D1: Floats, D2: Floats) -> NDArray[np.intp]:
    """The order (L, hills) in which tops are kept: some from the highest on, then those apart from higher ones."""
    order = np.argsort(-value, axis=1, kind="stable")
    x, y = (np.take_along_axis(a, order, axis=1) for a in (D1, D2))
    distance = np.maximum(np.abs(x[:, :, None] - x[:, None]), np.abs(y[:, :, None] - y[:, None]))
    again, on_a_ridge = (np.any(np.tril(distance < near, k=-1), axis=2) for near in (_SAME, _APART))
    place = np.argsort(np.argsort(again, axis=1, kind="stable"), axis=1)
    later = np.argsort(np.where(place < _HIGHEST, -1, on_a_ridge), axis=1, kind="stable")
    return np.take_along_axis(order, later, axis=1)


def _with_neighbours(tops: Floats, by_power: NDArray[np.intp], count: int) -> Floats:
    """Tops (L, hills), then the first of those of the load below and of the load above, (L, hills + 2 count)."""
    place, last = np.argsort(by_power), by_power.size - 1
    below, above = (by_power[np.clip(place + step, 0, last)] for step in (-1, 1))
    return np.concatenate([tops, tops[below, :count], tops[above, :count]], axis=1)


def _beside(one: Floats, more: Floats) -> Floats:
    """One candidate (L, hills) before more of them (L, hills, K)."""
    return np.concatenate([one[:, :, None], more], axis=2)


class _Seen:
    """A model that is asked once for each point: hills next to each other share most of what lies around them."""

    def __init__(self, model: EfficiencyModel) -> None:
        self._model = model
        self._place, self._value = np.empty((0, 3)), np.empty(0)

    def values(self, loads: Floats, D1: Floats, D2: Floats) -> Floats:
        """Efficiency at candidates (L, K) of each load, -inf where it is not carried."""
        return self.values_at(D1, D2, np.repeat(loads[:, None], D1.shape[1], axis=1))

    def values_at(self, D1: Floats, D2: Floats, power_W: Floats) -> Floats:
        """The same at points, all of one shape."""
        asked = np.stack([D1.ravel(), D2.ravel(), power_W.ravel()], axis=1)
        place, known = np.concatenate([self._place, asked]), self._value.size
        _, first, which = np.unique(np.round(place, _DIGITS), axis=0, return_index=True, return_inverse=True)
        new = np.sort(first[first >= known])
        value = np.concatenate([self._value, np.full(len(asked), np.nan)])
        if new.size:
            value[new] = self._model.predict(*place[new].T)
        kept = np.append(np.arange(known), new)
        self._place, self._value = place[kept], value[kept]
        found = value[first[which.ravel()[known:]]].reshape(D1.shape)
        return np.where(np.isfinite(found), found, -np.inf)


def _tops(value: Floats) -> NDArray[np.intp]:
    """The highest nodes of (L, n, n) that no neighbour tops, then the highest of all others, (L, hills)."""
    count = value.shape[1]
    padded = np.pad(value, ((0, 0), (1, 1), (1, 1)), constant_values=-np.inf)
    shifts = [(i, j) for i in range(3) for j in range(3)]
    highest = np.max([padded[:, i : i + count, j : j + count] for i, j in shifts], axis=0)
    top = (value >= highest) & np.isfinite(value)
    ranked = np.lexsort((-value.reshape(len(value), -1), ~top.reshape(len(value), -1)), axis=1)
    return np.asarray(ranked[:, : _HILLS[0]])
