"""Options that several verbs share."""

import math
import tempfile
from pathlib import Path
from typing import Annotated

import typer

from bench.errors import InputError, Problem
from bench.whole_file import NO_ROOM, why_not

Database = Annotated[
    str | None,
    typer.Option(
        "--db",
        metavar="URL",
        help="campaign database (an SQLAlchemy URL); else the key database of the bench's file, where one is given; "
        "else the variable D2EA_DB; else sqlite:///d2ea-data/d2ea.sqlite",
    ),
]

Measured = Annotated[
    str,
    typer.Argument(
        metavar="FILE.csv|CAMPAIGN_ID",
        help="a measurement table (.csv, .txt, .tsv, .dat or .parquet), or a campaign as listed by d2ea runs",
    ),
]
Folder = Annotated[Path, typer.Option("--models", metavar="DIR", help="where trained models are kept")]
SimModel = Annotated[
    Path | None, typer.Option("--sim-model", metavar="MODEL.toml", help="simulation model; else the baseline")
]
D1 = Annotated[float, typer.Option("--D1", help="duty ratio of the primary's pulse, 0 to 1")]
D2 = Annotated[float, typer.Option("--D2", help="inner phase shift of the secondary, 0 to 1")]
Power = Annotated[float, typer.Option("--P", metavar="W", help="output power")]
ModelFile = Annotated[
    Path | None, typer.Option("--model", metavar="MODEL.toml", help="simulation model; else the baseline")
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
        why = "a file stands in the way" if in_the_way else why_not(error)
        room = "make room, or " if error.errno in NO_ROOM else ""
        allowed = f"nothing can be written there ({why}); {room}name a folder that you may write to"
        raise InputError.of("command line", option, str(folder), allowed) from error


def point_problems(*, D1: float, D2: float, power_W: float) -> list[Problem]:
    """What is wrong with an operating point that was typed."""
    problems = [
        Problem(file="command line", field=field, value=value, allowed="a number from 0 to 1")
        for field, value in (("--D1", D1), ("--D2", D2))
        if not 0 <= value <= 1
    ]
    if not math.isfinite(power_W):
        problems.append(Problem(file="command line", field="--P", value=power_W, allowed="a power in W"))
    return problems
