"""The verb ``experiment``: list the experiments, run one or all, print and write what came out."""

import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated

import typer
from rich import box
from rich.markup import escape
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn
from rich.table import Table as RichTable

from bench.commands.streams import err, out, stamp
from bench.errors import InputError
from bench.wording import duration
from experiments.harness.page import Page
from experiments.harness.plain import is_number, plain_lines
from experiments.harness.registry import Entry, UnknownExperiment, entry, names
from experiments.harness.result import Result, Table, shown
from experiments.harness.settings import Settings, Step, Watch

QUICK = 0.1
DEFAULT_FOLDER = Path("experiments-out")
_LINE_EVERY_S = 10.0
_COLOURS = {"met": "green", "found": "green", "missed": "bold red", "false name": "bold red"}

app = typer.Typer(
    invoke_without_command=True,
    subcommand_metavar="",
    # the name is an argument of the verb itself, and options may follow it
    context_settings={"allow_interspersed_args": True},
)


@app.callback()
def experiment(
    name: Annotated[
        str, typer.Argument(metavar="NAME|all|list", help="an experiment, all of them, or a list")
    ],
    quick: Annotated[bool, typer.Option("--quick", help=f"the same as --scale {QUICK}")] = False,
    scale: Annotated[float | None, typer.Option(metavar="SHARE", help="of all trials and points")] = None,
    out_folder: Annotated[Path, typer.Option("--out", metavar="DIR")] = DEFAULT_FOLDER,
    processes: Annotated[int, typer.Option(min=1, help="trials side by side")] = 2,
    reference: Annotated[
        Path | None, typer.Option(metavar="FILE", help="other people's points, for simulator_benchmark")
    ] = None,
    only: Annotated[
        list[str] | None,
        typer.Option(metavar="PART", help="of an experiment that has parts; may be repeated"),
    ] = None,
) -> None:
    """Run an experiment: print its tables, and write DIR/NAME.json and DIR/NAME.html."""
    if name == "list":
        _list()
        return
    settings = Settings(
        out=out_folder,
        scale=_scale(quick, scale),
        processes=processes,
        reference=reference,
        only=tuple(only or ()),
    )
    for chosen in names() if name == "all" else [name]:
        _run(_entry(chosen), settings)


def _list() -> None:
    rows = tuple((found.name, found.experiment.title) for found in map(entry, names()))
    _print_table(Table(title="Experiments", columns=("name", "title"), rows=rows))


def _entry(name: str) -> Entry:
    try:
        return entry(name)
    except UnknownExperiment as error:
        raise InputError.of("command line", "NAME", name, str(error)) from error


def _scale(quick: bool, scale: float | None) -> float:
    if quick and scale is not None:
        raise InputError.of("command line", "--quick", None, f"is --scale {QUICK}: give one of the two")
    chosen = QUICK if quick else 1.0 if scale is None else scale
    if not 0 < chosen <= 1:
        raise InputError.of("command line", "--scale", chosen, "a share above 0 and at most 1")
    return chosen


def _run(found: Entry, settings: Settings) -> None:
    start_s = time.perf_counter()
    _check_parts(found, settings.only)
    with _watching(found.name) as watch:
        result = found.experiment.run(replace(settings, watch=watch))
    seconds = time.perf_counter() - start_s
    created = datetime.now(UTC).isoformat(timespec="seconds")
    page = Page(entry=found, result=result, scale=settings.scale, seconds=seconds, created=created)
    written = page.write(settings.out)
    _print_result(found.experiment.title, result)
    out.print(escape(f"{duration(seconds)}; written to {' and '.join(map(str, written))}"))


def _check_parts(found: Entry, only: tuple[str, ...]) -> None:
    parts = found.experiment.parts
    if wrong := [name for name in only if name not in parts]:
        allowed = f"one of {', '.join(parts)}" if parts else f"{found.name} has no parts"
        raise InputError.of("command line", "--only", wrong[0], allowed)


def _print_result(title: str, result: Result) -> None:
    stamp(result.virtual)
    out.print(f"[bold]{escape(title)}[/]")
    for table in (*result.tables, *([result.goal_table()] if result.goals else [])):
        out.print()
        _print_table(table)
    out.print()
    for note in result.notes:
        out.print(escape(note))


def _print_table(table: Table) -> None:
    if not out.is_terminal:
        for line in plain_lines(table):
            out.print(line, markup=False)
        return
    drawn = RichTable(title=table.title, title_justify="left", box=box.SIMPLE_HEAD, pad_edge=False)
    for k, column in enumerate(table.columns):
        right = all(is_number(row[k]) for row in table.rows)
        drawn.add_column(escape(column), justify="right" if right else "left", overflow="fold")
    for row in table.rows:
        texts = [escape(shown(cell)) for cell in row]
        drawn.add_row(*(f"[{_COLOURS[t]}]{t}[/]" if t in _COLOURS else t for t in texts))
    out.print(drawn)


@contextmanager
def _watching(name: str) -> Iterator[Watch]:
    """A bar on a terminal; elsewhere a line now and then."""
    if not err.is_terminal:
        yield _lines(name)
        return
    columns = (
        TextColumn(name),
        BarColumn(bar_width=20),
        MofNCompleteColumn(),
        TextColumn("{task.description}"),
    )
    with Progress(*columns, console=err) as bar:
        task = bar.add_task("", total=None)

        def show(step: Step) -> None:
            bar.update(task, completed=step.done, total=step.total, description=escape(_said(step)))

        yield show


def _lines(name: str) -> Watch:
    last_s = -_LINE_EVERY_S

    def show(step: Step) -> None:
        nonlocal last_s
        if time.perf_counter() - last_s >= _LINE_EVERY_S or step.done == step.total:
            last_s = time.perf_counter()
            err.print(escape(f"{name} {step.done}/{step.total} {_said(step)}"))

    return show


def _said(step: Step) -> str:
    left = "" if step.left_s is None or step.done == step.total else f", {duration(step.left_s)} left"
    return f"{step.said}{left}"
