"""The steady state against conservation, the closed form, a dense scan of D0, and time stepping."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from experiments.harness.result import Cell, Table
from experiments.harness.settings import Settings
from experiments.simulator.points import Findings, at_most, drawn_points, running_points
from sim.circuit import Temperatures, build_circuit
from sim.model import Model
from sim.modulation import centre_offset, hybrid_edges, infeasible_pulse
from sim.operating_points import Points
from sim.prototype import prototype
from sim.regulation import regulate
from sim.simulate import grid, simulate
from sim.solved import solve_points
from sim.station import IN_LINK
from sim.steady_state import Circuit, periodic
from sim.stepping import Stepper, settle

Array = NDArray[np.float64]

SEED = 31_000
STEPPED_POINTS, SCANNED_POINTS, SCAN_PHASES = 200, 2000, 241
WARM_C = 45.0
_SHIFT = np.array([0.0, 0.0, 1.0, 1.0])[:, None]
_CHUNK = 250  # points whose scans are solved at once
_ZOOMS = 5
JUMP_BAR_W = 0.05  # a slope ten times the usual leaves 6 mW


def energy_balance() -> Findings:
    """Every feasible grid point: terminal integrals against conduction and copper, and P1 - P2 against all parts."""
    whole = simulate(Model.baseline(), grid())
    feasible = np.flatnonzero(whole.feasible)
    solved = solve_points(Model.baseline(), whole.points.take(feasible))
    r, orbit = solved.result, solved.orbit
    carried = [name for name in r.values if name.startswith("loss_") and name.endswith("_conduction_W")]
    carried += [f"loss_{part}_W" for part in IN_LINK if not part.endswith("_core")]
    lost = orbit.input_power_W() - orbit.output_power_W()
    terminals = np.abs(lost - sum(r[name] for name in carried)) / r["P1_W"]
    parts = sum(values for name, values in r.values.items() if name.startswith("loss_"))
    balance = np.abs(r["P1_W"] - r["P2_W"] - parts) / r["P1_W"]
    power = np.abs(r["P2_W"] / solved.points.power_W - 1.0)
    said = f"{feasible.size} feasible grid points"
    return Findings(goals=(
        at_most(f"terminal integrals against conduction and copper, of P1, worst of {said}", terminals.max(), 1e-6),
        at_most(f"P1 - P2 against all parts, of P1, worst of {said}", balance.max(), 1e-6),
        at_most(f"power delivered against power demanded, relative, worst of {said}", power.max(), 1e-6),
    ))  # fmt: skip


def lossless_single_phase_shift() -> Findings:
    """Without drops and dead time the orbit is the textbook's: power and rms current of single phase shift."""
    phase = np.linspace(0.01, 0.5, 50)
    circuit = _without_losses(phase.size)
    orbit = periodic(circuit, hybrid_edges(phase, np.ones(50), np.zeros(50)), np.zeros(50), np.zeros((4, 50)))
    V1, V2, Th = circuit.V1_V, circuit.nV2_V, circuit.half_period_s
    power = V1 * V2 * Th / circuit.inductance_H * phase * (1 - phase)
    # corners of the trapezium: i(0) = -(V1 + V2) phi/2 - (V1 - V2)(1 - phi)/2, i(phi) = i(0) + (V1 + V2) phi
    unit = Th / circuit.inductance_H
    start = -0.5 * unit * ((V1 + V2) * phase + (V1 - V2) * (1 - phase))
    corner = start + unit * (V1 + V2) * phase
    square = (
        phase * (start**2 + start * corner + corner**2)
        + (1 - phase) * (corner**2 - corner * start + start**2)
    ) / 3
    rms = np.sqrt(np.sum(orbit.pieces.square(), axis=0) / Th)
    off_W, off_A = np.abs(orbit.output_power_W() / power - 1), np.abs(rms / np.sqrt(square) - 1)
    return Findings(goals=(
        at_most("SPS lossless, power against the closed form, relative", off_W.max(), 1e-9),
        at_most("SPS lossless, rms current against the closed form, relative", off_A.max(), 1e-9),
    ))  # fmt: skip


def _without_losses(size: int) -> Circuit:
    converter = prototype()
    circuit = build_circuit(
        converter,
        Temperatures.everywhere(converter, np.full(size, WARM_C)),
        np.full(size, converter.V1_V),
        np.full(size, converter.V2_V),
    )
    nothing = np.zeros_like(circuit.forward)
    return replace(
        circuit, forward=nothing, reverse=nothing, zero=nothing, behind_Ohm=0.0, eddy_s=0.0,
        dead_time_s=np.full(size, 1e-18),
    )  # fmt: skip


def time_stepping(settings: Settings) -> Findings:
    """Rms current and power of random points at the solver's D0, by stepping the circuit through time from rest."""
    points = running_points(settings.thinned(STEPPED_POINTS), np.random.default_rng(SEED))
    solved = solve_points(Model.baseline(), points)
    settled = settle(Stepper(circuit=solved.circuit), solved.edges)
    exact_W = solved.orbit.output_power_W()
    stepped_W = settled.output_W(solved.circuit.turns_ratio)
    rms = 100 * np.abs(settled.rms_A / solved.result["I_L_rms_A"] - 1)
    power = 100 * np.abs(stepped_W / exact_W - 1)
    worst = np.argsort(-np.maximum(rms, power))[:5]
    rows: tuple[tuple[Cell, ...], ...] = tuple(
        (
            float(np.ravel(points.D1)[k]), float(np.ravel(points.D2)[k]), float(np.ravel(points.power_W)[k]),
            float(rms[k]), float(power[k]), *(float(x) for x in solved.orbit.commutation.missing[:, k]),
        )
        for k in worst
    )  # fmt: skip
    columns = ("D1", "D2", "W", "rms, %", "power, %", "hard rise", "hard fall", "hard Q1", "hard Q4")
    said = f"{len(points)} random points"
    return Findings(
        goals=(
            at_most(f"time stepping, rms current, worst of {said}", rms.max(), 0.1, "%"),
            at_most(f"time stepping, power, worst of {said}", power.max(), 0.1, "%"),
        ),
        tables=(Table(title="Time stepping: the five points furthest off", columns=columns, rows=rows),),
        notes=(
            f"time stepping: median {np.median(rms):.4f} % of rms and {np.median(power):.4f} % of power, "
            f"{100 * np.mean((rms > 0.1) | (power > 0.1)):.1f} % of the points beyond 0.1 %; "
            f"every point closed within {settled.open_A.max():.1e} A; 'hard' is the share of a swing made hard",
        ),
    )


def dense_scan(settings: Settings) -> Findings:
    """Feasibility and root against a scan of the whole rising branch, at fixed temperatures."""
    points = drawn_points(settings.thinned(SCANNED_POINTS), np.random.default_rng(SEED + 1))
    converter = prototype()
    dead = converter.dead_share
    can = infeasible_pulse(np.asarray(points.D1), np.asarray(points.D2), dead) == ""
    points = points.take(np.flatnonzero(can))
    missed, above, gap_W = 0, 0, 0.0
    for start in range(0, len(points), _CHUNK):
        part = points.take(np.arange(start, min(start + _CHUNK, len(points))))
        found = _scanned(part)
        missed, above, gap_W = missed + found[0], above + found[1], max(gap_W, found[2])
    said = f"{len(points)} random points"
    return Findings(goals=(
        at_most(f"dense scan of D0: feasible points missed, of {said}", missed, 0),
        at_most(f"dense scan of D0: roots that are not the smallest, of {said}", above, 0),
        at_most(f"dense scan of D0: largest jump of P left by {_ZOOMS} zooms, of {said}", gap_W, JUMP_BAR_W, "W"),
    ))  # fmt: skip


def _scanned(points: Points) -> tuple[int, int, float]:
    """Missed points, roots beyond the first crossing, and the largest jump of power left, of some points."""
    converter, size = prototype(), len(points)
    temperatures = Temperatures.everywhere(converter, np.full(size, WARM_C))
    nominal = points.with_voltages_of(converter)
    circuit = build_circuit(converter, temperatures, np.asarray(nominal.V1_V), np.asarray(nominal.V2_V))
    D1, D2, goal_W = (np.asarray(x) for x in (points.D1, points.D2, points.power_W))
    edges = hybrid_edges(-centre_offset(D1, D2), D1, D2)
    found = regulate(circuit, edges, goal_W)
    phase = np.linspace(-2 * float(converter.dead_share), 0.5, SCAN_PHASES)
    power = _power(circuit, edges, np.repeat(phase[:, None], size, axis=1))
    reaches = power.max(axis=0) >= goal_W
    first = phase[np.argmax(power >= goal_W, axis=0)]
    step = phase[1] - phase[0]
    late = found.reached & reaches & (found.phase > first + 1e-6)
    return (
        int(np.sum(reaches & ~found.reached)),
        int(np.sum(late)),
        _largest_jump(circuit, edges, phase, power, step),
    )


def _power(circuit: Circuit, edges: Array, phase: Array) -> Array:
    """Power (K, N) at phases (K, N)."""
    rows, size = phase.shape
    repeated = circuit.take(np.tile(np.arange(size), rows))
    moved = np.tile(edges, (1, rows)) + _SHIFT * phase.ravel()
    nothing = np.zeros(rows * size)
    return (
        periodic(repeated, moved, nothing, np.zeros((4, rows * size))).output_power_W().reshape(phase.shape)
    )


def _largest_jump(circuit: Circuit, edges: Array, phase: Array, power: Array, step: float) -> float:
    """The steepest stretch of each curve, narrowed again and again: a jump stays, a slope shrinks."""
    low = phase[np.argmax(np.abs(np.diff(power, axis=0)), axis=0)]
    for _ in range(_ZOOMS):
        fine = low + step * np.linspace(0.0, 1.0, 9)[:, None]
        jumps = np.abs(np.diff(_power(circuit, edges, fine), axis=0))
        low, step = fine[np.argmax(jumps, axis=0), np.arange(low.size)], step / 8
    return float(jumps.max())
