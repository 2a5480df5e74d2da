"""Verbs that learn: train, optimise, models."""

from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated

import numpy as np
import pandas as pd
import typer
from rich.markup import escape
from rich.table import Table

from bench.commands.campaigns import read_measurements
from bench.commands.options import Database
from bench.commands.streams import out, stamp
from bench.errors import InputError
from bench.lut_file import check_lut_ending, write_lut
from bench.prediction import model_from
from bench.store import Store, database_url
from bench.training import KINDS, LEAST_ROWS, Trained, efficiency_of, feasible_of, simulated_table, train
from models.feasibility import FeasibleMap
from models.optimise import optimise as find_optimum
from models.pso import PSO_SAVL_POLISHED
from models.registry import ModelRecord, Registry, RegistryError
from models.screening import LOADED_KINDS
from models.surrogate import D2EA

app = typer.Typer()
models_app = typer.Typer(no_args_is_help=True, help="List and show trained models.")
app.add_typer(models_app, name="models")

Folder = Annotated[Path, typer.Option("--models", metavar="DIR", help="where trained models are kept")]
SimModel = Annotated[
    Path | None, typer.Option("--sim-model", metavar="MODEL.toml", help="simulation model; else the baseline")
]
Seed = Annotated[int, typer.Option(min=0, help="of the split and the search")]
HELD_OUT = "held_out_mean_abs_efficiency"
DEFAULT_FOLDER = Path("d2ea-data/models")
POINTS = 100.0  # efficiency in points


@app.command("train")
def train_(
    data: Annotated[
        str, typer.Argument(metavar="DATA|CAMPAIGN_ID", help="a measurement table, or a campaign")
    ],
    folder: Folder = DEFAULT_FOLDER,
    sim_model: SimModel = None,
    seed: Seed = 1,
    db: Database = None,
) -> None:
    """Train every kind of efficiency model, say the error on set points not fitted, and keep the models."""
    measured, campaign_id, virtual = _measured(data, db)
    simulator = model_from(sim_model)
    simulated = simulated_table(simulator)
    stamp(virtual)
    out.print(f"{len(measured)} measured and {len(simulated)} feasible simulated points")
    table = Table("model", "kind", "mean abs error", "worst", "points judged", box=None)
    for kind in KINDS:
        trained = train(kind, measured, simulated, simulator, seed=seed)
        record = _keep(trained, Registry(folder), campaign_id, db)
        error = trained.held_out
        mean, worst = (f"{value * POINTS:.3f} points" for value in (error.mean_abs, error.worst_abs))
        table.add_row(record.id, kind, mean, worst, str(error.points))
    out.print(table)
    out.print(
        "errors are of efficiency, on measured set points that were not fitted; models kept use all rows"
    )


def _keep(trained: Trained, registry: Registry, campaign_id: int | None, db: str | None) -> ModelRecord:
    created = datetime.now(UTC).isoformat(timespec="seconds")
    metrics = {HELD_OUT: trained.held_out.mean_abs}
    record = registry.save(trained.model, data_sha256=trained.data_sha256, created=created, metrics=metrics)
    if campaign_id is not None:
        with Store(database_url(db)) as store:
            store.add_model(record.id, {"kind": record.kind, **metrics}, campaign_id=campaign_id)
    return record


def _measured(data: str, db: str | None) -> tuple[pd.DataFrame, int | None, bool]:
    """Loaded rows of a file or a campaign, with the campaign's id and whether its lab was virtual."""
    campaign_id, virtual = None, False
    if data.isdigit():
        campaign_id = int(data)
        with Store(database_url(db)) as store:
            virtual = bool(store.campaign(campaign_id)["virtual"])
            frame = store.measurement_table(campaign_id)
    else:
        frame = read_measurements(Path(data))
    loaded = frame[frame["kind"].isin(LOADED_KINDS)].reset_index(drop=True) if len(frame) else frame
    if len(loaded) < LEAST_ROWS:
        said = f"holds {len(loaded)} loaded rows; at least {LEAST_ROWS} are needed to train and judge"
        raise InputError.of(f"campaign {data}" if campaign_id else data, "rows", None, said)
    return loaded, campaign_id, virtual


@app.command()
def optimise(
    model_id: Annotated[
        str | None, typer.Option("--model", metavar="ID", help="else the newest d2ea")
    ] = None,
    powers: Annotated[str, typer.Option(metavar="LOW:HIGH:STEP", help="output powers in W")] = "200:2000:100",
    out_file: Annotated[Path, typer.Option("--out", metavar="lut.csv|.h|.json")] = Path("lut.csv"),
    folder: Folder = DEFAULT_FOLDER,
    sim_model: SimModel = None,
    seed: Seed = 1,
) -> None:
    """Find D1 and D2 of the highest predicted efficiency over load."""
    check_lut_ending(out_file)
    loads_W = parse_powers(powers)
    simulator = model_from(sim_model)
    record = _chosen(Registry(folder), model_id)
    model = Registry(folder).load(record.id, efficiency_of(simulator))
    converter = simulator.altered_converter()
    edge_gap = float(2 * converter.dead_time_s * converter.frequency_Hz)
    mask = FeasibleMap.build(feasible_of(simulator), loads_W, edge_gap=edge_gap)
    optimum = find_optimum(model, loads_W, mask, seed=seed, optimiser=PSO_SAVL_POLISHED)
    write_lut(optimum, out_file, model=record.id)
    table = Table("P / W", "D1", "D2", "predicted", "regret / points", box=None)
    found = (optimum.power_W, optimum.D1, optimum.D2, optimum.predicted * POINTS, optimum.regret * POINTS)
    for power_W, D1, D2, predicted, regret in zip(*found, strict=True):
        cells = (f"{power_W:.0f}", f"{D1:.4f}", f"{D2:.4f}", f"{predicted:.3f} %", f"{regret:.4f}")
        table.add_row(*cells)
    out.print(escape(f"model {record.id} ({record.kind}), {optimum.optimiser}"))
    out.print(table)
    missing = int(np.isnan(optimum.D1).sum())
    if missing:
        out.print(f"{missing} of {len(loads_W)} loads cannot be carried at all and are left out")
    out.print(escape(f"written to {out_file}"))


def parse_powers(text: str) -> list[float]:
    """``LOW:HIGH:STEP`` in watts, both ends included.

    >>> parse_powers("200:400:100")
    [200.0, 300.0, 400.0]
    """
    try:
        low, high, step = map(float, text.split(":"))
        if not (0 < low <= high < np.inf and step > 0):
            raise ValueError
    except ValueError:
        allowed = "LOW:HIGH:STEP in W, above 0, such as 200:2000:100"
        raise InputError.of("command line", "--powers", text, allowed) from None
    return [low + step * number for number in range(int((high - low) / step + 1e-9) + 1)]


def _chosen(registry: Registry, model_id: str | None) -> ModelRecord:
    if model_id is not None:
        return registry.show(model_id)
    records = [record for record in registry.list() if record.kind == D2EA]
    if not records:
        raise RegistryError(f"no {D2EA} model in {registry.root}; d2ea train makes one")
    return records[-1]


@models_app.command("list")
def list_(folder: Folder = DEFAULT_FOLDER) -> None:
    """All models, oldest first."""
    records = Registry(folder).list()
    table = Table("id", "kind", "held-out error", "created", box=None)
    for record in records:
        error = record.metrics.get(HELD_OUT, float("nan"))
        table.add_row(record.id, record.kind, f"{error * POINTS:.3f} points", record.created[:19])
    out.print(table if records else "no models yet; d2ea train makes them")


@models_app.command()
def show(
    model_id: Annotated[str, typer.Argument(metavar="ID", help="as listed")], folder: Folder = DEFAULT_FOLDER
) -> None:
    """What is known of one model."""
    record = Registry(folder).show(model_id)
    for name in ("id", "kind", "created", "data_sha256"):
        out.print(escape(f"{name}: {getattr(record, name)}"))
    for title, entries in (("settings", record.settings), ("metrics", record.metrics)):
        for key, value in entries.items():
            out.print(escape(f"{title}.{key}: {value}"))
