"""The knowledge-based methods of the paper's Table I beside the simulator, on the paper's grid."""

from collections.abc import Callable

import numpy as np

from experiments.harness.result import Cell, Table
from experiments.harness.settings import Settings
from experiments.simulator.points import Findings
from sim.knowledge import harmonic_method, piecewise_method
from sim.model import Model
from sim.operating_points import Points
from sim.simulate import Result, grid, simulate

Method = Callable[[Model, Points], Result]

_METHODS: dict[str, Method] = {
    "piecewise": piecewise_method,
    "harmonic, 1": lambda model, points: harmonic_method(model, points, harmonics=1),
    "harmonic, 1 to 5": lambda model, points: harmonic_method(model, points, harmonics=3),
}


def knowledge_methods(settings: Settings) -> Findings:
    """How far each method is from the simulator where both run; no bar is set for them."""
    model, points = Model.baseline(), grid()
    ours = simulate(model, points)
    rows = []
    for name, method in _METHODS.items():
        start_s = settings.now()
        theirs = method(model, points)
        rows.append(_row(name, theirs, ours, settings.now() - start_s))
    columns = (
        "method", "feasible", "only here", "only in the simulator", "rms median, %", "D0 median", "efficiency, points",
        "s",
    )  # fmt: skip
    title = "Knowledge-based methods less the simulator (mean size of the efficiency's difference)"
    return Findings(tables=(Table(title=title, columns=columns, rows=tuple(rows)),))


def _row(name: str, theirs: Result, ours: Result, seconds: float) -> tuple[Cell, ...]:
    both = theirs.feasible & ours.feasible
    off = {
        column: np.abs(theirs[column] - ours[column])[both] for column in ("D0", "efficiency", "I_L_rms_A")
    }
    return (
        name,
        int(theirs.feasible.sum()),
        int((theirs.feasible & ~ours.feasible).sum()),
        int((ours.feasible & ~theirs.feasible).sum()),
        float(100 * np.median(off["I_L_rms_A"] / ours["I_L_rms_A"][both])),
        float(np.median(off["D0"])),
        float(100 * np.mean(off["efficiency"])),
        seconds,
    )
