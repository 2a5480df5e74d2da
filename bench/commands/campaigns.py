"""Verbs on stored campaigns: status, runs, pause, resume, abort, export, import."""

import os
from pathlib import Path
from typing import Annotated

import pandas as pd
import typer
from rich.markup import escape
from rich.table import Table
from sqlalchemy import RowMapping

from bench.campaign import State
from bench.commands.options import Database
from bench.commands.streams import err, out, stamp
from bench.errors import InputError, StateError
from bench.store import Provenance, Store, database_url
from bench.table_file import file_hash, write_table
from models.dataset import DatasetError, load_measurements

app = typer.Typer()

CampaignId = Annotated[int, typer.Argument(metavar="CAMPAIGN_ID", min=1, help="as listed by d2ea runs")]
Maybe = Annotated[int | None, typer.Argument(metavar="[CAMPAIGN_ID]", help="else the newest that is running")]

LIVE = frozenset({State.PLANNED, State.WAITING, State.CHECKING, State.RUNNING, State.PAUSED})


@app.command()
def runs(db: Database = None) -> None:
    """List all campaigns."""
    with Store(database_url(db)) as store:
        campaigns = store.campaigns()
    table = Table("id", "name", "state", "rows", "rejected", "lab", "created", box=None)
    for row in campaigns:
        lab = "virtual" if row["virtual"] else "hardware"
        rows = f"{row['accepted']}/{row['planned']}"
        cells = (row["id"], row["name"], said_state(row), rows, row["rejected"], lab, row["created"][:19])
        table.add_row(*(escape(str(cell)) for cell in cells))
    out.print(table if campaigns else "no campaigns yet")


@app.command()
def status(campaign_id: Maybe = None, db: Database = None) -> None:
    """Where a campaign stands: the newest, or the one named."""
    with Store(database_url(db)) as store:
        rows = {row["id"]: row for row in store.campaigns()}
        if not rows:
            out.print("no campaigns yet")
            return
        row = rows.get(campaign_id or max(rows)) or store.campaign(campaign_id or 0)
        last = store.events(row["id"])[-1:]
    stamp(row["virtual"])
    out.print(escape(f"campaign {row['id']} {row['name']!r}: {said_state(row)}"))
    out.print(f"{row['accepted']} of {row['planned']} rows accepted, {row['rejected']} rejected")
    for label, key in (("bench", "power_off"), ("stopped by", "error"), ("asked to", "request")):
        if row[key]:
            out.print(escape(f"{label}: {row[key]}"))
    for event in last:
        out.print(
            escape(f"last: {event['event']} {event['detail'] or ''} at {event['written'][:19]} UTC".strip())
        )


@app.command()
def pause(campaign_id: Maybe = None, db: Database = None) -> None:
    """Let a running campaign finish its point, then switch the bench off and wait."""
    _ask("pause", campaign_id, db, "it pauses after the point it is at")


@app.command()
def resume(campaign_id: Maybe = None, db: Database = None) -> None:
    """Let a paused campaign go on."""
    _ask(None, campaign_id, db, "it goes on")


@app.command()
def abort(campaign_id: Maybe = None, db: Database = None) -> None:
    """End a running campaign; it switches the bench off."""
    _ask("abort", campaign_id, db, "it switches the bench off and ends")


def _ask(request: str | None, campaign_id: int | None, db: str | None, then: str) -> None:
    with Store(database_url(db)) as store:
        live = [row for row in store.campaigns() if is_live(row)]
        if campaign_id is not None:
            row = store.campaign(campaign_id)
            if not is_live(row):
                raise StateError(f"campaign {campaign_id} is not running: {said_state(row)}")
        elif not live:
            raise StateError("no campaign is running here")
        else:
            row = live[-1]
        store.ask(row["id"], request)
    out.print(f"asked campaign {row['id']}: {then}")


@app.command()
def export(
    campaign_id: CampaignId,
    out_file: Annotated[
        Path, typer.Option("--out", metavar="FILE.csv|.parquet", help="where the table goes")
    ],
    db: Database = None,
) -> None:
    """Write the accepted rows of a campaign as a measurement table."""
    with Store(database_url(db)) as store:
        campaign = store.campaign(campaign_id)
        table = store.measurement_table(campaign_id)
    write_table(table, out_file)
    stamp(campaign["virtual"])
    out.print(escape(f"{len(table)} rows of campaign {campaign_id} written to {out_file}"))


@app.command("import")
def import_(
    file: Annotated[Path, typer.Argument(metavar="FILE.csv", help="a measurement table (.csv or .parquet)")],
    name: Annotated[str | None, typer.Option(help="of the campaign; else the file's name")] = None,
    virtual: Annotated[bool, typer.Option("--virtual", help="the rows come from a virtual lab")] = False,
    db: Database = None,
) -> None:
    """Make a campaign of somebody else's measurements."""
    measured = read_measurements(file)
    provenance = Provenance(config={"imported_from": file.name}, config_hash=file_hash(file), virtual=virtual)
    with Store(database_url(db)) as store:
        campaign_id = store.import_table(name or file.stem, measured, provenance)
    out.print(escape(f"campaign {campaign_id}: {len(measured)} rows imported from {file}"))


def read_measurements(file: Path) -> pd.DataFrame:
    """The usable rows of a measurement table; says which rows and columns are not used."""
    try:
        measured = load_measurements(file)
    except DatasetError as error:
        raise InputError.of(file, "measurement table", None, str(error).removeprefix(f"{file}: ")) from error
    for note in measured.notes:
        err.print(escape(f"{file}: {note}"))
    for row in measured.rejected:
        err.print(escape(f"{file}: row {row.row}, {row.column} = {row.value}: {row.reason}"))
    return measured.frame


def is_live(row: RowMapping) -> bool:
    """True while a process runs the campaign."""
    return row["state"] in LIVE and _alive(row["process"])


def said_state(row: RowMapping) -> str:
    """The state, or that the process which ran the campaign is gone."""
    if row["state"] in LIVE and not is_live(row):
        return f"{row['state']} when its process died; see that the bench is off"
    return str(row["state"])


def _alive(process: int | None) -> bool:
    if process is None:
        return False
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except PermissionError:
        return True
    return True
