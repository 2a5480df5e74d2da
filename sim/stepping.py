r"""The converter stepped through time: an independent way to the waveforms that :mod:`sim.steady_state` solves.

Between the legs' positions l (from -1 to 1), the link current i, the magnetizing current and the output voltage:

.. math::
    L \, \dot\imath &= \tfrac12 V_1 (l_1 + l_2) - \tfrac12 n v_2 (l_3 + l_4)
        - \operatorname{sign}(i) V_0 - R (i + \tau \dot\imath) - u \\
    L_m \, \dot\imath_m &= \tfrac12 n v_2 (l_3 + l_4) + u, \qquad
    u = \operatorname{sign}(i - i_m) V_0' + R' (i + \tau \dot\imath - i_m)

A resistor L/tau beside the inductance carries tau di/dt (eddy currents in the windings); what leaves the bridges'
terminals is i + tau di/dt. u is what the secondary drops, behind the magnetizing inductance.

When a leg flips, both its switches open; in the dead time the current that leaves it moves its charge,
:math:`0 \le q \le Q`, and its position follows the charge along the curve of its capacitances. At the end of the
dead time the rest is switched hard. Heun's rule takes all of that through a window of time, on nodes that are dense
where a leg is in its dead time and hold every instant at which one opens or closes.

Nothing but parameters is shared with the exact solver: no delays, no exponentials, no closed orbit.
"""

from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from numpy.typing import NDArray

from sim.parameters import ParameterError
from sim.soft_switching import CURVE_POINTS
from sim.steady_state import Circuit

Array = NDArray[np.float64]

_INSTANT = 1e-6  # of the dead time: events this close to a node are at it
_CLOSED_A = 1e-5
_MOST_HALF_PERIODS = 60


@dataclass(frozen=True, slots=True, kw_only=True)
class Steps:
    """How fine to step: nodes in a dead time, and nodes in a half period besides."""

    in_dead_time: int = 160
    in_half_period: int = 400

    def __post_init__(self) -> None:
        if self.in_dead_time < 2 or self.in_half_period < 2:
            raise ParameterError(f"{self}: at least 2 nodes each")


@dataclass(frozen=True, slots=True, kw_only=True)
class State:
    """A moment of N converters; arrays (N,), those of the legs (4, N).

    ``side`` is the rail that a leg is at or moves to (1 or -1), ``charge_C`` how much of its swing's charge has moved,
    ``closes_s`` when its dead time ends or ended.
    """

    time_s: Array
    link_A: Array
    magnetizing_A: Array
    output_V: Array
    side: Array
    charge_C: Array
    closes_s: Array

    def mirrored(self, half_period_s: Array) -> Self:
        """The same moment half a period earlier, by half-wave symmetry."""
        return replace(
            self,
            time_s=self.time_s - half_period_s,
            link_A=-self.link_A,
            magnetizing_A=-self.magnetizing_A,
            side=-self.side,
            closes_s=self.closes_s - half_period_s,
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class Trace:
    """Waveforms of N converters, arrays (S, N): the two ends of every step, so that jumps have both their sides."""

    time_s: Array
    vp_V: Array
    vs_V: Array
    current_A: Array
    magnetizing_A: Array
    output_V: Array

    def mean(self, values: Array) -> Array:
        """Mean over time, (N,), of values (S, N)."""
        length = np.diff(self.time_s, axis=0)
        total = np.sum(0.5 * (values[1:] + values[:-1]) * length, axis=0)
        return np.asarray(total / (self.time_s[-1] - self.time_s[0]))


@dataclass(frozen=True, slots=True, kw_only=True)
class Output:
    """What hangs at the secondary bridge: a capacitor and a constant-power load, or a stiff voltage (no value)."""

    capacitance_F: float | None = None
    load_W: float = 0.0

    def slope(self, current_A: Array, output_V: Array) -> Array:
        """dv2/dt in V/s when the bridge delivers a current."""
        if self.capacitance_F is None:
            return np.zeros_like(output_V)
        return np.asarray((current_A - self.load_W / output_V) / self.capacitance_F)


@dataclass(frozen=True, slots=True, kw_only=True)
class _Rates:
    """Time derivatives of a state, and the bridges' voltages and terminal current there."""

    link: Array
    magnetizing: Array
    charge: Array
    output: Array
    vp_V: Array
    nvs_V: Array
    current_A: Array


@dataclass(frozen=True, slots=True, kw_only=True)
class Stepper:
    """Steps N converters of one ``circuit``; the circuit's V2 only sets the charge of the secondary's swing."""

    circuit: Circuit
    output: Output = Output()
    steps: Steps = Steps()

    def run(self, state: State, until_s: Array, flips_s: Array) -> tuple[State, Trace]:
        """From a state to ``until_s`` (N,); each leg flips at ``flips_s`` (4, N), at most once, or never (inf)."""
        nodes = self._nodes(state, until_s, flips_s)
        waiting = flips_s.copy()
        shape = (2 * (len(nodes) - 1), *state.link_A.shape)
        times, vp, nvs, current, magnetizing, volts = (np.empty(shape) for _ in range(6))
        for k in range(len(nodes) - 1):
            before, waiting = self._events(state, waiting)
            state, first, second = self._step(before, nodes[k + 1] - nodes[k])
            for row, at, rates in ((2 * k, before, first), (2 * k + 1, state, second)):
                times[row], volts[row], magnetizing[row] = at.time_s, at.output_V, at.magnetizing_A
                vp[row], nvs[row], current[row] = rates.vp_V, rates.nvs_V, rates.current_A
        vs = nvs / self.circuit.turns_ratio
        return state, Trace(
            time_s=times, vp_V=vp, vs_V=vs, current_A=current, magnetizing_A=magnetizing, output_V=volts
        )  # fmt: skip

    @property
    def _instant_s(self) -> Array:
        return _INSTANT * self.circuit.dead_time_s

    def _nodes(self, state: State, until_s: Array, flips_s: Array) -> Array:
        """Sorted instants (S, N) from now to ``until_s``; rows in which nobody moves are left out."""
        share = np.linspace(0.0, 1.0, self.steps.in_dead_time + 1)[:, None, None]
        dead = self.circuit.dead_time_s * share
        length = until_s - state.time_s
        coarse = max(2, round(float(np.max(length / self.circuit.half_period_s)) * self.steps.in_half_period))
        even = state.time_s + np.linspace(0.0, 1.0, coarse + 1)[:, None] * length
        begun = state.closes_s - self.circuit.dead_time_s
        windows = [(start + dead).reshape(-1, state.time_s.size) for start in (flips_s, begun)]
        nodes = np.sort(np.clip(np.concatenate([even, *windows]), state.time_s, until_s), axis=0)
        moving = np.any(np.diff(nodes, axis=0) > 0, axis=1)
        return np.concatenate([nodes[:1], nodes[1:][moving]])

    def _events(self, state: State, waiting: Array) -> tuple[State, Array]:
        """Legs that flip now open; dead times that end now switch the rest hard."""
        now = waiting <= state.time_s + self._instant_s
        closed = state.closes_s <= state.time_s + self._instant_s
        charge = np.where(closed, self.circuit.charge_C, state.charge_C)
        flipped = replace(
            state,
            side=np.where(now, -state.side, state.side),
            charge_C=np.where(now, 0.0, charge),
            closes_s=np.where(now, waiting + self.circuit.dead_time_s, state.closes_s),
        )
        return flipped, np.where(now, np.inf, waiting)

    def _step(self, state: State, h: Array) -> tuple[State, _Rates, _Rates]:
        """Heun's rule over a step in which no leg opens or closes, with the rates at both of its ends."""
        open_ = state.closes_s > state.time_s + self._instant_s
        first = self._rates(state, open_)
        second = self._rates(self._moved(state, h, first, first), open_)
        return self._moved(state, h, first, second), first, second

    def _moved(self, state: State, h: Array, a: _Rates, b: _Rates) -> State:
        half = 0.5 * h
        charge = state.charge_C + half * (a.charge + b.charge)
        return State(
            time_s=state.time_s + h,
            link_A=state.link_A + half * (a.link + b.link),
            magnetizing_A=state.magnetizing_A + half * (a.magnetizing + b.magnetizing),
            output_V=state.output_V + half * (a.output + b.output),
            side=state.side,
            charge_C=np.minimum(np.maximum(charge, 0.0), self.circuit.charge_C),
            closes_s=state.closes_s,
        )

    def _rates(self, state: State, open_: NDArray[np.bool_]) -> _Rates:
        c, i = self.circuit, state.link_A
        level = state.side * np.where(open_, 2.0 * self._position(state.charge_C) - 1.0, 1.0)
        vp = 0.5 * c.V1_V * (level[0] + level[1])
        secondary = 0.5 * (level[2] + level[3])
        nvs = c.turns_ratio * state.output_V * secondary
        secondary_A = i - state.magnetizing_A
        V0, R = _chosen(vp, 0.5 * c.V1_V, i, np.stack([c.forward, c.reverse, c.zero]))
        behind_V, behind_Ohm, before_Ohm = self._behind(nvs, secondary_A, R)
        dropped_V = np.sign(i) * V0 + before_Ohm * i + behind_V + behind_Ohm * secondary_A
        share, all_Ohm = self._inductance_share(i), before_Ohm + behind_Ohm
        link = (vp - nvs - dropped_V) / (share * (c.inductance_H + all_Ohm * c.eddy_s))
        current = i + share * c.eddy_s * link
        into = c.turns_ratio * (current - state.magnetizing_A)
        leaves = state.side * np.stack([-current, -current, into, into])
        return _Rates(
            link=link,
            magnetizing=(nvs + behind_V + behind_Ohm * (current - state.magnetizing_A)) / c.magnetizing_H,
            charge=np.where(open_, leaves, 0.0),
            output=self.output.slope(into * secondary, state.output_V),
            vp_V=vp,
            nvs_V=nvs,
            current_A=current,
        )

    def _inductance_share(self, i: Array) -> Array | float:
        """Inductance at a current, of that at a small one."""
        c = self.circuit
        if not c.bends_A.size:
            return 1.0
        band = np.searchsorted(c.bends_A, np.abs(i))
        return c.relative_L[band, np.arange(i.size)]

    def _position(self, charge_C: Array) -> Array:
        """Share of the swing (4, N) that these charges have moved the nodes by."""
        c = self.circuit
        place = charge_C / c.charge_C * (CURVE_POINTS - 1)
        below = np.minimum(place.astype(np.intp), CURVE_POINTS - 2)
        legs = np.arange(4)[:, None]
        low = c.curves[legs, c.curve, below]
        return np.asarray(low + (c.curves[legs, c.curve, below + 1] - low) * (place - below))

    def _behind(self, nvs: Array, i: Array, R: Array) -> tuple[Array | float, Array | float, Array]:
        """The secondary's threshold with its sign, its resistance, and what of the resistances is before it."""
        c = self.circuit
        if c.secondary is None:
            return 0.0, c.behind_Ohm, R - c.behind_Ohm
        V0, behind_Ohm = _chosen(nvs, 0.5 * c.nV2_V, -i, c.secondary)
        return np.sign(i) * V0, behind_Ohm, R


def _chosen(v: Array, least_V: Array, i: Array, drops: Array) -> tuple[Array, Array]:
    """Drop of the state (along the voltage, against it, zero), from drops (3, 2, N)."""
    path = np.where(np.abs(v) <= least_V, 2, np.where(v * i > 0, 0, 1))
    V0, R = (np.choose(path, list(drops[:, k])) for k in (0, 1))
    return V0, R


@dataclass(frozen=True, slots=True, kw_only=True)
class Settled:
    """The half period that N converters repeat: its start, its trace, how far it is from closing in A."""

    state: State
    trace: Trace
    open_A: Array

    @property
    def rms_A(self) -> Array:
        """Rms link current (N,); squares are integrated as those of straight lines."""
        i = self.trace.current_A
        thirds = (i[1:] ** 2 + i[1:] * i[:-1] + i[:-1] ** 2) / 3
        length = np.diff(self.trace.time_s, axis=0)
        return np.asarray(np.sqrt(np.sum(thirds * length, axis=0) / np.sum(length, axis=0)))

    @property
    def peak_to_peak_A(self) -> Array:
        """Peak-to-peak link current (N,)."""
        return np.asarray(2 * np.max(np.abs(self.trace.current_A), axis=0))

    @property
    def input_W(self) -> Array:
        """Mean power (N,) out of the primary bridge."""
        return self.trace.mean(self.trace.vp_V * self.trace.current_A)

    def output_W(self, turns_ratio: Array) -> Array:
        """Mean power (N,) into the secondary bridge."""
        t = self.trace
        return t.mean(turns_ratio * t.vs_V * (t.current_A - t.magnetizing_A))


def at_rest(circuit: Circuit, edges: Array) -> State:
    """No current, every leg where ``edges`` (4, N) in units of Th have it just before t = 0."""
    size = circuit.V1_V.size
    return State(
        time_s=np.zeros(size),
        link_A=np.zeros(size),
        magnetizing_A=np.zeros(size),
        output_V=circuit.nV2_V / circuit.turns_ratio,
        side=np.where(np.mod(-edges - 1e-9, 2.0) < 1.0, 1.0, -1.0),
        charge_C=circuit.charge_C.copy(),
        closes_s=np.full(edges.shape, -1.0),
    )


def settle(stepper: Stepper, edges: Array) -> Settled:
    """The periodic state of N converters with a stiff output, from rest.

    Every half period starts from the mean of the last one's start and its negated end, until all close.
    """
    circuit = stepper.circuit
    half_period_s, flips_s = circuit.half_period_s, np.mod(edges, 1.0) * circuit.half_period_s
    start = at_rest(circuit, edges)
    for _ in range(_MOST_HALF_PERIODS):
        end, trace = stepper.run(start, half_period_s, flips_s)
        end = end.mirrored(half_period_s)
        open_A = np.abs(end.link_A - start.link_A)
        settled = Settled(state=start, trace=trace, open_A=open_A)
        start = replace(
            end,
            link_A=0.5 * (start.link_A + end.link_A),
            magnetizing_A=0.5 * (start.magnetizing_A + end.magnetizing_A),
            output_V=start.output_V,
            closes_s=np.where(end.closes_s > 0, end.closes_s, -1.0),
        )
        if np.all(open_A < _CLOSED_A):
            break
    return settled
