"""The verb simulate: a grid, a parameter space or a table of set points through the simulator."""

import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from rich.markup import escape
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from bench.commands.options import ModelFile, check_folder
from bench.commands.streams import err, out
from bench.errors import InputError
from bench.model_file import model_from
from bench.set_points import parse_space, read_points
from bench.sweep import CHUNK_ROWS, Rows, Sweep, TableRows, Watch, run_sweep
from bench.table_file import check_ending
from bench.wording import alike, counted
from bench.workers import LOCAL, Workers
from sim.converter_data import ideal_most_W
from sim.parameters import Converter

app = typer.Typer()

_LINE_EVERY_S = 10.0


@app.command("simulate")
def simulate_(
    points_file: Annotated[
        Path | None, typer.Argument(metavar="[POINTS.csv]", help="a table with the columns D1, D2, P_set_W")
    ] = None,
    grid_shape: Annotated[
        str | None, typer.Option("--grid", metavar="25x25x20", help="counts of D1, D2 and power instead")
    ] = None,
    vary: Annotated[
        list[str] | None,
        typer.Option(metavar="NAME=LOW:HIGH:COUNT", help="a further axis of the grid: V1_V, V2_V, voltage_ratio, "
                     "ambient_C, time_s or a value of the converter (inductor.inductance_H); may be "
                     "repeated"),
    ] = None,
    out_file: Annotated[
        Path, typer.Option("--out", metavar="FILE.csv|.parquet", help="where the simulated table goes")
    ] = Path("simulated.csv"),
    model_file: ModelFile = None,
    processes: Annotated[int, typer.Option(min=1, help="side by side: chunks, or the halves of a single one")] = 2,
    dask: Annotated[
        str | None,
        typer.Option(metavar="ADDRESS", help=f"a Dask scheduler instead, or '{LOCAL}' for a cluster on this machine"),
    ] = None,
    chunk: Annotated[int, typer.Option(metavar="ROWS", min=1, help="points of one chunk")] = CHUNK_ROWS,
) -> None:  # fmt: skip
    """Simulate a grid (a tenth of the rated power to all of it), a parameter space, or a table of set points.

    What was finished when it was stopped is kept beside --out, and the same command goes on from there.
    """
    check_ending(out_file)
    check_folder(out_file.parent, "--out")
    if (points_file is None) == (grid_shape is None):
        raise InputError.of("command line", "POINTS.csv or --grid", None, "exactly one of the two is needed")
    if points_file is not None and vary:
        raise InputError.of(
            "command line", "--vary", None, "belongs to --grid; a table brings its own columns"
        )
    model = model_from(model_file)
    inputs: Rows
    passed_on: tuple[str, ...] = ()
    if points_file is None:
        inputs = parse_space(grid_shape or "", vary or (), model.converter)
    else:
        table, passed_on = read_points(points_file, model.converter)
        inputs = TableRows(table=table)
        if passed_on:
            others = ", ".join(passed_on)
            err.print(escape(f"{points_file}: no inputs, kept and ignored: {others}"))
    sweep = Sweep(model=model, inputs=inputs, out=out_file, chunk_rows=chunk, passed_on=passed_on)
    with _watching(len(sweep)) as watch:
        swept = run_sweep(sweep, Workers(processes=processes, dask=dask), watch)
    resumed = f", {swept.resumed} of {len(sweep)} chunks were there" if swept.resumed else ""
    out.print(
        escape(f"{counted(swept.points, 'point')}, {swept.feasible} feasible{resumed}, written to {out_file}")
    )
    for reason, count in alike(swept.reasons).most_common():
        out.print(escape(f"  {count} × {reason}"))
    if not swept.feasible:
        out.print(escape(what_to_check(model.converter)))


def what_to_check(converter: Converter) -> str:
    """What of a model comes first where none of its points can run, with the values that it has."""
    c, inductor, transformer = converter, converter.inductor, converter.transformer
    return (
        f"no point can run; check first of the model: frequency_Hz = {c.frequency_Hz:g}, inductor.inductance_H = "
        f"{np.mean(inductor.inductance_H):g}, V1_V = {c.V1_V:g}, V2_V = {c.V2_V:g}, transformer.turns_ratio = "
        f"{np.mean(transformer.turns_ratio):.4g}: without losses they carry {ideal_most_W(c):.0f} W at most, and "
        f"rated_power_W = {c.rated_power_W:g}"
    )


@contextmanager
def _watching(chunks: int) -> Iterator[Watch]:
    """A bar on a terminal, elsewhere a line now and then; nothing for a single chunk."""
    if chunks < 2:
        yield lambda _done, _total: None
        return
    if not err.is_terminal:
        yield _lines()
        return
    columns = (TextColumn("points"), BarColumn(bar_width=20), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, console=err) as bar:
        task = bar.add_task("", total=None)
        yield lambda done, total: bar.update(task, completed=done, total=total)


def _lines() -> Watch:
    start_s = last_s = time.perf_counter()

    def show(done: int, total: int) -> None:
        nonlocal last_s
        now_s = time.perf_counter()
        if now_s - last_s >= _LINE_EVERY_S or done == total:
            last_s = now_s
            err.print(f"{done} of {total} points after {now_s - start_s:.0f} s")

    return show
