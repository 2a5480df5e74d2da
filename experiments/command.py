"""The verb ``experiment``: list the experiments, run one or all, print and write what came out."""

import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated

import typer
from rich import box
from rich.markup import escape
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn
from rich.table import Table as RichTable

import bench
import drivers
import experiments
import models
import sim
from bench.commands.options import check_folder
from bench.commands.streams import err, out, stamp
from bench.errors import InputError
from bench.wording import duration
from bench.workers import LOCAL
from experiments.harness.journal import code_hash
from experiments.harness.overview import Overview
from experiments.harness.page import Page
from experiments.harness.plain import is_number, plain_lines
from experiments.harness.registry import Entry, UnknownExperiment, entry, names
from experiments.harness.result import Table, shown
from experiments.harness.settings import Settings, Step, Watch

QUICK = 0.1
_ON_DASK = "trials that a cluster may run: blind_trials, blind_tuning, first_trials"
_WITH_REFERENCE = "an experiment that compares with other people's points: simulator_benchmark"
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
    out_folder: Annotated[
        Path, typer.Option("--out", metavar="DIR", help="where the results go")
    ] = DEFAULT_FOLDER,
    processes: Annotated[int, typer.Option(min=1, help="trials side by side")] = 2,
    dask: Annotated[
        str | None,
        typer.Option(
            metavar="ADDRESS",
            help=f"trials on a Dask scheduler instead, or '{LOCAL}' for a cluster on this machine",
        ),
    ] = None,
    again: Annotated[bool, typer.Option("--again", help="with all: also what DIR already holds")] = False,
    reference: Annotated[
        Path | None, typer.Option(metavar="FILE", help="other people's points, for simulator_benchmark")
    ] = None,
    only: Annotated[
        list[str] | None,
        typer.Option(metavar="PART", help="of an experiment that has parts; may be repeated"),
    ] = None,
) -> None:
    """Run an experiment: print its tables, and write DIR/NAME.json and DIR/NAME.html, pictures beside them.

    With all, the paper's tables and figures are run, without the trials and benchmarks that stand apart. It goes on
    where an earlier run of the same code and scale stopped, and writes one page, DIR/all.html, and every row in
    DIR/all.json.
    """
    if name == "list":
        _list()
        return
    check_folder(out_folder, "--out")
    settings = Settings(
        out=out_folder,
        scale=_scale(quick, scale),
        processes=processes,
        dask=dask,
        reference=reference,
        only=tuple(only or ()),
    )
    task = _Task(settings=settings, code=_code())
    if name == "all":
        _refuse(only is not None, "--only", "one experiment that has parts, not all")
        _refuse(reference is not None, "--reference", _WITH_REFERENCE)
        _refuse(dask is not None, "--dask", _ON_DASK)
        _all(task, again)
    else:
        found = _entry(name)
        _refuse(again, "--again", "all: a single experiment is always run again")
        _refuse(reference is not None and not found.experiment.reference, "--reference", _WITH_REFERENCE)
        _refuse(dask is not None and not found.experiment.spread, "--dask", _ON_DASK)
        _check_parts(found, settings.only)
        _print_page(task.run(found), out_folder)


def _list() -> None:
    rows = tuple(
        (found.name, found.experiment.title, "no" if found.experiment.apart else "yes")
        for found in map(entry, names())
    )
    _print_table(Table(title="Experiments", columns=("name", "title", "in all"), rows=rows))


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


def _code() -> str:
    return code_hash(sim, drivers, models, bench, experiments)


def _now() -> str:
    return datetime.now(UTC).isoformat(timespec="seconds")


def _refuse(given: bool, option: str, allowed: str) -> None:
    """An option that would say nothing here."""
    if given:
        raise InputError.of("command line", option, None, f"is for {allowed}")


def _check_parts(found: Entry, only: tuple[str, ...]) -> None:
    parts = found.experiment.parts
    if wrong := [name for name in only if name not in parts]:
        allowed = f"one of {', '.join(parts)}" if parts else f"{found.name} has no parts"
        raise InputError.of("command line", "--only", wrong[0], allowed)


@dataclass(frozen=True, slots=True, kw_only=True)
class _Task:
    """How everything of one command is run."""

    settings: Settings
    code: str

    def run(self, found: Entry) -> Page:
        """Run and write one experiment."""
        start_s = time.perf_counter()
        with _watching(found.name) as watch:
            result = found.experiment.run(replace(self.settings, watch=watch))
        seconds = time.perf_counter() - start_s
        scale = self.settings.scale
        page = Page(entry=found, result=result, scale=scale, seconds=seconds, created=_now(), code=self.code)
        page.write(self.settings.out)
        return page

    def kept(self, found: Entry) -> Page | None:
        """What an earlier run of the same code and scale left."""
        page = Page.read(self.settings.out, found)
        same = page is not None and (page.code, page.scale) == (self.code, self.settings.scale)
        return page if same else None


def _all(task: _Task, again: bool) -> None:
    entries = [found for found in map(_entry, names()) if not found.experiment.apart]
    pages = []
    for number, found in enumerate(entries, start=1):
        page = None if again else task.kept(found)
        err.print(escape(f"{number}/{len(entries)} {found.name}{': kept from before' if page else ''}"))
        pages.append(page or task.run(found))
        _print_judged(pages[-1])
    overview = Overview(pages=tuple(pages), scale=task.settings.scale, created=_now())
    written = overview.write(task.settings.out)
    counted = f"{overview.count('met')} met, {overview.count('missed')} missed"
    files = " and ".join(map(str, written))
    out.print(escape(f"{counted}; {duration(overview.seconds)} of work; written to {files}"))


def _print_judged(page: Page) -> None:
    stamp(page.result.virtual)
    out.print(f"[bold]{escape(page.entry.experiment.title)}[/]")
    for table in page.result.judged_tables():
        out.print()
        _print_table(table)
    out.print()


def _print_page(page: Page, folder: Path) -> None:
    result = page.result
    stamp(result.virtual)
    out.print(f"[bold]{escape(page.entry.experiment.title)}[/]")
    for table in (*result.tables, *result.judged_tables()):
        out.print()
        _print_table(table)
    out.print()
    for note in (*result.assumed, *result.notes):
        out.print(escape(note))
    name = page.entry.name
    out.print(escape(f"{duration(page.seconds)}; written to {folder / name}.json and {folder / name}.html"))


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
