"""Set points as an operator gives them: a grid with axes beside it, or a table; every problem named at once."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from bench.errors import InputError, Problem
from sim.parameters import Converter, ParameterError
from sim.space import CONDITIONS, SET_POINT, Axis, Space, check_inputs, input_names

if TYPE_CHECKING:
    import pandas as pd

ALLOWED = {
    "D1": (0.0, 1.0, "a number from 0 to 1"),
    "D2": (0.0, 1.0, "a number from 0 to 1"),
    "P_set_W": (-np.inf, np.inf, "a power in W"),
    "V1_V": (1e-9, np.inf, "a voltage above 0 V"),
    "V2_V": (1e-9, np.inf, "a voltage above 0 V"),
    "voltage_ratio": (1e-9, np.inf, "n V2 / V1, above 0"),
    "ambient_C": (-100.0, 200.0, "a temperature from -100 to 200 degC"),
    "time_s": (0.0, np.inf, "seconds since the start, 0 or more"),
}
_ANY = (-np.inf, np.inf, "a number")
MOST_PROBLEMS = 20  # of a table: more say nothing new
OPTION = "command line"


def parse_space(grid: str, vary: Sequence[str], converter: Converter) -> Space:
    """``25x25x20`` over D1, D2 and power, and ``NAME=LOW:HIGH:COUNT`` for every further input, as one space."""
    D1, D2, power = _counts(grid)
    rated_W = converter.rated_power_W
    axes = [_axis(text) for text in vary]
    twice = sorted({a.name for a in axes if [b.name for b in axes].count(a.name) > 1})
    if twice:
        raise InputError.of(OPTION, "--vary", ", ".join(twice), "each input once")
    axes += [
        Axis(name="D1", values=np.linspace(0.0, 1.0, D1)),
        Axis(name="D2", values=np.linspace(0.0, 1.0, D2)),
        Axis(name="P_set_W", values=np.linspace(0.1 * rated_W, rated_W, power)),
    ]
    ends = {axis.name: np.array([axis.values.min(), axis.values.max()]) for axis in axes}
    _checked(converter, ends, OPTION, "--vary")
    return Space(axes=tuple(axes))


def _counts(text: str) -> tuple[int, int, int]:
    parts = text.lower().split("x")
    if len(parts) != 3 or not all(part.isdigit() and int(part) > 0 for part in parts):
        raise InputError.of(OPTION, "--grid", text, "three counts above 0, such as 25x25x20")
    D1, D2, power = map(int, parts)
    return D1, D2, power


def _axis(text: str) -> Axis:
    name, _, span = text.partition("=")
    form = "NAME=LOW:HIGH:COUNT, such as V2_V=120:160:5 or inductor.inductance_H=200e-6:260e-6:4"
    try:
        low, high, count = (
            kind(part) for kind, part in zip((float, float, int), span.split(":"), strict=True)
        )
    except ValueError as error:
        raise InputError.of(OPTION, "--vary", text, form) from error
    least, most, said = ALLOWED.get(name, _ANY)
    if count < 1 or not (
        least <= min(low, high) and max(low, high) <= most and np.isfinite([low, high]).all()
    ):
        raise InputError.of(OPTION, "--vary", text, f"{form}; {name} is {said}, COUNT at least 1")
    if name in SET_POINT:
        raise InputError.of(OPTION, "--vary", text, f"{name} belongs to --grid")
    return Axis(name=name, values=np.linspace(low, high, count))


def read_points(path: Path, converter: Converter) -> "tuple[pd.DataFrame, tuple[str, ...]]":
    """A table of set points, and those of its columns that are no inputs; InputError names every bad cell."""
    known = input_names(converter)
    table, lines = _table(path, known)
    missing = [name for name in SET_POINT if name not in table]
    if missing:
        found = ", ".join(map(str, table.columns)) or "none"
        allowed = f"column is missing; required are {', '.join(SET_POINT)}; found: {found}"
        raise InputError(
            [Problem(file=str(path), field=name, value=None, allowed=allowed) for name in missing]
        )
    if table.empty:
        raise InputError.of(path, "file", None, "has no rows")
    names = [name for name in map(str, table.columns) if name in known]
    problems = [problem for name in names for problem in _bad_cells(table, name, path, lines)]
    if problems:
        raise InputError(problems[:MOST_PROBLEMS])
    table = table.astype(dict.fromkeys(names, float))
    _checked(converter, {name: table[name].to_numpy() for name in names}, str(path), "columns")
    return table, tuple(str(name) for name in table.columns if name not in names)


def _table(path: Path, known: Sequence[str]) -> "tuple[pd.DataFrame, Sequence[int]]":
    """The rows of a file, and on which line each stands; InputError where it is no table."""
    import pandas as pd  # here: it takes as long to load as a grid takes to solve

    from models.csv_table import CsvError, read_csv

    try:
        if path.suffix == ".parquet":
            return pd.read_parquet(path), ()
        read = read_csv(path, known)
    except (CsvError, OSError, ValueError) as error:
        why = error.strerror if isinstance(error, OSError) and error.strerror else error
        raise InputError.of(path, "file", None, f"cannot be read: {why}") from error
    twice = read.frame.columns[read.frame.columns.duplicated()]
    if len(twice):
        raise InputError.of(path, str(twice[0]), None, "this column is there more than once")
    return read.frame, read.lines


def _bad_cells(table: "pd.DataFrame", name: str, path: Path, lines: Sequence[int]) -> list[Problem]:
    low, high, said = ALLOWED.get(name, _ANY)
    import pandas as pd

    values = pd.to_numeric(table[name], errors="coerce")
    rows = np.flatnonzero(~(values.between(low, high) & np.isfinite(values)))
    where = [lines[row] if lines else int(row) + 2 for row in rows[:MOST_PROBLEMS]]
    return [
        Problem(
            file=str(path),
            field=name,
            value=_told(values.iloc[row], table[name].iloc[row]),
            allowed=said,
            line=line,
        )
        for row, line in zip(rows, where, strict=False)
    ]


def _told(number: float, cell: object) -> object:
    """A cell as its number, and as it stands where it is none."""
    return float(number) if np.isfinite(number) else cell


def _checked(converter: Converter, columns: dict[str, NDArray[np.float64]], where: str, field: str) -> None:
    try:
        check_inputs(converter, columns)
    except ParameterError as error:
        others = f"inputs beside the set points are {', '.join(CONDITIONS)} and values of the converter by their path"
        raise InputError.of(where, field, None, f"{error}; {others}") from error
