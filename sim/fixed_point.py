"""Regulation, losses and temperatures brought to their common fixed point."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from sim.bridges import part_names
from sim.circuit import Temperatures, build_circuit
from sim.losses import conduction_losses, switching_losses
from sim.magnetics import LinkCurrent, link_current, magnetic_losses
from sim.modulation import centre_offset, hybrid_edges
from sim.operating_points import Points
from sim.parameters import Converter
from sim.prototype import prototype
from sim.regulation import Regulated, regulate
from sim.stacking import pick
from sim.thermal import temperatures

Array = NDArray[np.float64]

_ROUNDS = 25
_COARSE_ROUNDS = 2
_POWER = 2e-7  # of the output power, relative with 10 W as the least scale: inside the promised 1e-6
_COARSE = 1e-4  # enough while temperatures still move
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
    """The converged state of N points that run."""

    temperatures: Temperatures
    regulated: Regulated
    current: LinkCurrent
    balance: Balance

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
        spare = np.nan_to_num(self.regulated.most_W, nan=np.inf) > (1 + margin) * np.abs(self.balance.P2_W)
        return np.asarray(self.regulated.reached & spare & (self.regulated.limit >= 0.5))


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
class _Station:
    """A set of points with what their next round starts from; arrays (N,)."""

    converter: Converter
    points: Points
    edges: Array
    temperatures: Temperatures
    target_W: Array
    I1_A: Array
    warm: Regulated | None

    def take(self, chosen: NDArray[np.intp]) -> "_Station":
        """Some of the points."""
        return _Station(
            converter=pick(self.converter, chosen),
            points=self.points.take(chosen),
            edges=self.edges[:, chosen],
            temperatures=pick(self.temperatures, chosen),
            target_W=self.target_W[chosen],
            I1_A=self.I1_A[chosen],
            warm=None if self.warm is None else self.warm.take(chosen),
        )

    def solve(self, tolerance: float) -> OperatingState:
        """Regulate at the present temperatures and account for the losses there."""
        V1 = self.points.V1_V - self.converter.input_cable_Ohm * self.I1_A
        V2, t = _capacitor_V(self.converter, self.points), self.temperatures
        circuit = build_circuit(self.converter, t, V1, V2)
        regulated = regulate(circuit, self.edges, self.target_W, warm=self.warm, tolerance=tolerance)
        pieces = regulated.orbit.pieces
        current = link_current(pieces, self.converter.frequency_Hz)
        losses = (
            conduction_losses(self.converter, t, pieces, V1)
            | switching_losses(self.converter, t, regulated.orbit, V1, V2)
            | magnetic_losses(self.converter, t, pieces, current)
        )
        balance = _balance(self.converter, self.points, regulated, losses)
        return OperatingState(temperatures=t, regulated=regulated, current=current, balance=balance)

    def onward(self, state: OperatingState) -> "_Station":
        """Where the next round starts."""
        losses = state.balance.losses
        return replace(
            self,
            temperatures=temperatures(self.converter, losses, np.asarray(self.points.ambient_C)),
            target_W=_delivered_W(self.converter, self.points) + losses["secondary_switching"],
            I1_A=state.balance.I1_A,
            warm=state.regulated,
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
    return _Station(
        converter=converter,
        points=points,
        edges=hybrid_edges(-centre_offset(D1, D2), D1, D2)
        + late * converter.secondary_delay_s / converter.half_period_s,
        temperatures=Temperatures.everywhere(converter, np.asarray(points.ambient_C))
        if warm is None
        else warm.temperatures,
        target_W=delivered + 0.003 * np.abs(delivered)
        if warm is None
        else delivered + warm.secondary_switching_W,
        I1_A=delivered / points.V1_V if warm is None else warm.I1_A,
        warm=None if warm is None else warm.regulated,
    )


def operate(converter: Converter, points: Points, warm: WarmStart | None = None) -> OperatingState:
    """Bring N points (all of them with the bridges on) to their steady state.

    ``warm`` is a start that this call may write to, from a converter so near that all its points run here too.

    Points leave the rounds when their temperatures and power have settled, or when their power cannot be
    reached; one last solution then states all. ``regulated.reached`` tells which points carry their power.
    """
    station = _start(converter, points, warm)
    busy = np.arange(len(points))
    for turn in range(_ROUNDS):
        part = station.take(busy)
        state = part.solve(_COARSE if turn < _COARSE_ROUNDS else _POWER / 2)
        ahead = part.onward(state)
        demanded = np.asarray(part.points.power_W)
        missed = np.abs(state.balance.P2_W - demanded) / np.maximum(np.abs(demanded), _LEAST_W)
        settled = (_furthest(ahead.temperatures, part.temperatures) < _KELVIN) & (missed < _POWER)
        _put(station, busy, ahead)
        station = replace(station, warm=_joined(station.warm, busy, state.regulated))
        busy = busy[~settled & state.regulated.reached]
        if not busy.size:
            break
    return station.solve(_POWER)


def carries(converter: Converter, points: Points) -> NDArray[np.bool_]:
    """Whether N points can run, at the temperatures of a moderate load: a first look, without the fixed point."""
    warm = replace(points, ambient_C=np.asarray(points.ambient_C) + _MODERATE_K)
    return _start(converter, warm, None).solve(_COARSE).regulated.reached


def _put(station: _Station, rows: NDArray[np.intp], part: _Station) -> None:
    """Write a part's temperatures, targets and currents back."""
    now = station.temperatures.by_place()
    for place, values in part.temperatures.by_place().items():
        now[place][rows] = values
    station.target_W[rows] = part.target_W
    station.I1_A[rows] = part.I1_A


def _joined(whole: Regulated | None, rows: NDArray[np.intp], part: Regulated) -> Regulated:
    """A warm start for all, in which some rows are renewed."""
    if whole is None:
        return part
    whole.phase[rows] = part.phase
    whole.most_W[rows] = part.most_W
    whole.reached[rows] = part.reached
    whole.orbit.start_A[rows] = part.orbit.start_A
    whole.orbit.delay[:, rows] = part.orbit.delay
    return whole
