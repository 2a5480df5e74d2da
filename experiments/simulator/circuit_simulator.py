"""The steady state against ngspice on the same circuit: current, conduction loss, power, and time."""

import resource
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from experiments.harness.result import Cell, Goal, Table
from experiments.harness.settings import Settings
from experiments.peers.ngspice import NgspiceFailed, installed, run_ngspice
from experiments.simulator.points import Findings, at_least, at_most, running_points
from experiments.simulator.speed import processor_s
from sim.losses import switching_losses
from sim.model import Model
from sim.netlist import SETTLED, netlist
from sim.operating_points import Points
from sim.parameters import NpcBridge
from sim.solved import Solved, solve_points

Array = NDArray[np.float64]

SEED = 32_000
POINTS, LIGHT_POINTS = 24, 6  # light ones carry a tenth of the rated power
CURRENT_BAR, CONDUCTION_BAR, RATIO_BAR = 0.5, 2.0, 1e4
KINDS = ("primary_outer", "primary_inner", "primary_clamp", "secondary")


@dataclass(frozen=True, slots=True, kw_only=True)
class _Compared:
    """One point: ngspice's answers beside ours, differences in per cent; None where ngspice failed."""

    row: tuple[Cell, ...]
    rms: float = float("nan")
    conduction: float = float("nan")
    processor_s: float = float("nan")
    unsettled: float = float("nan")


def ngspice_findings(per_point_s: float, settings: Settings) -> Findings:
    """Random points, some at light load, each settled by ngspice from the current of ideal square waves."""
    if not installed():
        note = "not run: there is no ngspice on the PATH (Debian: apt-get install ngspice)"
        nothing = float("nan")
        return Findings(goals=_goals(nothing, nothing, nothing, "not run"), notes=(note,))
    light = settings.thinned(LIGHT_POINTS)
    rng = np.random.default_rng(SEED)
    points = Points.join([
        running_points(light, rng, power_W=(200.0, 200.0)), running_points(settings.thinned(POINTS) - light or 1, rng),
    ])  # fmt: skip
    solved = solve_points(Model.baseline(), points)
    ours = _conduction_W(solved)
    compared = [_compare(solved, k, ours[k]) for k in range(len(points))]
    failed = sum(not np.isfinite(c.rms) for c in compared)
    used_s = [c.processor_s for c in compared if np.isfinite(c.processor_s)]
    worst_rms, worst_loss = (_worst([getattr(c, name) for c in compared]) for name in ("rms", "conduction"))
    ratio = float(np.median(used_s or [np.nan])) / per_point_s
    said = f"worst of {len(points)} points, {light} at light load"
    columns = (
        "D1", "D2", "W", "rms, %", "conduction, %", "P2, %", "unsettled, %", "mean current, A", "processor s",
        "failure",
    )  # fmt: skip
    return Findings(
        goals=_goals(worst_rms, worst_loss, ratio, said),
        tables=(Table(title="ngspice against the simulator", columns=columns, rows=tuple(c.row for c in compared)),),
        notes=(
            f"ngspice: {failed} of {len(points)} runs failed; settled from the current of lossless square waves, the "
            f"rms current of the last periods within {_worst([c.unsettled for c in compared]):.3f} % of that before",
            "conduction: all that the devices lose with less than 5 V across them, diodes in the dead time included, "
            "on both sides; a switch-level circuit has no turn-off and recovery losses, so its P2 is larger by those "
            "of the secondary",
        ),
    )  # fmt: skip


def _goals(rms: float, conduction: float, ratio: float, said: str) -> tuple[Goal, ...]:
    return (
        at_most(f"ngspice, rms current, {said}", rms, CURRENT_BAR, "%"),
        at_most(f"ngspice, conduction loss, {said}", conduction, CONDUCTION_BAR, "%"),
        at_least("ngspice's processor time over ours, per point", ratio, RATIO_BAR, "times"),
    )


def _worst(values: list[float]) -> float:
    """The largest size; not known if one of them is not."""
    return float(np.max(np.abs(values)))


def _conduction_W(solved: Solved) -> Array:
    """Conduction with the diodes of the dead time: switching losses of parts that lose nothing else at edges."""
    quiet = _without_edge_losses(solved)
    orbit = replace(
        solved.orbit,
        commutation=replace(solved.orbit.commutation, missing=0 * solved.orbit.commutation.missing),
    )
    V1, V2 = solved.circuit.V1_V, solved.circuit.nV2_V / solved.circuit.turns_ratio
    diodes = switching_losses(quiet.converter, solved.temperatures, orbit, V1, V2)
    conduction = sum(solved.result[f"loss_{kind}_conduction_W"] for kind in KINDS)
    return np.asarray(conduction + sum(diodes.values()))


def _without_edge_losses(solved: Solved) -> Solved:
    """The same points with devices whose edges lose no turn-off, turn-on or recovery energy."""
    converter = solved.converter
    assert isinstance(converter.primary, NpcBridge)  # the baseline's
    changed = {
        f"{name}": replace(
            switch,
            turn_off=replace(switch.turn_off, energy_J=0.0),
            turn_on=replace(switch.turn_on, energy_J=0.0),
            recovery=replace(switch.recovery, charge_C=0.0),
        )
        for name, switch in (
            ("outer", converter.primary.outer), ("inner", converter.primary.inner), ("low", converter.secondary.switch),
        )
    }  # fmt: skip
    clamp = replace(converter.primary.clamp, recovery=replace(converter.primary.clamp.recovery, charge_C=0.0))
    primary = replace(converter.primary, outer=changed["outer"], inner=changed["inner"], clamp=clamp)
    secondary = replace(converter.secondary, switch=changed["low"])
    return replace(solved, converter=replace(converter, primary=primary, secondary=secondary))


def _compare(solved: Solved, k: int, ours_W: float) -> _Compared:
    point = solved.points.take(np.array([k]))
    at: tuple[Cell, ...] = tuple(float(np.ravel(x)[0]) for x in (point.D1, point.D2, point.power_W))
    before = processor_s(resource.RUSAGE_CHILDREN)
    try:
        measured = run_ngspice(netlist(Model.baseline(), point))
    except NgspiceFailed as error:
        return _Compared(row=(*at, *([None] * 6), str(error)))
    used_s = processor_s(resource.RUSAGE_CHILDREN) - before
    theirs_W = sum(measured[f"loss_{kind}_conduction_w"] for kind in KINDS)
    rms = 100 * (measured["i_l_rms_a"] / solved.result["I_L_rms_A"][k] - 1)
    conduction = 100 * (theirs_W / ours_W - 1)
    output = 100 * (measured["p2_w"] / float(np.ravel(point.power_W)[0]) - 1)
    unsettled = 100 * abs(measured[SETTLED.lower()] / measured["i_l_rms_a"] - 1)
    off = tuple(map(float, (rms, conduction, output, unsettled)))
    row = (*at, *off, measured["i_l_mean_a"], used_s, None)
    return _Compared(row=row, rms=off[0], conduction=off[1], processor_s=used_s, unsettled=off[3])
