"""The measurement table: one row per accepted reading, read from CSV, Parquet or a frame, and checked.

``D1 D2 P2_W`` and ``P1_W`` or ``efficiency`` are required; rows of kind ``standby`` (supply on, PWM off) and
``no_load`` (PWM on, load off) need ``P1_W`` only. SI units; efficiency is a fraction. What cannot be is left
out and listed (:mod:`models.screening`); columns that are not known here are kept and ignored.
"""

import csv
import difflib
import io
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow

from models.screening import (
    KNOWN_COLUMNS,
    LOADED_KINDS,
    NUMERIC_COLUMNS,
    RejectedRow,
    complete,
    numbers,
    screen,
)

SET_POINT = ("D1", "D2", "P2_W")


class DatasetError(ValueError):
    """A measurement table that cannot be used at all: names the file, the column and what is allowed."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Measurements:
    """``frame``: the accepted rows, always with ``kind``, ``P1_W`` and ``efficiency`` (NaN where nothing is
    loaded). ``rejected``: the rows left out, one reason each. ``notes``: what else a reader should know."""

    frame: pd.DataFrame
    rejected: tuple[RejectedRow, ...]
    notes: tuple[str, ...]

    def loaded(self) -> pd.DataFrame:
        """The rows that carry power: kinds load and reference."""
        return self.frame[self.frame["kind"].isin(LOADED_KINDS)].reset_index(drop=True)


def load_measurements(source: Path | pd.DataFrame) -> Measurements:
    """Read and check a measurement table.

    Raises
    ------
    DatasetError
        The file cannot be read, a required column is missing, or no row can be used.
    """
    name = "table" if isinstance(source, pd.DataFrame) else str(source)
    raw = source.reset_index(drop=True) if isinstance(source, pd.DataFrame) else _read(source)
    _check_columns(raw, name)
    frame, notes = numbers(raw)
    rejected = screen(frame, raw)
    kept = np.ones(len(frame), dtype=bool)
    kept[[row.row - 1 for row in rejected]] = False
    if not kept.any():
        first = rejected[0] if rejected else None
        why = f"; row {first.row}, {first.column} = {first.value}: {first.reason}" if first else ""
        raise DatasetError(f"{name}: none of {len(frame)} rows can be used{why}")
    return Measurements(
        frame=complete(frame[kept].reset_index(drop=True)),
        rejected=rejected,
        notes=(*_unknown(frame), *notes),
    )


def _unknown(frame: pd.DataFrame) -> tuple[str, ...]:
    unknown = [str(column) for column in frame.columns if column not in KNOWN_COLUMNS]
    return (f"unknown columns, kept and ignored: {', '.join(unknown)}",) if unknown else ()


def _read(path: Path) -> pd.DataFrame:
    readers: dict[str, Callable[[Path], pd.DataFrame]] = {".csv": _read_csv, ".parquet": pd.read_parquet}
    suffix = path.suffix.lower()
    if suffix not in readers:
        raise DatasetError(f"{path}: the name ends in {path.suffix!r}; allowed are .csv and .parquet")
    if not path.is_file():
        raise DatasetError(f"{path}: no such file")
    try:
        return readers[suffix](path)
    except DatasetError:
        raise
    except (ValueError, OSError, csv.Error, pyarrow.ArrowException) as error:
        said = " ".join(str(error).split())[:200]
        raise DatasetError(f"{path}: cannot be read as {suffix[1:]}: {said}") from error


def _read_csv(path: Path) -> pd.DataFrame:
    """All values as text, so that what does not parse can be shown; an empty value is missing."""
    text = path.read_text(encoding="utf-8-sig")
    lines = csv.reader(io.StringIO(text, newline=""), skipinitialspace=True)
    header = [name.strip() for name in next(lines, [])]
    if len(header) == 1 and ";" in header[0]:
        raise DatasetError(f"{path}: columns are separated by ';'; allowed is ',' with '.' as decimal sign")
    rows = []
    for values in lines:
        if len(values) > len(header):
            raise DatasetError(
                f"{path}: line {lines.line_num} has {len(values)} values for {len(header)} columns; "
                "columns are separated by ',' and the decimal sign is '.'"
            )
        if values:
            rows.append([value.strip() or None for value in values] + [None] * (len(header) - len(values)))
    frame = pd.DataFrame(rows, columns=header, dtype=object)
    for column in header:
        if column not in NUMERIC_COLUMNS and header.count(column) == 1:
            frame[column] = _inferred(frame[column])
    return frame


def _inferred(column: pd.Series) -> pd.Series:
    """A column as numbers or truth values where all of it is that, else as it is."""
    if column.isin(["True", "False", "true", "false"]).all():
        return column.str.lower() == "true"
    numbers = pd.to_numeric(column, errors="coerce")
    return numbers if numbers.notna().equals(column.notna()) else column


def _check_columns(raw: pd.DataFrame, name: str) -> None:
    """Raise DatasetError with every column that is missing or there twice, and the nearest name present."""
    there = [str(column) for column in raw.columns]
    if twice := sorted({column for column in there if there.count(column) > 1}):
        raise DatasetError(
            f"{name}: column {twice[0]!r} is there {there.count(twice[0])} times; once is allowed"
        )
    missing = [column for column in SET_POINT if column not in there]
    if (
        "kind" in there
        and len(raw)
        and not raw["kind"].isin(LOADED_KINDS).any()
        and raw["kind"].notna().all()
    ):
        missing = []  # standby and no-load alone
    if "P1_W" not in there and "efficiency" not in there:
        missing.append("P1_W")
    if not missing:
        return
    said = []
    for column in missing:
        near = difflib.get_close_matches(column, there, n=1, cutoff=0.5)
        wanted = "P1_W or efficiency" if column == "P1_W" else column
        said.append(f"required column {wanted} is missing" + (f" (is {near[0]!r} meant?)" if near else ""))
    required = "required are D1, D2, P2_W and P1_W or efficiency"
    raise DatasetError(f"{name}: {'; '.join(said)}; {required}; there are: {', '.join(there) or 'none'}")
