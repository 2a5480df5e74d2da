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

from sim.fixed_point import carries
from sim.model import Model
from sim.neighbours import unknowns_of
from sim.operating_points import Points, efficiency, grid, grid_of
from sim.parameters import Converter
from sim.shares import shares
from sim.side_by_side import side_by_side
from sim.solution import Seed, Solution, lossless_peak_W, refused, solve
from sim.stacking import pick, stack
from sim.station import AT_INPUT, AT_OUTPUT, IN_LINK

__all__ = ["PARTS", "Points", "Result", "can_run", "each_can_run", "grid", "grid_of", "lossless_most_W", "simulate",
           "simulate_each", "simulate_many"]  # fmt: skip

Array = NDArray[np.float64]

PARTS = (*AT_INPUT, *IN_LINK, *AT_OUTPUT, "auxiliary", "input_cable", "output_cable", "added")
_NARROWER = 2.0  # dead times: no pulse is made so much narrower
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
    seed: Seed | None = field(default=None, repr=False, compare=False)
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
        whole = solve(first.altered_converter(), first.set_points(points), None, learn=len(variants) >= _MANY)
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
    solved = solve(model.altered_converter(), model.set_points(points), None, learn=True)
    return _result(model, points, solved)


def answering(near: Result, model: Model, unknowns: Array) -> Result:
    """A result for variants to start from as before, whose points respond as those of another model do.

    ``unknowns`` (n, N) are those that the model was solved for.
    """
    if near.seed is None:
        return near
    seed = near.seed.answering(model.altered_converter(), model.set_points(near.points), unknowns)
    return replace(near, seed=seed)


Case = tuple[Model, Points]
_Circuit = tuple[Converter, Points]
_Share = tuple[list[_Circuit], Seed | None, list[Array | None]]


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
    circuits: "list[_Circuit]", seed: Seed | None, starts: Sequence[Array | None], processes: int
) -> list[Solution]:
    """Converters at their points, in as few calls and processes as take the least time."""
    size = len(circuits[0][1])
    parts = shares([c.inductor.saturates for c, _ in circuits], size, processes)
    asked = [([circuits[k] for k in own.circuits], seed, [starts[k] for k in own.circuits]) for own in parts]
    # shares come back whole: to pickle a few long columns takes a tenth of what many short ones do
    found = {
        own.circuits[k]: whole.rows(slice(n * size, (n + 1) * size))
        for own, solved in zip(parts, side_by_side(_share_solved, asked), strict=True)
        for chosen, whole in solved
        for n, k in enumerate(chosen)
    }
    return [found[k] for k in range(len(circuits))]


def _share_solved(share: "_Share") -> "list[tuple[list[int], Solution]]":
    """Solutions, each of some of the share's circuits one after the other."""
    (circuits, seed, starts), found = share, []
    for chosen, converter, points in _stacked(circuits):
        unknown = np.full((unknowns_of(converter), len(circuits[0][1])), np.nan)
        ahead = [unknown if own is None else own for own in (starts[k] for k in chosen)]
        start = None if seed is None else replace(seed, ahead=np.concatenate(ahead, axis=1))
        found.append((chosen, solve(converter, points, start)))
    return found


def _stacked(circuits: "list[_Circuit]") -> Iterator[tuple[list[int], Converter, Points]]:
    """Converters and their points as one, for each call that is worth making."""
    (whole,) = shares([c.inductor.saturates for c, _ in circuits], len(circuits[0][1]), processes=1)
    for chosen in whole.calls:
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
        alone = refused(converter, moved) == ""
        tried = np.flatnonzero(alone & np.asarray(moved.pwm, dtype=bool))
        if tried.size:
            alone[tried] = carries(pick(converter, tried), moved.take(tried))
        runs[chosen] = alone.reshape(len(chosen), -1)
    return runs[slots]


def lossless_most_W(model: Model, points: Points) -> Array:
    """What N points carry at most without losses, pulses two dead times narrower, in W, (N,); 0 where none can run.

    No state is solved for: it tells in no time how what models carry compares.
    """
    converter, at = model.altered_converter(), model.set_points(points)
    return np.where(refused(converter, at) == "", lossless_peak_W(at, converter, -_NARROWER), 0.0)


def _result(model: Model, points: Points, solution: Solution) -> Result:
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
