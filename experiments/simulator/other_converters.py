"""Converters drawn at random: whether every point that is stated stands still, and what time stepping makes of it."""

import itertools

import numpy as np
from numpy.typing import NDArray

from experiments.harness.result import Cell, Table
from experiments.harness.settings import Settings
from experiments.peers.random_converters import random_converter, random_points
from experiments.simulator.points import Findings, at_most
from sim.fixed_point import operate
from sim.model import Model
from sim.simulate import simulate
from sim.solved import solve_points
from sim.stepping import Stepper, settle

Array = NDArray[np.float64]

CONVERTERS, POINTS = 40, 20
_SEED = 7
_BANDS = (0.003, 0.01, 0.02, 0.05)  # dead time over half a period
_STILL_K, _STILL = (
    0.05,
    1e-4,
)  # what the last solution of a settled point may still ask for; power is relative


def other_converters(settings: Settings) -> Findings:
    """Random points of random converters."""
    rows: list[tuple[float, Array, Array]] = []
    seen, runs, moving = 0, 0, 0
    for seed in range(settings.thinned(CONVERTERS)):
        rng = np.random.default_rng((_SEED, seed))
        converter = random_converter(rng)
        model, points = Model(converter=converter), random_points(converter, POINTS, rng)
        running = points.take(np.flatnonzero(simulate(model, points).feasible))
        seen, runs = seen + len(points), runs + len(running)
        if not len(running):
            continue
        outcome = operate(converter, running)
        asked, now = outcome.station.ahead(outcome.state).by_name(), outcome.station.slow.by_name()
        temperatures = [name for name in now if name not in ("target_W", "I1_A")]
        off_K = np.max([np.abs(asked[name] - now[name]) for name in temperatures], axis=0)
        off = np.abs(asked["target_W"] - now["target_W"]) / np.abs(np.asarray(running.power_W))
        moving += int(np.count_nonzero((off_K > _STILL_K) | (off > _STILL)))
        solved = solve_points(model, running)
        settled = settle(Stepper(circuit=solved.circuit), solved.edges)
        rms = 100 * np.abs(settled.rms_A / solved.result["I_L_rms_A"] - 1)
        missed_W = settled.output_W(solved.circuit.turns_ratio) - solved.orbit.output_power_W()
        rows.append((float(converter.dead_time_s) / converter.half_period_s, rms,
                     100 * np.abs(missed_W) / converter.rated_power_W))  # fmt: skip
    return Findings(
        goals=(at_most(f"random converters: {runs} stated points that do not stand still", moving, 0),),
        tables=(_table(rows),),
        notes=(
            f"random converters: {runs} of {seen} points of {len(rows)} converters run; the others cannot carry "
            "their power, get too hot or have no room for a pulse. Power against time stepping is relative to rated "
            "power; both take the drops of the dead times' diodes as those of the bridges' states",
        ),
    )


def _table(rows: list[tuple[float, Array, Array]]) -> Table:
    cells: list[tuple[Cell, ...]] = []
    for low, high in itertools.pairwise(_BANDS):
        inside = [(rms, power) for dead, rms, power in rows if low <= dead < high]
        if not inside:
            continue
        rms, power = (np.concatenate(part) for part in zip(*inside, strict=True))
        cells.append(
            (f"{100 * low:g} to {100 * high:g}", len(inside), rms.size,
             *(float(np.quantile(x, q)) for x in (rms, power) for q in (0.5, 0.9, 1.0)))
        )  # fmt: skip
    columns = (
        "dead time, % of half a period", "converters", "points", "rms median, %", "90th", "worst",
        "power median, % of rated", "90th", "worst",
    )  # fmt: skip
    return Table(title="Random converters against time stepping", columns=columns, rows=tuple(cells))
