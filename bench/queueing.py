"""Runs the campaigns of a queue, one after the other, when their time has come and their bench is free.

A campaign that a dead worker left behind goes on from its ledger. A bench that is in use is tried again later; one that
is UNSAFE ends the work, since nothing may be switched on there before an operator has cleared it.
"""

from collections.abc import Callable
from dataclasses import dataclass
from datetime import UTC, datetime

from bench.campaign import REAL, Surroundings, run_campaign
from bench.config import BenchConfig, CampaignConfig, check
from bench.errors import Aborted, BenchError, BenchTaken, BenchUnsafe, StoreError
from bench.job import Job
from bench.prediction import Predictor
from bench.progress import Progress, silent
from bench.store import Entry, Store
from bench.wording import counted
from drivers.clock import Clock, WallClock
from drivers.errors import InstrumentError

POLL_S = 5.0  # real time between two looks into the queue


def utc_now() -> datetime:
    """Now."""
    return datetime.now(UTC)


@dataclass(frozen=True, slots=True, kw_only=True)
class Worker:
    """Whose queue, whose benches (all, or one by name), and what it is handed."""

    store: Store
    bench: str | None = None
    now: Callable[[], datetime] = utc_now
    clock_of: Callable[[BenchConfig], Clock] = lambda config: WallClock(config.speed)
    say: Callable[[str], None] = lambda _: None
    progress: Callable[[Progress], None] = silent
    around: Surroundings = REAL
    predict: Predictor | None = None

    def run_due(self) -> int:
        """Run every entry that is due now; returns how many were run."""
        done = 0
        for entry in self.store.queue.due(self.now(), self.bench):
            try:
                said, ok, campaign_id = self._run(entry)
            except BenchTaken as taken:
                self.say(f"entry {entry.id} {entry.name!r} waits: {taken}")
                continue
            self.store.queue.finish(entry, now=self.now(), said=said, ok=ok, campaign_id=campaign_id)
            self.say(f"entry {entry.id} {entry.name!r}: {said}")
            done += 1
        return done

    def work(self, sleep: Callable[[float], None], *, until_empty: bool = False) -> None:
        """Run what is due, wait, and look again; for ever, or until nothing waits any more."""
        while True:
            self.run_due()
            if until_empty and not any(entry.state == "waiting" for entry in self.store.queue.all()):
                return
            sleep(POLL_S)

    def _run(self, entry: Entry) -> tuple[str, bool, int | None]:
        """What became of one run: in words, whether it was done, and its campaign."""
        where = f"queue entry {entry.id}"
        try:
            bench = check(entry.bench_config, BenchConfig, file=where)
            campaign = check(entry.campaign_config, CampaignConfig, file=where)
            job = Job.prepare(
                campaign, bench, predict=self.predict, file=where, bench_file=f"bench of {where}"
            )
            self.say(f"entry {entry.id} {entry.name!r} begins")
            clock = self.clock_of(bench)
            outcome = run_campaign(
                job, self.store, clock, progress=self.progress, around=self.around, key=entry.key
            )
        except (BenchTaken, BenchUnsafe, Aborted, StoreError):
            raise
        except (BenchError, InstrumentError) as error:
            return f"failed: {error}", False, None
        return f"done: {counted(outcome.accepted, 'row')} accepted", True, outcome.campaign_id
