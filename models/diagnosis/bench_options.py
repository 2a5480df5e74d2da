"""What can be done on the bench, and what every explanation that is left says of it."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from models.diagnosis.near_limit import margin
from models.diagnosis.observations import Channel, Observations
from sim.effects.catalogue import effect
from sim.model import Model
from sim.operating_points import Points
from sim.parameters import MOST_DEAD_TIME, Converter
from sim.simulate import Result, can_run, reference, simulate_many
from sim.size import size

Array = NDArray[np.float64]
SetPoint = tuple[float, float, float]

UNLOADED = ("standby", "no_load")
# Assumption: minutes of a point that has to settle, of one without load, of work at an open bench, of a warmer room
_POINT_MIN, _UNLOADED_MIN, _REBUILD_MIN, _AMBIENT_MIN = 4.0, 1.5, 15.0, 60.0
_AMBIENT_K = 15.0  # as much as a heater does to a closed bench
_DEAD_TIME_LONGER = 0.5  # of the converter's own
_SPARE = 0.02  # of the power, beside the margin that a diagnosis keeps from the most that can be carried
_AXES = (5, 5, 6)  # points over the measured ranges of D1, D2 and power
_HALVINGS = 6  # of the range of power, on the way to the most that can be carried
_AGAIN = 12  # measured points at most that may be measured again
_PORT_1 = ("analyzer_gain", "analyzer_offset", "analyzer_range_step")
# Stated for the prototype, and scaled to any other converter:
_WINDING_Ohm = 1e-3  # what four wires are good to
_LINK_V = 200.0  # Assumption: rms current is about power over this, as far as its noise matters
# Noise of one averaged reading: relative to the power and least, or constant.
_RELATIVE = {"P1_W": (1.5e-4, 0.05), "P_link1_W": (5e-4, 0.2), "P_link2_W": (5e-4, 0.2)}
_CONSTANT = {"D0": 2e-4, "T_heatsink_C": 0.3, "T_inductor_C": 0.4, "T_transformer_C": 0.4}
_CURRENT = (5e-4, 2e-3)


@dataclass(frozen=True, slots=True, kw_only=True)
class Allowed:
    """What may be proposed, and the bench minutes that it takes.

    ``set_points`` (N, 3) of D1, D2 and power in W; without them measured ones, and a grid over their
    ranges where these are few.
    ``by_hand`` allows what somebody has to come for: another wiring, another dead time, a warmer room. A step has to
    separate two explanations by ``least_sigma``, or with all that follow it by ``together_sigma``.
    """

    set_points: Array | None = None
    loaded_min: float = _POINT_MIN
    unloaded_min: float = _UNLOADED_MIN
    by_hand: bool = True
    least_sigma: float = 0.5
    together_sigma: float = 1.0


ANYTHING = Allowed()


@dataclass(frozen=True, slots=True, kw_only=True)
class Again:
    """Rows of the frame with load that can be measured again, and a simulation of every row with readings."""

    rows: NDArray[np.intp]
    near: Result

    def after(self, observations: Observations) -> tuple[Points, Result, NDArray[np.intp]]:
        """Standby, no load and these rows, after everything that was measured; what they start from; all rows."""
        kind, used = observations.frame["kind"].to_numpy(), np.unique(observations.row)
        unloaded = [used[kind[used] == name] for name in UNLOADED]
        end_s = float(np.max(np.asarray(observations.points.time_s)))
        rows = np.concatenate([*(found[:1] for found in unloaded), self.rows])
        points, near = observations.points.take(rows), self.near.take(np.searchsorted(used, rows))
        return replace(points, time_s=end_s), near, rows


@dataclass(frozen=True, slots=True, kw_only=True)
class Option:
    """One thing to do: what it is called, the bench minutes it takes, where, and whether it is done by hand."""

    action: str
    minutes: float
    set_point: SetPoint | None = None
    by_hand: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class Options:
    """K things to do, the readings that R models expect of them (R, K, channels), and their noise (K, channels).

    ``points`` are where the first of them are done; those behind are done without the converter. ``near`` is a
    simulation there for variants to start from, ``rows`` are those of the frame that they repeat, -1 for a point that
    repeats none.
    """

    what: tuple[Option, ...]
    readings: Array
    sigma: Array
    points: Points
    near: Result
    rows: NDArray[np.intp] | None = None

    @property
    def minutes(self) -> Array:
        """Bench minutes of each, (K,)."""
        return np.array([o.minutes for o in self.what])

    def noisier(self, times: Array) -> "Options":
        """The same on a bench whose channels are so many times as noisy, (channels,)."""
        sigma = self.sigma.copy()
        sigma[: len(self.points)] *= times  # the others are measured without it
        return replace(self, sigma=sigma)

    def take(self, chosen: Sequence[int], channels: Sequence[int]) -> "Options":
        """Some of them, by some of the channels."""
        rows, columns = np.array(chosen, dtype=np.intp), np.array(channels, dtype=np.intp)
        at = rows[rows < len(self.points)]
        return Options(
            what=tuple(self.what[k] for k in chosen),
            readings=self.readings[:, rows[:, None], columns],
            sigma=self.sigma[rows[:, None], columns],
            points=self.points.take(at),
            near=self.near.take(at),
            rows=None if self.rows is None else self.rows[at],
        )


def bench_options(
    observations: Observations,
    models: Sequence[Model],
    channels: Sequence[Channel],
    allowed: Allowed = ANYTHING,
    again: Again | None = None,
    like: Model | None = None,
) -> Options:
    """Every allowed measurement, with the readings that each model predicts there.

    With ``again`` they are those measured rows; else set points of the ``allowed``, solved from a simulation of
    ``like``, by default the first of the models.
    """
    if again is None:
        points = _points(observations, models, allowed)
        near, rows = reference(like or models[0], points), None
    else:
        points, near, rows = again.after(observations)
    what, converter = _measured(points, allowed), models[0].converter
    if not allowed.by_hand:
        return Options(
            what=tuple(what),
            readings=_readings(simulate_many(models, points, near), channels),
            sigma=usual_sigma(channels, np.asarray(points.power_W), converter),
            points=points,
            near=near,
            rows=rows,
        )
    most = int(np.argmax(np.asarray(points.power_W)))
    at, one = _set_points(points)[most], points.take(np.array([most])).unseen()
    warmer = replace(one, ambient_C=np.asarray(one.ambient_C) + _AMBIENT_K)
    said_so = f"warm the room by {_AMBIENT_K:.0f} K and measure {said(at)}"
    what.append(Option(action=said_so, minutes=_AMBIENT_MIN, set_point=at, by_hand=True))
    rebuilds = _rebuilds(converter)
    places = np.append(np.arange(len(points)), [most] * (1 + len(rebuilds)))
    where, near = Points.join([points, warmer, *(one for _ in rebuilds)]), near.take(places)
    first = np.arange(len(points) + 1)
    seen = [_readings(simulate_many(models, where.take(first), near.take(first)), channels)]
    for said_so, change in rebuilds.items():
        what.append(Option(action=f"{said_so} {said(at)}", minutes=_REBUILD_MIN, set_point=at, by_hand=True))
        rebuilt = [change(m) for m in models]
        same = all(new is m for new, m in zip(rebuilt, models, strict=True))
        seen.append(
            seen[0][:, [most]]
            if same
            else _readings(simulate_many(rebuilt, one, near.take(np.array([most]))), channels)
        )
    four_wires = "measure the ac link's resistance with four wires, warm"
    what.append(Option(action=four_wires, minutes=_REBUILD_MIN, by_hand=True))
    ohms = np.full((len(models), 1, len(channels)), np.nan)
    ohms[:, 0, 0] = [_link_Ohm(m) for m in models]
    sigma = usual_sigma(channels, np.asarray(where.power_W), converter)
    four_wires_Ohm = _WINDING_Ohm * size("input_resistance", converter)
    return Options(
        what=tuple(what),
        readings=np.concatenate([*seen, ohms], axis=1),
        sigma=np.concatenate([sigma, np.full((1, len(channels)), four_wires_Ohm)]),
        points=where,
        near=near,
        rows=None if rows is None else np.where(np.arange(places.size) == len(points), -1, rows[places]),
    )


def _readings(results: Sequence[Result], channels: Sequence[Channel]) -> Array:
    """What models say of channels at K points, (R, K, channels)."""
    return np.stack([np.stack([r[c.column] for c in channels], axis=-1) for r in results])


def _points(observations: Observations, models: Sequence[Model], allowed: Allowed) -> Points:
    """Standby, no load, and what is allowed with load, as far as every model runs there."""
    p, loaded = observations.points, observations.loaded
    one = Points(
        D1=1.0, D2=0.0, power_W=0.0,
        V1_V=float(np.median(np.asarray(p.V1_V)[loaded])),
        V2_V=float(np.median(np.asarray(p.V2_V)[loaded])),
        ambient_C=float(np.median(np.asarray(p.ambient_C)[loaded])),
        time_s=float(np.max(np.asarray(p.time_s))), held=bool(np.all(p.held)),
    )  # fmt: skip

    def runs(set_points: Array) -> NDArray[np.bool_]:
        D1, D2, power = set_points.T
        return with_room(observations, models, replace(one, D1=D1, D2=D2, power_W=power))

    set_points = _around(observations, runs) if allowed.set_points is None else allowed.set_points
    idle = replace(one, D1=np.median(set_points[:, 0]), D2=np.median(set_points[:, 1]))
    D1, D2, power = set_points[runs(set_points)].T
    return Points.join(
        [replace(idle, pwm=False, D1=1.0, D2=0.0), idle, replace(one, D1=D1, D2=D2, power_W=power)]
    )


def with_room(observations: Observations, models: Sequence[Model], points: Points) -> NDArray[np.bool_]:
    """Which points (K,) every model carries with more power to spare than a diagnosis of such observations asks for."""
    spare = 1 + margin(observations) + _SPARE
    return can_run(models, replace(points, power_W=spare * np.asarray(points.power_W)))


def _around(observations: Observations, runs: Callable[[Array], NDArray[np.bool_]]) -> Array:
    """A grid over the measured ranges, the most that it carries, and some of the measured points again, (N, 3)."""
    p, loaded = observations.points, np.flatnonzero(observations.loaded)
    measured = np.stack([np.asarray(x)[loaded] for x in (p.D1, p.D2, p.power_W)], axis=1)
    D1, D2, power = (np.linspace(x.min(), x.max(), count) for x, count in zip(measured.T, _AXES, strict=True))
    pairs = np.stack([a.ravel() for a in np.meshgrid(D1, D2, indexing="ij")], axis=1)
    grid = np.column_stack([np.repeat(pairs, power.size, axis=0), np.tile(power, len(pairs))])
    return np.concatenate([measured[:: -(-len(measured) // _AGAIN)], grid, _most_carried(pairs, power, runs)])


def _most_carried(pairs: Array, power: Array, runs: Callable[[Array], NDArray[np.bool_]]) -> Array:
    """The largest power inside a range that each pair of D1 and D2 carries, where it carries some and not all."""
    low, high = np.full(len(pairs), power.min()), np.full(len(pairs), power.max())
    inside = runs(np.column_stack([pairs, low])) & ~runs(np.column_stack([pairs, high]))
    pairs, low, high = pairs[inside], low[inside], high[inside]
    for _ in range(_HALVINGS if low.size else 0):
        middle = 0.5 * (low + high)
        carried = runs(np.column_stack([pairs, middle]))
        low, high = np.where(carried, middle, low), np.where(carried, high, middle)
    return np.column_stack([pairs, low])


def _set_points(points: Points) -> list[SetPoint]:
    columns = (np.asarray(x).tolist() for x in (points.D1, points.D2, points.power_W))
    return list(zip(*columns, strict=True))


def _measured(points: Points, allowed: Allowed) -> list[Option]:
    """Standby, no load, and a measurement at every point after those two."""
    unloaded = [Option(action=name, minutes=allowed.unloaded_min) for name in UNLOADED]
    loaded = [
        Option(action=f"measure {said(at)}", minutes=allowed.loaded_min, set_point=at)
        for at in _set_points(points)[2:]
    ]
    return unloaded + loaded


def said(at: SetPoint) -> str:
    """A set point in words."""
    return f"D1 = {at[0]:.3f}, D2 = {at[1]:.3f}, {at[2]:.0f} W"


def _with_more_dead_time(more_s: float, model: Model) -> Model:
    longer_s = model.converter.dead_time_s + more_s
    return replace(model, converter=replace(model.converter, dead_time_s=longer_s))


def _with_elements_swapped(model: Model) -> Model:
    """What is wrong with port 1 then reads the output: the input power appears as wrong the other way."""
    for name in _PORT_1:
        if name in model.effects:
            head, values = effect(name).headline.name, model.effects[name]
            model = model.with_effect(name, **{**values, head: -effect(name).value(values)})
    return model


def _rebuilds(converter: Converter) -> dict[str, Callable[[Model], Model]]:
    """What somebody may change on the bench before a measurement, in words, and what a model is then.

    Dead time is not proposed to be longer where there is none, or where that would come near the most that can be.
    """
    own_s = float(converter.dead_time_s)
    more_s = _DEAD_TIME_LONGER * own_s
    found: dict[str, Callable[[Model], Model]] = {}
    if 0.0 < own_s + 2 * more_s < MOST_DEAD_TIME * float(converter.half_period_s):
        longer = partial(_with_more_dead_time, more_s)
        found[f"set {more_s * 1e9:.0f} ns more dead time and measure"] = longer
    return found | {"swap the analyzer's elements and measure": _with_elements_swapped}


def _link_Ohm(model: Model) -> float:
    """Resistance of the ac link at dc, primary side, as four wires would find it."""
    c = model.altered_converter()
    return float(
        c.link_resistance_Ohm + c.inductor.winding.resistance_Ohm + c.transformer.winding.resistance_Ohm
    )


def usual_sigma(channels: Sequence[Channel], power_W: Array, converter: Converter) -> Array:
    """Noise of one averaged reading of each channel at these powers, (K, channels)."""
    watts, amperes = size("power", converter), size("input_current", converter)
    columns = []
    for c in channels:
        if c.column in _CONSTANT:
            columns.append(np.full(power_W.size, _CONSTANT[c.column]))
        elif c.column in _RELATIVE:
            relative, least = _RELATIVE[c.column]
            columns.append(np.maximum(relative * power_W, least * watts))
        else:
            relative, least = _CURRENT
            current_A = power_W / _LINK_V * amperes / watts
            columns.append(np.maximum(relative * current_A, least * amperes))
    return np.stack(columns, axis=-1)
