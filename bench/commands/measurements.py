"""Measurement tables as commands read them: checked, with what is not used said on the way."""

from collections.abc import Sequence
from pathlib import Path

from rich.markup import escape

from bench.commands.streams import err
from bench.errors import InputError
from bench.wording import counted
from models.dataset import DatasetError, Measurements, load_measurements
from models.other_names import OtherName
from models.screening import RejectedRow

_LISTED = 20  # rows that are left out for one reason
_REASONS = 20


def read_measurements(file: Path, names: Sequence[OtherName] = ()) -> Measurements:
    """A measurement table, checked; says which rows and columns are not used."""
    try:
        measured = load_measurements(file, names)
    except DatasetError as error:
        raise InputError.of(file, "measurement table", None, str(error).removeprefix(f"{file}: ")) from error
    for note in measured.notes:
        err.print(escape(f"{file}: {note}"))
    for said in left_out_lines(measured):
        err.print(escape(f"{file}: {said}"))
    return measured


def left_out_lines(measured: Measurements) -> list[str]:
    """The rows that are left out, of each reason the first and which others; and whether they are most of the table."""
    alike: dict[tuple[str, str], list[RejectedRow]] = {}
    for row in measured.rejected:
        alike.setdefault((row.column, row.reason), []).append(row)
    lines = []
    for first, *others in list(alike.values())[:_REASONS]:
        lines.append(str(first))
        if others:
            listed = ", ".join(str(row.row) for row in others[:_LISTED]) + ", …" * (len(others) > _LISTED)
            lines.append(f"{counted(len(others), 'row')} more for that reason: {listed}")
    if rest := sum(len(rows) for rows in list(alike.values())[_REASONS:]):
        lines.append(f"and {counted(rest, 'row')} more left out")
    left, whole = len(measured.rejected), len(measured.rejected) + len(measured.frame)
    if left > whole / 2:
        lines.append(
            f"{left} of {whole} rows are left out, most of the table: is every column what it is called?"
        )
    return lines
