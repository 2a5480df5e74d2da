"""Regulation, losses and temperatures brought to their common fixed point."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from sim.neighbours import settled_alone
from sim.operating_points import Points
from sim.parameters import Converter
from sim.stacking import pick
from sim.station import KELVIN, LEAST_W, POWER, OperatingState, Slow, Station, WarmStart, station_of
from sim.steady_state import COARSE, FINE

Array = NDArray[np.float64]

_ROUNDS = 32
_LIGHT = 7  # rounds of one step of Newton's rule each; what is open then has its orbits closed before losses are asked
_FEW, _SHARE = 40, 1 / 30  # of all: so few settle sooner by a response of their own
_END = 0.8  # of the phase at the end of the branch: Newton's rule gets lost beyond
_BRANCH = 0.005  # of Th: a longer last step of the phase leads to another solution
_ABSURD = 3.0  # times the power of the round before, or the rated one
_MODERATE_K = 20.0  # above ambient


@dataclass(frozen=True, slots=True, kw_only=True)
class Outcome:
    """Which of N points carry their power, the most that the others do (NaN: unknown), and the state of the former."""

    reached: NDArray[np.bool_]
    most_W: Array
    state: OperatingState
    station: Station

    def comfortable(self, margin: float) -> NDArray[np.bool_]:
        """Points of the state with more power to spare than ``margin`` (relative) on the rising branch."""
        regulated = self.state.regulated
        spare = self.station.spare(self.state)
        return np.asarray(regulated.reached & (spare > margin) & (regulated.limit >= 0.5))


def operate(converter: Converter, points: Points, warm: WarmStart | None = None) -> Outcome:
    """Bring N points (all of them with the bridges on) to their steady state.

    ``warm`` is a start that this call may write to, from a converter so near that all its points run here too.

    Points leave the rounds when their temperatures and power have settled, or when their power cannot be
    reached; one last solution then states all that run.
    """
    station, memory = station_of(converter, points, warm), _Secant(len(points))
    if station.warm is None:
        first = station.solve(COARSE)
        station.slow.put(np.arange(len(points)), station.ahead(first).by_name())
        station = replace(station, warm=first.regulated)
    else:
        station = replace(station, warm=station.nearer())
    _settle(station, memory, np.flatnonzero(station.known.reached))
    left, state = _stated(station)
    rows = np.flatnonzero(station.known.reached)
    moved = np.flatnonzero(np.abs(state.regulated.phase - left.known.phase) > _BRANCH)
    if moved.size:  # the last solution left a falling branch: temperatures are others there
        station.known.put(rows[moved], state.regulated.take(moved))
        _settle(station, memory, rows[moved])
        left, state = _stated_anew(station, moved, state)
    return Outcome(reached=station.known.reached, most_W=station.known.most_W, state=state, station=left)


def _stated(station: Station) -> tuple[Station, OperatingState]:
    """The last solution of all points that are reached; what drops in it is so no more."""
    while True:
        rows = np.flatnonzero(station.known.reached)
        left = station.take(rows)
        state = left.solve(FINE)
        if np.all(state.regulated.reached):
            return left, state
        station.known.reached[rows] = state.regulated.reached
        station.known.most_W[rows] = state.regulated.most_W


def _stated_anew(
    station: Station, moved: NDArray[np.intp], state: OperatingState
) -> tuple[Station, OperatingState]:
    """The same, with a solution of all of them of which only those ``moved`` are not right any more."""
    left = station.take(np.flatnonzero(station.known.reached))
    if len(left.points) == state.balance.P2_W.size:
        again = left.take(moved).solve(FINE)
        if np.all(again.regulated.reached):
            return left, state.renewed(moved, again)
    return _stated(station)


def _settle(station: Station, memory: "_Secant", busy: NDArray[np.intp]) -> None:
    """Rounds on some points of a station, which is written to, until temperatures and power have settled.

    The few that are open after the light ones settle by Newton's rule on all at once (:mod:`sim.neighbours`) where they
    can. What never settles is not reached.
    """
    for turn in range(_ROUNDS):
        busy = _powered(station, busy)
        if busy.size and turn >= _LIGHT and busy.size <= max(_FEW, _SHARE * len(station.points)):
            busy = _left_open(station, busy)
        if not busy.size:
            return
        part = station.take(busy)
        if turn < _LIGHT:
            (state, onward), stays = part.follow(), np.ones(busy.size, dtype=bool)
        else:
            state = part.solve(FINE)
            onward, stays = state.regulated, state.regulated.reached
        if turn == _LIGHT:
            memory.forget(busy)
        ahead = part.ahead(state)
        settled = state.regulated.reached & _near(part, ahead)
        stays &= _possible(part, ahead)
        station.known.put(busy, replace(onward, reached=stays))
        station.slow.put(busy, memory.step(busy, part.slow.by_name(), ahead.by_name()))
        busy = busy[~settled & stays]
    _give_up(station, busy)


def _give_up(station: Station, lost: NDArray[np.intp]) -> None:
    """Mark points as ones without a steady state."""
    station.known.reached[lost], station.known.most_W[lost] = False, np.nan


def _powered(station: Station, busy: NDArray[np.intp]) -> NDArray[np.intp]:
    """Which of the busy points have a voltage at the dc link, which no orbit is without; the others are given up.

    Where losses run away with temperature, what flows through the input cable takes all of it.
    """
    powered = station.powered()[busy]
    _give_up(station, busy[~powered])
    return busy[powered]


def _left_open(station: Station, busy: NDArray[np.intp]) -> NDArray[np.intp]:
    """Which of the busy points Newton's rule on all unknowns (:mod:`sim.neighbours`) leaves open.

    Settled ones are written to the station. Of the others those past ``_END`` of their branch are marked as not
    reached, so that their phase is looked for in a bracket.
    """
    settled, there = settled_alone(station.take(busy))
    known = station.known
    known.reached[busy] = settled | (np.abs(known.phase[busy]) < _END * known.limit[busy])
    done = np.flatnonzero(settled)
    known.put(busy[done], there.known.take(done))
    station.slow.put(busy[done], pick(there.slow, done).by_name())
    return busy[~settled]


def _possible(part: Station, ahead: Slow) -> NDArray[np.bool_]:
    """Whether the secondary bridge is asked for no more than some loss could explain: an orbit that got lost is not."""
    most_W = _ABSURD * np.maximum(np.abs(part.slow.target_W), part.converter.rated_power_W)
    return np.asarray(np.abs(ahead.target_W) < most_W)


def _near(part: Station, ahead: Slow) -> NDArray[np.bool_]:
    """Whether temperatures and power have settled."""
    now, then = part.slow.temperatures.by_place(), ahead.temperatures.by_place()
    furthest_K = np.max([np.abs(now[place] - then[place]) for place in now], axis=0)
    missed = np.abs(part.slow.target_W - ahead.target_W)
    scale_W = np.maximum(np.abs(np.asarray(part.points.power_W)), LEAST_W)
    return np.asarray((furthest_K < KELVIN) & (missed < POWER * scale_W))


class _Secant:
    """Steffensen's rule on each slow variable by itself: its own last two rounds tell how far to go."""

    def __init__(self, size: int) -> None:
        self._size = size
        self._last: dict[str, tuple[Array, Array]] = {}

    def forget(self, rows: NDArray[np.intp]) -> None:
        """Begin anew with some points."""
        for x, g in self._last.values():
            x[rows], g[rows] = np.nan, np.nan

    def step(
        self, rows: NDArray[np.intp], now: dict[str, Array], asked: dict[str, Array]
    ) -> dict[str, Array]:
        """The next values of some points, from those used and those their losses ask for."""
        following = {}
        for name, x in now.items():
            unknown = (np.full(self._size, np.nan), np.full(self._size, np.nan))
            last_x, last_g = self._last.setdefault(name, unknown)
            g = asked[name]
            with np.errstate(divide="ignore", invalid="ignore"):
                slope = (g - last_g[rows]) / (x - last_x[rows])
            slope = np.where(np.isfinite(slope), np.clip(slope, -0.3, 0.5), 0.0)
            following[name] = x + (g - x) / (1.0 - slope)
            last_x[rows], last_g[rows] = x, g
        return following


def carries(converter: Converter, points: Points) -> NDArray[np.bool_]:
    """Whether N points can run, at the temperatures of a moderate load: a first look, without the fixed point."""
    warm = replace(points, ambient_C=np.asarray(points.ambient_C) + _MODERATE_K)
    return station_of(converter, warm, None).within_reach()
