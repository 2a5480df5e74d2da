"""The simulator against its bars: speed, agreement with solvers that share nothing with it, and the paper's prototype.

Every row is a figure beside its bar. The grid is the paper's (12,500 points: D0 solved for the demanded power, all
losses, temperatures at their fixed point). Energy balance and the lossless closed form check it against physics; a
dense scan of D0 checks feasibility and root; time stepping from rest and ngspice, on a circuit file that the simulator
writes, check the steady state. ``--reference FILE`` compares with points that others simulated in PLECS.

``--scale`` thins points and the largest sweep. Seconds depend on the machine and on what else runs there; ratios
depend on it less, and processor time is given beside.
"""

from collections.abc import Callable
from functools import cache

from experiments.harness.registry import Experiment
from experiments.harness.result import Result
from experiments.harness.settings import Countdown, Settings
from experiments.simulator.agreement import (
    dense_scan,
    energy_balance,
    lossless_single_phase_shift,
    time_stepping,
)
from experiments.simulator.circuit_simulator import ngspice_findings
from experiments.simulator.knowledge_methods import knowledge_methods
from experiments.simulator.load_steps import load_steps
from experiments.simulator.other_converters import other_converters
from experiments.simulator.points import Findings
from experiments.simulator.reference import reference_findings
from experiments.simulator.speed import grid_cost, grid_findings, sweep_ladder
from experiments.simulator.virtual_prototype import virtual_prototype

PARTS = (
    "reference", "grid", "sweeps", "dense_scan", "ngspice", "energy_balance", "closed_form", "time_stepping",
    "other_converters", "load_steps", "knowledge_based", "prototype",
)  # fmt: skip


def run(settings: Settings) -> Result:
    """Every part in turn, or those asked for; nothing of it is measured in a virtual lab."""
    chosen = [name for name in PARTS if not settings.only or name in settings.only]
    parts = _parts(settings)
    countdown = Countdown(len(chosen), settings)
    found = []
    for name in chosen:
        found.append(parts[name]())
        countdown.finished(name)
    return Result(
        goals=tuple(goal for f in found for goal in f.goals),
        tables=tuple(table for f in found for table in f.tables),
        notes=tuple(note for f in found for note in f.notes),
    )


def _parts(settings: Settings) -> dict[str, Callable[[], Findings]]:
    cost = cache(lambda: grid_cost(settings))
    return {
        "reference": lambda: reference_findings(settings.reference),  # first: a wrong file is told at once
        "grid": lambda: grid_findings(cost(), settings),
        "sweeps": lambda: sweep_ladder(settings),  # before anything that needs memory
        "dense_scan": lambda: dense_scan(settings),
        "ngspice": lambda: ngspice_findings(cost().per_point_s, settings),
        "energy_balance": energy_balance,
        "closed_form": lossless_single_phase_shift,
        "time_stepping": lambda: time_stepping(settings),
        "other_converters": lambda: other_converters(settings),
        "load_steps": load_steps,
        "knowledge_based": lambda: knowledge_methods(settings),
        "prototype": virtual_prototype,
    }


EXPERIMENT = Experiment(
    title="Benchmark: the simulator against its bars", run=run, parts=PARTS, apart=True, reference=True
)
