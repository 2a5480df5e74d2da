"""Regulation, losses and temperatures brought to their common fixed point."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from sim.bridges import part_names
from sim.circuit import SwingCurves, Temperatures, build_circuit
from sim.losses import conduction_losses, switching_losses
from sim.magnetics import LinkCurrent, link_current, magnetic_losses
from sim.modulation import centre_offset, hybrid_edges
from sim.operating_points import Points
from sim.parameters import Converter
from sim.prototype import prototype
from sim.regulation import Regulated, follow, regulate, spare_power
from sim.stacking import pick
from sim.steady_state import COARSE, FINE, Accuracy
from sim.thermal import temperatures
from sim.waveform import Circuit

Array = NDArray[np.float64]

_ROUNDS = 32
_CAREFUL = 8  # every so many rounds orbits are closed before their losses are asked
_POWER = 2e-7  # of the output power, relative with 10 W as the least scale: inside the promised 1e-6
_KELVIN = 1e-4  # moves a loss of 10 W by 4 uW
_LEAST_W = 10.0
_MODERATE_K = 20.0  # above ambient

AT_INPUT, AT_OUTPUT = part_names(prototype())
IN_LINK = ("inductor_copper", "inductor_core", "transformer_copper", "transformer_core", "link_resistance")


@dataclass(frozen=True, slots=True, kw_only=True)
class Balance:
    """Powers in W along the chain and the losses between them, each (N,)."""

    P1_W: Array
    I1_A: Array
    P_link1_W: Array
    P_link2_W: Array
    P2_W: Array
    losses: dict[str, Array]


@dataclass(frozen=True, slots=True, kw_only=True)
class WarmStart:
    """What a solution leaves for a variant of its converter at the same points, arrays (N,)."""

    temperatures: Temperatures
    secondary_switching_W: Array
    I1_A: Array
    regulated: Regulated

    def take(self, chosen: NDArray[np.intp]) -> "WarmStart":
        """Some of the points, in arrays of their own."""
        return WarmStart(
            temperatures=pick(self.temperatures, chosen),
            secondary_switching_W=self.secondary_switching_W[chosen],
            I1_A=self.I1_A[chosen],
            regulated=self.regulated.take(chosen),
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class OperatingState:
    """The converged state of N points that run; ``spare`` is about what power they could add, relative."""

    temperatures: Temperatures
    regulated: Regulated
    current: LinkCurrent
    balance: Balance
    spare: Array

    def start(self) -> WarmStart:
        """What a variant may start from."""
        return WarmStart(
            temperatures=self.temperatures,
            secondary_switching_W=self.balance.losses["secondary_switching"],
            I1_A=self.balance.I1_A,
            regulated=self.regulated,
        )

    def comfortable(self, margin: float) -> NDArray[np.bool_]:
        """Points that run, with more power to spare than ``margin`` (relative) on the rising branch."""
        return np.asarray(self.regulated.reached & (self.spare > margin) & (self.regulated.limit >= 0.5))


def _input_current(power_W: Array, V1_V: Array, resistance_Ohm: Array | float) -> Array:
    """I1 from V1 I1 = P + R I1^2, the smaller root, in a form that stands R = 0."""
    return 2 * power_W / (V1_V + np.sqrt(np.maximum(V1_V**2 - 4 * resistance_Ohm * power_W, 0.0)))


def _balance(converter: Converter, points: Points, regulated: Regulated, losses: dict[str, Array]) -> Balance:
    """Walk from the ideal secondary bridge to both terminals."""
    at_bridge = regulated.orbit.output_power_W()
    cable = converter.output_cable_Ohm * (points.power_W / points.V2_V) ** 2
    P2 = at_bridge - losses["secondary_switching"] - cable
    link2 = at_bridge + losses["secondary_conduction"]
    link1 = link2 + sum(losses[name] for name in IN_LINK)
    into = link1 + sum(losses[name] for name in part_names(converter)[0]) + converter.auxiliary_power_W
    I1 = _input_current(into, np.asarray(points.V1_V), converter.input_cable_Ohm)
    input_cable = converter.input_cable_Ohm * I1**2
    whole = losses | {
        "auxiliary": np.broadcast_to(converter.auxiliary_power_W, P2.shape) + 0.0,
        "input_cable": input_cable + np.zeros_like(P2),
        "output_cable": cable + np.zeros_like(P2),
    }
    return Balance(P1_W=into + input_cable, I1_A=I1, P_link1_W=link1, P_link2_W=link2, P2_W=P2, losses=whole)


def _furthest(a: Temperatures, b: Temperatures) -> Array:
    one, other = a.by_place(), b.by_place()
    return np.asarray(np.max([np.abs(one[place] - other[place]) for place in one], axis=0))


@dataclass(frozen=True, slots=True, kw_only=True)
class _Slow:
    """What circuit and regulation are solved for and their losses then move, arrays (N,)."""

    temperatures: Temperatures
    target_W: Array
    I1_A: Array

    def by_name(self) -> dict[str, Array]:
        """Every one by a name."""
        return self.temperatures.by_place() | {"target_W": self.target_W, "I1_A": self.I1_A}

    def put(self, rows: NDArray[np.intp], values: dict[str, Array]) -> None:
        """Renew some of the points."""
        for name, own in self.by_name().items():
            own[rows] = values[name]


@dataclass(frozen=True, slots=True, kw_only=True)
class _Station:
    """A set of points with what their next round starts from."""

    converter: Converter
    points: Points
    edges: Array
    swings: SwingCurves
    slow: _Slow
    warm: Regulated | None

    def take(self, chosen: NDArray[np.intp]) -> "_Station":
        """Some of the points."""
        if chosen.size == len(self.points):  # all of them, in their order
            return self
        return _Station(
            converter=pick(self.converter, chosen),
            points=self.points.take(chosen),
            edges=self.edges[:, chosen],
            swings=self.swings.take(chosen),
            slow=pick(self.slow, chosen),
            warm=None if self.warm is None else self.warm.take(chosen),
        )

    @property
    def known(self) -> Regulated:
        """The solution to go on from, once there is one."""
        assert self.warm is not None
        return self.warm

    def solve(self, accuracy: Accuracy) -> OperatingState:
        """Regulate at the present temperatures and account for the losses there."""
        circuit = self._circuit()
        regulated = regulate(circuit, self.edges, self.slow.target_W, warm=self.warm, accuracy=accuracy)
        return self._account(circuit, regulated)

    def follow(self) -> tuple[OperatingState, Regulated]:
        """One step towards the solution: what there is now, and where to go on."""
        circuit = self._circuit()
        now, ahead = follow(circuit, self.edges, self.slow.target_W, self.known)
        return self._account(circuit, now), ahead

    def nearer(self) -> Regulated:
        """One step towards the solution, before any losses are asked."""
        return follow(self._circuit(), self.edges, self.slow.target_W, self.known)[1]

    def _voltages(self) -> tuple[Array, Array]:
        """Of the dc links behind the cables."""
        V1 = self.points.V1_V - self.converter.input_cable_Ohm * self.slow.I1_A
        return np.asarray(V1), _capacitor_V(self.converter, self.points)

    def _circuit(self) -> Circuit:
        return build_circuit(self.converter, self.slow.temperatures, *self._voltages(), self.swings)

    def _account(self, circuit: Circuit, regulated: Regulated) -> OperatingState:
        (V1, V2), t = self._voltages(), self.slow.temperatures
        pieces = regulated.orbit.pieces
        current = link_current(pieces, self.converter.frequency_Hz)
        losses = (
            conduction_losses(self.converter, t, pieces, V1)
            | switching_losses(self.converter, t, regulated.orbit, V1, V2)
            | magnetic_losses(self.converter, t, pieces, current)
        )
        balance = _balance(self.converter, self.points, regulated, losses)
        return OperatingState(
            temperatures=temperatures(self.converter, losses, np.asarray(self.points.ambient_C)),
            regulated=regulated, current=current, balance=balance,
            spare=spare_power(circuit, self.edges, regulated),
        )  # fmt: skip

    def ahead(self, state: OperatingState) -> _Slow:
        """What the losses of a solution ask for."""
        losses = state.balance.losses
        return _Slow(
            temperatures=state.temperatures,
            target_W=_delivered_W(self.converter, self.points) + losses["secondary_switching"],
            I1_A=state.balance.I1_A,
        )


def _delivered_W(converter: Converter, points: Points) -> Array:
    """Power at the output capacitors: demanded, and lost in the output cable."""
    demanded = np.asarray(points.power_W)
    return np.asarray(demanded + converter.output_cable_Ohm * (demanded / points.V2_V) ** 2)


def _capacitor_V(converter: Converter, points: Points) -> Array:
    """Voltage at the output capacitors: that of the terminals, and what the output cable drops."""
    return np.asarray(points.V2_V + converter.output_cable_Ohm * points.power_W / points.V2_V)


def _start(converter: Converter, points: Points, warm: WarmStart | None) -> _Station:
    D1, D2 = np.asarray(points.D1), np.asarray(points.D2)
    late = np.array([0.0, 0.0, 1.0, 1.0])[:, None]
    delivered = _delivered_W(converter, points)
    if warm is None:
        slow = _Slow(
            temperatures=Temperatures.everywhere(converter, np.asarray(points.ambient_C)),
            target_W=delivered + 0.003 * np.abs(delivered),
            I1_A=delivered / points.V1_V,
        )
    else:
        slow = _Slow(
            temperatures=warm.temperatures,
            target_W=delivered + warm.secondary_switching_W,
            I1_A=warm.I1_A,
        )
    return _Station(
        converter=converter,
        points=points,
        edges=hybrid_edges(-centre_offset(D1, D2), D1, D2)
        + late * converter.secondary_delay_s / converter.half_period_s,
        swings=SwingCurves.of(converter, len(points)),
        slow=slow,
        warm=None if warm is None else warm.regulated,
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class Outcome:
    """Which of N points carry their power, the most that the others do (NaN: unknown), and the state of the former."""

    reached: NDArray[np.bool_]
    most_W: Array
    state: OperatingState


def operate(converter: Converter, points: Points, warm: WarmStart | None = None) -> Outcome:
    """Bring N points (all of them with the bridges on) to their steady state.

    ``warm`` is a start that this call may write to, from a converter so near that all its points run here too.

    Points leave the rounds when their temperatures and power have settled, or when their power cannot be
    reached; one last solution then states all that run.
    """
    station, memory = _start(converter, points, warm), _Secant(len(points))
    if station.warm is None:
        first = station.solve(COARSE)
        station.slow.put(np.arange(len(points)), station.ahead(first).by_name())
        station = replace(station, warm=first.regulated)
    else:
        station = replace(station, warm=station.nearer())
    busy = np.flatnonzero(station.known.reached)
    for turn in range(_ROUNDS):
        part = station.take(busy)
        if turn % _CAREFUL == _CAREFUL - 1:
            state = part.solve(FINE)
            onward, stays = state.regulated, state.regulated.reached
        else:
            (state, onward), stays = part.follow(), np.ones(busy.size, dtype=bool)
        ahead = part.ahead(state)
        settled = state.regulated.reached & _near(part, ahead)
        station.known.put(busy, replace(onward, reached=stays))
        station.slow.put(busy, memory.step(busy, part.slow.by_name(), ahead.by_name()))
        busy = busy[~settled & stays]
        if not busy.size:
            break
    while True:  # what drops in the last solution is not stated
        rows = np.flatnonzero(station.known.reached)
        state = station.take(rows).solve(FINE)
        if np.all(state.regulated.reached):
            return Outcome(reached=station.known.reached, most_W=station.known.most_W, state=state)
        station.known.reached[rows] = state.regulated.reached


def _near(part: _Station, ahead: _Slow) -> NDArray[np.bool_]:
    """Whether temperatures and power have settled."""
    now, then = part.slow.temperatures.by_place(), ahead.temperatures.by_place()
    furthest_K = np.max([np.abs(now[place] - then[place]) for place in now], axis=0)
    missed = np.abs(part.slow.target_W - ahead.target_W)
    scale_W = np.maximum(np.abs(np.asarray(part.points.power_W)), _LEAST_W)
    return np.asarray((furthest_K < _KELVIN) & (missed < _POWER * scale_W))


class _Secant:
    """Steffensen's rule on each slow variable by itself: its own last two rounds tell how far to go."""

    def __init__(self, size: int) -> None:
        self._size = size
        self._last: dict[str, tuple[Array, Array]] = {}

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
    return _start(converter, warm, None).solve(COARSE).regulated.reached
