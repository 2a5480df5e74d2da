"""A CSV file as a frame, whoever wrote it: separated by comma, semicolon or tab, decimal sign as the file has it.

Numbers stay text, so that what does not parse can be shown as it stands there; an empty value is missing.
"""

import csv
import io
import re
from collections.abc import Collection, Iterable
from pathlib import Path

import pandas as pd

SEPARATORS = ",;\t"
_DECIMAL_COMMA = re.compile(r"[+-]?\d*,\d+([eE][+-]?\d+)?")


class CsvError(ValueError):
    """A file that is no table: the line and what is wrong with it."""


def read_csv(path: Path, numeric: Collection[str]) -> pd.DataFrame:
    """Read a table; columns named in ``numeric`` stay text, others become what all their values are.

    The separator is the one that cuts the header into most columns, the comma of equals. Where it is not the comma, a
    comma in a numeric column is the decimal sign, unless a point is used as well.

    Raises
    ------
    CsvError
        A line has more values than the header has columns.
    """
    text = _decoded(path)
    separator = _separator(text)
    lines = csv.reader(io.StringIO(text, newline=""), delimiter=separator, skipinitialspace=True)
    header = [name.strip() for name in next(lines, [])]
    rows = []
    for values in lines:
        if len(values) > len(header):
            raise CsvError(
                f"line {lines.line_num} has {len(values)} values for {len(header)} columns; columns are separated by "
                "',' with '.' as decimal sign, or by ';' or tab with either decimal sign"
            )
        if values:
            rows.append([value.strip() or None for value in values] + [None] * (len(header) - len(values)))
    frame = pd.DataFrame(rows, columns=header, dtype=object)
    once = [column for column in header if header.count(column) == 1]
    numbers = [column for column in once if column in numeric]
    if separator != "," and not any("." in value for column in numbers for value in frame[column].dropna()):
        for column in numbers:
            frame[column] = _with_point(frame[column])
    for column in once:
        if column not in numeric:
            frame[column] = _inferred(frame[column])
    return frame


def _decoded(path: Path) -> str:
    """Text of a file in UTF-8, else in the code page that spreadsheets of Western Europe write."""
    content = path.read_bytes()
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError:
        return content.decode("cp1252")


def _separator(text: str) -> str:
    first = text.split("\n", 1)[0]
    return max(SEPARATORS, key=lambda each: len(next(csv.reader([first], delimiter=each), [])))


def _with_point(column: Iterable[str | None]) -> list[str | None]:
    return [v.replace(",", ".") if v is not None and _DECIMAL_COMMA.fullmatch(v) else v for v in column]


def _inferred(column: pd.Series) -> pd.Series:
    """A column as numbers or truth values where all of it is that, else as it is."""
    if column.isin(["True", "False", "true", "false"]).all():
        return column.str.lower() == "true"
    numbers = pd.to_numeric(column, errors="coerce")
    return numbers if numbers.notna().equals(column.notna()) else column
