"""The virtual prototype beside the paper's: peak efficiency, where the losses are, and all that was assumed."""

import inspect
from collections.abc import Iterator

import numpy as np

import sim.prototype
from experiments.harness.result import Cell, Table
from experiments.simulator.points import Findings
from sim.datasheet import datasheet
from sim.model import Model
from sim.simulate import Points, simulate

PAPER_PEAK, PAPER_PEAK_W = 0.9845, 600.0  # of the paper, section IV-C
LOADS_W = (600.0, 1000.0, 1600.0)  # of the paper's figure 18
SHARES = {
    "primary bridge": ("primary_",),
    "secondary bridge": ("secondary_",),
    "inductor": ("inductor_", "link_resistance"),
    "transformer": ("transformer_",),
    "rest": ("auxiliary", "input_cable", "output_cable", "added"),
}
_FINE = 41


def virtual_prototype() -> Findings:
    """The best D1 and D2 of a fine grid at each load of the paper's grid, without any fit."""
    loads_W = np.linspace(200.0, 2000.0, 19)
    best = {float(P): _best(float(P)) for P in loads_W}
    peak_W = max(best, key=lambda P: best[P][0])
    rows: list[tuple[Cell, ...]] = [
        ("peak efficiency", best[peak_W][0], PAPER_PEAK), ("at, W", peak_W, PAPER_PEAK_W),
        ("difference of the peaks, points", 100 * (best[peak_W][0] - PAPER_PEAK), 0.0),
    ]  # fmt: skip
    shares = tuple(_shares(P, best[P]) for P in LOADS_W)
    columns = ("load, W", "D1", "D2", "efficiency", "loss, W", *(f"{name}, %" for name in SHARES))
    return Findings(
        tables=(
            Table(title="Virtual prototype", columns=("what", "simulated", "paper"), rows=tuple(rows)),
            Table(title="Loss shares at the best D1 and D2 (a picture in the paper)", columns=columns, rows=shares),
        ),
        notes=(
            "paper, in words: at 600 W the secondary bridge's losses are the main ones; with power its share falls and "
            "that of inductor and transformer rises; the primary bridge's share stays below the secondary's",
            "assumed in the virtual prototype: " + "; ".join(_assumed()),
        ),
    )  # fmt: skip


def _best(power_W: float) -> tuple[float, float, float]:
    """Efficiency, D1 and D2 of the best feasible point of a fine grid."""
    D1, D2 = (x.ravel() for x in np.meshgrid(np.linspace(0.3, 1.0, _FINE), np.linspace(0.0, 0.6, _FINE)))
    result = simulate(Model.baseline(), Points(D1=D1, D2=D2, power_W=power_W))
    k = int(np.nanargmax(result["efficiency"]))
    return float(result["efficiency"][k]), float(D1[k]), float(D2[k])


def _shares(power_W: float, best: tuple[float, float, float]) -> tuple[Cell, ...]:
    efficiency, D1, D2 = best
    result = simulate(Model.baseline(), Points(D1=D1, D2=D2, power_W=power_W))
    losses = {name: float(v[0]) for name, v in result.values.items() if name.startswith("loss_")}
    total = sum(losses.values())
    shares = [
        100
        * sum(loss for name, loss in losses.items() if name.removeprefix("loss_").startswith(parts))
        / total
        for parts in SHARES.values()
    ]
    return (power_W, D1, D2, efficiency, total, *shares)


def _assumed() -> Iterator[str]:
    """What the sources call an assumption: lines of the prototype's file, values of the parts' files."""
    for line in inspect.getsource(sim.prototype).splitlines():
        value, mark, said = line.partition("# Assumption")
        if mark and value.strip():
            yield f"{value.strip().rstrip(',(')} ({said.strip(': ') or 'plausible'})"
    for part in ("UF3C065030K4S", "IKW40N65ES5", "APT30DQ60BG"):
        named = [name for name, entry in datasheet(part).items() if entry.source.startswith("Assumption")]
        yield f"{part}: {', '.join(named)}"
