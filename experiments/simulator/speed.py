"""What a point costs: the grid, the grid as a whole process, and sweeps of growing size."""

import os
import resource
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

from bench.set_points import parse_space
from bench.sweep import Sweep, run_sweep
from bench.workers import Workers
from experiments.harness.result import Cell, Table
from experiments.harness.settings import Settings
from experiments.simulator.points import Findings, at_most
from sim.model import Model
from sim.prototype import prototype
from sim.simulate import grid, simulate
from sim.space import solve_rows

SECONDS_BAR, PROCESS_BAR, FLAT_BAR, MEMORY_BAR = 1.0, 3.0, 1.3, 2.0
LARGEST_SWEEP, SMALLEST_SWEEP = 10_000_000, 10_000
REPEATS = 3
_GIB = 1024.0**2  # of the kilobytes that the system counts in


@dataclass(frozen=True, slots=True, kw_only=True)
class GridCost:
    """Seconds of the grid on the wall and on all processors (the best of some runs), and its feasible points."""

    seconds: float
    processor_s: float
    feasible: int
    processes: int

    @property
    def per_point_s(self) -> float:
        """Processor seconds of a feasible point."""
        return self.processor_s / self.feasible


def grid_cost(settings: Settings) -> GridCost:
    """The closed-loop grid with all losses and temperatures, in this process and a fork of it for every other core."""
    model, space = Model.baseline(), parse_space("25x25x20", (), prototype())
    columns = space.rows(0, len(space))
    simulate(model, grid((5, 5, 4)))  # what is made once only is made before the clock starts
    wall_s, used_s, feasible = [], [], 0
    for _ in range(REPEATS):
        start_s, before = settings.now(), processor_s()
        feasible = int(solve_rows(model, columns, settings.processes)["feasible"].sum())
        wall_s.append(settings.now() - start_s)
        used_s.append(processor_s() - before)
    return GridCost(
        seconds=min(wall_s), processor_s=min(used_s), feasible=feasible, processes=settings.processes
    )


def grid_findings(cost: GridCost, settings: Settings) -> Findings:
    """The grid in this process and as a process of its own, from nothing to a Parquet file."""
    with tempfile.TemporaryDirectory() as folder:
        options = (
            "simulate", "--grid", "25x25x20", "--processes", str(cost.processes),
            "--out", str(Path(folder, "grid.parquet")),
        )  # fmt: skip
        command = [sys.executable, "-c", "from bench.cli import main; main()", *options]
        start_s, before = settings.now(), processor_s(resource.RUSAGE_CHILDREN)
        subprocess.run(command, check=True, capture_output=True)
        whole_s, used_s = settings.now() - start_s, processor_s(resource.RUSAGE_CHILDREN) - before
    load = os.getloadavg()[0]
    return Findings(
        goals=(
            at_most(
                f"grid of 12,500 points, all losses, {cost.processes} processes, best of {REPEATS}",
                cost.seconds, SECONDS_BAR, "s",
            ),
            at_most("the same as a whole process, to a Parquet file", whole_s, PROCESS_BAR, "s"),
        ),
        notes=(
            f"grid: {cost.processor_s:.2f} s of processor time, {1e6 * cost.per_point_s:.0f} us for each of "
            f"{cost.feasible} feasible points; as a whole process {used_s:.2f} s; {os.cpu_count()} cores, "
            f"load {load:.1f} at the time",
        ),
    )  # fmt: skip


@dataclass(frozen=True, slots=True, kw_only=True)
class _Rung:
    """One size of sweep: points, wall seconds, processor seconds, peak memory of the largest process in GiB."""

    points: int
    seconds: float
    processor_s: float
    memory_GiB: float


def sweep_ladder(settings: Settings) -> Findings:
    """Sweeps over D1, D2, power, voltage ratio and inductance; ``scale`` thins the largest of 10^7 points."""
    sizes = [size for size in _sizes(settings.thinned(LARGEST_SWEEP)) if size >= SMALLEST_SWEEP] or [
        SMALLEST_SWEEP
    ]
    rungs = [_swept(size, settings) for size in sizes]
    cost = [rung.processor_s / rung.points for rung in rungs]
    rows: tuple[tuple[Cell, ...], ...] = tuple(
        (rung.points, rung.seconds, rung.processor_s, 1e6 * c, c / cost[0], rung.memory_GiB)
        for rung, c in zip(rungs, cost, strict=True)
    )
    columns = ("points", "s", "processor s", "processor us a point", "of the first", "peak memory, GiB")
    said = f"{rungs[0].points:,} to {rungs[-1].points:,} points"
    goals = [
        at_most(f"peak memory of a process, {said}", max(r.memory_GiB for r in rungs), MEMORY_BAR, "GiB")
    ]
    if len(rungs) > 1:
        goals.insert(
            0,
            at_most(f"processor time per point, {said}, most over the first", max(cost) / cost[0], FLAT_BAR),
        )
    notes = () if rungs[-1].points == LARGEST_SWEEP else (
        f"sweeps were run to {rungs[-1].points:,} points only; --scale 1 goes to {LARGEST_SWEEP:,}",
    )  # fmt: skip
    title = f"Sweeps to Parquet, {settings.processes} processes"
    return Findings(goals=tuple(goals), tables=(Table(title=title, columns=columns, rows=rows),), notes=notes)


def _sizes(largest: int) -> list[int]:
    return [10**k for k in range(4, 8) if 10**k <= largest]


def _swept(points: int, settings: Settings) -> _Rung:
    """A space of so many points: 20 x 20 x 25 of D1, D2, power, and the rest in voltage ratio and inductance."""
    more = points // SMALLEST_SWEEP
    ratios = {1: 1, 10: 5, 100: 10, 1000: 25}[more]
    vary = [] if more == 1 else [
        f"voltage_ratio=0.85:1.05:{ratios}", f"inductor.inductance_H=200e-6:260e-6:{more // ratios}"
    ]  # fmt: skip
    with tempfile.TemporaryDirectory(dir=_folder(settings)) as folder:
        inputs = parse_space("20x20x25", vary, prototype())
        sweep = Sweep(
            model=Model.baseline(),
            inputs=inputs,
            out=Path(folder, "sweep.parquet"),
        )
        start_s, before = settings.now(), processor_s()
        run_sweep(sweep, Workers(processes=settings.processes), lambda _done, _total: None)
        seconds, used_s = settings.now() - start_s, processor_s() - before
    memory = max(
        resource.getrusage(who).ru_maxrss for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)
    )
    return _Rung(points=points, seconds=seconds, processor_s=used_s, memory_GiB=memory / _GIB)


def _folder(settings: Settings) -> Path:
    settings.out.mkdir(parents=True, exist_ok=True)
    return settings.out


def processor_s(*whom: int) -> float:
    """Processor time so far of this process and its ended children, or of those named."""
    usage = [resource.getrusage(who) for who in whom or (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(u.ru_utime + u.ru_stime for u in usage)
