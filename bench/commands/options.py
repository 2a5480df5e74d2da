"""Options that several verbs share."""

from pathlib import Path
from typing import Annotated

import typer

Database = Annotated[
    str | None,
    typer.Option("--db", metavar="URL", help="campaign database (an SQLAlchemy URL); else D2EA_DB"),
]

Folder = Annotated[Path, typer.Option("--models", metavar="DIR", help="where trained models are kept")]
SimModel = Annotated[
    Path | None, typer.Option("--sim-model", metavar="MODEL.toml", help="simulation model; else the baseline")
]
DEFAULT_FOLDER = Path("d2ea-data/models")
