"""Options that several verbs share."""

import tempfile
from pathlib import Path
from typing import Annotated

import typer

from bench.errors import InputError

Database = Annotated[
    str | None,
    typer.Option("--db", metavar="URL", help="campaign database (an SQLAlchemy URL); else D2EA_DB"),
]

Folder = Annotated[Path, typer.Option("--models", metavar="DIR", help="where trained models are kept")]
SimModel = Annotated[
    Path | None, typer.Option("--sim-model", metavar="MODEL.toml", help="simulation model; else the baseline")
]
DEFAULT_FOLDER = Path("d2ea-data/models")


def check_folder(folder: Path, option: str) -> None:
    """Make a folder of results before the work for it begins; InputError where nothing can be written."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            pass
    except OSError as error:
        in_the_way = isinstance(error, FileExistsError | NotADirectoryError)
        why = "a file stands in the way" if in_the_way else error.strerror
        allowed = f"nothing can be written there ({why}); name a folder that you may write to"
        raise InputError.of("command line", option, str(folder), allowed) from error
