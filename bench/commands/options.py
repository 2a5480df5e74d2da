"""Options that several verbs share."""

from typing import Annotated

import typer

Database = Annotated[
    str | None,
    typer.Option("--db", metavar="URL", help="campaign database (an SQLAlchemy URL); else D2EA_DB"),
]
