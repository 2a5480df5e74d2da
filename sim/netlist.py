r"""One operating point as a switch-level circuit for ngspice, a solver that we did not write.

What the circuit has: two NPC legs with clamp diodes and a full bridge, every switch with its channel, its
antiparallel diode and its nonlinear output capacitance, gates with the dead time, link inductor, transformer with
the magnetizing inductance on its primary, all series resistance, stiff dc links. Drops are those at the operating
point's temperatures. What it has not: turn-off energy, reverse recovery, core loss, cables, auxiliaries.

What conducts from a threshold V0 on does so by

.. math:: i = \frac{s}{r} \, \tfrac12 \left( u + \sqrt{u^2 + d^2} \right), \qquad u = v - V_0

with the gate's state s and a rounding d of 1 mV, smooth for Newton's method and V0 + r i to within microvolts for
a current of an ampere. Output capacitances are junctions of SPICE diodes that do not conduct, at no forward drop that
a device has; they follow the law of :class:`sim.parameters.Capacitance`.

The link current starts from that of ideal, lossless square waves, not from the simulator's orbit, and settles; the
file measures its distance from half-wave symmetry and the change of its rms from one period to the next, so that
whoever runs it sees that it settled.
"""

from collections.abc import Iterator
from dataclasses import dataclass, fields

import numpy as np

from sim.bridges import primary_scheme, secondary_scheme
from sim.circuit import Temperatures, winding_resistance
from sim.model import Model
from sim.modulation import CLAMPED
from sim.operating_points import Points
from sim.parameters import Conduction, Converter, Diode, NpcBridge, ParameterError, Quantity, Switch
from sim.solved import Solved, solve_points
from sim.steady_state import lossless_start_A, magnetizing_current

_ROUNDING_V = 1e-3
_LEAK_S = 1e-8  # conductance of an open channel
_EMISSION = 1000  # of a junction that is only a capacitance: no forward drop of a device makes it conduct
# at every node, for Newton's method: at most so much, and of a junction's mean
_SHUNT_F, _LEAST_SHUNT = 1e-12, 1e-3
_RAMP = 0.005  # of the dead time: a gate's slope
_NO_DEAD_TIME = 0.01  # of half a period: what stands for a dead time where there is none
_CONDUCTING_V = 5.0  # a device with less across it conducts; what it loses with more is switching

SETTLED = "I_L_rms_before_A"  # rms current of the period before those that are measured
_MEASURED = {
    "I_L_rms_A": "RMS i(Vlink)",
    "I_L_mean_A": "AVG i(Vlink)",  # 0 by half-wave symmetry
    "I_L_pp_A": "PP i(Vlink)",
    "P1_W": "AVG p1",
    "P2_W": "AVG p2",
    "loss_link_W": "AVG link",
    "loss_hard_W": "AVG hard",
}


@dataclass(frozen=True, slots=True, kw_only=True)
class Settling:
    """How long the circuit runs: periods to settle, periods that are measured, the longest step over the dead time.

    Forty periods of the prototype are three of its time constants L/R and more.
    """

    settle_periods: int = 40
    measured_periods: int = 2
    longest_step: float = 0.125

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
    converter = model.converter
    if isinstance(converter.primary, NpcBridge) and converter.modulation not in CLAMPED:
        raise ParameterError(
            f"a netlist of a three-level primary is written for {', '.join(CLAMPED)} modulation; "
            f"this model is driven by {converter.modulation}"
        )
    if converter.inductor.saturates:
        raise ParameterError("a netlist's inductor is linear; this model's saturates (inductor_saturation)")
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

    @property
    def edge_s(self) -> float:
        """The dead time, or what stands for it: ramps and steps are parts of it."""
        return _scalar(self.converter.dead_time_s) or _NO_DEAD_TIME * self.half_period_s

    def lines(self) -> Iterator[str]:
        devices = [
            *self._primary_devices(),
            *self._bridge(self.converter.secondary.switch, "secondary", ("q", "0"), ("as", "bs"), "gq"),
        ]
        yield from self._head()
        yield from self._gates()
        yield from self._sources()
        yield from self._link()
        yield "* what conducts"
        yield from (device.line for device in devices)
        yield from self._capacitances(devices)
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
        yield "* gates, from 0 to 1"
        period_s, dead_s = 2 * self.half_period_s, _scalar(self.converter.dead_time_s)
        ramp_s = _RAMP * self.edge_s
        for gate, (on, off) in self._turns().items():
            width_s = (off - on) * self.half_period_s - dead_s - 2 * ramp_s
            start_s = (on * self.half_period_s + dead_s) % period_s
            start_s -= period_s * (start_s + width_s > period_s)
            timing = f"{start_s:.9g} {ramp_s:g} {ramp_s:g} {width_s:.9g} {period_s:.9g}"
            yield f"V{gate} {gate} 0 PULSE(0 1 {timing})"

    def _turns(self) -> dict[str, tuple[float, float]]:
        """Where each gate goes on and off, in half periods."""
        first, second, lead, lag = self.solved.edges[:, 0].tolist()
        secondary = {
            "gq1": (lead, lead + 1), "gq2": (lead + 1, lead + 2), "gq4": (lag, lag + 1), "gq3": (lag + 1, lag + 2),
        }  # fmt: skip
        if isinstance(self.converter.primary, NpcBridge):  # the second leg is the mirror image of the first
            return secondary | {
                "g1": (first, second + 1), "g2": (second, first + 1),
                "g3": (second + 1, first + 2), "g4": (first + 1, second + 2),
            }  # fmt: skip
        return secondary | {
            "g1": (first, first + 1), "g2": (first + 1, first + 2),
            "g4": (second, second + 1), "g3": (second + 1, second + 2),
        }  # fmt: skip

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
        eddy_Ohm = _scalar(c.inductance_H) / max(_scalar(c.eddy_s), 1e-15)
        yield "* ac link: inductor with eddy currents, all series resistance, magnetizing inductance, ideal transformer"
        yield "Vlink ap w 0"
        yield f"Llink w x {_scalar(c.inductance_H):.9g} IC={_scalar(lossless_start_A(c, edges)):.6g}"
        yield f"Reddy w x {eddy_Ohm:.9g}"
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
        at = {"p": V1 / 2, "m": -V1 / 2, "q": V2, "as": V2 * high[2], "bs": V2 * (not high[3])}
        if isinstance(self.converter.primary, NpcBridge):
            level = V1 / 2 * (float(np.sum(high[:2])) - 1.0)
            for leg, v in (("a", level), ("b", -level)):
                at |= {f"{leg}p": v, f"u{leg}": max(v, 0.0), f"l{leg}": min(v, 0.0)}
        else:
            at |= {"ap": V1 * (high[0] - 0.5), "bp": V1 * (0.5 - high[1])}
        at |= {
            "s0": at["as"],
            "w": at["ap"],
            "x": at["ap"],
            "y": at["bp"] + _scalar(c.nV2_V) / V2 * (at["as"] - at["bs"]),
        }
        yield ".ic " + " ".join(f"v({node})={v:.6g}" for node, v in at.items())

    def _primary_devices(self) -> Iterator[_Device]:
        """Two three-level legs, or two two-level ones."""
        primary, t = self.converter.primary, self.temperatures.junction_C
        if not isinstance(primary, NpcBridge):
            yield from self._bridge(primary.switch, "primary", ("p", "m"), ("ap", "bp"), "g")
            return
        gates = {"a": ("g1", "g2", "g3", "g4"), "b": ("g4", "g3", "g2", "g1")}
        for leg, (g1, g2, g3, g4) in gates.items():
            up, mid, low = f"u{leg}", f"{leg}p", f"l{leg}"
            outer = (primary.outer, "primary_outer", t["primary_outer"])
            inner = (primary.inner, "primary_inner", t["primary_inner"])
            yield from self._switch(f"1{leg}", ("p", up), g1, outer)
            yield from self._switch(f"2{leg}", (up, mid), g2, inner)
            yield from self._switch(f"3{leg}", (mid, low), g3, inner)
            yield from self._switch(f"4{leg}", (low, "m"), g4, outer)
            drop = _drop(primary.clamp.on, t["primary_clamp"])
            yield _Device(f"d5{leg}", "primary_clamp", "o", up, None, drop)
            yield _Device(f"d6{leg}", "primary_clamp", low, "o", None, drop)

    def _bridge(
        self, switch: Switch, kind: str, rails: tuple[str, str], legs: tuple[str, str], gate: str
    ) -> Iterator[_Device]:
        """Two two-level legs; the fourth switch is the lower one of the second leg."""
        (high, low), (a, b) = rails, legs
        what = (switch, kind, self.temperatures.junction_C[kind])
        places = (("1", high, a), ("2", a, low), ("3", high, b), ("4", b, low))
        for number, one, other in places:
            name = f"{gate}{number}"
            yield from self._switch(name, (one, other), name, what)

    @staticmethod
    def _switch(
        name: str, nodes: tuple[str, str], gate: str, what: tuple[Switch, str, Quantity]
    ) -> Iterator[_Device]:
        """Channel and antiparallel diode."""
        (a, b), (switch, kind, junction_C) = nodes, what
        on = _drop(switch.on, junction_C)
        yield _Device(f"s{name}", kind, a, b, gate, on, both_ways=switch.synchronous)
        yield _Device(f"r{name}", kind, b, a, None, _drop(switch.reverse, junction_C))

    def _devices_by_kind(self) -> dict[str, Switch | Diode]:
        return {**primary_scheme(self.converter).devices, **secondary_scheme(self.converter).devices}

    def _shunt_F(self) -> float:
        """A capacitance to ground of every node that is none beside the junctions."""
        V1, V2 = _scalar(self.solved.circuit.V1_V), _scalar(self.solved.circuit.nV2_V)
        V = max(V1, V2 / self.converter.transformer.turns_ratio)
        least_F = min(_scalar(d.capacitance.charge_C(V)) / V for d in self._devices_by_kind().values())
        return min(_SHUNT_F, _LEAST_SHUNT * least_F)

    def _capacitances(self, devices: list[_Device]) -> Iterator[str]:
        """A junction across each switch and each clamp diode, from its positive to its negative node."""
        yield "* output capacitances: junctions that do not conduct"
        for kind, device in self._devices_by_kind().items():
            c = device.capacitance
            yield (
                f".model c_{kind} D(IS=1e-30 N={_EMISSION} CJO={_scalar(c.zero_bias_F):.9g} "
                f"VJ={c.junction_V:g} M={c.grading:g} FC=0)"
            )
        for d in devices:
            if d.gate:
                yield f"Dc{d.name} {d.b} {d.a} c_{d.kind}"
            elif d.kind == "primary_clamp":
                yield f"Dc{d.name} {d.a} {d.b} c_{d.kind}"

    def _run(self, devices: list[_Device]) -> Iterator[str]:
        period_s, s = 2 * self.half_period_s, self.settling
        start_s = s.settle_periods * period_s
        stop_s = start_s + s.measured_periods * period_s
        nodes = sorted({node for d in devices for node in (d.a, d.b, d.gate) if node not in (None, "0")})
        yield (
            ".options reltol=1e-4 abstol=1e-4 vntol=1e-3 chgtol=1e-13 itl4=100 "
            f"cshunt={self._shunt_F():.3g} method=gear maxord=2"
        )
        yield ".control"
        yield "save i(Vlink) i(Vtop) i(Vbottom) i(Vout) v(w) v(y) " + " ".join(f"v({n})" for n in nodes)
        step_s = s.longest_step * self.edge_s
        yield f"tran {step_s:g} {stop_s:.9g} {start_s - period_s:.9g} {step_s:g} uic"
        yield f"let p1 = -{_scalar(self.solved.circuit.V1_V) / 2:.9g}*(i(Vtop) + i(Vbottom))"
        yield "let p2 = v(q)*i(Vout)"
        yield "let link = (v(w) - v(y))*i(Vlink)"
        yield from self._loss_vectors(devices)
        window = f"from={start_s:.9g} to={stop_s:.9g}"
        yield f"meas tran {SETTLED} RMS i(Vlink) from={start_s - period_s:.9g} to={start_s:.9g}"
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
