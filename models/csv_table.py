"""A CSV file as a frame, whoever wrote it: separated by comma, semicolon or tab, decimal sign as the file has it.

Numbers stay text, so that what does not parse can be shown as it stands there; an empty value is missing.
"""

import csv
import io
import re
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import pandas as pd

from models.number_forms import AmbiguousNumberError, in_one_form

SEPARATORS = ",;\t"
_SEPARATED = (
    "columns are separated by ',' with '.' as decimal sign, or by ';' or tab with either decimal sign"
)
_COMMENT = ("#", "sep=")  # what some spreadsheets write ahead of the header is none of the table
_RUNS_ON = 5  # lines: no value of a measurement is so long
_WORKBOOK = b"PK\x03\x04"


class CsvError(ValueError):
    """A file that is no table: the line and what is wrong with it."""


@dataclass(frozen=True, slots=True, kw_only=True)
class CsvTable:
    """``frame`` of the file's rows, ``lines`` where each stands in it, from 1, and what a reader should know."""

    frame: pd.DataFrame
    lines: tuple[int, ...]
    notes: tuple[str, ...]


def read_csv(path: Path, numeric: Collection[str]) -> CsvTable:
    """Read a table; columns named in ``numeric`` stay text, others become what all their values are.

    Empty lines, and lines before the header that begin with ``#`` or ``sep=``, are no rows. The separator is the one
    that cuts the header into most columns, the comma of equals. Numbers may have either decimal sign, and their
    thousands apart (:mod:`models.number_forms`).

    Raises
    ------
    CsvError
        The file is no text, a quotation mark is not closed, a line has more values than the header has columns, or a
        number may be two.
    """
    text = _decoded(path)
    begin, header_line = _beginning(text)
    separator = _separator(header_line)
    lines = csv.reader(io.StringIO(text[begin:], newline=""), delimiter=separator, skipinitialspace=True)
    skipped = text.count("\n", 0, begin)
    header = [name.strip() for name in next(lines, [])]
    rows, places, short = [], [], []
    for place, values in _filled(lines, header, skipped):
        if len(values) < len(header):
            short.append(f"line {place}: {len(values)} of {len(header)}")
        rows.append([value or None for value in values] + [None] * (len(header) - len(values)))
        places.append(place)
    frame = _named(pd.DataFrame(rows, columns=header, dtype=object))
    _convert(frame, numeric, places)
    notes = []
    if short:
        count = f"{len(short)} of {len(rows)} lines have" if len(short) > 1 else "a line has"
        notes.append(
            f"{count} fewer values than the header has columns ({short[0]}); what is missing is empty"
        )
    if sum(map(bool, header)) == 1:
        notes.append(f"the header, line {skipped + 1}, has a single name; {_SEPARATED}")
    return CsvTable(frame=frame, lines=tuple(places), notes=tuple(notes))


def _decoded(path: Path) -> str:
    """Text of a file in UTF-8 or UTF-16, else in the code page that spreadsheets of Western Europe write."""
    content = path.read_bytes()
    if content.startswith(_WORKBOOK):
        raise CsvError("this is a workbook or an archive, not text; save the sheet as CSV")
    wide = content.startswith((b"\xff\xfe", b"\xfe\xff"))
    text = ""
    for encoding in ("utf-16",) if wide else ("utf-8-sig", "cp1252"):
        try:
            text = content.decode(encoding)
            break
        except UnicodeDecodeError as error:
            where = error.start
    else:
        raise CsvError(f"this is not text: byte {content[where]:#04x} at {where}; save the table as CSV")
    if "\0" in text:
        raise CsvError(
            f"this is not text: a zero byte stands at {text.index(chr(0))}. Is it UTF-16 without a byte order mark? "
            "Save the table as CSV in UTF-8"
        )
    return text.replace("\r\n", "\n").replace("\r", "\n")


def _beginning(text: str) -> tuple[int, str]:
    """Where the header begins, and its line: the first one that is neither empty nor a comment."""
    at = 0
    for line in text.splitlines(keepends=True):
        if line.strip() and not line.startswith(_COMMENT):
            return at, line
        at += len(line)
    return len(text), ""


def _separator(header: str) -> str:
    return max(SEPARATORS, key=lambda each: len(next(csv.reader([header], delimiter=each), [])))


def _filled(lines: Iterator[list[str]], header: list[str], skipped: int) -> Iterator[tuple[int, list[str]]]:
    """Lines that hold anything, where they stand, without what is empty beyond the header's last column."""
    reader, place = iter(lines), skipped + 1
    for values in reader:
        begins, place = place + 1, skipped + reader.line_num  # type: ignore[attr-defined]
        stripped = [value.strip() for value in values]
        while len(stripped) > len(header) and not stripped[-1]:
            stripped.pop()
        if len(stripped) > len(header):
            raise CsvError(
                f"line {place} has {len(stripped)} values for {len(header)} columns, the header being line "
                f"{skipped + 1}{_perhaps_the_header(stripped, place)}; {_SEPARATED}"
            )
        if place - begins >= _RUNS_ON:
            raise CsvError(
                f"line {begins}: a quotation mark opens a value that runs on to line {place}; is it closed? Values are "
                "quoted as a whole, or not at all"
            )
        if any(stripped):
            yield place, stripped


def _perhaps_the_header(values: list[str], place: int) -> str:
    """What to do where the line without a number in it is the header, below what an instrument wrote of itself."""
    if any(re.fullmatch(r"[-+\d.,eE]+", value) for value in values):
        return ""
    return f". If line {place} is the header, delete the lines above it, or begin each of them with {_COMMENT[0]}"


def _named(frame: pd.DataFrame) -> pd.DataFrame:
    """Columns without a name: named by their place where they hold anything, else left out."""
    nameless = [place for place, name in enumerate(frame.columns) if not name]
    empty = [place for place in nameless if frame.iloc[:, place].isna().all()]
    names = [name or f"(column {place + 1})" for place, name in enumerate(frame.columns)]
    frame.columns = names
    return frame.iloc[:, [place for place in range(len(names)) if place not in empty]].copy()


def _convert(frame: pd.DataFrame, numeric: Collection[str], lines: Sequence[int]) -> None:
    """Make numbers what reads as such, in columns that are there once."""
    once = [column for column in frame.columns if list(frame.columns).count(column) == 1]
    try:
        read = in_one_form({column: frame[column] for column in once if column in numeric}, lines)
    except AmbiguousNumberError as error:
        raise CsvError(str(error)) from error
    for column in once:
        frame[column] = read[column] if column in read else _inferred(frame[column])


def _inferred(column: pd.Series) -> pd.Series:
    """A column as numbers or truth values where all of it is that, else as it is."""
    if column.isin(["True", "False", "true", "false"]).all():
        return column.str.lower() == "true"
    numbers = pd.to_numeric(column, errors="coerce")
    return numbers if numbers.notna().equals(column.notna()) else column
