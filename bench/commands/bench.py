"""Verbs that touch a bench: mock, check, run."""

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import FrameType
from typing import Annotated

import typer
from rich.markup import escape

from bench.campaign import CampaignOutcome, Job, run_campaign
from bench.commands.live import duration, live
from bench.commands.options import Database
from bench.commands.streams import err, out, stamp
from bench.config import read_bench, read_campaign
from bench.connect import inspect_bench
from bench.errors import Aborted
from bench.hidden import parse_hidden
from bench.store import Store, database_url
from bench.toml_file import to_toml, write_atomically
from drivers.clock import WallClock

app = typer.Typer()

HEARTBEAT_S = 2.0  # of the lab's clock
LEAST_BEAT_S = 0.2  # of real time, however fast the lab's clock runs: a busy machine must keep up

BenchFile = Annotated[Path, typer.Argument(metavar="BENCH.toml", help="the instruments of a bench")]


@app.command()
def mock(
    out_file: Annotated[
        Path, typer.Option("--out", help="where the mock instruments' bench.toml goes")
    ] = Path("bench.toml"),
    hide: Annotated[
        list[str] | None,
        typer.Option(
            metavar="EFFECT[=VALUE]", help="an effect that the virtual lab has and nobody is told of"
        ),
    ] = None,
    speed: Annotated[float, typer.Option(help="clock speed of the virtual lab", min=0.01, max=300.0)] = 1.0,
    seed: Annotated[int, typer.Option(help="of the virtual lab's tolerances and noise", min=0)] = 1,
) -> None:
    """Run the mock instruments in the foreground, until interrupted."""
    from drivers.mocks.plant import Plant  # here: a program that runs a real bench loads no mocks
    from drivers.mocks.rack import Rack

    hidden = parse_hidden(hide or [])
    stop = threading.Event()
    with on_signals(stop.set):
        plant = Plant.virtual(seed=seed, hidden=hidden, clock=WallClock(speed))
        with Rack(plant, speed=speed, heartbeat_s=max(HEARTBEAT_S, LEAST_BEAT_S * speed)) as rack:
            text = to_toml(rack.bench_config())
            write_atomically(out_file, text)
            try:
                stamp(virtual=True)
                out.print(f"listening; {escape(str(out_file))} tells where. Ctrl-C ends it.")
                stop.wait()
            finally:
                _remove_own(out_file, text)
    err.print("mock instruments stopped")


def _remove_own(path: Path, text: str) -> None:
    """Remove our file, but not one that another rack has put in its place."""
    if path.is_file() and path.read_text(encoding="utf-8") == text:
        path.unlink()


@app.command()
def check(bench_file: BenchFile) -> None:
    """Connect to all instruments, identify them, compare limits; list every fault."""
    config = read_bench(bench_file)
    stamp(config.virtual)
    found = inspect_bench(config, WallClock(config.speed))
    for name, identity in found.identities.items():
        out.print(escape(f"{name}: {identity} {identity.serial} {identity.firmware}".rstrip()))
    for fault in found.faults:
        err.print(f"[bold red]fault:[/] {escape(fault)}")
    if found.faults:
        raise typer.Exit(1)
    out.print(f"{escape(config.name)}: no faults")


@app.command()
def run(
    campaign_file: Annotated[Path, typer.Argument(metavar="CAMPAIGN.toml", help="what to measure")],
    bench_file: Annotated[Path, typer.Option("--bench", metavar="BENCH.toml", help="the instruments")],
    db: Database = None,
) -> None:
    """Run a campaign; the bench is off when it ends, however it ends."""
    config = read_bench(bench_file)
    job = Job.prepare(read_campaign(campaign_file), config, file=str(campaign_file))
    stamp(config.virtual)
    out.print(escape(job.plan.said()))
    with Store(database_url(db, config.database)) as store, stop_on_signals():
        with live() as progress:
            outcome = run_campaign(job, store, WallClock(config.speed), progress=progress)
        _report(outcome, store)


def _report(outcome: CampaignOutcome, store: Store) -> None:
    out.print(
        f"campaign {outcome.campaign_id} done: {outcome.accepted} rows accepted, "
        f"{outcome.rejected} rejected, {outcome.settled} settled, "
        f"in {duration(outcome.bench_seconds)} of bench time"
    )
    out.print(escape(f"bench: {outcome.power_off}"))
    out.print(escape(f"database: {store.url}"))


@contextmanager
def on_signals(act: Callable[[], None]) -> Iterator[None]:
    """Call ``act`` on Ctrl-C, termination and hang-up of the terminal."""

    def handle(_number: int, _frame: FrameType | None) -> None:
        act()

    signals = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
    before = [signal.signal(number, handle) for number in signals]
    try:
        yield
    finally:
        for number, handler in zip(signals, before, strict=True):
            signal.signal(number, handler)


@contextmanager
def stop_on_signals() -> Iterator[None]:
    """The first signal ends the campaign, which powers off; later ones change nothing."""
    stopping = threading.Event()

    def stop() -> None:
        if not stopping.is_set():
            stopping.set()
            raise Aborted("interrupted by the operator")

    with on_signals(stop):
        yield
