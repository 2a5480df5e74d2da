"""The bench software's own time per point, databases that fail in the middle of a run, and benches that share one."""

import multiprocessing
import os
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

from sqlalchemy.engine import make_url

from bench.campaign import resume_campaign, run_campaign
from bench.errors import StoreError
from bench.job import Job
from bench.progress import Progress
from bench.states import State
from bench.store import Store
from bench.store.failures import Failures
from experiments.harness.postgresql import Cluster
from experiments.survey.campaign import campaign, predict
from experiments.survey.instant import InstantBench, instant_bench

FAILURES = ("disk_full", "read_only", "locked", "gone")
LOCKED_S = 7.0  # longer than the store waits for a lock
TOO_LONG_S = 120.0


@dataclass(frozen=True, slots=True, kw_only=True)
class PointTimes:
    """Wall and processor time of each point, in milliseconds, durable commits included."""

    wall_ms: list[float]
    processor_ms: list[float]
    disk_ms: list[float]  # of a small write that is forced to the same disk, nothing else


def time_per_point(url: str, points: int, seed: int) -> PointTimes:
    """Run a campaign on instruments that take no time, and time it from point to point."""
    marks: list[tuple[float, float]] = []

    def mark(progress: Progress) -> None:
        if progress.said == "accepted":
            marks.append((time.perf_counter(), time.process_time()))

    bench = InstantBench(seed)
    job = Job.prepare(campaign(points, seed), instant_bench("timed"), predict=predict)
    with Store(url) as store:
        run_campaign(job, store, bench.clock, around=bench.around(), progress=mark)
    pairs = list(pairwise(marks))
    return PointTimes(
        wall_ms=[1e3 * (b[0] - a[0]) for a, b in pairs],
        processor_ms=[1e3 * (b[1] - a[1]) for a, b in pairs],
        disk_ms=_forced_writes(url, len(pairs)),
    )


def _forced_writes(url: str, count: int) -> list[float]:
    """How long the disk under a database takes for a page, in milliseconds."""
    file = Path(make_url(url).database or "x").with_suffix(".probe")
    taken = []
    with file.open("wb") as probe:
        for _ in range(count):
            began = time.perf_counter()
            probe.write(bytes(4096))
            probe.flush()
            os.fdatasync(probe.fileno())
            taken.append(1e3 * (time.perf_counter() - began))
    file.unlink()
    return taken


@dataclass(frozen=True, slots=True, kw_only=True)
class DatabaseReport:
    """What became of a campaign whose database failed."""

    failure: str
    stopped: bool
    off: bool
    said: str
    rows_before: int
    rows_after: int
    planned: int

    @property
    def good(self) -> bool:
        """Stopped, off, said so, and complete after it was resumed."""
        return self.stopped and self.off and bool(self.said) and self.rows_after == self.planned


def failing_file(kind: str, file: Path, *, after: int, seed: int, points: int = 6) -> DatabaseReport:
    """A SQLite database that fails so many transactions into a run, is healed, and the campaign resumed."""
    with Store(f"sqlite:///{file}") as store:
        failures = Failures(store.database)
        failures.after(after, kind, LOCKED_S)
        return _interrupted(kind, store, failures.heal, seed=seed, points=points)


def stopped_server(cluster: Cluster, *, seed: int, points: int = 6) -> DatabaseReport:
    """A PostgreSQL server that stops in the middle of a run, and is started again."""
    with Store(cluster.new_schema()) as store:
        return _interrupted(
            "server stopped", store, cluster.start, seed=seed, points=points, at_row=(4, cluster.stop)
        )


def _interrupted(
    failure: str,
    store: Store,
    heal: Callable[[], None],
    *,
    seed: int,
    points: int,
    at_row: tuple[int, Callable[[], None]] | None = None,
) -> DatabaseReport:
    bench = InstantBench(seed)
    job = Job.prepare(campaign(points, seed), instant_bench("failing"), predict=predict)

    def watch(progress: Progress) -> None:
        if at_row and progress.done == at_row[0] and progress.said == "accepted":
            at_row[1]()

    said = ""
    try:
        run_campaign(job, store, bench.clock, around=bench.around(), progress=watch)
    except StoreError as error:
        said = str(error)
    off = bench.off
    heal()
    before = store.campaign(1)
    if before["shown"] is not State.DONE:
        stored = Job.stored(store, before, predict=predict)
        resume_campaign(1, store, bench.clock, job=stored, around=bench.around())
    after = store.campaign(1)
    return DatabaseReport(
        failure=failure,
        stopped=bool(said),
        off=off,
        said=said,
        rows_before=before["accepted"],
        rows_after=after["accepted"],
        planned=after["planned"],
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class SharedReport:
    """Benches that wrote one database at once, and a reader beside them."""

    benches: int
    done: int
    rows: int
    wanted: int
    reads: int
    slowest_read_ms: float


def write_as_one_of_many(url: str, name: str, points: int, seed: int) -> None:
    """One bench of several, in a process of its own."""
    bench = InstantBench(seed)
    job = Job.prepare(campaign(points, seed), instant_bench(name), predict=predict)
    with Store(url) as store:
        run_campaign(job, store, bench.clock, around=bench.around())


def benches_at_once(url: str, *, benches: int, points: int) -> SharedReport:
    """So many benches at once, and a reader that reads all of it all the time."""
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload(["experiments.survey.databases"])
    with Store(url) as store:
        processes = [
            context.Process(target=write_as_one_of_many, args=(url, f"bench {k}", points, k), daemon=True)
            for k in range(benches)
        ]
        for process in processes:
            process.start()
        reads: list[float] = []
        until = time.monotonic() + TOO_LONG_S
        while any(process.is_alive() for process in processes) and time.monotonic() < until:
            began = time.perf_counter()
            for row in store.campaigns():
                store.measurement_table(row["id"])
            reads.append(1e3 * (time.perf_counter() - began))
            threading.Event().wait(0.01)
        for process in processes:
            process.join(TOO_LONG_S)
        rows = store.campaigns()
        return SharedReport(
            benches=benches,
            done=sum(row["shown"] is State.DONE for row in rows),
            rows=sum(row["accepted"] for row in rows),
            wanted=sum(row["planned"] for row in rows),
            reads=len(reads),
            slowest_read_ms=max(reads, default=0.0),
        )
