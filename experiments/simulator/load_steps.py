"""Load steps of the closed loop, with the capacitor and the gains that the prototype's file fixes."""

import numpy as np

from experiments.harness.result import Cell, Table
from experiments.simulator.points import Findings, at_most
from sim.model import Model
from sim.prototype import prototype_voltage_loop
from sim.simulate import Result, grid, simulate
from sim.transient import DutyTable, LoadStep, load_step, loop_plant
from sim.voltage_loop import margin

STEPS_W = ((1600.0, 600.0), (600.0, 1600.0))
BAR_MS = 1.0
_MS = 1e3


def best_table(result: Result) -> DutyTable:
    """The feasible D1 and D2 of highest efficiency at each power of a grid."""
    power_W = np.asarray(result.points.power_W)
    efficiency = np.where(result.feasible, result["efficiency"], -np.inf)
    best = [
        rows[np.argmax(efficiency[rows])]
        for P in np.unique(power_W)
        for rows in [np.flatnonzero(power_W == P)]
    ]
    kept = [k for k in best if result.feasible[k]]
    D1, D2 = (np.asarray(x)[kept] for x in (result.points.D1, result.points.D2))
    return DutyTable(power_W=power_W[kept], D1=D1, D2=D2)


def load_steps() -> Findings:
    """Both steps, stepped through time; the margin at both loads."""
    model, loop = Model.baseline(), prototype_voltage_loop()
    table = best_table(simulate(model, grid()))
    rows: list[tuple[Cell, ...]] = []
    goals = []
    for from_W, to_W in STEPS_W:
        response = load_step(model, loop, table, LoadStep(from_W=from_W, to_W=to_W))
        settling_ms = _MS * response.settling_s()
        found = margin(loop, loop_plant(model, table, to_W))
        goals.append(
            at_most(f"load step {from_W:.0f} to {to_W:.0f} W, V2 within 1 % after", settling_ms, BAR_MS, "ms")
        )
        rows.append(
            (from_W, to_W, settling_ms, 100 * response.deviation, found.phase_deg, found.crossover_Hz,
             float(response.D0[0]), float(response.D0[-1]))
        )  # fmt: skip
    columns = (
        "from, W", "to, W", "settled, ms", "largest deviation, %", "phase margin, deg", "crossover, Hz", "D0 before",
        "D0 after",
    )  # fmt: skip
    note = (
        f"voltage loop, all assumed: {1e6 * loop.capacitance_F:.0f} uF, {loop.proportional_per_V:g} per V, "
        f"{loop.integral_per_V_s:g} per V s, sampled once a period; D1 and D2 follow the load by the best of the grid"
    )
    title = "Load steps (phase margin at the second load)"
    return Findings(
        goals=tuple(goals), tables=(Table(title=title, columns=columns, rows=tuple(rows)),), notes=(note,)
    )
