r"""The knowledge-based methods of the literature as comparators, with the interface of :func:`sim.simulate.simulate`.

Both take the link as lossless, the edges as instant and every temperature as ambient. Then the current is a sum of the
four square waves' triangles, whatever the order of the edges (which replaces the derivation mode by mode),

.. math:: i(x) = \frac{T_h}{L} \left[ \tfrac12 V_1 \sum_p S(x - e_p) - \tfrac12 n V_2 \sum_s S(x - e_s) \right]

with S exact for the *piecewise* method and cut off for the *harmonic* one (:mod:`sim.harmonic`), and D0 solves the
lossless power. From the waveform come the losses as a textbook takes them: conduction by mean and mean square, copper
by rms current, cores by Steinmetz' equation of the peak flux, and edges by the sign of the current: soft ones lose
turn-off energy, hard ones turn-on energy, recovery and all of the output capacitances' energy.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sim.bridges import Scheme, Transition, part_names, primary_scheme, secondary_scheme, switching_part
from sim.circuit import Temperatures, winding_resistance
from sim.harmonic import share_of_pair, triangle
from sim.model import Model
from sim.modulation import EDGES, centre_offset, hybrid_edges, infeasible_pulse, outside_modulation
from sim.operating_points import Points, carried, efficiency
from sim.parameters import Converter, Core
from sim.simulate import Result
from sim.soft_switching import residual_energy
from sim.station import IN_LINK

Array = NDArray[np.float64]
Shape = Callable[[Array], Array]

_NODES = np.linspace(0.0, 1.0, 65)[:, None]
_SHIFT = np.array([0.0, 0.0, 1.0, 1.0])[:, None]
_BISECTIONS = 45


def piecewise_method(model: Model, points: Points) -> Result:
    """The closed form of straight lines; columns as :func:`sim.simulate.simulate` gives them."""
    return _solve(model, points, _Shapes(current=_straight, share=_parabola))


def harmonic_method(model: Model, points: Points, *, harmonics: int = 3) -> Result:
    """The first ``harmonics`` odd harmonics; columns as :func:`sim.simulate.simulate` gives them."""
    shapes = _Shapes(current=lambda x: triangle(x, harmonics), share=lambda x: share_of_pair(x, harmonics))
    return _solve(model, points, shapes)


@dataclass(frozen=True, slots=True, kw_only=True)
class _Shapes:
    """What a method makes of a square wave: its current's shape, and the power that two of them exchange."""

    current: Shape
    share: Shape

    def power_share(self, edges: Array) -> Array:
        """Power over n V1 V2 / (2 fs Lk) of edges (4, N)."""
        return np.asarray(np.mean(self.share(edges[2:, None] - edges[None, :2]), axis=(0, 1)))


def _straight(x: Array) -> Array:
    return np.asarray(np.abs(x - 2.0 * np.floor(0.5 * x + 0.5)) - 0.5)


def _parabola(x: Array) -> Array:
    wrapped = x - 2.0 * np.floor(0.5 * x + 0.5)
    return np.asarray(wrapped * (1.0 - np.abs(wrapped)))


@dataclass(frozen=True, slots=True, kw_only=True)
class _Wave:
    """Half a period of N points as a polygon: places (S, N) in Th, current, and the bridges' states between them."""

    place: Array
    current_A: Array
    vp: Array  # -1, 0, 1 between the places, (S - 1, N)
    vs: Array
    at_edge_A: Array  # (4, N), as each square wave rises

    @property
    def length(self) -> Array:
        """Lengths between the places."""
        return np.diff(self.place, axis=0)

    def means(self, state: Array, sign: float) -> list[tuple[Array, Array]]:
        """Mean |i| and mean i^2 while the current flows along a bridge's voltage, against it, in its zero state."""
        i = self.current_A
        middle, square = 0.5 * (i[1:] + i[:-1]), (i[1:] ** 2 + i[1:] * i[:-1] + i[:-1] ** 2) / 3
        size = 0.5 * (np.abs(i[1:]) + np.abs(i[:-1]))
        along = sign * state * middle
        return [
            (np.sum(np.where(chosen, size, 0.0) * self.length, axis=0),
             np.sum(np.where(chosen, square, 0.0) * self.length, axis=0))
            for chosen in (along > 0, along < 0, along == 0)
        ]  # fmt: skip


def _solve(model: Model, points: Points, shapes: _Shapes) -> Result:
    converter, moved = model.altered_converter(), model.set_points(points)
    D1, D2, P = (np.asarray(x) for x in (moved.D1, moved.D2, moved.power_W))
    scale_W = (
        moved.V1_V * moved.V2_V * converter.transformer.turns_ratio
        * converter.half_period_s / converter.inductor.inductance_H
    )  # fmt: skip
    centred = hybrid_edges(-centre_offset(D1, D2), D1, D2)
    way = np.where(P < 0, -1.0, 1.0)
    reason = _refused(converter, moved)
    most_W = way * scale_W * shapes.power_share(centred + 0.5 * _SHIFT * way)
    for k in np.flatnonzero((reason == "") & (way * P > most_W)):
        reason[k] = f"{carried(float(most_W[k]))} without losses"
    phase = way * _phase(shapes, centred, way, way * P / scale_W)
    values = _columns(converter, moved, shapes, centred + _SHIFT * phase)
    values["D0"] = phase - centre_offset(D1, D2)
    feasible = reason == ""
    kept = {name: np.where(feasible, value, np.nan) for name, value in values.items()}
    return Result(points=points, feasible=feasible, reason=reason, values=kept)


def _refused(converter: Converter, points: Points) -> NDArray[np.str_]:
    D1, D2 = np.asarray(points.D1), np.asarray(points.D2)
    dead = np.broadcast_to(converter.dead_share, D1.shape)
    reason = infeasible_pulse(D1, D2, dead).astype("U96")
    reason = np.where(reason == "", outside_modulation(converter.modulation, D1, D2), reason).astype("U96")
    reason[(reason == "") & ~np.asarray(points.pwm, dtype=bool)] = (
        "standby: the method is one of running bridges"
    )
    return reason


def _phase(shapes: _Shapes, centred: Array, way: Array, share: Array) -> Array:
    """Smallest size of the phase at which a share is reached, by bisection."""
    low, high = np.zeros_like(share), np.full_like(share, 0.5)
    for _ in range(_BISECTIONS):
        middle = 0.5 * (low + high)
        below = way * shapes.power_share(centred + _SHIFT * (way * middle)) < share
        low, high = np.where(below, middle, low), np.where(below, high, middle)
    return high


def _wave(converter: Converter, points: Points, shapes: _Shapes, edges: Array) -> _Wave:
    V1, nV2 = points.V1_V, converter.transformer.turns_ratio * points.V2_V
    unit = converter.half_period_s / converter.inductor.inductance_H
    half = np.stack(np.broadcast_arrays(0.5 * V1, 0.5 * V1, -0.5 * nV2, -0.5 * nV2)) * unit

    def current(x: Array) -> Array:
        return np.asarray(sum(half[k] * shapes.current(x - edges[k]) for k in range(4)))

    place = np.sort(
        np.concatenate([np.broadcast_to(_NODES, (len(_NODES), len(points))), edges % 1.0]), axis=0
    )
    between = 0.5 * (place[1:] + place[:-1])
    level = [np.where(np.mod(between - edge, 2.0) < 1.0, 0.5, -0.5) for edge in edges]
    return _Wave(
        place=place, current_A=current(place), vp=level[0] + level[1], vs=level[2] + level[3],
        at_edge_A=current(edges),
    )  # fmt: skip


def _columns(converter: Converter, points: Points, shapes: _Shapes, edges: Array) -> dict[str, Array]:
    wave, size = _wave(converter, points, shapes, edges), len(points)
    ambient_C = np.asarray(points.ambient_C)
    t = Temperatures.everywhere(converter, ambient_C)
    P2 = np.asarray(points.power_W)
    square = sum(m[1] for m in wave.means(wave.vp, 1.0))
    before, behind = part_names(converter)
    losses = dict.fromkeys((*before, *IN_LINK, *behind), np.zeros(size))
    losses |= _bridge_losses(converter, points, wave, t) | _magnetic_losses(converter, points, wave, t)
    losses["auxiliary"] = converter.auxiliary_power_W + np.zeros(size)
    losses["output_cable"] = converter.output_cable_Ohm * (P2 / points.V2_V) ** 2 + np.zeros(size)
    link2 = P2 + losses["output_cable"] + sum(losses[p] for p in behind)
    link1 = link2 + sum(losses[p] for p in IN_LINK)
    inside = link1 + sum(losses[p] for p in before) + losses["auxiliary"]
    losses["input_cable"] = converter.input_cable_Ohm * (inside / points.V1_V) ** 2 + np.zeros(size)
    losses["added"] = np.zeros(size)
    P1 = inside + losses["input_cable"]
    hard = np.where(_driving_A(converter, wave) > 0, 0.0, 1.0)  # a swing takes no time
    return {
        "P1_W": P1, "I1_A": P1 / points.V1_V, "P2_W": P2, "efficiency": efficiency(P1, P2),
        "I_L_rms_A": np.sqrt(square), "I_L_pp_A": 2 * np.max(np.abs(wave.current_A), axis=0),
        "P_link1_W": link1, "P_link2_W": link2,
        **{f"T_{place}_C": ambient_C for place in ("heatsink", "transformer", "inductor")},
        **{f"loss_{part}_W": loss for part, loss in losses.items()},
        **{f"missing_{edge}": hard[k] for k, edge in enumerate(EDGES)},
        **{f"zvs_{edge}": 1.0 - hard[k] for k, edge in enumerate(EDGES)},
    }  # fmt: skip


def _driving_A(converter: Converter, wave: _Wave) -> Array:
    """Current (4, N) that drives each leg's node to its new rail as its square wave rises."""
    n = converter.transformer.turns_ratio
    return np.stack([-wave.at_edge_A[0], -wave.at_edge_A[1], n * wave.at_edge_A[2], n * wave.at_edge_A[3]])


def _bridge_losses(converter: Converter, points: Points, wave: _Wave, t: Temperatures) -> dict[str, Array]:
    primary, secondary = primary_scheme(converter), secondary_scheme(converter)
    n, driving = converter.transformer.turns_ratio, _driving_A(converter, wave)
    rate = 2.0 * converter.frequency_Hz
    lost: dict[str, Array] = {}
    for scheme, means, turns, link_V, first in (
        (primary, wave.means(wave.vp, 1.0), 1.0, points.V1_V, 0),
        (secondary, wave.means(wave.vs, -1.0), n, points.V2_V, 2),
    ):
        for path, (mean, square) in zip((scheme.forward, scheme.reverse, scheme.zero), means, strict=True):
            for c in path:
                V0, R = c.law.at(t.junction_C[c.kind])
                heat = c.count * (V0 * turns * mean + R * turns**2 * square)
                lost[f"{c.kind}_conduction"] = lost.get(f"{c.kind}_conduction", 0.0) + heat
        for k, transitions in enumerate((scheme.first, scheme.second)):
            for transition in transitions:
                edge = _edge_J(scheme, transition, t, driving[first + k], np.asarray(scheme.step * link_V))
                for kind, energy in edge.items():
                    part = switching_part(kind, scheme.devices[kind])
                    lost[part] = lost.get(part, 0.0) + scheme.legs * rate * energy
    return {part: np.asarray(loss) for part, loss in lost.items()}


def _edge_J(
    scheme: Scheme, step: Transition, t: Temperatures, driving_A: Array, step_V: Array
) -> dict[str, Array]:
    """Energy of an edge by kind of device: turn-off where the current is for it, everything hard where against."""
    hard_A = np.maximum(-driving_A, 0.0)
    opens, closes = scheme.switch(step.opens), scheme.switch(step.closes)
    charging, discharging = (
        [scheme.devices[kind].capacitance for kind in kinds] for kinds in (step.charging, step.discharging)
    )
    recovered = scheme.devices[step.recovers].recovery.at(
        current_A=hard_A, junction_C=t.junction_C[step.recovers]
    ) * step_V  # fmt: skip
    turned_on = closes.turn_on.at(current_A=hard_A, voltage_V=step_V, junction_C=t.junction_C[step.closes])
    stored = np.where(driving_A > 0, 0.0, residual_energy(charging, discharging, step_V, 1.0))
    kept = 0.5 * recovered if step.shares else 0.0 * recovered
    turned_off = opens.turn_off.at(
        current_A=np.maximum(driving_A, 0.0), voltage_V=step_V, junction_C=t.junction_C[step.opens]
    )
    lost: dict[str, Array] = {}
    for kind, energy in (
        (step.opens, turned_off),
        (step.closes, turned_on + stored + recovered - kept),
        (step.recovers, kept),
    ):
        lost[kind] = np.asarray(lost.get(kind, 0.0) + energy)
    return lost


def _magnetic_losses(converter: Converter, points: Points, wave: _Wave, t: Temperatures) -> dict[str, Array]:
    square = sum(m[1] for m in wave.means(wave.vp, 1.0))
    inductor, transformer = converter.inductor, converter.transformer
    R_inductor, R_transformer = winding_resistance(converter, t)
    peak_Vs = inductor.inductance_H * np.max(np.abs(wave.current_A), axis=0)
    width = np.sum(np.abs(wave.vs) * wave.length, axis=0)
    flux_Vs = 0.5 * transformer.turns_ratio * points.V2_V * width * converter.half_period_s
    f = converter.frequency_Hz
    return {
        "inductor_copper": np.asarray(R_inductor * (1 + inductor.winding.ac_extra) * square),
        "transformer_copper": np.asarray(R_transformer * (1 + transformer.winding.ac_extra) * square),
        "link_resistance": np.asarray(converter.link_resistance_Ohm * square),
        "inductor_core": _steinmetz_W(inductor.core, f, peak_Vs),
        "transformer_core": _steinmetz_W(transformer.core, f, flux_Vs),
    }


def _steinmetz_W(core: Core, frequency_Hz: float, peak_Vs: Array) -> Array:
    """Core loss in W of a sine of a peak flux linkage, k f^alpha B^beta times the volume."""
    B = peak_Vs / (core.turns * core.area_m2)
    return np.asarray(core.k * frequency_Hz**core.alpha * B**core.beta * core.volume_m3)
