"""The verb train: every kind of efficiency model from one table."""

from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated

import typer
from rich.markup import escape
from rich.table import Table

from bench.commands.measurements import read_measurements
from bench.commands.options import DEFAULT_FOLDER, Database, Folder, Measured, SimModel, check_folder
from bench.commands.streams import err, out, stamp
from bench.errors import InputError
from bench.model_file import model_from
from bench.store import Store, database_url
from bench.store.row import finite
from bench.training import (
    HALF_WIDTH,
    HELD_OUT,
    KINDS,
    LEAST_ROWS,
    NotTrained,
    Trained,
    Trainer,
    simulated_table,
    tenth_of,
)
from bench.training_data import TrainingData
from bench.wording import points_text
from models.accuracy import Accuracy
from models.registry import ModelRecord, Origin, Registry
from sim.model import Model

app = typer.Typer()

_FAR_OFF = 0.01  # of efficiency, as a mean: more than parts and instruments inside their tolerances do

Seed = Annotated[int, typer.Option(min=0, help="of the split")]


@app.command("train")
def train_(
    data: Measured,
    folder: Folder = DEFAULT_FOLDER,
    sim_model: SimModel = None,
    seed: Seed = 1,
    db: Database = None,
) -> None:
    """Train every kind of efficiency model, say the error on set points not fitted, and keep the models."""
    check_folder(folder, "--models")
    measured = training_data(data, db)
    simulator = model_from(sim_model)
    simulated = simulated_table(simulator)
    stamp(bool(measured.virtual))
    out.print(f"{len(measured)} measured and {len(simulated)} feasible simulated points")
    doubts = ""
    table = Table("model", "kind", "mean abs error", "worst", "points judged", box=None)
    trainer = Trainer(simulator=simulator, simulated=tenth_of(simulated, seed=seed), say=_progress)
    for kind in KINDS:
        try:
            trained = trainer.judged(kind, measured, seed=seed)
        except NotTrained as why:
            _progress(str(why))
            continue
        record = _keep(trained, Registry(folder), measured, simulator, db)
        error = trained.held_out
        mean, worst = (f"{points_text(value)} points" for value in (error.mean_abs, error.worst_abs))
        table.add_row(record.id, kind, mean, worst, judged_text(error))
        if kind == "simulation_only" and error.mean_abs > _FAR_OFF:
            doubts = f"the simulation is {mean} off: d2ea diagnose {data} says why; --sim-model takes another converter"
    out.print(table)
    if doubts:
        out.print(escape(doubts))
    out.print(
        "errors are of efficiency, on measured set points that were not fitted; models kept use all rows"
    )


def judged_text(error: Accuracy) -> str:
    """On how many points a model was judged, and of how many where it has no prediction for some of them."""
    return f"{error.points} of {error.points + error.unpredicted}" if error.unpredicted else str(error.points)


def _progress(said: str) -> None:
    err.print(escape(said))


def _keep(
    trained: Trained, registry: Registry, measured: TrainingData, simulator: Model, db: str | None
) -> ModelRecord:
    metrics = {HELD_OUT: trained.held_out.mean_abs, HALF_WIDTH: trained.half_width}
    origin = Origin(
        data=measured.data, virtual=measured.virtual, fitted=measured.names, simulator=simulator.as_plain()
    )
    record = registry.save(
        trained.model,
        data_sha256=trained.data_sha256,
        created=datetime.now(UTC).isoformat(timespec="seconds"),
        metrics=metrics,
        origin=origin,
    )
    for campaign_id in measured.campaigns:
        with Store(database_url(db)) as store:
            store.add_model(record.id, {"kind": record.kind, **finite(metrics)}, campaign_id=campaign_id)
    return record


def training_data(data: str, db: str | None) -> TrainingData:
    """Loaded rows of a file or a campaign; InputError when there are too few to learn from."""
    if data.isdigit():
        with Store(database_url(db)) as store:
            measured = TrainingData.of_campaigns(store, [int(data)])
    else:
        measured = TrainingData.of_file(Path(data), read_measurements(Path(data)))
    if len(measured) < LEAST_ROWS:
        said = f"holds {len(measured)} loaded rows; at least {LEAST_ROWS} are needed to train and judge"
        raise InputError.of(f"campaign {data}" if data.isdigit() else data, "rows", None, said)
    return measured
