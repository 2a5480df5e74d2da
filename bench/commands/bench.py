"""Verbs that touch a bench: mock, check, run, resume, clear."""

import signal
import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING, Annotated

import typer
from rich.markup import escape

from bench.campaign import Surroundings, resume_campaign, run_campaign
from bench.commands.live import live
from bench.commands.options import Database
from bench.commands.streams import err, out, stamp
from bench.config import BenchConfig, CampaignConfig, read_bench, read_campaign
from bench.config import check as check_settings
from bench.connect import acknowledge_alarms, inspect_bench
from bench.errors import BenchUnsafe, InputError, Interrupted, Problem, StateError
from bench.hidden import parse_hidden
from bench.instruments import open_bench
from bench.job import CampaignOutcome, Job
from bench.leftovers import switch_off_leftovers
from bench.spy import FileSpy, file_spy
from bench.states import STOPPED
from bench.store import BenchRow, BenchState, Row, Store, database_url, how_to_name
from bench.toml_file import read_toml, to_toml
from bench.whole_file import write_whole
from bench.wording import counted, duration
from drivers.clock import WallClock

if TYPE_CHECKING:
    from drivers.mocks.faults import FaultFile

app = typer.Typer()

HEARTBEAT_S = 2.0  # of the lab's clock
LEAST_BEAT_S = 0.2  # of real time, however fast the lab's clock runs: a busy machine must keep up

BenchFile = Annotated[Path, typer.Argument(metavar="BENCH.toml", help="the instruments of a bench")]


FaultOption = Annotated[
    Path | None, typer.Option("--fault", metavar="FILE", help="what goes wrong, and when (TOML)")
]


def faults_in(path: Path | None) -> "FaultFile":
    """The faults of a file; none without one."""
    from bench.rehearsal import read_faults  # here: a program that runs a real bench loads no mocks
    from drivers.mocks.faults import NO_FAULTS

    return NO_FAULTS if path is None else read_faults(path)


@app.command()
def mock(
    out_file: Annotated[
        Path, typer.Option("--out", help="where the mock instruments' bench.toml goes")
    ] = Path("bench.toml"),
    hide: Annotated[
        list[str] | None,
        typer.Option(
            metavar="EFFECT[=VALUE]",
            help="an effect, or a foreign family, that the virtual lab has and nobody is told of; may be repeated",
        ),
    ] = None,
    speed: Annotated[float, typer.Option(help="clock speed of the virtual lab", min=0.01, max=300.0)] = 1.0,
    seed: Annotated[int, typer.Option(help="of the virtual lab's tolerances and noise", min=0)] = 1,
    fault: FaultOption = None,
) -> None:
    """Run the mock instruments in the foreground, until interrupted."""
    from drivers.mocks.plant import Plant  # here: a program that runs a real bench loads no mocks
    from drivers.mocks.rack import Rack

    _refuse_to_replace(out_file)
    hidden = parse_hidden(hide or [], foreign=True)
    faults = faults_in(fault)
    stop = threading.Event()
    with on_signals(stop.set):
        plant = Plant.virtual(seed=seed, hidden=hidden, clock=WallClock(speed))
        beat_s = max(HEARTBEAT_S, LEAST_BEAT_S * speed)
        with Rack(plant, speed=speed, heartbeat_s=beat_s, faults=faults) as rack:
            text = to_toml(rack.bench_config())
            write_whole(out_file, text)
            try:
                stamp(virtual=True)
                out.print(f"listening; {escape(str(out_file))} tells where. Ctrl-C ends it.")
                stop.wait()
            finally:
                _remove_own(out_file, text)
    err.print("mock instruments stopped")


def _refuse_to_replace(path: Path) -> None:
    """InputError for the file of a bench on hardware, or of mock instruments that still listen."""
    if not path.exists():
        return
    there = read_toml(path)
    analyzer = there.get("analyzer")
    port = Path(str(analyzer.get("resource"))) if isinstance(analyzer, dict) else None
    if there.get("virtual") is not True:
        whose = "there is a file of that name, and not of mock instruments"
    elif port is not None and port.exists():
        whose = "mock instruments that still run wrote that file"
    else:  # left behind by some that are gone
        return
    raise InputError.of("command line", "--out", str(path), f"{whose}; name another one")


def _remove_own(path: Path, text: str) -> None:
    """Remove our file, but not one that another rack has put in its place."""
    if path.is_file() and path.read_text(encoding="utf-8") == text:
        path.unlink()


@app.command()
def check(
    bench_file: BenchFile,
    acknowledge: Annotated[
        bool, typer.Option("--acknowledge", help="first clear alarms of supply and load whose cause is gone")
    ] = False,
) -> None:
    """Connect to all instruments, identify them, compare limits; list every fault."""
    config = read_bench(bench_file)
    stamp(config.virtual)
    for alarm in acknowledge_alarms(config, WallClock(config.speed)) if acknowledge else ():
        out.print(escape(f"acknowledged: {alarm}"))
    found = inspect_bench(config, WallClock(config.speed))
    for name, identity in found.identities.items():
        out.print(escape(f"{name}: {identity} {identity.serial} {identity.firmware}".rstrip()))
    for fault in found.faults:
        err.print(f"[bold red]fault:[/] {escape(fault)}")
    if found.faults:
        raise typer.Exit(1)
    out.print(f"{escape(config.name)}: no faults")


Spied = Annotated[
    Path | None, typer.Option("--spy", metavar="FILE", help="write every byte on every wire to this file")
]


@app.command()
def run(
    campaign_file: Annotated[Path, typer.Argument(metavar="CAMPAIGN.toml", help="what to measure")],
    bench_file: Annotated[Path, typer.Option("--bench", metavar="BENCH.toml", help="the instruments")],
    spy: Spied = None,
    rehearse: Annotated[
        bool, typer.Option("--rehearse", help="on mock instruments, under the bench's limits; keeps nothing")
    ] = False,
    fault: FaultOption = None,
    db: Database = None,
) -> None:
    """Run a campaign; the bench is off when it ends, however it ends."""
    config = read_bench(bench_file)
    if rehearse:
        _refuse_beside_rehearse({"--spy": spy, "--db": db})
        _rehearse(read_campaign(campaign_file), config, fault, str(bench_file))
        return
    if fault is not None:
        raise InputError.of(
            "command line", "--fault", str(fault), "faults are for --rehearse and for d2ea mock"
        )
    with Store(database_url(db, config.database)) as store, stop_on_signals():
        store.benches.refuse(config.name)
        job = Job.prepare(
            read_campaign(campaign_file), config, file=str(campaign_file), bench_file=str(bench_file)
        )
        stamp(config.virtual)
        out.print(escape(job.plan.said()))
        with live() as progress, file_spy(spy) as spies:
            outcome = run_campaign(
                job, store, WallClock(config.speed), progress=progress, around=_around(spies)
            )
        _report(outcome)
        _tell_database(store, None if db else config.database)


def _refuse_beside_rehearse(options: Mapping[str, object]) -> None:
    """InputError for options that a rehearsal would ignore; their values may hold a password and are not said."""
    allowed = (
        "not with --rehearse, which speaks to mock instruments and keeps nothing: leave one of the two out"
    )
    given = [option for option, value in options.items() if value is not None]
    if given:
        problems = [Problem(file="command line", field=name, value=None, allowed=allowed) for name in given]
        raise InputError(problems)


def _rehearse(campaign: CampaignConfig, config: BenchConfig, fault: Path | None, bench_file: str) -> None:
    from bench.rehearsal import rehearse  # here: a program that runs a real bench loads no mocks

    stamp(virtual=True)
    with live() as progress, stop_on_signals():
        went = rehearse(campaign, config, faults_in(fault), progress=progress, bench_file=bench_file)
    for struck in went.struck:
        what = f"{struck.fault.kind} at the {struck.fault.instrument}"
        out.print(escape(f"fault: {what}, exchange {struck.exchange}"))
    out.print(f"{went.accepted} of {went.planned} rows accepted, {went.rejected} rejected")
    out.print(escape(f"bench: {went.power_off}"))
    if went.error is not None:
        raise went.error
    out.print("the rehearsal reached its last point; nothing of it is kept")


@app.command()
def resume(
    campaign_id: Annotated[
        int | None, typer.Argument(metavar="[CAMPAIGN_ID]", min=1, help="else the newest that can go on")
    ] = None,
    bench_file: Annotated[
        Path | None,
        typer.Option(
            "--bench", metavar="BENCH.toml", help="where its instruments are now, if they have moved"
        ),
    ] = None,
    spy: Spied = None,
    db: Database = None,
) -> None:
    """Let a campaign go on: one that is paused, or one that stopped or died, from where the ledger stands."""
    config = None if bench_file is None else read_bench(bench_file)
    with Store(database_url(db, config.database if config else None)) as store, stop_on_signals():
        row = _resumable(store, campaign_id)
        if row["is_live"]:
            store.ask(row["id"], None)
            out.print(f"asked campaign {row['id']}: it goes on")
            return
        job = Job.stored(store, row, bench=config)
        stamp(row["virtual"])
        done = row["accepted"] + row["rejected"]
        out.print(f"campaign {row['id']} was {row['shown']}; {done} of {row['planned']} rows are done")
        clock = WallClock(job.bench.speed)
        with live() as progress, file_spy(spy) as spies:
            outcome = resume_campaign(
                row["id"], store, clock, job=job, progress=progress, around=_around(spies)
            )
        _report(outcome)
        _tell_database(store, None if db or config is None else config.database)


def _resumable(store: Store, campaign_id: int | None) -> Row:
    if campaign_id is not None:
        return store.campaign(campaign_id)
    waiting = [row for row in store.campaigns() if row["shown"] in STOPPED or row["request"] == "pause"]
    if not waiting:
        raise StateError("no campaign here is paused or stopped: there is nothing to resume")
    return waiting[-1]


def _around(spies: FileSpy | None) -> Surroundings:
    return Surroundings() if spies is None else Surroundings(connect=partial(open_bench, spy_of=spies))


@app.command()
def clear(
    bench_name: Annotated[
        str | None, typer.Argument(metavar="[BENCH]", help="name of the bench; else the only one to clear")
    ] = None,
    bench_file: Annotated[
        Path | None,
        typer.Option(
            "--bench", metavar="BENCH.toml", help="where its instruments are now, if they have moved"
        ),
    ] = None,
    seen_off: Annotated[
        bool,
        typer.Option(
            "--seen-off", help="you have seen with your own eyes that what cannot be reached is off"
        ),
    ] = False,
    db: Database = None,
) -> None:
    """Acknowledge UNSAFE: switch off and read back what can be reached, then let the bench be used again."""
    given = None if bench_file is None else read_bench(bench_file)
    with Store(database_url(db, given.database if given else None)) as store:
        bench = _to_clear(store, bench_name)
        config = given or check_settings(bench.config, BenchConfig, file=f"bench {bench.name}")
        stamp(config.virtual)
        report = switch_off_leftovers(config, WallClock(config.speed))
        out.print(escape(f"bench {bench.name!r}: {report.told}"))
        if not report.safe and not seen_off:
            raise BenchUnsafe(
                "not everything could be read back as off, so nothing is cleared; look at the bench, and say "
                "--seen-off once you have seen that it is"
            )
        said = str(report) if report.safe else f"seen off by the operator; {report}"
        store.benches.clear(bench.name, said)
    out.print(escape(f"bench {bench.name!r} is cleared"))


def _to_clear(store: Store, name: str | None) -> BenchRow:
    known = store.benches.all()
    wanted = [
        bench
        for bench in known
        if bench.state in (BenchState.UNSAFE, BenchState.UNCONFIRMED) and name in (None, bench.name)
    ]
    if len(wanted) == 1:
        return wanted[0]
    states = ", ".join(f"{bench.name!r} is {bench.state}" for bench in known) or "no bench is known here"
    what = "several benches are to be cleared: name one" if wanted else "there is nothing to clear"
    raise StateError(f"{what}; {states}")


def _report(outcome: CampaignOutcome) -> None:
    out.print(
        f"campaign {outcome.campaign_id} done: {counted(outcome.accepted, 'row')} accepted, "
        f"{outcome.rejected} rejected, {outcome.settled} settled, "
        f"in {duration(outcome.bench_seconds)} of bench time"
    )
    out.print(escape(f"bench: {outcome.power_off}"))


def _tell_database(store: Store, by_bench: str | None) -> None:
    """Where the rows are; and, where the bench's own key chose that, how other commands find them."""
    named = how_to_name(by_bench) if by_bench else ""
    looks = f"; d2ea status{named} looks into it" if named else ""
    out.print(escape(f"database: {store.url}{looks}"))


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
            raise Interrupted("interrupted by the operator")

    with on_signals(stop):
        yield
