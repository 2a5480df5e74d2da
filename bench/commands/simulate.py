"""The verb simulate: a grid or a table of set points through the simulator."""

from pathlib import Path
from typing import Annotated

import numpy as np
import pandas as pd
import typer
from rich.markup import escape

from bench.commands.streams import out
from bench.errors import InputError, Problem
from bench.prediction import model_from
from bench.table_file import check_ending, write_table
from sim.parameters import Converter, Quantity
from sim.simulate import Points, grid_of, simulate

app = typer.Typer()

REQUIRED = ("D1", "D2", "P_set_W")
OPTIONAL = ("V1_V", "V2_V", "ambient_C")
ALLOWED = {
    "D1": (0.0, 1.0, "a number from 0 to 1"),
    "D2": (0.0, 1.0, "a number from 0 to 1"),
    "P_set_W": (-np.inf, np.inf, "a power in W"),
    "V1_V": (1e-9, np.inf, "a voltage above 0 V"),
    "V2_V": (1e-9, np.inf, "a voltage above 0 V"),
    "ambient_C": (-100.0, 200.0, "a temperature from -100 to 200 degC"),
}
MOST_PROBLEMS = 20  # of a table: more say nothing new


@app.command("simulate")
def simulate_(
    points_file: Annotated[
        Path | None, typer.Argument(metavar="[POINTS.csv]", help="a table with the columns D1, D2, P_set_W")
    ] = None,
    grid_shape: Annotated[
        str | None, typer.Option("--grid", metavar="25x25x20", help="counts of D1, D2 and power instead")
    ] = None,
    out_file: Annotated[Path, typer.Option("--out", metavar="FILE.csv|.parquet")] = Path("simulated.csv"),
    model_file: Annotated[
        Path | None, typer.Option("--model", metavar="MODEL.toml", help="else the baseline")
    ] = None,
) -> None:
    """Simulate a grid (a tenth of the rated power to all of it) or a table of set points."""
    check_ending(out_file)
    if (points_file is None) == (grid_shape is None):
        raise InputError.of("command line", "POINTS.csv or --grid", None, "exactly one of the two is needed")
    given = pd.DataFrame() if points_file is None else read_points(points_file)
    model = model_from(model_file)
    points = (
        parse_grid(grid_shape or "", model.converter)
        if points_file is None
        else _as_points(given, model.converter)
    )
    result = simulate(model, points)
    simulated = pd.DataFrame(result.columns())
    added = [name for name in given.columns if name not in simulated]
    write_table(pd.concat([given[added], simulated], axis="columns"), out_file)
    feasible = int(result.feasible.sum())
    out.print(escape(f"{len(simulated)} points, {feasible} feasible, written to {out_file}"))
    for reason, count in pd.Series(result.reason[~result.feasible]).value_counts().head(3).items():
        out.print(escape(f"  {count} × {reason}"))


def parse_grid(text: str, converter: Converter) -> Points:
    """``25x25x20`` as the points of a converter's grid."""
    parts = text.lower().split("x")
    if len(parts) != 3 or not all(part.isdigit() and int(part) > 0 for part in parts):
        raise InputError.of("command line", "--grid", text, "three counts above 0, such as 25x25x20")
    D1, D2, power = map(int, parts)
    return grid_of(converter, (D1, D2, power))


def read_points(path: Path) -> pd.DataFrame:
    """A table of set points; InputError names each missing column and bad cell."""
    try:
        table = pd.read_parquet(path) if path.suffix == ".parquet" else pd.read_csv(path)
    except (OSError, ValueError) as error:
        raise InputError.of(path, "file", None, f"cannot be read: {error}") from error
    missing = [name for name in REQUIRED if name not in table]
    if missing:
        found = ", ".join(map(str, table.columns)) or "none"
        allowed = f"column is missing; required are {', '.join(REQUIRED)}; found: {found}"
        raise InputError(
            [Problem(file=str(path), field=name, value=None, allowed=allowed) for name in missing]
        )
    problems: list[Problem] = []
    for name in (*REQUIRED, *(name for name in OPTIONAL if name in table)):
        low, high, said = ALLOWED[name]
        values = pd.to_numeric(table[name], errors="coerce")
        for row in np.flatnonzero(~(values.between(low, high) & np.isfinite(values))):
            value = table[name].iloc[row]
            problems.append(Problem(file=str(path), field=name, value=value, allowed=said, line=int(row) + 2))
        table[name] = values.astype(float)
    if problems:
        raise InputError(problems[:MOST_PROBLEMS])
    if table.empty:
        raise InputError.of(path, "file", None, "has no rows")
    return table


def _as_points(table: pd.DataFrame, converter: Converter) -> Points:
    conditions: dict[str, Quantity] = {"V1_V": converter.V1_V, "V2_V": converter.V2_V}
    conditions |= {name: table[name].to_numpy() for name in OPTIONAL if name in table}
    D1, D2, power_W = (table[name].to_numpy() for name in REQUIRED)
    return Points(D1=D1, D2=D2, power_W=power_W, **conditions)
