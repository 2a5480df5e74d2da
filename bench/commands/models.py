"""Verbs on trained models: list, show, use, rollback."""

from datetime import UTC, datetime
from typing import Annotated

import typer
from rich.markup import escape
from rich.table import Table

from bench.commands.options import DEFAULT_FOLDER, Database, Folder
from bench.commands.streams import out, stamp
from bench.store import Store, database_url
from bench.training import HELD_OUT
from bench.wording import points_text
from models.journal import Decision, Journal
from models.registry import Registry

app = typer.Typer()
models_app = typer.Typer(no_args_is_help=True, help="Trained models: list, show, use, rollback.")
app.add_typer(models_app, name="models")

ModelId = Annotated[str, typer.Argument(metavar="ID", help="as listed by d2ea models list")]
SHOWN = 5  # rows and decisions, unless all are asked for


@models_app.command("list")
def list_(folder: Folder = DEFAULT_FOLDER) -> None:
    """All models, oldest first; the one in use is marked."""
    registry, used = Registry(folder), Journal(folder).in_use()
    records = registry.list()
    table = Table("", "id", "kind", "held-out error", "lab", "created", box=None)
    for record in records:
        error = f"{points_text(record.metrics.get(HELD_OUT))} points"
        lab = {True: "virtual", False: "hardware", None: "–"}[record.virtual]
        table.add_row("in use" * (record.id == used), record.id, record.kind, error, lab, record.created[:19])
    out.print(table if records else "no models yet; d2ea train and d2ea retrain make them")
    for said in registry.unreadable():
        out.print(escape(f"[not listed] {said}"), style="bold yellow")


@models_app.command()
def show(
    model_id: ModelId,
    folder: Folder = DEFAULT_FOLDER,
    rows: Annotated[bool, typer.Option("--rows", help="name every measured row behind it")] = False,
    db: Database = None,
) -> None:
    """What is known of one model: how it was made, what was decided about it, and what it was fitted to."""
    registry = Registry(folder)
    record, origin = registry.show(model_id), registry.origin(model_id)
    stamp(bool(record.virtual))
    for name in ("id", "kind", "created", "data", "data_sha256"):
        out.print(escape(f"{name}: {getattr(record, name) or 'not recorded'}"))
    beside = record.made_beside()
    out.print(escape(f"converter: {beside.converter.name if beside else 'not recorded'}"))
    for title, entries in (("settings", record.settings), ("metrics", record.metrics)):
        for key, value in entries.items():
            out.print(escape(f"{title}.{key}: {value}"))
    for label, named in (("fitted to", origin.fitted), ("judged on", origin.held_out)):
        out.print(escape(f"{label}: {len(named)} measured rows{_some(named, rows)}"))
    for said in gone(origin.fitted, db):
        out.print(escape(f"[data gone] {said}"), style="bold yellow")
    for entry in Journal(folder).decisions():
        if model_id in (entry.model, entry.replaced):
            out.print(escape(said_decision(entry)))


@models_app.command()
def use(
    model_id: ModelId,
    folder: Folder = DEFAULT_FOLDER,
    reason: Annotated[str, typer.Option(help="kept in the journal")] = "chosen by a person",
) -> None:
    """Put a model into use: optimise and the dashboard take it until another one is."""
    Registry(folder).show(model_id)
    out.print(escape(said_decision(Journal(folder).use(model_id, when=now(), reason=reason))))


@models_app.command()
def rollback(
    folder: Folder = DEFAULT_FOLDER,
    reason: Annotated[str, typer.Option(help="kept in the journal")] = "taken back by a person",
) -> None:
    """Take the model in use out of use; the one before it is in use again."""
    out.print(escape(said_decision(Journal(folder).roll_back(when=now(), reason=reason))))


def now() -> str:
    """The time of a decision."""
    return datetime.now(UTC).isoformat(timespec="seconds")


def said_decision(entry: Decision) -> str:
    """A decision in one line."""
    instead = f" in the place of {entry.replaced}" if entry.replaced and entry.replaced != entry.model else ""
    return f"{entry.when[:19]} {entry.model} {entry.decision.replace('_', ' ')}{instead}: {entry.reason}"


def gone(fitted: tuple[str, ...], db: str | None) -> list[str]:
    """Campaigns that a model was fitted to and that the database no longer holds."""
    wanted = {int(name.split()[1]) for name in fitted if name.startswith("campaign ")}
    if not wanted:
        return []
    with Store(database_url(db)) as store:
        known = {row["id"] for row in store.campaigns()}
        where = store.url
    missing = sorted(wanted - known)
    return [f"campaign {id} is not in {where}: its measurements cannot be looked at" for id in missing]


def _some(names: tuple[str, ...], all_of_them: bool) -> str:
    if not names:
        return ""
    shown = names if all_of_them else names[:SHOWN]
    more = len(names) - len(shown)
    return f": {'; '.join(shown)}" + (f"; and {more} more (--rows names them)" if more else "")
