"""Live progress of a campaign: a bar on a terminal, one plain line per point elsewhere."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rich.markup import escape
from rich.progress import BarColumn, MofNCompleteColumn, TextColumn
from rich.progress import Progress as Bar

from bench.commands.streams import err
from bench.progress import Progress

PERCENT = 100.0


@contextmanager
def live() -> Iterator[Callable[[Progress], None]]:
    """A watcher for ``run_campaign``."""
    if not err.is_terminal:
        yield _print_line
        return
    columns = (BarColumn(bar_width=20), MofNCompleteColumn(), TextColumn("{task.description}"))
    with Bar(*columns, console=err) as bar:
        task = bar.add_task("connecting", total=None)

        def show(progress: Progress) -> None:
            bar.update(
                task, completed=progress.done, total=progress.total, description=escape(one_line(progress))
            )
            if progress.said.startswith("rejected"):
                bar.console.print(escape(f"point {_where(progress)}: {progress.said}"))

        yield show


def _print_line(progress: Progress) -> None:
    if progress.said:
        err.print(escape(f"{progress.done}/{progress.total} {one_line(progress)}"))


def one_line(progress: Progress) -> str:
    """Point, measured and simulated efficiency, running residual and time left, as far as they are known."""
    parts = [_where(progress), progress.said]
    if progress.measured is not None:
        parts.append(f"measured {progress.measured * PERCENT:.3f} %")
    if progress.residual is not None:
        parts.append(f"measured − simulated {progress.residual * PERCENT:+.3f} points")
    if progress.mean_residual is not None:
        parts.append(f"mean so far {progress.mean_residual * PERCENT:+.3f}")
    if progress.left_s is not None:
        parts.append(f"{duration(progress.left_s)} left")
    return ", ".join(part for part in parts if part)


def _where(progress: Progress) -> str:
    row = progress.row
    return f"{row.kind} D1 = {row.D1:.3f} D2 = {row.D2:.3f} {row.power_W:.0f} W" if row else ""


def duration(seconds: float) -> str:
    """A time for people.

    >>> duration(7325)
    '2 h 02 min'
    >>> duration(95)
    '1 min 35 s'
    """
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    if hours:
        return f"{hours} h {minutes:02d} min"
    return f"{minutes} min {rest:02d} s" if minutes else f"{rest} s"
