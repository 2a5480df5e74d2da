"""Live progress of a campaign: on a terminal the last points and a bar, elsewhere one plain line per point."""

from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rich.console import Group
from rich.live import Live
from rich.markup import escape
from rich.progress import BarColumn, MofNCompleteColumn, TextColumn
from rich.progress import Progress as Bar
from rich.table import Table

from bench.commands.streams import err
from bench.progress import Progress
from bench.wording import duration, minus

PERCENT = 100.0
LAST = 8  # points in the table


@contextmanager
def live() -> Iterator[Callable[[Progress], None]]:
    """A watcher for ``run_campaign``."""
    if not err.is_terminal:
        yield _print_line
        return
    columns = (BarColumn(bar_width=20), MofNCompleteColumn(), TextColumn("{task.description}", markup=False))
    bar = Bar(*columns, console=err)
    task = bar.add_task("connecting", total=None)
    last: deque[Progress] = deque(maxlen=LAST)
    with Live(bar, console=err, refresh_per_second=4) as screen:

        def show(progress: Progress) -> None:
            if progress.row is not None and progress.said:
                last.append(progress)
            bar.update(task, completed=progress.done, total=progress.total, description=_now(progress))
            screen.update(Group(_table(last), bar) if last else bar)

        yield show


def _now(progress: Progress) -> str:
    """What goes on, beside the bar."""
    parts = [_where(progress) or progress.said]
    if progress.mean_residual is not None:
        parts.append(f"mean difference {progress.mean_residual * PERCENT:+.3f} points")
    if progress.left_s is not None:
        parts.append(_left(progress.left_s, progress.at_most))
    if progress.row is not None and progress.row.why:
        parts.append(progress.row.why)
    return ", ".join(part for part in parts if part)


def _left(seconds: float, at_most: bool) -> str:
    return f"{'at most ' if at_most else ''}{duration(seconds)} left"


def _table(last: deque[Progress]) -> Table:
    """The last points, the newest at the bottom."""
    table = Table(
        "", "kind", "D1", "D2", "P / W", "measured", "simulated", "difference / points", "", box=None
    )
    for progress in last:
        row = progress.row
        assert row is not None, "only points get here"
        cells = [str(progress.done), str(row.kind), f"{row.D1:.3f}", f"{row.D2:.3f}", f"{row.power_W:.0f}"]
        cells += [_per_cent(progress.measured), _per_cent(progress.predicted), _points(progress.residual)]
        table.add_row(
            *cells, escape(progress.said), style="red" if progress.said.startswith("rejected") else None
        )
    return table


def _per_cent(value: float | None) -> str:
    return "–" if value is None else f"{value * PERCENT:.3f} %"


def _points(value: float | None) -> str:
    return "–" if value is None else f"{value * PERCENT:+.3f}"


def _print_line(progress: Progress) -> None:
    if progress.said:
        total = f"{'at most ' if progress.at_most else ''}{progress.total}"
        err.print(escape(f"{progress.done}/{total} {one_line(progress)}"))


def one_line(progress: Progress) -> str:
    """Point, measured and simulated efficiency, running residual and time left, as far as they are known."""
    parts = [_where(progress), progress.said]
    if progress.measured is not None:
        parts.append(f"measured {progress.measured * PERCENT:.3f} %")
    if progress.residual is not None:
        parts.append(minus(f"measured − simulated {progress.residual * PERCENT:+.3f} points"))
    if progress.mean_residual is not None:
        parts.append(minus(f"mean so far {progress.mean_residual * PERCENT:+.3f}"))
    if progress.left_s is not None:
        parts.append(_left(progress.left_s, progress.at_most))
    if progress.row is not None and progress.row.why:
        parts.append(progress.row.why)
    return ", ".join(part for part in parts if part)


def _where(progress: Progress) -> str:
    row = progress.row
    return f"{row.kind} D1 = {row.D1:.3f} D2 = {row.D2:.3f} {row.power_W:.0f} W" if row else ""
