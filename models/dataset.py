"""The measurement table: one row per accepted reading, read from CSV, Parquet or a frame, and checked.

``D1 D2 P2_W`` and ``P1_W`` or ``efficiency`` are required; rows of kind ``standby`` (supply on, PWM off) and
``no_load`` (PWM on, load off) need ``P1_W`` only. SI units; efficiency is a fraction. What cannot be is left
out and listed (:mod:`models.screening`); columns that are not known here are kept and ignored.
"""

import csv
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow

from models.csv_table import CsvError, CsvTable, read_csv
from models.other_names import OtherName, OtherNameError, as_option, converting, meant, renamed, units_below
from models.screening import (
    KNOWN_COLUMNS,
    LOADED_KINDS,
    NUMERIC_COLUMNS,
    RejectedRow,
    complete,
    kinds,
    numbers,
    screen,
)
from models.suggested_command import guessed, in_other_units, or_efficiency, suggested
from models.switching_frequency import stated_frequencies

SET_POINT = ("D1", "D2", "P2_W")
_TEXT = (".csv", ".txt", ".tsv", ".dat")  # endings of a table as text
_NO_FILE = "table"  # what a frame is called


class DatasetError(ValueError):
    """A measurement table that cannot be used at all: names the file, the column and what is allowed."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Measurements:
    """``frame``: the N accepted rows, always with ``kind``, ``P1_W`` and ``efficiency`` (NaN where nothing is
    loaded). ``rows`` (N,): which row of the table each of them was, from 1. ``rejected``: the rows left out, one
    reason each. ``notes``: what else a reader should know."""

    frame: pd.DataFrame
    rows: tuple[int, ...]
    rejected: tuple[RejectedRow, ...]
    notes: tuple[str, ...]

    @property
    def virtual(self) -> bool | None:
        """Whether any row comes from a virtual lab; None where the table does not say."""
        return bool((self.frame["lab"] == "virtual").any()) if "lab" in self.frame else None

    def loaded(self) -> pd.DataFrame:
        """The rows that carry power: kinds load and reference."""
        return self.frame[self.frame["kind"].isin(LOADED_KINDS)].reset_index(drop=True)


def load_measurements(source: Path | pd.DataFrame, names: Sequence[OtherName] = ()) -> Measurements:
    """Read and check a measurement table; ``names`` tells which columns it has under other names or in other units.

    Raises
    ------
    DatasetError
        The file cannot be read, a required column is missing, or no row can be used.
    """
    name = _NO_FILE if isinstance(source, pd.DataFrame) else str(source)
    read = _whole(source) if isinstance(source, pd.DataFrame) else _read(source, names)
    raw = read.frame
    try:
        raw = renamed(raw, names)
    except OtherNameError as error:
        raise DatasetError(f"{name}: {error}") from error
    _check_columns(read, raw, name, names)
    frame, notes = numbers(raw)
    rejected = tuple(
        replace(
            row,
            reason=converting(row.reason, names),
            line=read.lines[row.row - 1] if read.lines else None,
        )
        for row in screen(frame, raw)
    )
    kept = np.ones(len(frame), dtype=bool)
    kept[[row.row - 1 for row in rejected]] = False
    if not kept.any():
        raise DatasetError(f"{name}: {_why_none(rejected)}")
    return Measurements(
        frame=complete(frame[kept].reset_index(drop=True)),
        rows=tuple(int(place) + 1 for place in np.flatnonzero(kept)),
        rejected=rejected,
        notes=(
            *read.notes,
            *_unknown(frame, raw),
            *_units(raw, names),
            *(converting(note, names) for note in notes),
        ),
    )


def _why_none(rejected: Sequence[RejectedRow]) -> str:
    """Why no row can be used: the reason of most of them, as its first row has it, and how many that are."""
    if not rejected:
        return "has a header and no rows"
    counts = Counter((row.column, row.reason) for row in rejected)
    most, count = counts.most_common(1)[0]
    first = next(row for row in rejected if (row.column, row.reason) == most)
    others = len(rejected) - count
    alike = f", and so for {count} rows" if count > 1 else ""
    beside = f"; {others} for other reasons" if others else ""
    return f"none of {len(rejected)} rows can be used; {first}{alike}{beside}"


def _unknown(frame: pd.DataFrame, raw: pd.DataFrame) -> tuple[str, ...]:
    """That columns are not known, and which of those known but not in the table some of them seem to be."""
    stated = {each.column for each in stated_frequencies(frame, range(1, len(frame) + 1)) if each.sure}
    unknown = [str(column) for column in frame.columns if column not in (*KNOWN_COLUMNS, *stated)]
    if not unknown:
        return ()
    near = meant((), [column for column in KNOWN_COLUMNS if column not in raw], unknown)
    units = units_below(raw)
    options = " ".join(as_option(ours, theirs, units.get(theirs)) for ours, theirs in near.items())
    asked = f"; d2ea import {options} would take what seems to be known under another name" if near else ""
    return (f"unknown columns, kept and ignored: {', '.join(unknown)}{asked}",)


def _units(raw: pd.DataFrame, names: Sequence[OtherName]) -> tuple[str, ...]:
    """That a row below the header says other units than ours, and what converts them."""
    options = in_other_units(raw, names)
    return (
        (f"a row of units has others than ours; d2ea import {' '.join(options)} converts",) if options else ()
    )


def _whole(frame: pd.DataFrame) -> CsvTable:
    """A frame that was no text: its rows stand on no lines, and an index with a name is a column like any other."""
    return CsvTable(frame=frame.reset_index(drop=frame.index.name is None), lines=(), notes=())


def _read(path: Path, names: Sequence[OtherName]) -> CsvTable:
    numeric = {*NUMERIC_COLUMNS, *(name.theirs for name in names)}
    readers: dict[str, Callable[[Path], CsvTable]] = {
        **dict.fromkeys(_TEXT, lambda file: read_csv(file, numeric)),
        ".parquet": lambda file: _whole(pd.read_parquet(file)),
    }
    suffix = path.suffix.lower()
    if suffix not in readers:
        raise DatasetError(f"{path}: the name ends in {path.suffix!r}; allowed are {', '.join(readers)}")
    if not path.is_file():
        raise DatasetError(f"{path}: no such file")
    try:
        return readers[suffix](path)
    except CsvError as error:
        raise DatasetError(f"{path}: {error}") from error
    except (ValueError, OSError, csv.Error, pyarrow.ArrowException) as error:
        said = " ".join(str(error).split())[:200]
        raise DatasetError(f"{path}: cannot be read as {suffix[1:]}: {said}") from error


def _check_columns(read: CsvTable, raw: pd.DataFrame, name: str, names: Sequence[OtherName]) -> None:
    """Raise DatasetError with every column that is missing or there twice, and the nearest name present.

    Beside the options that were given it says those that are needed still, as they are to be typed.
    """
    there = [str(column) for column in raw.columns]
    if not there:
        raise DatasetError(f"{name}: is empty")
    if twice := sorted({column for column in there if there.count(column) > 1}):
        raise DatasetError(
            f"{name}: column {twice[0]!r} is there {there.count(twice[0])} times; once is allowed"
        )
    missing = [column for column in SET_POINT if column not in there]
    if "kind" in there and len(raw) and not kinds(raw["kind"]).isin(LOADED_KINDS).any():
        missing = []  # standby and no-load alone
    if "P1_W" not in there and "efficiency" not in there:
        missing.append("P1_W")
    if not missing:
        return
    near = guessed(missing, there)
    said = "; ".join(
        f"required column {'P1_W or efficiency' if column == 'P1_W' else column} is missing"
        + (f" (is {theirs!r} meant?)" if (theirs := or_efficiency(column, near)) else "")
        for column in missing
    )
    required = f"required are D1, D2, P2_W and P1_W or efficiency; there are: {', '.join(there)}"
    if len(there) > 1:
        required += suggested(None if name == _NO_FILE else name, raw, names, missing, near)
    raise DatasetError("; ".join([f"{name}: {said}", *read.notes, required]))
