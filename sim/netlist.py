r"""One operating point as a switch-level circuit for ngspice, a solver that we did not write.

What the circuit has: two NPC legs with clamp diodes and a full bridge, every switch with its channel, its
antiparallel diode and its nonlinear output capacitance, gates with the dead time, link inductor, transformer with
the magnetizing inductance on its primary, all series resistance, stiff dc links. Drops are those at the operating
point's temperatures. What it has not: turn-off energy, reverse recovery, core loss, cables, auxiliaries.

What conducts from a threshold V0 on does so by

.. math:: i = \frac{s}{r} \, \tfrac12 \left( u + \sqrt{u^2 + d^2} \right), \qquad u = v - V_0

with the gate's state s and a rounding d of 1 mV, smooth for Newton's method and V0 + r i to within microvolts for
a current of an ampere. Output capacitances are junctions of SPICE diodes that do not conduct; they follow the law of
:class:`sim.parameters.Capacitance`.

The link current starts from that of ideal, lossless square waves, not from the simulator's orbit, and settles; the
file measures its distance from half-wave symmetry and the change of its rms from one period to the next, so that
whoever runs it sees that it settled.
"""

from collections.abc import Iterator
from dataclasses import dataclass, fields

import numpy as np

from sim.circuit import Temperatures, winding_resistance
from sim.model import Model
from sim.operating_points import Points
from sim.parameters import Capacitance, Conduction, Converter, ParameterError, Quantity, Switch
from sim.solved import Solved, solve_points
from sim.steady_state import lossless_start_A, magnetizing_current

_ROUNDING_V = 1e-3
_LEAK_S = 1e-8  # conductance of an open channel
_RAMP_S = 2e-9  # of a gate: half a per cent of the dead time
_CONDUCTING_V = 5.0  # a device with less across it conducts; what it loses with more is switching

SETTLED = "I_L_rms_before_A"  # rms current of the period before those that are measured
_MEASURED = {
    "I_L_rms_A": "RMS i(Llink)",
    "I_L_mean_A": "AVG i(Llink)",  # 0 by half-wave symmetry
    "I_L_pp_A": "PP i(Llink)",
    "P1_W": "AVG p1",
    "P2_W": "AVG p2",
    "loss_link_W": "AVG link",
    "loss_hard_W": "AVG hard",
}


@dataclass(frozen=True, slots=True, kw_only=True)
class Settling:
    """How long the circuit runs: periods to settle, periods that are measured, the longest step."""

    settle_periods: int = 20
    measured_periods: int = 2
    longest_step_s: float = 50e-9

    def __post_init__(self) -> None:
        for field in fields(self):
            if not getattr(self, field.name) > 0:
                raise ParameterError(f"Settling.{field.name} is {getattr(self, field.name)}; allowed: > 0")


def netlist(model: Model, points: Points, settling: Settling | None = None) -> str:
    """The circuit file of one operating point, at the D0 that the simulator found for it.

    ``ngspice -b FILE.cir`` runs it and prints what it measured.

    Raises
    ------
    ParameterError
        For more or less than one point, and for a point that cannot run.
    """
    if len(points) != 1:
        raise ParameterError(f"a netlist is of one operating point; got {len(points)}")
    writer = _Writer(solved=solve_points(model, points), settling=settling or Settling())
    return "\n".join(writer.lines()) + "\n"


@dataclass(frozen=True, slots=True)
class _Device:
    """A conducting path from node ``a`` to ``b``; ``gate`` is None for a diode; ``kind`` tells who loses."""

    name: str
    kind: str
    a: str
    b: str
    gate: str | None
    drop: tuple[float, float]
    both_ways: bool = False

    @property
    def line(self) -> str:
        """The element: what flows, and a leak that ties nodes between two open switches."""
        v = f"V({self.a},{self.b})"
        return f"B{self.name} {self.a} {self.b} I = {self._current(v, 'V')} + {v}*{_LEAK_S:g}"

    def power(self) -> Iterator[str]:
        """Vectors ``across`` and ``lost`` of the interpreter: its voltage in V and its loss in W."""
        ends = [f"{sign}v({node})" for sign, node in (("+", self.a), ("-", self.b)) if node != "0"]
        yield f"let across = 0{''.join(ends)}"
        yield f"let lost = across*{self._current('across', 'v')}"

    def _current(self, v: str, of: str) -> str:
        V0, r = self.drop
        state = f"{of}({self.gate})*" if self.gate else ""
        if self.both_ways:
            return f"{state}{v}/{r:.9g}"
        u = f"({v}-{V0:.9g})"
        return f"{state}({u}+sqrt({u}*{u}+{_ROUNDING_V**2:g}))/{2 * r:.9g}"


def _scalar(value: Quantity) -> float:
    return float(np.ravel(value)[0])


def _drop(conduction: Conduction, junction_C: Quantity) -> tuple[float, float]:
    threshold_V, resistance_Ohm = conduction.at(junction_C)
    return _scalar(threshold_V), _scalar(resistance_Ohm)


@dataclass(frozen=True, slots=True, kw_only=True)
class _Writer:
    """Puts the file together, block by block."""

    solved: Solved
    settling: Settling

    @property
    def converter(self) -> Converter:
        return self.solved.converter

    @property
    def temperatures(self) -> Temperatures:
        return self.solved.temperatures

    @property
    def half_period_s(self) -> float:
        return self.converter.half_period_s

    def lines(self) -> Iterator[str]:
        devices = [*self._npc_devices(), *self._bridge_devices()]
        yield from self._head()
        yield from self._gates()
        yield from self._sources()
        yield from self._link()
        yield "* what conducts"
        yield from (device.line for device in devices)
        yield from self._capacitances()
        yield from self._start()
        yield from self._run(devices)

    def _head(self) -> Iterator[str]:
        p, r = self.solved.points, self.solved.result
        yield (
            f"* {self.converter.name}: D1 = {_scalar(p.D1):g}, D2 = {_scalar(p.D2):g}, {_scalar(p.power_W):g} W, "
            f"D0 = {_scalar(r['D0']):.6f}"
        )
        yield f"* the simulator says: I_L_rms_A = {_scalar(r['I_L_rms_A']):.6g}, P1_W = {_scalar(r['P1_W']):.6g}"

    def _gates(self) -> Iterator[str]:
        """A switch opens at an edge, its complement closes a dead time later."""
        rise, fall, lead, lag = self.solved.edges[:, 0].tolist()
        turns = {  # on and off, in half periods
            "g1": (rise, fall + 1), "g2": (fall, rise + 1), "g3": (fall + 1, rise + 2), "g4": (rise + 1, fall + 2),
            "gq1": (lead, lead + 1), "gq2": (lead + 1, lead + 2), "gq4": (lag, lag + 1), "gq3": (lag + 1, lag + 2),
        }  # fmt: skip
        yield "* gates, from 0 to 1; the second NPC leg is the mirror image of the first"
        period_s, dead_s = 2 * self.half_period_s, _scalar(self.converter.dead_time_s)
        for gate, (on, off) in turns.items():
            width_s = (off - on) * self.half_period_s - dead_s - 2 * _RAMP_S
            start_s = (on * self.half_period_s + dead_s) % period_s
            start_s -= period_s * (start_s + width_s > period_s)
            timing = f"{start_s:.9g} {_RAMP_S:g} {_RAMP_S:g} {width_s:.9g} {period_s:.9g}"
            yield f"V{gate} {gate} 0 PULSE(0 1 {timing})"

    def _sources(self) -> Iterator[str]:
        V1, nV2 = _scalar(self.solved.circuit.V1_V), _scalar(self.solved.circuit.nV2_V)
        yield "* dc links: o is the neutral point, the secondary's negative rail is ground"
        yield f"Vtop p o {V1 / 2:.9g}"
        yield f"Vbottom o m {V1 / 2:.9g}"
        yield "Ro o 0 1meg"
        yield f"Vout q 0 {nV2 / self.converter.transformer.turns_ratio:.9g}"

    def _link(self) -> Iterator[str]:
        c, edges = self.solved.circuit, self.solved.edges
        n = self.converter.transformer.turns_ratio
        R = self.converter.link_resistance_Ohm + sum(winding_resistance(self.converter, self.temperatures))
        im = magnetizing_current(c, edges, 0 * edges[:1])
        yield "* ac link: inductor, all series resistance, magnetizing inductance, ideal transformer"
        yield f"Llink ap x {_scalar(c.inductance_H):.9g} IC={_scalar(lossless_start_A(c, edges)):.6g}"
        yield f"Rlink x y {_scalar(R):.9g}"
        yield f"Lmag y bp {_scalar(c.magnetizing_H):.9g} IC={_scalar(im):.6g}"
        yield f"Esecondary s0 bs y bp {1 / n:.9g}"
        yield "Vsense s0 as 0"
        yield f"Fprimary y bp Vsense {1 / n:.9g}"

    def _start(self) -> Iterator[str]:
        """Node voltages just before t = 0, so that the first step has nothing to charge."""
        c = self.solved.circuit
        V1, V2 = _scalar(c.V1_V), _scalar(c.nV2_V) / self.converter.transformer.turns_ratio
        high = np.mod(-1e-9 - self.solved.edges[:, 0], 2.0) < 1.0
        level = V1 / 4 * (2.0 * np.sum(high[:2]) - 2.0)
        at = {"p": V1 / 2, "m": -V1 / 2, "q": V2, "as": V2 * high[2], "bs": V2 * (not high[3])}
        for leg, v in (("a", level), ("b", -level)):
            at |= {f"{leg}p": v, f"u{leg}": max(v, 0.0), f"l{leg}": min(v, 0.0)}
        at |= {"s0": at["as"], "x": at["ap"], "y": at["bp"] + _scalar(c.nV2_V) / V2 * (at["as"] - at["bs"])}
        yield ".ic " + " ".join(f"v({node})={v:.6g}" for node, v in at.items())

    def _npc_devices(self) -> Iterator[_Device]:
        """Leg a, and leg b as its mirror image."""
        primary, t = self.converter.primary, self.temperatures
        gates = {"a": ("g1", "g2", "g3", "g4"), "b": ("g4", "g3", "g2", "g1")}
        for leg, (g1, g2, g3, g4) in gates.items():
            up, mid, low = f"u{leg}", f"{leg}p", f"l{leg}"
            outer = (primary.outer, "primary_outer", t.outer_C)
            inner = (primary.inner, "primary_inner", t.inner_C)
            yield from self._switch(f"1{leg}", ("p", up), g1, outer)
            yield from self._switch(f"2{leg}", (up, mid), g2, inner)
            yield from self._switch(f"3{leg}", (mid, low), g3, inner)
            yield from self._switch(f"4{leg}", (low, "m"), g4, outer)
            drop = _drop(primary.clamp.on, t.clamp_C)
            yield _Device(f"d5{leg}", "primary_clamp", "o", up, None, drop)
            yield _Device(f"d6{leg}", "primary_clamp", low, "o", None, drop)

    def _bridge_devices(self) -> Iterator[_Device]:
        low = (self.converter.secondary.switch, "secondary", self.temperatures.secondary_C)
        yield from self._switch("q1", ("q", "as"), "gq1", low)
        yield from self._switch("q2", ("as", "0"), "gq2", low)
        yield from self._switch("q3", ("q", "bs"), "gq3", low)
        yield from self._switch("q4", ("bs", "0"), "gq4", low)

    @staticmethod
    def _switch(
        name: str, nodes: tuple[str, str], gate: str, what: tuple[Switch, str, Quantity]
    ) -> Iterator[_Device]:
        """Channel and antiparallel diode."""
        (a, b), (switch, kind, junction_C) = nodes, what
        on = _drop(switch.on, junction_C)
        yield _Device(f"s{name}", kind, a, b, gate, on, both_ways=switch.synchronous)
        yield _Device(f"r{name}", kind, b, a, None, _drop(switch.reverse, junction_C))

    def _capacitances(self) -> Iterator[str]:
        primary, low = self.converter.primary, self.converter.secondary.switch
        models: dict[str, tuple[Capacitance, list[tuple[str, str]]]] = {
            "couter": (primary.outer.capacitance, [n for x in "ab" for n in (("p", f"u{x}"), (f"l{x}", "m"))]),
            "cinner": (primary.inner.capacitance, [n for x in "ab" for n in ((f"u{x}", f"{x}p"), (f"{x}p", f"l{x}"))]),
            "cclamp": (primary.clamp.capacitance, [n for x in "ab" for n in ((f"u{x}", "o"), ("o", f"l{x}"))]),
            "csecondary": (low.capacitance, [n for x in ("as", "bs") for n in (("q", x), (x, "0"))]),
        }  # fmt: skip
        yield "* output capacitances: junctions from positive to negative node that do not conduct"
        for model, (junction, places) in models.items():
            yield (
                f".model {model} D(IS=1e-30 CJO={_scalar(junction.zero_bias_F):.9g} VJ={junction.junction_V:g} "
                f"M={junction.grading:g} FC=0)"
            )
            for k, (a, b) in enumerate(places):
                yield f"D{model}{k} {b} {a} {model}"

    def _run(self, devices: list[_Device]) -> Iterator[str]:
        period_s, s = 2 * self.half_period_s, self.settling
        start_s = s.settle_periods * period_s
        stop_s = start_s + s.measured_periods * period_s
        nodes = sorted({node for d in devices for node in (d.a, d.b, d.gate) if node not in (None, "0")})
        yield ".options reltol=1e-4 abstol=1e-6 vntol=1e-4 chgtol=1e-13 itl4=100 method=gear maxord=2"
        yield ".control"
        yield "save i(Llink) i(Vtop) i(Vbottom) i(Vout) v(x) v(y) " + " ".join(f"v({n})" for n in nodes)
        yield f"tran {s.longest_step_s:g} {stop_s:.9g} {start_s - period_s:.9g} {s.longest_step_s:g} uic"
        yield f"let p1 = -{_scalar(self.solved.circuit.V1_V) / 2:.9g}*(i(Vtop) + i(Vbottom))"
        yield "let p2 = v(q)*i(Vout)"
        yield "let link = (v(x) - v(y))*i(Llink)"
        yield from self._loss_vectors(devices)
        window = f"from={start_s:.9g} to={stop_s:.9g}"
        yield f"meas tran {SETTLED} RMS i(Llink) from={start_s - period_s:.9g} to={start_s:.9g}"
        for name, what in _MEASURED.items():
            yield f"meas tran {name} {what} {window}"
        for kind in _kinds(devices):
            yield f"meas tran loss_{kind}_conduction_W AVG {kind} {window}"
        yield "quit"
        yield ".endc"
        yield ".end"

    def _loss_vectors(self, devices: list[_Device]) -> Iterator[str]:
        """Per kind of device what it loses while it conducts; in ``hard`` what all lose besides."""
        yield f"* a device with less than {_CONDUCTING_V:g} V across it conducts; what it loses with more is switching"
        yield "let hard = 0*p1"
        yield from (f"let {kind} = 0*p1" for kind in _kinds(devices))
        for device in devices:
            yield from device.power()
            yield f"let conducted = lost/(1 + (across/{_CONDUCTING_V:g})^8)"
            yield f"let {device.kind} = {device.kind} + conducted"
            yield "let hard = hard + lost - conducted"


def _kinds(devices: list[_Device]) -> list[str]:
    return sorted({device.kind for device in devices})
