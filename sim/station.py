"""Operating points in work: what is solved for, what the losses make of it, and the balance of powers."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from numpy.typing import NDArray

from sim.bridges import part_names
from sim.circuit import SwingCurves, Temperatures, build_circuit
from sim.harmonics import share_left
from sim.losses import conduction_losses, switching_losses
from sim.magnetics import LinkCurrent, link_current, magnetic_losses
from sim.modulation import centre_offset, hybrid_edges
from sim.operating_points import Points
from sim.parameters import Converter
from sim.piecewise import phase_for_share
from sim.prototype import prototype
from sim.regulation import Regulated, carried, follow, regulate, spare_power
from sim.stacking import pick, put
from sim.steady_state import Accuracy, half_period
from sim.thermal import temperatures
from sim.waveform import Circuit
from sim.wound_parts import Winding

Array = NDArray[np.float64]

AT_INPUT, AT_OUTPUT = part_names(prototype())
POWER = 2e-7  # of the output power, relative with 10 W as the least scale: inside the promised 1e-6
KELVIN = 1e-4  # moves a loss of 10 W by 4 uW
LEAST_W = 10.0
_LATE = np.array([0.0, 0.0, 1.0, 1.0])[:, None]  # which edges a later secondary moves
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

    def renewed(self, rows: NDArray[np.intp], part: "OperatingState") -> "OperatingState":
        """This state with some of its points taken from another one; its arrays are written to."""
        put(self, rows, part)
        orbit = self.regulated.orbit.renewed(rows, part.regulated.orbit)
        return replace(self, regulated=replace(self.regulated, orbit=orbit))


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


@dataclass(frozen=True, slots=True, kw_only=True)
class Slow:
    """What circuit and regulation are solved for and their losses then move, arrays (N,)."""

    temperatures: Temperatures
    target_W: Array
    I1_A: Array

    def by_name(self) -> dict[str, Array]:
        """Every one by a name."""
        return self.temperatures.by_place() | {"target_W": self.target_W, "I1_A": self.I1_A}

    @classmethod
    def of(cls, values: Mapping[str, Array]) -> Self:
        """From every one by its name."""
        t = dict(values)
        target_W, I1_A = t.pop("target_W"), t.pop("I1_A")
        return cls(temperatures=Temperatures.of(t), target_W=target_W, I1_A=I1_A)

    def put(self, rows: NDArray[np.intp], values: dict[str, Array]) -> None:
        """Renew some of the points."""
        for name, own in self.by_name().items():
            own[rows] = values[name]


@dataclass(frozen=True, slots=True, kw_only=True)
class Station:
    """A set of points with what their next round starts from."""

    converter: Converter
    points: Points
    edges: Array
    swings: SwingCurves
    slow: Slow
    warm: Regulated | None

    def take(self, chosen: NDArray[np.intp]) -> "Station":
        """Some of the points."""
        if chosen.size == len(self.points) and np.array_equal(chosen, np.arange(chosen.size)):
            return self
        return Station(
            converter=pick(self.converter, chosen),
            points=self.points.take(chosen),
            edges=self.edges.take(chosen, axis=1),
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
        return self._account(regulated)

    def within_reach(self) -> NDArray[np.bool_]:
        """Whether the power can be carried at the present temperatures, (N,)."""
        return carried(self._circuit(), self.edges, self.slow.target_W)

    def follow(self) -> tuple[OperatingState, Regulated]:
        """One step towards the solution: what there is now, and where to go on."""
        circuit = self._circuit()
        now, ahead = follow(circuit, self.edges, self.slow.target_W, self.known)
        return self._account(now), ahead

    def nearer(self) -> Regulated:
        """One step towards the solution, before any losses are asked."""
        return follow(self._circuit(), self.edges, self.slow.target_W, self.known)[1]

    def missed(self) -> tuple[OperatingState, Array]:
        """What there is now, taken as it is, and by how much that misses a steady state, (n, N).

        That is: the current that does not close in A, delays in Th, power in W, then what the losses ask of every slow
        variable less what it is.
        """
        orbit, open_ = half_period(self._circuit(), self.edges, self.known.state())
        state = self._account(replace(self.known, orbit=orbit))
        power_W, asked, now = orbit.output_power_W(), self.ahead(state).by_name(), self.slow.by_name()
        slow = [asked[name] - now[name] for name in now]
        return state, np.concatenate([open_, (power_W - self.slow.target_W)[None], slow])

    def ready(self, state: OperatingState) -> "Station":
        """This station at a state that was found, for variants to start from."""
        return replace(self, warm=state.regulated, slow=self.ahead(state))

    def start(self) -> WarmStart:
        """What a variant may start from."""
        return WarmStart(
            temperatures=self.slow.temperatures,
            secondary_switching_W=self.slow.target_W - _delivered_W(self.converter, self.points),
            I1_A=self.slow.I1_A,
            regulated=self.known,
        )

    def settled(self, state: OperatingState, missed: Array) -> NDArray[np.bool_]:
        """Whether what :meth:`missed` found is a steady state, (N,)."""
        temperatures = len(self.slow.temperatures.by_place())
        scale_W = np.maximum(np.abs(np.asarray(self.points.power_W)), LEAST_W)
        power = np.max(np.abs(missed[[5, 6 + temperatures]]), axis=0) < POWER * scale_W
        warm = np.max(np.abs(missed[6 : 6 + temperatures]), axis=0) < KELVIN
        return np.asarray(state.regulated.orbit.closed & power & warm)

    def on_branch(self) -> NDArray[np.bool_]:
        """Whether the phase lies on the rising branch, (N,)."""
        way = np.where(self.slow.target_W < 0, -1.0, 1.0)
        return np.asarray(way * self.known.phase <= self.known.limit)

    def powered(self) -> NDArray[np.bool_]:
        """Whether the input cable leaves the dc link a voltage, (N,): a step that is far too long may take it away."""
        V1, _ = self._voltages()
        return np.asarray(V1 > 0.0)  # NaN is not

    def spare(self, state: OperatingState) -> Array:
        """About what power (relative) the points could add, (N,)."""
        return spare_power(self.edges, state.regulated)

    def _voltages(self) -> tuple[Array, Array]:
        """Of the dc links behind the cables."""
        V1 = self.points.V1_V - self.converter.input_cable_Ohm * self.slow.I1_A
        return np.asarray(V1), _capacitor_V(self.converter, self.points)

    def _circuit(self) -> Circuit:
        return build_circuit(self.converter, self.slow.temperatures, *self._voltages(), self.swings)

    def _account(self, regulated: Regulated) -> OperatingState:
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
        )  # fmt: skip

    def ahead(self, state: OperatingState) -> Slow:
        """What the losses of a solution ask for."""
        losses = state.balance.losses
        return Slow(
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


def _with_flat_windings(converter: Converter, edges: Array, points: Points, target_W: Array) -> Converter:
    """The converter with the resistance that its windings have at each point's own harmonics.

    They are those of the lossless waves, with the phase at which these carry the power.
    """
    V1_V, nV2_V = np.asarray(points.V1_V), converter.transformer.turns_ratio * np.asarray(points.V2_V)
    scale_W = V1_V * nV2_V * converter.half_period_s / converter.inductor.inductance_H
    way = np.where(target_W < 0, -1.0, 1.0)
    phase = way * phase_for_share(way * target_W / scale_W, edges, way)
    there = edges + _LATE * phase

    def flat(winding: Winding) -> Winding:
        left = share_left(there, V1_V, nV2_V, winding.flattens_at_harmonic)
        return replace(winding, ac_extra=winding.ac_extra * left)

    inductor, transformer = converter.inductor, converter.transformer
    return replace(
        converter,
        inductor=replace(inductor, winding=flat(inductor.winding)),
        transformer=replace(transformer, winding=flat(transformer.winding)),
    )


def station_of(converter: Converter, points: Points, warm: WarmStart | None) -> Station:
    D1, D2 = np.asarray(points.D1), np.asarray(points.D2)
    delivered = _delivered_W(converter, points)
    if warm is None:
        slow = Slow(
            temperatures=Temperatures.everywhere(converter, np.asarray(points.ambient_C)),
            target_W=delivered + 0.003 * np.abs(delivered),
            I1_A=delivered / points.V1_V,
        )
    else:
        slow = Slow(
            temperatures=warm.temperatures,
            target_W=delivered + warm.secondary_switching_W,
            I1_A=warm.I1_A,
        )
    edges = hybrid_edges(-centre_offset(D1, D2), D1, D2)
    edges = edges + _LATE * converter.secondary_delay_s / converter.half_period_s
    return Station(
        converter=_with_flat_windings(converter, edges, points, delivered),
        points=points,
        edges=edges,
        swings=SwingCurves.of(converter, len(points)),
        slow=slow,
        warm=None if warm is None else warm.regulated,
    )
