"""The verb diagnose: what the simulation gets wrong, why, how sure, what to do."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import pandas as pd
import typer
from rich.markup import escape
from rich.table import Table

from bench.commands.measurements import read_measurements
from bench.commands.options import Database, Measured, check_folder
from bench.commands.streams import err, out, stamp
from bench.diagnosing import answer_of
from bench.diagnosis_files import FILES, DiagnosisFiles
from bench.errors import InputError
from bench.imported import frequencies_by_import, left_out_text
from bench.model_file import model_from
from bench.questions import first_questions
from bench.so_far import so_far_text
from bench.verdict_wording import stretch_texts, unexplained_text, verdict_text
from bench.whole_file import write_whole
from bench.wording import (
    channel_name,
    counted,
    effect_name,
    minus,
    none_of_its_rows,
    parameter_text,
    points_text,
    probability_text,
    probable_causes,
    step_text,
    told_by,
)
from models.dataset import Measurements, load_measurements
from models.switching_frequency import StatedFrequency, stated_frequencies
from sim.effects.catalogue import left_out
from sim.model import Model
from sim.parameters import ParameterError

if TYPE_CHECKING:
    from bench.store import Row, Store
    from models.diagnosis.diagnose import Diagnosis

MOST_ROWS = 5000  # memory of a diagnosis rises with readings squared: some gigabytes here

app = typer.Typer()


@app.command()
def diagnose(
    data: Measured,
    out_dir: Annotated[Path, typer.Option("--out", metavar="DIR", help="where the results go")] = Path(
        "diagnosis"
    ),
    model: Annotated[
        Path | None,
        typer.Option(metavar="MODEL.toml", help="simulation model to compare with; else the baseline"),
    ] = None,
    json_file: Annotated[
        Path | None, typer.Option("--json", metavar="FILE", help="the answer for programs")
    ] = None,
    without: Annotated[
        list[str] | None,
        typer.Option(metavar="EFFECT", help="leave an effect out of the catalogue; may be repeated"),
    ] = None,
    processes: Annotated[int, typer.Option(min=1, help="share large simulations between so many")] = 2,
    db: Database = None,
) -> None:
    """Name what the simulation gets wrong, with evidence; extend the model; measure the gain."""
    from models.diagnosis.diagnose import diagnose as find_cause  # here: scipy and the simulator load slowly
    from models.diagnosis.plausibility import ImplausibleTable
    from models.diagnosis.stretches import stretches
    from models.diagnosis.usable import TooFewPoints
    from sim.side_by_side import kept

    check_folder(out_dir, "--out")
    if json_file is not None:
        check_folder(json_file.parent, "--json")
        if json_file.is_dir():
            raise InputError.of("command line", "--json", str(json_file), "a folder; name the file to write")
    unknown = known_effects(without or ())
    table, campaign_id, virtual = measured(data, db)
    where = data if campaign_id is None else f"campaign {data}"
    _check_size(where, table)
    simulation = model_from(model)
    _check_frequency(where, _stated(table, campaign_id, db), simulation)
    stamp(virtual)

    def progress(said: str) -> None:
        err.print(escape(said))

    def diagnosed(rows: Measurements) -> "Diagnosis":
        return find_cause(rows, simulation, without=unknown, progress=progress, processes=processes)

    with kept(processes):
        try:
            found = diagnosed(table)
        except TooFewPoints as error:
            asked = "measure more set points of D1, D2 and power"
            if table.rejected:
                asked = f"put right what those rows were left out for, or {asked}"
            raise InputError.of(where, "rows", None, f"{error}; {asked}") from error
        except ImplausibleTable as error:
            raise InputError.of(where, "columns", None, str(error)) from error
        apart = stretches(found, table, diagnosed, progress)
    plain = answer_of(found, table, _campaign(campaign_id, db), str(out_dir / FILES.model), apart)
    files = DiagnosisFiles(found=found, table=table, answer=plain, source=where, virtual=virtual)
    files.write(out_dir)
    if json_file is not None:
        write_whole(json_file, files.as_json)
    if campaign_id is not None:
        with _store(db) as store:
            store.add_diagnosis(plain, campaign_id=campaign_id)
    tell(plain)
    out.print(escape(f"written to {out_dir}: {', '.join(FILES)}"))
    for stretch in apart:
        if stretch.found is not None:
            folder = out_dir / stretch.name
            files.of_stretch(stretch.name, stretch.found, stretch.measurements, folder).write(folder)
            out.print(escape(f"written to {folder}: the same of what was measured {stretch.name} the change"))


def _check_size(where: str, table: Measurements) -> None:
    """InputError for more rows than a diagnosis has memory for."""
    if (rows := len(table.frame)) > MOST_ROWS:
        rest = f"average the readings of each set point, or keep one row of {-(-rows // MOST_ROWS)}"
        raise InputError.of(where, "rows", rows, f"at most {MOST_ROWS}; {rest}")


def _check_frequency(where: str, stated: Sequence[StatedFrequency], simulation: Model) -> None:
    """InputError for rows that were measured at another switching frequency than the model's."""
    converter = simulation.converter
    for each in stated:
        if each.differs_from(converter.frequency_Hz):
            allowed = (
                f"measured at {each.frequency_Hz / 1e3:g} kHz, and the model ({converter.name}) switches at "
                f"{converter.frequency_Hz / 1e3:g} kHz: link inductance and dead time would be blamed for it. Name a "
                f"model file with frequency_Hz = {each.frequency_Hz:g} by --model, or keep only rows of the model's "
                "frequency; where the column means something else, give it another name"
            )
            raise InputError.of(where, f"row {each.row}, column {each.column}", each.value, allowed)


def _stated(table: Measurements, campaign_id: int | None, db: str | None) -> tuple[StatedFrequency, ...]:
    """The switching frequencies that a table says, itself or when it was imported."""
    if campaign_id is None:
        return stated_frequencies(table.frame, table.rows)
    with _store(db) as store:
        return frequencies_by_import(store.campaign(campaign_id)["config"])


def known_effects(names: Sequence[str]) -> frozenset[str]:
    """Effects of the catalogue to do without; InputError for a name that is none, and for all of them."""
    try:
        return left_out(names)
    except ParameterError as error:
        raise InputError.of("command line", "--without", None, str(error)) from error


def measured(data: str, db: str | None) -> tuple[Measurements, int | None, bool]:
    """Checked measurements of a file or a campaign, the campaign's id, and whether its lab was virtual."""
    if not data.isdigit():
        table = read_measurements(Path(data))
        return table, None, bool(table.virtual)
    with _store(db) as store:
        campaign = store.campaign(int(data))
        frame: pd.DataFrame = store.measurement_table(int(data))
    if not len(frame):
        said = f"none is accepted, so there is nothing to diagnose: {none_of_its_rows(campaign, 'accepted')}"
        raise InputError.of(f"campaign {data}", "rows", None, said)
    return load_measurements(frame), int(data), bool(campaign["virtual"])


def _campaign(campaign_id: int | None, db: str | None) -> "Row | None":
    """A campaign as the store tells it; none of a file."""
    if campaign_id is None:
        return None
    with _store(db) as store:
        return store.campaign(campaign_id)


def _store(db: str | None) -> "Store":
    from bench.store import Store, database_url  # here: a diagnosis of a file needs no database

    return Store(database_url(db))


def tell(plain: dict[str, Any]) -> None:
    """The answer for people."""
    gap, gain = plain["gap"], plain["gain"]
    if so_far := so_far_text(plain):
        out.print(escape(so_far))
    for note in plain.get("notes") or ():
        out.print(escape(f"read: {note}"))
    out.print(f"{plain['points']} points; channels: {', '.join(map(channel_name, plain['channels']))}")
    efficiency = f"{points_text(gap['mean_abs_efficiency'])} points of efficiency"
    out.print(minus(f"gap: {efficiency}, {gap['mean_loss_W']:+.2f} W of loss, mean"))
    out.print(escape(f"verdict: {verdict_text(plain)}"))
    if unexplained := unexplained_text(plain):
        out.print(escape(unexplained))
    for stretch in stretch_texts(plain):
        out.print(escape(f"{stretch.rows}: {stretch.said}"))
    if shown := probable_causes(plain):
        table = Table("cause", "probability", "value (95 %)", "check", box=None)
        for cause in shown:
            value = "; ".join(parameter_text(p) for p in cause["parameters"])
            table.add_row(
                effect_name(cause["effect"]), probability_text(cause["probability"]), value, cause["check"]
            )
        out.print(table)
    for asked in first_questions(plain):
        out.print(escape(asked))
    for step in plain["next"]:
        worth = f"tells {told_by(step['separates'])}, by {step['expected_sigma']:.1f} sigma"
        out.print(escape(f"next: {step_text(step)} (about {step['minutes']:.3g} min); {worth}"))
    if gain:
        after = f"{points_text(gain['before'])} points before, {points_text(gain['after'])} after"
        out.print(escape(f"on held-out blocks ({gain['blocks']}): {after}"))
    if plain["rejected_rows"]:
        rows = counted(len({row["row"] for row in plain["rejected_rows"]}), "row")
        out.print(f"all or some readings of {rows} left out; the reasons are in diagnosis.json")
    if before := left_out_text(plain):
        out.print(escape(f"{before}; the reasons are in diagnosis.json"))
    for column in plain["rejected_columns"]:
        out.print(escape(f"column {column['column']} left out: {column['reason']}"))
