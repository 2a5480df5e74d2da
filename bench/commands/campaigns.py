"""Verbs on stored campaigns: status, runs, pause, abort, export, import."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Annotated

import typer
from rich.markup import escape
from rich.table import Table
from sqlalchemy import RowMapping

from bench.commands.measurements import read_measurements
from bench.commands.options import Database
from bench.commands.streams import out, stamp
from bench.errors import InputError, StateError
from bench.imported import import_config, left_out_by_import, left_out_text
from bench.plan import most_rows
from bench.states import STOPPED, State
from bench.store import BenchRow, BenchState, Provenance, Row, Store, database_url
from bench.store.tables import CHOICE, CHOSEN
from bench.table_file import file_hash, write_table
from bench.wording import counted, none_of_its_rows
from models.other_names import OtherName, OtherNameError

app = typer.Typer()

_ALARMING = {BenchState.UNSAFE: "bold red", BenchState.UNCONFIRMED: "bold yellow"}  # and how they are shown

CampaignId = Annotated[int, typer.Argument(metavar="CAMPAIGN_ID", min=1, help="as listed by d2ea runs")]
Running = Annotated[
    int | None, typer.Argument(metavar="[CAMPAIGN_ID]", min=1, help="else the newest that is running")
]
Stored = Annotated[
    int | None, typer.Argument(metavar="[CAMPAIGN_ID]", min=1, help="else the newest, running or not")
]


@app.command()
def runs(db: Database = None) -> None:
    """List all campaigns."""
    with Store(database_url(db)) as store:
        campaigns = store.campaigns()
    table = Table("id", "name", "state", "rows", "rejected", "lab", "created", box=None)
    for row in campaigns:
        lab = "virtual" if row["virtual"] else "hardware"
        rows = f"{row['accepted']}/{row['planned']}"
        cells = (row["id"], row["name"], row["shown"], rows, row["rejected"], lab, row["created"][:19])
        table.add_row(*(escape(str(cell)) for cell in cells))
    out.print(table if campaigns else "no campaigns yet")


@app.command()
def status(campaign_id: Stored = None, db: Database = None) -> None:
    """Where a campaign stands: the newest, or the one named."""
    with Store(database_url(db)) as store:
        rows = {row["id"]: row for row in store.campaigns()}
        if not rows:
            out.print("no campaigns yet")
            return
        row = rows[max(rows)] if campaign_id is None else store.campaign(campaign_id)
        events = store.events(row["id"])
        last, told = events[-1:], _choice(events)
        benches = store.benches.all()
    alarming = [bench for bench in benches if bench.state in _ALARMING]  # what needs a hand comes first
    stamp(row["virtual"])
    for bench in alarming:
        out.print(f"[{_ALARMING[bench.state]}]{escape(said_bench(bench))}[/]")
    out.print(escape(f"campaign {row['id']} {row['name']!r}: {row['shown']}"))
    most = most_rows(row["config"]) if row["shown"] is not State.DONE else None
    grows = f"; more are chosen as it goes, {most} in all at most" if most else ""
    out.print(f"{row['accepted']} of {row['planned']} rows accepted, {row['rejected']} rejected{grows}")
    if before := left_out_text(left_out_by_import(row["config"])):
        out.print(escape(before))
    for event in told:
        out.print(escape(f"{event['event']}: {event['detail']}"))
    for line in _how_it_stands(row, last, [bench.unsafe for bench in alarming]):
        out.print(escape(line))
    for bench in benches:
        if bench not in alarming:
            out.print(escape(said_bench(bench)))


def _how_it_stands(row: Row, last: Sequence[RowMapping], said: Sequence[str | None]) -> Iterator[str]:
    """How the bench was left, what stopped the campaign, what it is asked, its last event; nothing twice."""
    told = [text for text in said if text]
    for label, key in (("bench", "power_off"), ("stopped by", "error"), ("asked to", "request")):
        text = row[key] or ""
        if text and not text.endswith(tuple(told)):
            yield f"{label}: {text}"
            told.append(text)
    for event in last:
        detail = event["detail"] or ""
        more = f" {detail}" if detail and not detail.endswith(tuple(told)) else ""
        yield f"last: {event['event']}{more} at {event['written'][:19]} UTC"


def _choice(events: Sequence[RowMapping]) -> list[RowMapping]:
    """What the last choice of points went by, and the questions that they answer, each once."""
    lines = [event for event in events if event["event"] in (CHOICE, CHOSEN)]
    begins = [
        k
        for k, event in enumerate(lines)
        if event["event"] == CHOICE and (not k or lines[k - 1]["event"] == CHOSEN)
    ]
    last = lines[begins[-1] :] if begins else []
    return list({event["detail"]: event for event in last}.values())


def said_bench(bench: BenchRow) -> str:
    """What is known of a bench in one line; of one that is UNSAFE also what each of its parts said."""
    match bench.state:
        case BenchState.UNSAFE:
            since = f"UNSAFE since {(bench.unsafe_since or '')[:19]} UTC"
            why = "".join(f"\n  {line}" for line in (bench.unsafe or "").splitlines())
            what = f"{since}: switch it off by hand and see that it is off, then: d2ea clear{why}"
        case BenchState.UNCONFIRMED:
            what = f"left on by campaign {bench.campaign_id}, which died; d2ea resume or d2ea clear switches it off"
        case BenchState.ON:
            what = f"on, campaign {bench.campaign_id} ({bench.owner})"
        case BenchState.OFF:
            what = f"seen off at {(bench.seen_off or '')[:19]} UTC"
        case _:
            what = "never switched on from here"
    return f"bench {bench.name!r}: {what}"


@app.command()
def pause(campaign_id: Running = None, db: Database = None) -> None:
    """Let a running campaign finish its point, then switch the bench off and wait."""
    _ask("pause", campaign_id, db, "it pauses after the point it is at")


@app.command()
def abort(campaign_id: Running = None, db: Database = None) -> None:
    """End a running campaign; it switches the bench off."""
    _ask("abort", campaign_id, db, "it switches the bench off and ends")


def _ask(request: str | None, campaign_id: int | None, db: str | None, then: str) -> None:
    with Store(database_url(db)) as store:
        row = running(store, campaign_id)
        store.ask(row["id"], request)
    out.print(f"asked campaign {row['id']}: {then}")


def running(store: Store, campaign_id: int | None) -> Row:
    """The campaign named, else the newest that is running; StateError when it does not run."""
    if campaign_id is not None:
        row = store.campaign(campaign_id)
        if not row["is_live"]:
            hint = "; d2ea resume goes on with it" if row["shown"] in STOPPED else ""
            raise StateError(f"campaign {campaign_id} is not running: {row['shown']}{hint}")
        return row
    live = [row for row in store.campaigns() if row["is_live"]]
    if not live:
        raise StateError("no campaign is running here")
    return live[-1]


@app.command()
def export(
    campaign_id: CampaignId,
    out_file: Annotated[
        Path, typer.Option("--out", metavar="FILE.csv|.parquet", help="where the table goes")
    ],
    rejected: Annotated[
        bool, typer.Option("--rejected", help="the rejected rows instead, with the reason of each")
    ] = False,
    db: Database = None,
) -> None:
    """Write the accepted rows of a campaign as a measurement table."""
    with Store(database_url(db)) as store:
        campaign = store.campaign(campaign_id)
        table = (store.rejected_table if rejected else store.measurement_table)(campaign_id)
    if not len(table):
        kind = "rejected" if rejected else "accepted"
        why = none_of_its_rows(campaign, kind)
        raise StateError(f"campaign {campaign_id} has no {kind} rows, so nothing is written: {why}")
    write_table(table, out_file)
    stamp(campaign["virtual"])
    kind = "rejected row" if rejected else "row"
    out.print(escape(f"{counted(len(table), kind)} of campaign {campaign_id} written to {out_file}"))


@app.command("import")
def import_(
    file: Annotated[
        Path,
        typer.Argument(metavar="FILE.csv", help="a measurement table (.csv, .txt, .tsv, .dat or .parquet)"),
    ],
    name: Annotated[str | None, typer.Option(help="of the campaign; else the file's name")] = None,
    columns: Annotated[
        list[str] | None,
        typer.Option(
            "--column",
            metavar="OURS=THEIRS[*FACTOR]",
            help="a column under another name or in another unit: P1_W='Pin (kW)*1000', of temperatures "
            "T_heatsink_C='T_hs in degF' or 'in K'; may be repeated",
        ),
    ] = None,
    virtual: Annotated[
        bool, typer.Option("--virtual", help="the rows come from a virtual lab; else the column lab says so")
    ] = False,
    db: Database = None,
) -> None:
    """Make a campaign of somebody else's measurements."""
    measured = read_measurements(file, _other_names(columns or []))
    virtual = virtual or bool(measured.virtual)
    config = import_config(file, measured)
    provenance = Provenance(config=config, config_hash=file_hash(file), virtual=virtual)
    with Store(database_url(db)) as store:
        before = [row["id"] for row in store.campaigns() if row["config_hash"] == provenance.config_hash]
        campaign_id = store.import_table(name or file.stem, measured.frame, provenance)
    stamp(virtual)
    out.print(escape(f"campaign {campaign_id}: {counted(len(measured.frame), 'row')} imported from {file}"))
    if before:
        out.print(
            f"the very same file is campaign {before[-1]} too: what learns from both counts its rows twice"
        )
    other = "of another converter than the prototype with --model MODEL.toml"
    out.print(f"d2ea diagnose {campaign_id} tells what is wrong; {other}")


def _other_names(said: Sequence[str]) -> list[OtherName]:
    try:
        return [OtherName.parse(text) for text in said]
    except OtherNameError as error:
        raise InputError.of("command line", "--column", None, str(error)) from error
