"""Which rows of a measurement table cannot be, and why.

Checks run on the numbers as given, in the order of ``CHECKS``; a row is rejected by the
first one it fails, so that a power in kilowatts is not reported as too much efficiency as well. Optional
channels do not cost a row: a value that cannot be is left empty and noted.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pandas as pd

from models.number_forms import NO_DATA, as_number
from models.row_times import counted_from_the_start
from models.summary_rows import summary_rows
from models.temperature_units import ROOM, said_of_units

KINDS = ("load", "reference", "standby", "no_load")
LOADED_KINDS = ("load", "reference")
CORE_COLUMNS = ("D1", "D2", "P2_W", "P1_W", "efficiency")
OPTIONAL_COLUMNS = (
    *("time_s", "P_set_W", "D0", "V1_V", "I1_A", "V2_V", "I2_A", "I_L_rms_A", "P_link1_W", "P_link2_W"),
    *("T_ambient_C", "T_heatsink_C", "T_transformer_C", "T_inductor_C"),
    *("range_U1_V", "range_I1_A", "range_U2_V", "range_I2_A", "u_P1_W", "u_P2_W", "u_efficiency"),
)
NUMERIC_COLUMNS = (*CORE_COLUMNS, *OPTIONAL_COLUMNS)
TEXT_COLUMNS = ("kind", "settled", "quality", "lab")
KNOWN_COLUMNS = (*NUMERIC_COLUMNS, "point", "repeat", *TEXT_COLUMNS)

GOOD = "good"
KILOWATT_LIMIT = 10.0  # W: 0.2 to 2 is a power in kW, but a small converter has light loads there
_KILO_APART = 200.0  # between the largest load and the smallest: more is a unit's thousand
ABSOLUTE_ZERO_C = -273.15
ROOM_C = (-40.0, 85.0)
# of the power, in the median row: ten times what analyzers specify for a dc voltage and a current together
_MAKE_UP = 0.01
_NOT_AMPERES = 1.5  # times: more than any ripple or error of an instrument, and less than any other unit
DISAGREEMENT = 0.005  # of efficiency against P2/P1: more than the rounding of printed powers explains


@dataclass(frozen=True, slots=True, kw_only=True)
class RejectedRow:
    """Why a row was left out; ``row`` counts data rows from 1, the header not included, ``line`` lines of a file."""

    row: int
    column: str
    value: str
    reason: str
    line: int | None = None

    def __str__(self) -> str:
        where = f"row {self.row}" if self.line is None else f"row {self.row} (line {self.line})"
        return f"{where}, {self.column} = {self.value}: {self.reason}"


@dataclass(frozen=True, slots=True)
class Check:
    """One thing that cannot be: the column to name, the reason to give, and the rows it holds for; ``more`` of the
    reason goes by those rows."""

    column: str
    reason: str
    impossible: Callable[[pd.DataFrame], pd.Series]
    kinds: tuple[str, ...] = LOADED_KINDS
    more: Callable[[pd.DataFrame], str] = lambda frame: ""


def _not_finite(column: str) -> Callable[[pd.DataFrame], pd.Series]:
    return lambda frame: ~(frame[column].abs() < NO_DATA)


def _least_likely_W(power: pd.Series) -> float:
    """The power below which a row is rather in kilowatts: far below the largest, or any where all rows are so small."""
    largest = float(power.where(power < NO_DATA).max())
    return largest / _KILO_APART if largest >= KILOWATT_LIMIT else np.inf


def _outside_unit(column: str) -> Callable[[pd.DataFrame], pd.Series]:
    return lambda frame: ~frame[column].between(0.0, 1.0)


def _in_factor(column: str, factor: str) -> str:
    return f"d2ea import --column {column}={column}*{factor} converts it"


def _exchanged(one: str, other: str) -> str:
    return f"--column {one}={other} --column {other}={one}"


def _with_the_powers(frame: pd.DataFrame) -> str:
    """Which voltages and currents are exchanged too where powers are: those whose product is the other port's power."""
    pairs = [pair for pair in (("V1_V", "V2_V"), ("I1_A", "I2_A")) if set(pair) <= set(frame)]
    options = " ".join(_exchanged(*pair) for pair in pairs)
    if not pairs:
        return ""
    if len(pairs) == 1:
        return f", and if {' and '.join(pairs[0])} are exchanged too, with {options}"
    first, second = (float((frame[f"V{k}_V"] * frame[f"I{k}_A"] / frame["P1_W"]).median()) for k in (1, 2))
    are_too = abs(first - 1.0) < abs(second - 1.0)
    return f", with {options}: V1_V * I1_A is P1_W there, so they are exchanged too" if are_too else ""


def _half_period(column: str) -> str:
    converted = f"per cent or degrees are converted by d2ea import --column {column}={column}*"
    return f"outside [0, 1]: {column} is in units of the half period; {converted}0.01 or *{1 / 180:.6f}"


NO_NUMBER = "not a finite number (text, NaN, INF or the analyzer's code for no data)"
CHECKS = (
    Check("P1_W", NO_NUMBER, _not_finite("P1_W"), ("standby", "no_load")),
    *(Check(column, NO_NUMBER, _not_finite(column)) for column in ("D1", "D2", "P2_W")),
    Check("P1_W", "overrange or no data", lambda f: f["P1_W"].abs() >= NO_DATA),
    Check("efficiency", "overrange or no data", lambda f: f["efficiency"].abs() >= NO_DATA),
    Check(
        "P1_W", "neither P1_W nor efficiency is a number", lambda f: f["P1_W"].isna() & f["efficiency"].isna()
    ),
    *(Check(column, _half_period(column), _outside_unit(column)) for column in ("D1", "D2")),
    Check(
        "P2_W",
        "below 0 W, and P1_W too: power flows from the output to the input; such rows are not diagnosed",
        lambda f: (f["P2_W"] < 0) & (f["P1_W"] < 0),
    ),
    Check(
        "P2_W",
        "not above 0 W: a loaded point delivers power to the output; a row without load has the kind no_load or "
        f"standby; if it counts the other way, {_in_factor('P2_W', '-1')}",
        lambda f: f["P2_W"] <= 0,
    ),
    Check(
        "P2_W",
        f"below 10 W: this looks like kilowatts; powers are in W, and {_in_factor('P2_W', '1000')}, P1_W alike",
        lambda f: (f["P2_W"] < KILOWATT_LIMIT) & (f["P2_W"] < _least_likely_W(f["P2_W"])),
    ),
    Check(
        "efficiency",
        f"this looks like per cent; efficiency is a fraction (0.9845), and {_in_factor('efficiency', '0.01')}",
        lambda f: f["efficiency"].between(2.0, 100.0),
    ),
    Check("efficiency", "not in (0, 1]", lambda f: (f["efficiency"] <= 0) | (f["efficiency"] > 1)),
    Check(
        "P1_W",
        f"not above 0 W: a loaded point draws power; if it counts the other way, {_in_factor('P1_W', '-1')}",
        lambda f: f["P1_W"] <= 0,
    ),
    Check(
        "P1_W",
        f"P2_W is about 1000 times as much: P1_W looks like kilowatts, and {_in_factor('P1_W', '1000')}",
        lambda f: f["P2_W"] > 500 * f["P1_W"],
    ),
    Check(
        "P2_W",
        "above P1_W: more power out than in; if the two are exchanged, d2ea import "
        f"{_exchanged('P1_W', 'P2_W')} puts them right",
        lambda f: f["P2_W"] > f["P1_W"],
        more=_with_the_powers,
    ),
    Check(
        "efficiency",
        "differs from P2_W / P1_W by more than 0.005",
        lambda f: (f["efficiency"] - f["P2_W"] / f["P1_W"]).abs() > DISAGREEMENT,
    ),
)


def numbers(raw: pd.DataFrame) -> tuple[pd.DataFrame, tuple[str, ...]]:
    """Known numeric columns as float64 (NaN where there is no number) and ``kind``; notes besides.

    Optional values that cannot be are left empty: one note per column says how many, and the first.
    """
    frame = raw.copy()
    notes: list[str] = []
    if "time_s" in raw:
        raw, notes = counted_from_the_start(raw)
    for column in NUMERIC_COLUMNS:
        if column in raw:
            frame[column] = as_number(raw[column])
        elif column in CORE_COLUMNS:
            frame[column] = np.nan
        if column in raw and column in OPTIONAL_COLUMNS:
            notes += _blank(frame, raw, column)
    notes += [note for port in ("1", "2") for note in _check_current(frame, port)]
    notes += said_of_units(frame[[column for column in OPTIONAL_COLUMNS if column in raw]])
    notes += [*_not_read(frame, raw, "P1_W", "efficiency"), *_not_read(frame, raw, "efficiency", "P1_W")]
    kind = raw["kind"] if "kind" in raw else pd.Series("load", index=raw.index)
    frame["kind"] = kinds(kind)
    return frame, tuple(notes)


def _not_read(frame: pd.DataFrame, raw: pd.DataFrame, column: str, other: str) -> list[str]:
    """That values of one of the two columns which tell the loss are no numbers, where the other one stands in."""
    if not {column, other} <= set(raw):
        return []
    lost = frame[column].isna() & raw[column].notna() & frame[other].notna() & frame["P2_W"].notna()
    if not lost.any():
        return []
    first = int(np.flatnonzero(lost)[0])
    count, value = f"{int(lost.sum())} of {len(frame)}", raw[column].iloc[first]
    return [
        f"{column}: {count} values are no numbers (row {first + 1}: {value}); taken from {other} and P2_W there"
    ]


def kinds(given: pd.Series) -> pd.Series:
    """Kinds of rows as they are named here, from ``No load`` or ``no-load`` too; load where nothing is said."""
    said = given.astype(object).where(given.notna(), "load").astype(str).str.strip()
    return said.str.lower().str.replace(r"[\s-]+", "_", regex=True)


def _blank(frame: pd.DataFrame, raw: pd.DataFrame, column: str) -> list[str]:
    value = frame[column]
    unusable = (value.isna() & raw[column].notna()) | (value.abs() >= NO_DATA)
    if column.startswith(("u_", "range_")) or column == "V1_V":
        unusable |= value <= 0
    if column.startswith("T_"):
        unusable |= value < ABSOLUTE_ZERO_C
    if column == ROOM:
        unusable |= _of_no_room(value)
    if not unusable.any():
        return []
    frame[column] = value.mask(unusable)
    first = int(np.flatnonzero(unusable)[0])
    count = f"{int(unusable.sum())} of {len(frame)}"
    return [
        f"{column}: {count} values cannot be and are left empty (row {first + 1}: {raw[column].iloc[first]})"
    ]


def _of_no_room(value: pd.Series) -> pd.Series:
    """Single temperatures that no room has, among others that some room has: a spike, not a unit."""
    beyond = ~value.between(*ROOM_C) & value.notna()
    return beyond & (beyond.sum() < 0.5 * value.notna().sum())


def _check_current(frame: pd.DataFrame, port: str) -> list[str]:
    """At a dc port voltage times current is power: say where they differ, and leave empty what is not in amperes."""
    voltage, current, power = f"V{port}_V", f"I{port}_A", f"P{port}_W"
    if not {voltage, current, power} <= set(frame):
        return []
    of = frame[voltage] * frame[current] / frame[power].where(frame[power] > KILOWATT_LIMIT)
    ratio = float(of.median())
    if not np.isfinite(ratio) or abs(ratio - 1.0) < _MAKE_UP:
        return []
    if 1 / _NOT_AMPERES < ratio < _NOT_AMPERES:
        return [
            f"{current}: {voltage} * {current} is {ratio:.4g} times {power} (median), where a dc port has 1 within "
            f"{_MAKE_UP:g}: one of the three is read elsewhere or wrongly, or the port carries ripple. Nothing is left "
            f"out; efficiency goes by {power}"
        ]
    frame[current] = np.nan
    thousand = {-3: "*1000", 3: "*0.001"}.get(round(float(np.log10(abs(ratio))))) if ratio else None
    known = (
        f"; in another unit, d2ea import --column {current}={current}{thousand} converts it"
        if thousand
        else ""
    )
    if thousand == "*0.001":
        known += f", unless it is {power} that is in kilowatts: {_in_factor(power, '1000')}"
    return [
        f"{current}: {voltage} * {current} is {ratio:.4g} times {power} (median), so it is left empty{known}"
    ]


def screen(frame: pd.DataFrame, raw: pd.DataFrame) -> tuple[RejectedRow, ...]:
    """Rows of ``frame`` (from :func:`numbers`) that cannot be, with what stood in ``raw``; in row order."""
    rejected: dict[int, RejectedRow] = {}

    def reject(rows: pd.Series, column: str, reason: str) -> None:
        for row in np.flatnonzero(rows):
            no_input = column == "P1_W" and "P1_W" not in raw
            there = "efficiency" if no_input and "efficiency" in raw else column
            value = raw[there].iloc[row] if there in raw else frame[there].iloc[row]
            reasoned = RejectedRow(row=int(row) + 1, column=there, value=str(value), reason=reason)
            rejected.setdefault(int(row), reasoned)

    # a row of units is no summary, though 1 may stand in it
    read = frame[["P1_W", "P2_W"]].notna().any(axis=1)
    for each in summary_rows(raw, NUMERIC_COLUMNS, TEXT_COLUMNS):
        reject(read & each.rows, each.column, each.reason)
    reject(~frame["kind"].isin(KINDS), "kind", f"unknown kind; allowed are {', '.join(KINDS)}")
    if "quality" in raw:
        said = raw["quality"].astype(object)
        bad = said.notna() & (said.astype(str).str.strip().str.lower() != GOOD)
        reject(bad, "quality", f"the analyzer's data are not good; allowed is {GOOD!r} or nothing")
    for check in CHECKS:
        rows = frame["kind"].isin(check.kinds) & check.impossible(frame)
        if rows.any():
            reject(rows, check.column, check.reason + check.more(frame[rows]))
    text = raw.astype(str)  # whatever stands in unknown columns can be compared as text
    reject(text.duplicated(keep="first"), str(raw.columns[0]), "repeats an earlier row in every column")
    if "time_s" in raw:
        readings = text[[column for column in text if column in (*NUMERIC_COLUMNS, "kind")]]
        again = readings.duplicated(keep="first") & frame["time_s"].notna()
        reject(again, "time_s", "repeats an earlier row: every reading, and when it was taken")
    return tuple(rejected[row] for row in sorted(rejected))


def complete(frame: pd.DataFrame) -> pd.DataFrame:
    """Screened rows with ``P1_W`` and ``efficiency`` from each other; no efficiency where unloaded."""
    loaded = frame["kind"].isin(LOADED_KINDS)
    P1_W = frame["P1_W"].where(frame["P1_W"].notna() | ~loaded, frame["P2_W"] / frame["efficiency"])
    efficiency = frame["efficiency"].where(frame["efficiency"].notna(), frame["P2_W"] / P1_W).where(loaded)
    return frame.assign(P1_W=P1_W, efficiency=efficiency)
