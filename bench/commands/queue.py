"""Verbs on the queue: add, list, remove, run."""

import time
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated

import typer
from rich.markup import escape
from rich.table import Table

from bench.commands.bench import stop_on_signals
from bench.commands.live import live
from bench.commands.options import Database
from bench.commands.streams import err, out, stamp
from bench.config import read_bench, read_campaign
from bench.queueing import Worker
from bench.store import Store, database_url, how_to_name

app = typer.Typer()
verbs = typer.Typer(no_args_is_help=True, help="Campaigns that wait for their time, or for their bench.")
app.add_typer(verbs, name="queue")


@verbs.command()
def add(
    campaign_file: Annotated[Path, typer.Argument(metavar="CAMPAIGN.toml", help="what to measure")],
    bench_file: Annotated[Path, typer.Option("--bench", metavar="BENCH.toml", help="the instruments")],
    db: Database = None,
) -> None:
    """Let a campaign wait for its schedule (start_at, every); without one, for its bench."""
    bench, campaign = read_bench(bench_file), read_campaign(campaign_file)
    stamp(bench.virtual)
    schedule = campaign.schedule
    due = schedule.start_at.astimezone(UTC) if schedule.start_at else None
    url = database_url(db, bench.database)
    with Store(url) as store:
        entry = store.queue.add(
            campaign.model_dump(mode="json"), bench.settings(), due=due, every_s=schedule.every
        )
    runs_it = f"d2ea queue run{how_to_name(url)} runs it"
    out.print(escape(f"entry {entry}: {campaign.name!r} on {bench.name!r}, {said_due(due)}; {runs_it}"))


@verbs.command("list")
def list_(db: Database = None) -> None:
    """What waits, and what became of what ran."""
    with Store(database_url(db)) as store:
        entries = store.queue.all()
    table = Table("id", "campaign", "bench", "state", "due", "every", "runs", "last run", box=None)
    for e in entries:
        every = f"{e.every_s:g} s" if e.every_s else "–"
        due = said_due(e.due) if e.state == "waiting" else "–"
        cells = (e.id, e.name, e.bench, e.state, due, every, e.runs, e.said or "–")
        table.add_row(*(escape(str(cell)) for cell in cells))
    out.print(table if entries else "the queue is empty")


@verbs.command()
def remove(
    entry_id: Annotated[int, typer.Argument(metavar="ID", min=1, help="as listed by d2ea queue list")],
    db: Database = None,
) -> None:
    """Take a campaign out of the queue; one that runs already goes on."""
    with Store(database_url(db)) as store:
        store.queue.remove(entry_id)
    out.print(f"entry {entry_id} removed")


@verbs.command()
def run(
    bench: Annotated[
        str | None, typer.Option(metavar="NAME", help="only campaigns of the bench of this name")
    ] = None,
    until_empty: Annotated[
        bool, typer.Option("--until-empty", help="end when nothing waits any more")
    ] = False,
    db: Database = None,
) -> None:
    """Run what is due, in the foreground, until interrupted; restarted, it goes on with what it was at."""
    with Store(database_url(db)) as store, stop_on_signals(), live() as progress:
        worker = Worker(store=store, bench=bench, progress=progress, say=lambda text: err.print(escape(text)))
        worker.work(time.sleep, until_empty=until_empty)
    out.print("the queue is empty")


def said_due(due: datetime | None) -> str:
    """When an entry is due, in local time."""
    return "as soon as the bench is free" if due is None else f"{due.astimezone():%Y-%m-%d %H:%M:%S}"
