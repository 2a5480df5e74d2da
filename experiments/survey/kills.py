"""kill -9 at every transition of every point, inside the store, and at any instant: what is left, and what comes after.

The mock bench lives in this process, the campaign in another one that is killed. A clock that both share stands still
at the kill; then it is stepped by the heartbeat time, and the converter must be off.
"""

import multiprocessing
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from multiprocessing.process import BaseProcess
from pathlib import Path

import numpy as np
import pandas as pd

from bench.store import BenchState, Store
from drivers.clock import SharedStepClock
from drivers.mocks.controller import MISSED_BEATS
from drivers.mocks.rack import Rack
from experiments.survey.campaign import bench_of, campaign
from experiments.survey.child import STEPS, WHERE, Orders, Place, live
from experiments.survey.steady_plant import Row, SteadyPlant

TOO_LONG_S = 120.0
KILLED = -9


@dataclass(slots=True)
class KillReport:
    """What became of one campaign that was killed again and again."""

    kills: int = 0
    off_in_time: int = 0
    unexpected: list[str] = field(default_factory=list)
    rows: int = 0
    lost: int = 0
    doubled: int = 0
    identical: bool = False
    seen_off: bool = False

    @property
    def good(self) -> bool:
        """Nothing lost, doubled or changed, and off in time every time."""
        return (
            self.identical
            and self.seen_off
            and not (self.lost or self.doubled or self.unexpected)
            and self.off_in_time == self.kills
        )


class KillBench:
    """A mock bench with a shared clock, a database, and a campaign that can be started and killed."""

    def __init__(self, folder: Path, *, url: str, points: int, seed: int) -> None:
        self.url = url
        self._clock_file = folder / "clock"
        self.clock = SharedStepClock(self._clock_file)
        self._reader = Store(url)
        self.plant = SteadyPlant(self.clock, seed=seed, row=self._row)
        self.rack = Rack(self.plant).start()
        self._campaign = campaign(points, seed).model_dump(mode="json")
        self._context = multiprocessing.get_context("forkserver")
        self._context.set_forkserver_preload(["experiments.survey.child"])

    def close(self) -> None:
        """End the mock instruments."""
        self.rack.stop()
        self._reader.close()
        self.clock.close()

    def start(self, place: Place | None = None) -> BaseProcess:
        """A new process that begins or resumes the campaign."""
        orders = Orders(
            url=self.url,
            clock=self._clock_file,
            campaign=self._campaign,
            bench=bench_of(self.rack).model_dump(mode="json"),
            place=place,
        )
        process = self._context.Process(target=live, args=(orders,), daemon=True)
        process.start()
        return process

    def converter_off_within_heartbeat(self) -> bool:
        """Let the heartbeat time pass for the lab, and look whether the PWM is off."""
        self.clock.sleep(MISSED_BEATS * self.rack.heartbeat_s + 0.5)
        self.rack.controller.tick()
        return not self.plant.setting.pwm

    def table(self) -> pd.DataFrame:
        """What was accepted, times apart."""
        return self._reader.measurement_table(1).drop(columns="time_s", errors="ignore")

    def judge(self, report: KillReport, undisturbed: pd.DataFrame) -> None:
        """Compare the finished campaign with one that nobody killed."""
        table = self.table()
        keys = table[["point", "repeat"]].value_counts()
        wanted = set(undisturbed[["point", "repeat"]].itertuples(index=False, name=None))
        found = set(table[["point", "repeat"]].itertuples(index=False, name=None))
        report.rows = len(table)
        report.lost = len(wanted - found)
        report.doubled = int((keys > 1).sum())
        report.identical = table.equals(undisturbed)
        report.seen_off = self.plant.off and self._reader.benches.all()[0].state is BenchState.OFF

    def _row(self) -> Row:
        """The row that is measured now: the first in the ledger that is not finished."""
        rows = self._reader.unfinished(1)
        return (int(rows[0]["point"]), int(rows[0]["repeat"])) if rows else (0, 0)


def undisturbed(points: int, seed: int) -> pd.DataFrame:
    """The table of the same campaign, run once and left in peace."""
    with tempfile.TemporaryDirectory(prefix="d2ea-kills-") as name:
        bench = KillBench(Path(name), url=f"sqlite:///{name}/x.sqlite", points=points, seed=seed)
        try:
            process = bench.start()
            process.join(TOO_LONG_S)
            if process.exitcode != 0:
                raise RuntimeError(f"the undisturbed campaign ended with {process.exitcode}")
            return bench.table()
        finally:
            bench.close()


def places(rows: int, *, share: float, seed: int) -> list[Place]:
    """Every place of every row, in order; or a seeded share of them."""
    every = [Place(position=p, step=s, where=w) for p in range(rows) for s in STEPS for w in WHERE]
    chosen = np.random.default_rng(seed).random(len(every)) < share
    return [place for place, is_chosen in zip(every, chosen, strict=True) if is_chosen]


def kill_at(
    wanted: Sequence[Place], reference: pd.DataFrame, *, url: str, points: int, seed: int
) -> KillReport:
    """Kill one campaign at each place in turn, resume it every time, and let it finish."""
    report = KillReport()
    with tempfile.TemporaryDirectory(prefix="d2ea-kills-") as name:
        bench = KillBench(Path(name), url=url or f"sqlite:///{name}/x.sqlite", points=points, seed=seed)
        try:
            for place in wanted:
                process = bench.start(place)
                process.join(TOO_LONG_S)
                _count(report, bench, process, str(place))
            _finish(report, bench, reference)
        finally:
            bench.close()
    return report


def kill_at_any_instant(
    kills: int, reference: pd.DataFrame, *, url: str, points: int, seed: int
) -> KillReport:
    """Kill one campaign after random times, until it has been killed so often or has come to its end."""
    report, rng = KillReport(), np.random.default_rng([seed, 9])
    with tempfile.TemporaryDirectory(prefix="d2ea-kills-") as name:
        bench = KillBench(Path(name), url=url or f"sqlite:///{name}/x.sqlite", points=points, seed=seed)
        try:
            for k in range(kills):
                process = bench.start()
                process.join(float(rng.uniform(0.02, 0.4)))
                if process.exitcode == 0:
                    break
                process.kill()
                process.join()
                _count(report, bench, process, f"random kill {k}")
            _finish(report, bench, reference)
        finally:
            bench.close()
    return report


def _count(report: KillReport, bench: KillBench, process: BaseProcess, where: str) -> None:
    if process.exitcode != KILLED:
        report.unexpected.append(f"{where}: ended with {process.exitcode}")
        return
    report.kills += 1
    if bench.converter_off_within_heartbeat():
        report.off_in_time += 1
    else:
        report.unexpected.append(f"not off in the heartbeat time after a kill at {where}")


def _finish(report: KillReport, bench: KillBench, reference: pd.DataFrame) -> None:
    started = time.monotonic()
    process = bench.start()
    process.join(TOO_LONG_S)
    if process.exitcode != 0:
        report.unexpected.append(f"last run: {process.exitcode} after {time.monotonic() - started:.1f} s")
    bench.judge(report, reference)
