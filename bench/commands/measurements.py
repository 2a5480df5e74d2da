"""Measurement tables as commands read them: checked, with what is not used said on the way."""

from collections.abc import Sequence
from pathlib import Path

from rich.markup import escape

from bench.commands.streams import err
from bench.errors import InputError
from bench.wording import counted
from models.dataset import DatasetError, Measurements, load_measurements
from models.other_names import OtherName

_REJECTED_SHOWN = 20  # rows that are left out, each in a line of its own


def read_measurements(file: Path, names: Sequence[OtherName] = ()) -> Measurements:
    """A measurement table, checked; says which rows and columns are not used."""
    try:
        measured = load_measurements(file, names)
    except DatasetError as error:
        raise InputError.of(file, "measurement table", None, str(error).removeprefix(f"{file}: ")) from error
    for note in measured.notes:
        err.print(escape(f"{file}: {note}"))
    for row in measured.rejected[:_REJECTED_SHOWN]:
        err.print(escape(f"{file}: {row}"))
    if (more := len(measured.rejected) - _REJECTED_SHOWN) > 0:
        err.print(escape(f"{file}: and {counted(more, 'row')} more left out"))
    return measured
