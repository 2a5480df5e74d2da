"""Verbs on the best modulation over load: optimise, and lut load, verify, trace."""

import math
from collections.abc import Iterable
from pathlib import Path
from typing import Annotated

import numpy as np
import pandas as pd
import typer
from rich.markup import escape
from rich.table import Table

from bench.campaign import run_campaign
from bench.commands.bench import stop_on_signals
from bench.commands.live import live
from bench.commands.options import DEFAULT_FOLDER, Database, Folder, check_folder
from bench.commands.streams import err, out, stamp
from bench.config import BenchConfig, read_bench
from bench.converter_stated import check_same_converter, stated_converter
from bench.errors import BenchError, InputError
from bench.lut_file import LutOrigin, check_lut_ending, converter_of, read_lut, write_beside, write_lut
from bench.lut_on_bench import following, load_into_controller, table_rows, verification, verified
from bench.model_file import model_from, read_model, simulator_for
from bench.optimum import BestModulation, loads_of
from bench.prediction import model_of
from bench.store import Store, database_url
from bench.table_file import check_ending, write_table
from bench.training import HALF_WIDTH, efficiency_of
from bench.wording import per_cent, points_text
from drivers.clock import WallClock
from models.calibrated import Vouched, vouched
from models.feasibility import edge_gap_of
from models.journal import Journal
from models.lut import Line, Lut, Surroundings, check_lines
from models.optimise import OptimumTable
from models.registry import ModelRecord, Registry, RegistryError
from models.surrogate import CALIBRATED, D2EA, SimulatorStage

app = typer.Typer()
lut_app = typer.Typer(
    no_args_is_help=True,
    help="A table of D1 and D2 over load: load it into the controller, verify it, trace it to what was measured.",
)
app.add_typer(lut_app, name="lut")

LutFile = Annotated[Path, typer.Argument(metavar="FILE", help="a table written by d2ea optimise")]
BenchFile = Annotated[Path, typer.Option("--bench", metavar="BENCH.toml", help="the instruments")]
OwnModel = Annotated[
    Path | None,
    typer.Option(
        "--sim-model",
        metavar="MODEL.toml",
        help="simulation model; else the one that the model was trained beside",
    ),
]
Seed = Annotated[int, typer.Option(min=0, help="of the search")]
SEARCHED = (CALIBRATED, D2EA)  # kinds that the best modulation is looked for on, the better one first


@app.command()
def optimise(
    model_id: Annotated[
        str | None,
        typer.Option(
            "--model",
            metavar="ID",
            help="trained model, as listed by d2ea models list; else the one in use, else the newest calibrated "
            "or d2ea",
        ),
    ] = None,
    powers: Annotated[
        str | None,
        typer.Option(
            metavar="LOW:HIGH:STEP", help="output powers in W; else a tenth of the rated one to all of it"
        ),
    ] = None,
    out_file: Annotated[
        Path, typer.Option("--out", metavar="lut.csv|.h|.json", help="where the table goes")
    ] = Path("lut.csv"),
    folder: Folder = DEFAULT_FOLDER,
    sim_model: OwnModel = None,
    seed: Seed = 1,
) -> None:
    """Find D1 and D2 of the highest predicted efficiency over load, as a table that firmware can interpolate."""
    check_lut_ending(out_file)
    check_folder(out_file.parent, "--out")
    asked_W = parse_powers(powers) if powers is not None else None
    record = chosen(Registry(folder), model_id)
    simulator = simulator_for(record, None if sim_model is None else read_model(sim_model))
    stage = efficiency_of(record.made_beside() or simulator)
    model = vouched(Registry(folder).load(record.id, stage))
    own = model.of.model if isinstance(model, Vouched) else simulator
    search = BestModulation(simulator=simulator, loads_W=asked_W or loads_of(own))
    optimum = search.best(model, seed)
    lut = search.table(model, optimum, record.metrics.get(HALF_WIDTH, math.nan))
    origin = LutOrigin.of(record, simulator)
    write_lut(lut, out_file, origin)
    write_beside(folder / record.id, lut, origin)
    stamp(bool(record.virtual))
    out.print(escape(f"model {record.id} ({record.kind}), {optimum.optimiser}"))
    _tell(lut, optimum)
    out.print(escape(f"written to {out_file}"))


def _tell(lut: Lut, optimum: OptimumTable) -> None:
    table = Table("P / W", "D1", "D2", "predicted", "95 %", "price / points", "soft edges", box=None)
    known = math.isfinite(lut.half_width)
    interval = f"± {points_text(lut.half_width)} points" if known else "not known"
    for row in lut.frame().to_dict("records"):
        cells = (f"{row['P_W']:.0f}", f"{row['D1']:.4f}", f"{row['D2']:.4f}", per_cent(row["predicted"], 3))
        table.add_row(*cells, interval, points_text(row["price"]), str(row["soft_edges"]))
    out.print(table)
    if not known:
        out.print(
            "95 % is not known: the model was judged on fewer than 19 rows that it was not fitted to; d2ea train with "
            "more measured rows tells it"
        )
    if math.isfinite(optimum.worst_regret):
        out.print(
            f"the search missed the model's own optimum by {points_text(optimum.worst_regret, 4)} points at most"
        )
    if lut.left_out_W:
        left_out = len(lut.left_out_W)
        out.print(f"{left_out} of {len(optimum.power_W)} loads cannot be carried at all and are left out")
    tell_unsound(lut.lines)
    if not lut.unsound:
        out.print(
            "between the rows: every point carries its power, soft edges stay soft, no dip of efficiency"
        )


def tell_unsound(lines: Iterable[Line]) -> None:
    """Which lines between rows are not sound, and what to do where the converter may trip on one."""
    unsound = [line for line in lines if not line.sound]
    for line in unsound:
        err.print(f"[bold yellow]between rows:[/] {escape(str(line))}")
    trips = [line for line in unsound if line.zero_state_appears or not line.carries]
    if trips:
        apart = ", ".join(f"up to {line.low_W:g} W and from {line.high_W:g} W on" for line in trips)
        err.print(
            f"a controller that follows the table may trip there. Two tables do without that line: make each by d2ea "
            f"optimise --powers LOW:HIGH:STEP, {apart}"
        )


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
        allowed = "LOW:HIGH:STEP in W, LOW and STEP above 0, HIGH not below LOW, such as 200:2000:100"
        raise InputError.of("command line", "--powers", text, allowed) from None
    return [low + step * number for number in range(int((high - low) / step + 1e-9) + 1)]


def chosen(registry: Registry, model_id: str | None) -> ModelRecord:
    """The model asked for, else the one in use, else the newest of the kinds that are for searching."""
    if wanted := model_id or Journal(registry.root).in_use():
        return registry.show(wanted)
    records = registry.list()
    for kind in SEARCHED:
        if of_kind := [record for record in records if record.kind == kind]:
            return of_kind[-1]
    raise RegistryError(f"no {' or '.join(SEARCHED)} model in {registry.root}; d2ea train makes them")


@lut_app.command()
def load(file: LutFile, bench_file: BenchFile) -> None:
    """Load a table into the controller and read it back; it is not yet in use."""
    table, config = _for_this_bench(file, bench_file)
    stamp(config.virtual)
    held = load_into_controller(config, table)
    shown = Table("P / W", "D1", "D2", box=None)
    for row in held.rows:
        shown.add_row(f"{row.power_W:.0f}", f"{row.D1:.4f}", f"{row.D2:.4f}")
    out.print(escape(f"{held.identity} holds {len(held.rows)} rows, read back in whole PWM counts:"))
    out.print(shown)


def _for_this_bench(file: Path, bench_file: Path) -> tuple[pd.DataFrame, BenchConfig]:
    """A table and the bench that it is for; InputError where it is another's.

    Says where the table does not tell, and between which rows the simulated converter of the bench is worse off.
    """
    table, config = read_lut(file), read_bench(bench_file)
    model = model_of(config.converter)
    if (stated := converter_of(file)) is None:
        own = f"bench {config.name!r} has {stated_converter(model)!r}"
        err.print(
            escape(f"{file} does not say which converter it is for; {own}: make sure that it is the one")
        )
    else:
        check_same_converter(file, stated, config.name, model)
    around = Surroundings(model=SimulatorStage(efficiency_of(model)), simulator=model)
    tell_unsound(check_lines(table, around))
    return table, config


@lut_app.command()
def verify(
    file: LutFile,
    bench_file: BenchFile,
    out_file: Annotated[
        Path | None, typer.Option("--out", metavar="FILE.csv|.parquet", help="where the comparison goes")
    ] = None,
    db: Database = None,
) -> None:
    """Let the controller follow a table, draw its loads and those between, and measure; the bench is off after."""
    if out_file is not None:
        check_ending(out_file)
        check_folder(out_file.parent, "--out")
    table, config = _for_this_bench(file, bench_file)
    stamp(config.virtual)
    job = verification(table, config, name=f"verify {file.name}", bench_file=str(bench_file))
    with Store(database_url(db, config.database)) as store, stop_on_signals():
        with live() as progress:
            around = following(table_rows(table))
            outcome = run_campaign(job, store, WallClock(config.speed), progress=progress, around=around)
        measured = store.measurement_table(outcome.campaign_id)
    result = verified(table, measured, edge_gap_of(model_from(config.converter.model)))
    if out_file is not None:
        write_table(result, out_file)
    _tell_verified(result)
    out.print(escape(f"campaign {outcome.campaign_id}; bench: {outcome.power_off}"))
    if outcome.rejected:
        raise BenchError(
            f"{outcome.rejected} of {len(job.plan.points)} loads were rejected; d2ea status says why"
        )
    if not result["followed"].all():
        raise BenchError(
            "the controller applied other values than the table's; see the rows marked NOT the table"
        )


def _tell_verified(result: pd.DataFrame) -> None:
    table = Table("P / W", "D1", "D2", "measured", "predicted", "measured − predicted", "", box=None)
    for row in result.to_dict("records"):
        predicted = row.get("predicted", math.nan)
        remark = "" if row["followed"] else "NOT the table"
        remark = remark or {1.0: "inside", 0.0: "outside"}.get(row.get("inside", math.nan), "")
        off = f"{points_text(row['measured'] - predicted)} points"
        cells = (f"{row['P_W']:.0f}", f"{row['D1']:.4f}", f"{row['D2']:.4f}", per_cent(row["measured"], 3))
        table.add_row(*cells, per_cent(predicted, 3), off, remark)
    out.print(table)
    judged = result["inside"].dropna() if "inside" in result else pd.Series(dtype=float)
    if len(judged):
        out.print(
            f"{int(judged.sum())} of {len(judged)} measured efficiencies lie in the predicted 95 % interval"
        )


@lut_app.command()
def trace(
    file: LutFile,
    power_W: Annotated[
        float, typer.Option("--power", metavar="W", help="which entry: the one nearest to it")
    ],
    folder: Folder = DEFAULT_FOLDER,
    db: Database = None,
) -> None:
    """From one entry of a table back to the measurements that it rests on."""
    from bench.trace import trace_entry

    table = read_lut(file)
    told = trace_entry(file, table, power_W, registry=Registry(folder), db=database_url(db))
    stamp(told.virtual)
    for line in told.lines:
        out.print(escape(line))
