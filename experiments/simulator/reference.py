r"""Other people's points: rms and peak-to-peak current of a circuit that we did not choose, simulated in PLECS.

Which D0 a row's waveform belongs to is the question. Solved for the row's power, D0 differs from the logged one by
up to a hundredth of a half period. The logged ones say why: they lie next to multiples of 0.02, a step of 200 ns (D1
and D2 are multiples of it, too). A modulator that acts in such steps makes the loop hunt between two of them, with its
integral resting at the limit between both; the current was taken while one of the two was in force. Logged just above
a limit that is the step above it, just below it the step below: the middle of the step that the logged D0 lies in. The
mean over the hunting is the D0 that carries the power. A window of measurement sees something between the two; half
way is taken. Assumption: the modulator's step was inferred from these logs, it is not in the source.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from bench.errors import InputError, Problem
from experiments.harness.result import Cell, Goal, Table
from experiments.peers.plecs_dab import DEAD_TIME_S, FREQUENCY_HZ, plecs_dab
from experiments.simulator.points import Findings, at_most
from sim.circuit import Temperatures, build_circuit
from sim.model import Model
from sim.modulation import hybrid_edges
from sim.operating_points import Points
from sim.simulate import simulate
from sim.steady_state import periodic

Array = NDArray[np.float64]

COLUMNS = ("Vin_V", "Vref_V", "P_W", "D1", "D2", "D0", "I_L_pp_A", "I_L_rms_A")
STEP = 2 * DEAD_TIME_S * FREQUENCY_HZ  # 200 ns in half periods
MEDIAN_BAR, LARGE_BAR = 2.0, 6.0
SOLVED, HALF_WAY = "solved for the row's power", "half way from solved to that middle"
_CELSIUS = 25.0
_FREE, _FITTED = 121, 1.0  # values of D0 that are tried; per cent of both currents together


@dataclass(frozen=True, slots=True, kw_only=True)
class _Rows:
    """The reference's rows as arrays (N,)."""

    points: Points
    D0_lead: Array
    rms_A: Array
    pp_A: Array


def reference_findings(path: Path | None) -> Findings:
    """Errors of rms and peak-to-peak current for four readings of D0; "not run" without a file."""
    if path is None:
        return Findings(notes=("reference points: not run (--reference FILE)",))
    rows = _read(path)
    solved = simulate(Model(converter=plecs_dab()), rows.points)
    D2 = np.asarray(rows.points.D2)
    own = solved["D0"] + D2
    middle = STEP * (np.floor(rows.D0_lead / STEP) + 0.5)
    readings = {
        SOLVED: own,
        "as logged": rows.D0_lead,
        "middle of the logged D0's step": middle,
        HALF_WAY: 0.5 * (own + middle),
    }
    errors = {name: _errors(rows, D0 - D2) for name, D0 in readings.items()}
    table = tuple(_row(name, errors[name], readings[name] - rows.D0_lead) for name in readings)
    known = f"{int(solved.feasible.sum())} PLECS points"
    judged = {"D0 solved for the power": SOLVED, "D0 by the logs' steps": HALF_WAY}
    return Findings(
        goals=tuple(
            goal for said, name in judged.items() for goal in _goals(f"{known}, {said}", *errors[name])
        ),
        tables=(Table(title="PLECS points by the D0 that is taken", columns=_HEAD, rows=table),),
        notes=(_explained(rows, own, solved.feasible), _floor(rows, own)),
    )


def _goals(said: str, rms: Array, pp: Array) -> tuple[Goal, ...]:
    return tuple(
        at_most(f"{said}: {what}, {share}", float(np.nanquantile(error, q)), bar, "%")
        for what, error in (("rms", rms), ("peak-to-peak", pp))
        for share, q, bar in (("median", 0.5, MEDIAN_BAR), ("90th percentile", 0.9, LARGE_BAR))
    )


_HEAD = (
    "D0",
    "rms median, %",
    "90th, %",
    "pp median, %",
    "pp 90th, %",
    "D0 less logged, median",
    "90th of its size",
)


def _row(name: str, errors: tuple[Array, Array], off: Array) -> tuple[Cell, ...]:
    values = [float(np.nanquantile(error, q)) for error in errors for q in (0.5, 0.9)]
    return (name, *values, float(np.nanmedian(off)), float(np.nanquantile(np.abs(off), 0.9)))


def _explained(rows: _Rows, own: Array, feasible: NDArray[np.bool_]) -> str:
    """What the logged D0 themselves say about the steps, and how much one step matters."""
    place = rows.D0_lead / STEP
    distance = np.abs(place - np.round(place))
    D2 = np.asarray(rows.points.D2)
    sensitivity = np.abs(
        _current(rows, own + 0.25 * STEP - D2)[0] / _current(rows, own - 0.25 * STEP - D2)[0] - 1
    )
    return (
        f"reference: {int((~feasible).sum())} rows cannot run here; the logged D0 lie within {np.median(distance):.3f} "
        f"(median; 90 %: {np.quantile(distance, 0.9):.3f}) of a step of {STEP:.2f} from its multiples, where evenly "
        "spread ones would lie within 0.25 (0.45): the loop hunts across a modulator's steps, and half a step of D0 "
        f"moves the rms current by {100 * np.nanmedian(sensitivity):.1f} % (median; 90 %: "
        f"{100 * np.nanquantile(sensitivity, 0.9):.0f} %), which is the residue"
    )


def _floor(rows: _Rows, own: Array) -> str:
    """Where in a step those D0 lie that the waveforms themselves tell, and those that the power does."""
    D2, off = np.asarray(rows.points.D2), np.linspace(-1.5, 1.5, _FREE) * STEP
    errors = [np.hypot(*_errors(rows, own + x - D2)) for x in off]
    known = np.flatnonzero(np.isfinite(own))
    best = np.argmin(np.stack(errors)[:, known], axis=0)
    left = np.min(np.stack(errors)[:, known], axis=0)
    told = (own[known] + off[best])[left < _FITTED] / STEP
    free, solved = (np.bincount(np.round(4 * place).astype(int) % 4, minlength=4) / place.size for place in (
        told, own[known] / STEP
    ))  # fmt: skip
    return (
        f"reference: left free, D0 fits rms and peak-to-peak together within {_FITTED:g} % in {told.size} rows. By "
        f"quarters of a step, {100 * free[2]:.0f} % of these D0 lie at its middle and {100 * free[0]:.0f} % at the "
        "limit of two steps; those solved for the power are evenly spread "
        f"({100 * solved[2]:.0f} and {100 * solved[0]:.0f} %): waveforms belong to few places of a step, powers to "
        "any, so D0 solved for the power is off by a part of a step whoever solves it"
    )


def _errors(rows: _Rows, D0: Array) -> tuple[Array, Array]:
    """Errors in per cent of rms and peak-to-peak current at our D0."""
    rms, pp = _current(rows, D0)
    return 100 * np.abs(rms / rows.rms_A - 1), 100 * np.abs(pp / rows.pp_A - 1)


def _current(rows: _Rows, D0: Array) -> tuple[Array, Array]:
    """Rms and peak-to-peak current at our D0; NaN where that is not known."""
    known = np.flatnonzero(np.isfinite(D0))
    points, size = rows.points.take(known), known.size
    converter = plecs_dab()
    temperatures = Temperatures.everywhere(converter, np.full(size, _CELSIUS))
    V1_V, V2_V, D1, D2 = (np.asarray(x) for x in (points.V1_V, points.V2_V, points.D1, points.D2))
    circuit = build_circuit(converter, temperatures, V1_V, V2_V)
    orbit = periodic(circuit, hybrid_edges(D0[known], D1, D2), np.zeros(size), np.zeros((4, size)))
    rms, pp = np.full(D0.size, np.nan), np.full(D0.size, np.nan)
    rms[known] = np.sqrt(np.sum(orbit.pieces.square(), axis=0) / circuit.half_period_s)
    ends = np.maximum(np.max(np.abs(orbit.pieces.current_A), axis=0), np.abs(orbit.pieces.end_A[-1]))
    pp[known] = 2 * ends
    return rms, pp


def _read(path: Path) -> _Rows:
    """The rows that the file calls valid; InputError for what is missing or no number."""
    try:
        table = pd.read_csv(path)
    except (OSError, ValueError) as error:
        raise InputError.of(path, "file", None, f"cannot be read: {error}") from error
    problems = [
        Problem(
            file=str(path), field=name, value=None, allowed=f"column is missing; needed: {', '.join(COLUMNS)}"
        )
        for name in COLUMNS
        if name not in table
    ]
    if problems:
        raise InputError(problems)
    if "valid" in table:
        table = table[table["valid"] == 1]
    numbers = table[list(COLUMNS)].apply(pd.to_numeric, errors="coerce")
    wrong = numbers.index[~np.isfinite(numbers).all(axis=1)]
    if len(wrong) or numbers.empty:
        line = int(wrong[0]) + 2 if len(wrong) else None
        raise InputError(
            [Problem(file=str(path), field="row", value=None, allowed="numbers in every column", line=line)]
        )
    v = {name: numbers[name].to_numpy(dtype=float) for name in COLUMNS}
    points = Points(D1=v["D1"], D2=1.0 - v["D2"], power_W=v["P_W"], V1_V=v["Vin_V"], V2_V=v["Vref_V"])
    return _Rows(points=points, D0_lead=v["D0"], rms_A=v["I_L_rms_A"], pp_A=v["I_L_pp_A"])
