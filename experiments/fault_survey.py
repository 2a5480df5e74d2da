"""A bench that is safe, and loses nothing: what is done to it, and what becomes of it.

A campaign on mock instruments over real ports is killed with ``kill -9`` before, inside and after every transaction
of every row, and at random instants; every scripted fault strikes at every instrument; replies come late at random on
Modbus RTU and on SCPI; random commands go to a bench with random limits; the database fills up, becomes read-only, is
locked, disappears, and its server is stopped; four benches write one PostgreSQL at once.

Numbers that are stored are held against what the made-up plant shows without noise. Everything is seeded; instants of
random kills and the times measured depend on the machine.
"""

import logging
import tempfile
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path

import numpy as np

from experiments.harness.postgresql import Cluster, programs
from experiments.harness.registry import Experiment
from experiments.harness.result import Goal, Result, Table
from experiments.harness.settings import Countdown, Settings
from experiments.survey.databases import (
    FAILURES,
    DatabaseReport,
    PointTimes,
    SharedReport,
    benches_at_once,
    failing_file,
    stopped_server,
    time_per_point,
)
from experiments.survey.faulted import FaultReport, Script, perform, scripts
from experiments.survey.kills import KillReport, kill_at, kill_at_any_instant, places, undisturbed
from experiments.survey.late import LateReport, late_on_rtu, late_on_scpi
from experiments.survey.limits import Commanded, commanded

KILL_SEEDS = (101, 102, 103)
KILL_POINTS = 3  # with standby, no load and references: seven rows of twelve places each
RANDOM_KILLS = 20
ROUNDS = 4  # of every script, on as many seeds
STRIKES = 40
LATE_EXCHANGES = 10_000
TIMED_POINTS = 200
RANDOM_COMMANDS, RANDOM_BENCHES = 300, 20
BENCHES, BENCH_POINTS = 4, 20
MOST_MS = 20.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Survey:
    """All that was found; ``shared`` is None where PostgreSQL is missing."""

    kills: list[KillReport]
    faults: list[FaultReport]
    late: list[LateReport]
    wild: list[Commanded]
    times: PointTimes
    databases: list[DatabaseReport]
    shared: SharedReport | None


def run(settings: Settings) -> Result:
    """All of it; a smaller scale takes a seeded share of every row."""
    logging.getLogger("d2ea").setLevel(logging.CRITICAL)  # what goes wrong here is meant to
    logging.getLogger("pymodbus").setLevel(logging.CRITICAL)
    settings.out.mkdir(parents=True, exist_ok=True)
    countdown = Countdown(7, settings)
    kills = _kills(settings)
    countdown.finished(f"{sum(report.kills for report in kills)} kills")
    faults = _faults(settings)
    countdown.finished(f"{sum(report.struck for report in faults)} faulted exchanges")
    exchanges = settings.thinned(LATE_EXCHANGES)
    late = [late_on_rtu(exchanges, 5), late_on_scpi(exchanges, 6)]
    countdown.finished("late replies")
    wild = [commanded(RANDOM_COMMANDS, 900 + k) for k in range(settings.thinned(RANDOM_BENCHES))]
    countdown.finished("random commands")
    with tempfile.TemporaryDirectory(dir=settings.out, prefix="databases-") as name:
        times = time_per_point(f"sqlite:///{name}/timed.sqlite", settings.thinned(TIMED_POINTS), 1)
        countdown.finished("time per point")
        failed = [
            failing_file(kind, Path(name) / f"{kind}.sqlite", after=60 + 7 * k, seed=3 + k)
            for k, kind in enumerate(FAILURES)
        ]
    countdown.finished("databases that fail")
    stopped, shared, kills_there = _postgresql(settings)
    countdown.finished("PostgreSQL")
    found = Survey(
        kills=kills + kills_there,
        faults=faults,
        late=late,
        wild=wild,
        times=times,
        databases=failed + stopped,
        shared=shared,
    )
    return Result(
        virtual=True,
        goals=tuple(_goals(found, settings)),
        tables=(
            _kill_table(found.kills),
            _fault_table(found.faults),
            _late_table(found.late),
            _database_table(found.databases),
        ),
        notes=tuple(_notes(found)),
    )


# --- the parts --------------------------------------------------------------------------------------------


def _kills(settings: Settings) -> list[KillReport]:
    found = []
    for seed in KILL_SEEDS:
        reference = undisturbed(KILL_POINTS, seed)
        wanted = places(len(reference), share=settings.scale, seed=seed)
        found.append(kill_at(wanted, reference, url="", points=KILL_POINTS, seed=seed))
    often = settings.thinned(RANDOM_KILLS)
    found.append(kill_at_any_instant(often, reference, url="", points=KILL_POINTS, seed=seed))
    return found


def _faults(settings: Settings) -> list[FaultReport]:
    every = list(scripts())
    rng = np.random.default_rng(17)
    if settings.scale < 1.0:
        every = [every[k] for k in sorted(rng.permutation(len(every))[: settings.thinned(len(every))])]
    rounds = settings.thinned(ROUNDS)
    jobs = [(script, 11 + k) for k in range(rounds) for script in every]
    with ProcessPoolExecutor(2 * settings.processes, mp_context=get_context("forkserver")) as pool:
        return list(pool.map(_perform, jobs))


def _perform(what: tuple[Script, int]) -> FaultReport:
    logging.getLogger("d2ea").setLevel(logging.CRITICAL)
    logging.getLogger("pymodbus").setLevel(logging.CRITICAL)
    script, seed = what
    return perform(script, strikes=STRIKES, seed=seed)


def _postgresql(settings: Settings) -> tuple[list[DatabaseReport], SharedReport | None, list[KillReport]]:
    if (bin := programs()) is None:
        return [], None, []
    seed = KILL_SEEDS[0]
    reference = undisturbed(KILL_POINTS, seed)
    wanted = places(len(reference), share=0.3 * settings.scale, seed=seed + 1)
    with Cluster(bin) as cluster:
        shared = benches_at_once(cluster.new_schema(), benches=BENCHES, points=settings.thinned(BENCH_POINTS))
        url = cluster.new_schema()
        killed = kill_at(wanted, reference, url=url, points=KILL_POINTS, seed=seed)
        return [stopped_server(cluster, seed=9)], shared, [killed]


# --- goals and tables -------------------------------------------------------------------------------------


def _goals(found: Survey, settings: Settings) -> Iterator[Goal]:
    """Bars that count work are those of the share that was done."""
    kills, faults, times = found.kills, found.faults, found.times
    number = sum(report.kills for report in kills)
    yield _least("kill -9, in all", number, settings.thinned(200))
    identical = sum(report.good for report in kills)
    yield _least(f"killed campaigns identical to an undisturbed one (of {len(kills)})", identical, len(kills))
    wrong_rows = sum(report.lost + report.doubled for report in kills)
    yield _most("rows lost or doubled by kills", wrong_rows, 0)
    off = sum(report.off_in_time for report in kills)
    yield _least("kills after which the converter was off in the heartbeat time", off, number)
    yield _least("different faults scripted", len({report.name for report in faults}), settings.thinned(25))
    good = sum(report.good for report in faults)
    yield _least(f"completed, or stopped safe with the cause named (of {len(faults)})", good, len(faults))
    yield _least("faulted exchanges", sum(report.struck for report in faults), settings.thinned(1000))
    yield _most("wrong numbers stored", sum(len(report.wrong) for report in faults), 0)
    yield _most("trips that were not latched", sum(report.latched is False for report in faults), 0)
    for report in found.late:
        yield _least(
            f"exchanges with late replies, {report.wire}", report.exchanges, settings.thinned(LATE_EXCHANGES)
        )
        yield _most(f"misattributed, {report.wire}", report.misattributed, 0)
    yield _most("commands outside the limits on a wire", sum(len(seen.beyond) for seen in found.wild), 0)
    yield _most("own time per point, 95th percentile, wall", _p95(times.wall_ms), MOST_MS, "ms")
    yield _most("own time per point, 95th percentile, processor", _p95(times.processor_ms), MOST_MS, "ms")
    fine, databases = sum(report.good for report in found.databases), len(found.databases)
    yield _least(f"databases that failed: stopped safe, resumed (of {databases})", fine, databases)
    yield _least("ways in which a database failed", databases, len(FAILURES) + (found.shared is not None))
    if found.shared is not None:
        yield _least("benches that wrote one PostgreSQL at once, all rows there", found.shared.done, BENCHES)


def _least(name: str, value: float, bar: float) -> Goal:
    return Goal(name=name, value=float(value), bar=float(bar), at_least=True)


def _most(name: str, value: float, bar: float, unit: str = "") -> Goal:
    return Goal(name=name, value=float(value), bar=float(bar), at_least=False, unit=unit)


def _p95(values: list[float]) -> float:
    return float(np.percentile(values, 95))


def _kill_table(kills: list[KillReport]) -> Table:
    columns = ("kills", "off in time", "rows", "lost", "doubled", "identical", "seen off", "unexpected")
    rows = tuple(
        (
            k.kills,
            k.off_in_time,
            k.rows,
            k.lost,
            k.doubled,
            k.identical,
            k.seen_off,
            "; ".join(k.unexpected) or None,
        )
        for k in kills
    )
    return Table(title="Campaigns that were killed", columns=columns, rows=rows)


def _fault_table(faults: list[FaultReport]) -> Table:
    columns = ("fault", "struck", "became", "rows", "wrong", "off", "latched", "good", "cause")
    rows = tuple(
        (
            f.name,
            f.struck,
            f.outcome,
            f.rows,
            len(f.wrong),
            f.truly_off,
            f.latched,
            f.good,
            f.cause[:90] or None,
        )
        for f in faults
    )
    return Table(title="Scripted faults", columns=columns, rows=rows)


def _late_table(late: list[LateReport]) -> Table:
    columns = ("wire", "exchanges", "late replies", "no answer", "misattributed")
    rows = tuple((r.wire, r.exchanges, r.late, r.missing, r.misattributed) for r in late)
    return Table(title="Late replies", columns=columns, rows=rows)


def _database_table(databases: list[DatabaseReport]) -> Table:
    columns = ("what failed", "stopped", "bench off", "rows then", "rows in the end", "planned", "said")
    rows = tuple(
        (d.failure, d.stopped, d.off, d.rows_before, d.rows_after, d.planned, d.said[:90]) for d in databases
    )
    return Table(title="Databases that fail", columns=columns, rows=rows)


def _notes(found: Survey) -> Iterator[str]:
    times, wild, shared = found.times, found.wild, found.shared
    yield (
        f"own time per point, median: {np.median(times.wall_ms):.1f} ms wall, "
        f"{np.median(times.processor_ms):.1f} ms processor; four durable commits a point; one page forced to this disk "
        f"takes {np.median(times.disk_ms):.1f} ms, {_p95(times.disk_ms):.1f} ms at the 95th percentile, by itself"
    )
    yield f"{sum(seen.seen for seen in wild)} commands seen on the wires of {len(wild)} benches with random limits"
    if shared is None:
        yield "PostgreSQL is not installed here: its rows are missing"
    else:
        yield (
            f"{shared.benches} benches stored {shared.rows} of {shared.wanted} rows in one PostgreSQL beside "
            f"{shared.reads} reads of all of it, the slowest {shared.slowest_read_ms:.0f} ms"
        )


EXPERIMENT = Experiment(
    title="Fault survey: kills, faults, late replies, limits, databases", run=run, apart=True
)
