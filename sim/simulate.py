"""``simulate(model, points)``: the one entry that others need.

For each point the phase is solved for the demanded power, losses and temperatures are brought to their
fixed point, and the chain of powers follows, each loss at its node::

    P1 - [cable, auxiliary, primary bridge] - P_link1 - [inductor, transformer] - P_link2
       - [secondary bridge, cable] - P2

A loss behind P_link2 moves D0; one before it does not.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from sim.columns import columns, columns_of, impossible
from sim.fixed_point import Outcome, carries, operate
from sim.model import Model
from sim.modulation import centre_offset, hybrid_edges, infeasible_pulse, outside_modulation
from sim.neighbours import Response, approach, started, unknowns_of
from sim.operating_points import Points, efficiency, grid, grid_of
from sim.parameters import Converter
from sim.piecewise import power_share
from sim.side_by_side import dealt, side_by_side
from sim.stacking import pick, stack
from sim.station import AT_INPUT, AT_OUTPUT, IN_LINK, WarmStart, station_of

__all__ = ["PARTS", "Points", "Result", "can_run", "each_can_run", "grid", "grid_of", "simulate", "simulate_each",
           "simulate_many"]  # fmt: skip

Array = NDArray[np.float64]

PARTS = (*AT_INPUT, *IN_LINK, *AT_OUTPUT, "auxiliary", "input_cable", "output_cable", "added")
_SPARE = 0.12  # of the power: a variant that can carry so much less is refused nowhere by its start
_WORTH_SHARING = 400  # rows in each process: to send them takes a tenth of what they take
_SATURATING = 15  # others at the same points take as long as one variant that saturates
_MANY = 4  # variants at once that pay for their response being learned


@dataclass(frozen=True, slots=True, kw_only=True)
class Result:
    """What the model says of N points: flags, reasons, and columns of shape (N,), NaN where infeasible.

    ``seed`` is what variants of the model start from. In standby (``pwm`` false) the input takes nothing, and the
    bridge's columns are NaN. ``state`` (n, N) is what a variant was solved for, in the units of :mod:`sim.neighbours`.
    """

    points: Points
    feasible: NDArray[np.bool_]
    reason: NDArray[np.str_]
    values: dict[str, Array]
    seed: "_Seed | None" = field(default=None, repr=False, compare=False)
    state: Array = field(default_factory=lambda: np.zeros((0, 0)), repr=False, compare=False)

    def __getitem__(self, column: str) -> Array:
        return self.values[column]

    def take(self, chosen: NDArray[np.intp]) -> "Result":
        """Some of the points, and what variants there start from."""
        return Result(
            points=self.points.take(chosen),
            feasible=self.feasible[chosen],
            reason=self.reason[chosen],
            values={name: value[chosen] for name, value in self.values.items()},
            seed=None if self.seed is None else self.seed.take(chosen),
            state=self.state.take(chosen, axis=1) if self.state.size else self.state,
        )

    def columns(self) -> dict[str, NDArray[np.generic]]:
        """The simulation table: inputs, ``feasible``, then every result column."""
        p = self.points
        inputs: dict[str, NDArray[np.generic]] = {
            "D1": np.asarray(p.D1), "D2": np.asarray(p.D2), "P_set_W": np.asarray(p.power_W),
        }  # fmt: skip
        return inputs | {"feasible": self.feasible, "reason": self.reason} | dict(self.values)


def simulate(model: Model, points: Points) -> Result:
    """Simulate a model at N points; ``feasible`` tells which run, the others carry a reason and NaN."""
    return simulate_many([model], points)[0]


def simulate_many(models: Sequence[Model], points: Points, near: Result | None = None) -> list[Result]:
    """Several variants of one converter at the same points, in one vectorised call.

    All are solved from ``near``, a result of one of them or their like at the same points, where that has power
    to spare; without it the first is solved from nothing and the others from that.
    """
    given = points.with_voltages_of(models[0].converter)
    return simulate_each([(model, given) for model in models], near)


def simulate_each(
    cases: "Sequence[Case]",
    near: Result | None = None,
    starts: Sequence[Array | None] = (),
    processes: int = 1,
) -> list[Result]:
    """The same, each variant at points of its own, as many of them for each.

    ``starts`` are states (n, N) of the results of near variants; a variant with one starts there. What is worth it is
    shared between so many ``processes``; only a program that owns its process may ask for more than one.
    """
    variants, results, seed = list(cases), [], None if near is None else near.seed
    if seed is None:
        first, points = variants.pop(0)
        whole = _solve(
            first.altered_converter(), first.set_points(points), None, learn=len(variants) >= _MANY
        )
        results, seed = [_result(first, points, whole)], whole.seed
    if variants:
        distinct, slots = _circuits(variants)
        own = dict(zip(reversed(slots), reversed(starts), strict=True)) if starts else {}
        starting = [own.get(k) for k in range(len(distinct))]
        solved = _all_solved(distinct, seed, starting, processes)
        results += [_result(*case, solved[k]) for case, k in zip(variants, slots, strict=True)]
    return results


def reference(model: Model, points: Points) -> Result:
    """A result for many variants to start from: how its points respond to whatever changes is found as well."""
    solved = _solve(model.altered_converter(), model.set_points(points), None, learn=True)
    return _result(model, points, solved)


Case = tuple[Model, Points]
_Circuit = tuple[Converter, Points]
_Share = tuple[list[_Circuit], "_Seed | None", list[Array | None]]


def _circuits(cases: Sequence[Case]) -> tuple[list[_Circuit], list[int]]:
    """The converters and set points that differ, and which of them each case has.

    What an effect adds at the input or does to a reading needs no solution of its own.
    """
    distinct: list[_Circuit] = []
    slots = []
    for model, points in cases:
        altered, moved = model.altered_converter(), model.set_points(points)
        same = (k for k, (other, where) in enumerate(distinct) if other is altered and where is moved)
        slots.append(next(same, len(distinct)))
        if slots[-1] == len(distinct):
            distinct.append((altered, moved))
    return distinct, slots


def _all_solved(
    circuits: "list[_Circuit]", seed: "_Seed | None", starts: Sequence[Array | None], processes: int
) -> "list[_Solution]":
    """Converters at their points, all in one call but for those that saturate, and a call in each process."""
    size = len(circuits[0][1])
    cost = [_SATURATING if c.inductor.saturates else 1 for c, _ in circuits]
    parts = dealt(cost, processes if len(circuits) * size >= processes * _WORTH_SHARING else 1)
    shares = [([circuits[k] for k in part], seed, [starts[k] for k in part]) for part in parts]
    # shares come back whole: to pickle a few long columns takes a tenth of what many short ones do
    found = {
        int(part[k]): whole.rows(slice(n * size, (n + 1) * size))
        for part, solved in zip(parts, side_by_side(_share_solved, shares), strict=True)
        for chosen, whole in solved
        for n, k in enumerate(chosen)
    }
    return [found[k] for k in range(len(circuits))]


def _share_solved(share: "_Share") -> "list[tuple[list[int], _Solution]]":
    """Solutions, each of some of the share's circuits one after the other."""
    (circuits, seed, starts), found = share, []
    for chosen, converter, points in _stacked(circuits):
        unknown = np.full((unknowns_of(converter), len(circuits[0][1])), np.nan)
        ahead = [unknown if own is None else own for own in (starts[k] for k in chosen)]
        start = None if seed is None else replace(seed, ahead=np.concatenate(ahead, axis=1))
        found.append((chosen, _solve(converter, points, start)))
    return found


def _stacked(circuits: "list[_Circuit]") -> Iterator[tuple[list[int], Converter, Points]]:
    """Converters and their points as one, but for those that saturate: they take longer."""
    for saturates in (False, True):
        chosen = [k for k, (c, _) in enumerate(circuits) if c.inductor.saturates == saturates]
        if chosen:
            converter = stack([circuits[k][0] for k in chosen], len(circuits[chosen[0]][1]))
            yield chosen, converter, Points.join([circuits[k][1] for k in chosen])


def can_run(models: Model | Sequence[Model], points: Points) -> NDArray[np.bool_]:
    """Whether points can run with a model, or with all of several: much faster than :func:`simulate`, no fixed point.

    Parts are taken 20 K above ambient; at the very limit of what D1 and D2 carry the two may differ.
    """
    return np.asarray(np.all(each_can_run([models] if isinstance(models, Model) else models, points), axis=0))


def each_can_run(models: Sequence[Model], points: Points) -> NDArray[np.bool_]:
    """The same of N points with each of K models, (K, N)."""
    given = points.with_voltages_of(models[0].converter)
    circuits, slots = _circuits([(model, given) for model in models])
    runs = np.empty((len(circuits), len(points)), dtype=bool)
    for chosen, converter, moved in _stacked(circuits):
        alone = _refused(converter, moved) == ""
        tried = np.flatnonzero(alone & np.asarray(moved.pwm, dtype=bool))
        if tried.size:
            alone[tried] = carries(pick(converter, tried), moved.take(tried))
        runs[chosen] = alone.reshape(len(chosen), -1)
    return runs[slots]


@dataclass(frozen=True, slots=True, kw_only=True)
class _Seed:
    """Warm starts of the points ``rows`` (K,) of a set of ``size``; ``spare`` (K,) tells which have power to spare.

    ``ahead`` (n, V size) is where V variants start with their response, NaN where at the start itself.
    """

    size: int
    rows: NDArray[np.intp]
    start: WarmStart
    spare: NDArray[np.bool_]
    response: Response | None = None
    ahead: Array | None = None

    @classmethod
    def of(cls, size: int, rows: NDArray[np.intp], outcome: Outcome, *, learn: bool) -> "_Seed":
        """Of what was solved at ``rows`` of ``size`` points."""
        solved, response = outcome.station.ready(outcome.state), None
        if learn and rows.size:
            response, look = Response.of(solved)
            solved = response.nearer(solved, look)
        return cls(
            size=size, rows=rows, start=solved.start(), spare=outcome.comfortable(_SPARE), response=response
        )

    def take(self, chosen: NDArray[np.intp]) -> "_Seed":
        """The starts for some of the points."""
        place = self.find(chosen)
        rows = np.flatnonzero(place >= 0)
        own = place[rows]
        return _Seed(
            size=chosen.size, rows=rows, start=self.start.take(own), spare=self.spare[own],
            response=None if self.response is None else self.response.take(own),
        )  # fmt: skip

    def find(self, rows: NDArray[np.intp]) -> NDArray[np.intp]:
        """Which start each row of a repeated set has, -1 for none."""
        place = np.full(self.size, -1)
        place[self.rows] = np.arange(self.rows.size)
        return np.asarray(place[rows % self.size])


@dataclass(frozen=True, slots=True, kw_only=True)
class _Table:
    """What is found at N points, columns (C, N) and states of variants (n, N), written to as it is found."""

    reason: NDArray[np.str_]
    columns: Array
    states: Array

    def put(self, rows: NDArray[np.intp], columns: Array, why: NDArray[np.str_]) -> None:
        """Columns (C, K) of some points; of those that cannot be, the reason why."""
        sound = np.flatnonzero(why == "")
        self.columns[:, rows[sound]] = columns[:, sound]
        for k in np.flatnonzero(why != "").tolist():
            self.reason[rows[k]] = why[k]

    def visit(
        self,
        converter: Converter,
        points: Points,
        rows: NDArray[np.intp],
        seed: _Seed,
        place: NDArray[np.intp],
    ) -> NDArray[np.intp]:
        """Solve variants from their neighbours in ``seed``; which of the rows that did not settle."""
        if seed.response is None or not rows.size:
            return np.arange(rows.size)
        at, open_ = points.take(rows), np.ones(rows.size, dtype=bool)
        station = station_of(pick(converter, rows), at, seed.start.take(place))
        if seed.ahead is not None:
            station = started(station, seed.ahead.take(rows, axis=1))
        for found in approach(station, seed.response, place):
            self.put(rows[found.rows], found.columns, found.why)
            self.states[:, rows[found.rows]] = found.unknowns
            open_[found.rows] = False
        return np.flatnonzero(open_)


@dataclass(frozen=True, slots=True, kw_only=True)
class _Solution:
    """Reason of infeasibility ("" where feasible), every column's true value, a start for variants, and the state."""

    reason: NDArray[np.str_]
    values: dict[str, Array]
    seed: _Seed | None
    state: Array

    def rows(self, chosen: slice) -> "_Solution":
        """A stretch of the points."""
        values = {name: value[chosen] for name, value in self.values.items()}
        return _Solution(reason=self.reason[chosen], values=values, seed=None, state=self.state[:, chosen])


def _result(model: Model, points: Points, solution: _Solution) -> Result:
    at = model.set_points(points)
    shown = model.observe(at, _with_added_loss(model, at, solution.values))
    return Result(
        points=points,
        feasible=solution.reason == "",
        reason=solution.reason,
        values=shown,
        seed=solution.seed,
        state=solution.state,
    )


def _with_added_loss(model: Model, points: Points, truth: dict[str, Array]) -> dict[str, Array]:
    added = model.added_loss_W(points, truth)
    P1 = truth["P1_W"] + added
    return truth | {
        "P1_W": P1,
        "I1_A": P1 / np.asarray(points.V1_V),
        "loss_added_W": truth["loss_added_W"] + added,
        "efficiency": efficiency(P1, truth["P2_W"]),
    }


def _ceiling_W(points: Points, converter: Converter) -> Array:
    """More than a point can carry: the lossless peak with both pulses widened by two dead times."""
    scale_W = (
        points.V1_V * points.V2_V * converter.transformer.turns_ratio
        * converter.half_period_s / (converter.inductor.inductance_H * converter.inductor.bands()[1][-1])
    )  # fmt: skip
    wider = 2 * converter.dead_time_s / converter.half_period_s
    D1, D2 = np.minimum(points.D1 + wider, 1.0), np.maximum(points.D2 - wider, 0.0)
    share, _ = power_share(hybrid_edges(0.5 - centre_offset(D1, D2), D1, D2))
    return np.asarray(scale_W * share)


def _solve(converter: Converter, points: Points, seed: _Seed | None, *, learn: bool = False) -> _Solution:
    """Solve every point that can be; points with a start in ``seed`` go from there.

    Without one, variants may start from what is left; with ``learn`` they know its response as well.
    """
    size = len(points)
    reason = _refused(converter, points)
    standby = ~np.asarray(points.pwm, dtype=bool)
    names = columns_of(converter)
    table = _Table(
        reason=reason,
        columns=np.full((len(names), size), np.nan),
        states=np.full((unknowns_of(converter), size), np.nan),
    )
    run = np.flatnonzero((reason == "") & ~standby)
    place = np.full(run.size, -1) if seed is None else seed.find(run)
    left: _Seed | None = None
    if seed is not None:
        near = np.flatnonzero(place >= 0)
        open_ = table.visit(converter, points, run[near], seed, place[near])
        keep = np.sort(np.concatenate([np.flatnonzero(place < 0), near[open_]]))
        run, place = run[keep], place[keep]
        place[place >= 0] = np.where(seed.spare[place[place >= 0]], place[place >= 0], -1)
    for rows, start in ((run[place < 0], None), (run[place >= 0], seed)):
        if not rows.size:
            continue
        at = points.take(rows)
        warm = None if start is None else start.start.take(place[place >= 0])
        outcome = operate(pick(converter, rows), at, warm)
        for k in np.flatnonzero(~outcome.reached).tolist():
            reason[rows[k]] = _why_not(float(outcome.most_W[k]))
        there = np.flatnonzero(outcome.reached)
        found = columns(converter, outcome.state, at.take(there))
        table.put(rows[there], found, impossible(outcome.state, found))
        if seed is None:
            left = _Seed.of(size, rows[there], outcome, learn=learn)
    values = dict(zip(names, table.columns, strict=True))
    for name in ("P1_W", "I1_A", "P2_W", "loss_added_W"):
        values[name][standby] = 0.0
    values["T_heatsink_C"][standby] = np.asarray(points.ambient_C)[standby]
    return _Solution(reason=reason, values=values, seed=left, state=table.states)


def _refused(converter: Converter, points: Points) -> NDArray[np.str_]:
    """Why a point need not be tried, "" where it must; standby is never refused."""
    dead = np.broadcast_to(converter.dead_time_s / converter.half_period_s, (len(points),))
    D1, D2 = np.asarray(points.D1), np.asarray(points.D2)
    reason, open_ = np.full(len(points), "", dtype="U96"), np.asarray(points.pwm, dtype=bool).copy()
    for told in (infeasible_pulse(D1, D2, dead), outside_modulation(converter.modulation, D1, D2)):
        rows = np.flatnonzero(open_ & (told != ""))
        reason[rows], open_[rows] = told[rows], False
    most = _ceiling_W(points, converter)
    for k in np.flatnonzero(open_ & (np.abs(points.power_W) >= most)):
        reason[k] = f"D1 and D2 carry less than {most[k]:.0f} W"
    return reason


def _why_not(most_W: float) -> str:
    if np.isfinite(most_W):
        return f"D1 and D2 carry at most {most_W:.0f} W into the secondary bridge"
    return "no steady state found"
