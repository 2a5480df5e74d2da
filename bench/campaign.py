"""The campaign engine: runs a plan on a bench, stores every step, and leaves the bench off.

A campaign and each of its points move along one table of transitions (``bench.states``); anything else is an
error. For every point the simulator's prediction is stored before the point is set. Whatever goes wrong, the power
goes off first, then it is recorded, then it is raised. A campaign that stopped, however it stopped, goes on from
the ledger: what was accepted or rejected stays, what had begun is measured anew. Where a plan grows, its next points
are in the ledger, with why, before any of them is set; while they are chosen, the bench's heartbeat goes on.
"""

from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager, suppress
from dataclasses import dataclass
from datetime import datetime

import numpy as np
import pandas as pd
from sqlalchemy import RowMapping

from bench.beside import beside
from bench.config import BenchConfig
from bench.errors import Aborted, BenchUnsafe, CampaignStopped, StateError, StoreError, named
from bench.growth import Growth, Think
from bench.instruments import Bench, open_bench
from bench.job import CampaignOutcome, Job, planned
from bench.leftovers import switch_off_leftovers
from bench.log import about, log
from bench.plan import Kind
from bench.point import Campaign, PointRunner
from bench.prediction import Asked
from bench.process import Owner
from bench.progress import Progress, Tracker, silent
from bench.reporting import Reporter
from bench.safety import PowerOffReport
from bench.states import STOPPED, State, check_transition
from bench.store import BenchState, Row, Session, Store
from drivers.clock import Clock

ASK_EVERY_S = 0.5  # of the clock: how often a request of the operator is looked for
WAIT_STEP_S = 5.0  # of the clock: how long a wait goes on before requests are looked for

OFF_TRIES = 3  # a signal may interrupt a power-off; it is then begun again

__all__ = ["CampaignOutcome", "Job", "measurement_table", "resume_campaign", "run_campaign"]

OpenBench = Callable[[BenchConfig, Clock], AbstractContextManager[Bench]]


@dataclass(frozen=True, slots=True, kw_only=True)
class Surroundings:
    """How to reach the bench, how to switch it off when nobody runs it, what day it is, where long work is done.

    ``listens`` tells whether the operator may have asked for something since: on a clock that runs ahead of him, not at
    each of its seconds.
    """

    connect: OpenBench = open_bench
    make_safe: Callable[[BenchConfig, Clock], PowerOffReport] = switch_off_leftovers
    today: Callable[[], datetime] = datetime.now
    think: Think = beside
    listens: Callable[[], bool] = lambda: True


REAL = Surroundings()


def run_campaign(
    job: Job,
    store: Store,
    clock: Clock,
    *,
    progress: Callable[[Progress], None] = silent,
    around: Surroundings = REAL,
    key: str | None = None,
) -> CampaignOutcome:
    """Run ``job`` to its last point; the bench is off when this returns, and when it raises.

    A campaign asked for under a ``key`` is made once: asked for again, it goes on where it stopped.

    Raises
    ------
    CampaignStopped, InstrumentError, StoreError : ended early, and the bench was seen off.
    BenchTaken : another campaign has the bench; nothing was switched.
    BenchUnsafe : some part of the bench could not be seen off, or UNSAFE is latched.
    """
    store.benches.refuse(job.bench.name)
    campaign_id = store.create_campaign(
        job.campaign.name, job.provenance(key), job.plan.points, said=job.plan.said()
    )
    if store.campaign(campaign_id)["shown"] is not State.PLANNED:
        stored = Job.stored(store, store.campaign(campaign_id), bench=job.bench, predict=job.predict)
        return resume_campaign(campaign_id, store, clock, job=stored, progress=progress, around=around)
    tracker = Tracker(job.plan, progress)
    return _Run(job, store, clock, campaign_id, tracker, around).run(State.PLANNED)


def resume_campaign(
    campaign_id: int,
    store: Store,
    clock: Clock,
    *,
    job: Job | None = None,
    progress: Callable[[Progress], None] = silent,
    around: Surroundings = REAL,
) -> CampaignOutcome:
    """Let a campaign that stopped go on from the ledger; raises as ``run_campaign``, and StateError.

    ``job`` is that of ``Job.stored``, by default with the settings of before.
    """
    row = store.campaign(campaign_id)
    if row["shown"] not in STOPPED and not _forsaken(store, row):
        raise StateError(f"campaign {campaign_id} is {row['shown']}: there is nothing to resume")
    job = job or Job.stored(store, row)
    store.benches.refuse(job.bench.name, campaign_id)
    tracker = Tracker(job.plan, progress)
    run = _Run(job, store, clock, campaign_id, tracker, around)
    run.take_over(State(row["state"]))
    return run.run(State.CHECKING)


_RUNNING: set[tuple[str, int]] = set()  # campaigns that this process runs now, by database


def _forsaken(store: Store, row: Row) -> bool:
    """Whether this process ran the campaign and does so no more: its database failed at the end."""
    mine = Owner.stored(row) == Owner.here()
    return bool(row["is_live"]) and mine and (store.url, row["id"]) not in _RUNNING


def measurement_table(store: Store, outcome: CampaignOutcome) -> pd.DataFrame:
    """The accepted rows of a campaign as a measurement table."""
    return store.measurement_table(outcome.campaign_id)


class _Run:
    """One run of one job, from its start or from where it stopped."""

    def __init__(
        self, job: Job, store: Store, clock: Clock, campaign_id: int, tracker: Tracker, around: Surroundings
    ) -> None:
        self.job, self.store, self.clock, self.id = job, store, clock, campaign_id
        self.tracker, self.around = tracker, around
        self.owner = Owner.here()
        self.state = State.PLANNED
        self.before_s = store.time_s(campaign_id)  # campaign time of earlier sessions
        self.start_s = clock.now()
        self.asked_s = -np.inf
        self.request: str | None = None
        self.session_id: int | None = None
        self.reporter = Reporter(store, campaign_id, self._time_s)
        self.campaign = Campaign(
            id=campaign_id,
            job=job,
            store=store,
            tracker=tracker,
            reporter=self.reporter,
            time_s=self._time_s,
            began_s=self.start_s - self.before_s,
            attend=self._attend,
        )

    def take_over(self, stored: State) -> None:
        """Make a stopped campaign our own; rows that were measured and not judged are judged now."""
        check_transition(State.INTERRUPTED if stored not in STOPPED else stored, State.CHECKING)
        judge = PointRunner(self.campaign, None)
        for row in self.store.take_over(self.id, stored, owner=self.owner):
            judge.judge_stored(row)
        counts = self.store.campaign(self.id)
        self.tracker.accepted, self.tracker.rejected = counts["accepted"], counts["rejected"]

    # --- the campaign -------------------------------------------------------------------------------

    def run(self, state: State) -> CampaignOutcome:
        self.state = state
        mark = (self.store.url, self.id)
        _RUNNING.add(mark)
        try:
            with about(campaign=self.id):
                self._begin_session()
                self._wait_for_start()
                if self.state is not State.CHECKING:
                    self._move(State.CHECKING)
                report = self._owning_the_bench()
        except BaseException as error:
            if self.state in (State.PLANNED, State.WAITING, State.CHECKING):  # nothing was switched on
                with suppress(StoreError):  # the error that comes first is the one to tell
                    self._end(_end_state(error), "nothing was switched on", error)
            raise
        finally:
            _RUNNING.discard(mark)
        return CampaignOutcome(
            campaign_id=self.id,
            accepted=self.tracker.accepted,
            rejected=self.tracker.rejected,
            settled=self.store.settled(self.id),
            power_off=report,
            bench_seconds=self.clock.now() - self.start_s,
        )

    def _begin_session(self) -> None:
        job = self.job
        session = Session(
            campaign_id=self.id,
            seed=job.campaign.seed,
            config_hash=job.provenance().config_hash,
            bench=job.bench.settings(),
            offset_s=self.before_s,
        )
        self.session_id = self.store.begin_session(session, owner=self.owner)

    def _owning_the_bench(self) -> PowerOffReport:
        """Nobody else may switch this bench while we do; what a dead campaign left on goes off first."""
        config, benches = self.job.bench, self.store.benches
        found = benches.take(config.name, virtual=config.virtual, campaign_id=self.id, owner=self.owner)
        try:
            if found is not None and found.state in (BenchState.UNCONFIRMED, BenchState.ON):
                self._switch_off_leftovers()
            with self.around.connect(config, self.clock) as bench:
                return self._on(bench)
        finally:
            with suppress(StoreError):  # then it stays ours until this process ends
                benches.release(config.name, self.id)

    def _switch_off_leftovers(self) -> None:
        report = self.around.make_safe(self.job.bench, self.clock)
        self.store.note(self.id, "left on by a campaign that died", time_s=self._time_s(), detail=str(report))
        self.campaign.note_bench(report)
        if not report.safe:
            self._end(State.UNSAFE, report.told, None)
            raise BenchUnsafe(report.told)

    def _on(self, bench: Bench) -> PowerOffReport:
        """Everything between the first contact and the bench seen off."""
        error: BaseException | None = None
        try:
            self._measure_all(bench)
        except BaseException as raised:  # noqa: BLE001  the safety layer: made safe, recorded, raised again
            error = raised
        report = _seen_off(bench)
        if report.safe and isinstance(error, BenchUnsafe):  # in the middle; by now it was seen off after all
            first = "; ".join(str(error).splitlines())
            error = CampaignStopped(f"the bench was seen off only at the second go: {first}")
        with suppress(StoreError):  # a screen that cannot be told hides nothing that follows
            faults = (str(error),) if error else ()
            self.reporter.moment("off" if report.safe else "unsafe", faults=faults)
        if not report.safe:
            # the report itself is no cause
            cause = error.__cause__ if isinstance(error, BenchUnsafe) else error
            said = f"{report.told}\nafter: {named(cause)}" if cause else report.told
            self._record_end(report, State.UNSAFE, cause, BenchUnsafe(said))
        elif error is not None:
            self._record_end(report, _end_state(error), error, error)
        else:
            self._record_end(report, State.DONE, None, None)
        return report

    def _record_end(
        self,
        report: PowerOffReport,
        state: State,
        error: BaseException | None,
        raised: BaseException | None,
    ) -> None:
        """Write how it ended, then raise what there is to raise: a database that fails hides nothing."""
        try:
            self.campaign.note_bench(report)
            self._end(state, report.told, error)
        except StoreError as lost:
            said = f"the bench was seen off ({report}), but that could not be recorded: {lost}"
            log.error("end of campaign not recorded", extra={"detail": str(lost)})
            self.state = state
            if report.safe:
                raise StoreError(f"{said}; before that: {error}" if error else said) from (error or lost)
        if raised is not None:
            raise raised from (error if raised is not error else error.__cause__ if error else None)

    def _measure_all(self, bench: Bench) -> None:
        self.reporter.attach(bench.links)
        self.reporter.moment("checking")
        assert self.session_id is not None
        self.store.identify(self.id, self.session_id, bench.check())
        bench.configure()
        rows: Sequence[RowMapping] = self.store.unfinished(self.id)
        predicted = self._predictions(rows, bench.beat().T_ambient_C)
        self.campaign.power_up(bench)
        self._move(State.RUNNING)
        points = PointRunner(self.campaign, self.session_id)
        growth = Growth(of=self.campaign, think=self.around.think)
        while True:
            for row in rows:
                self._attend()
                if self.request == "pause":
                    self._pause(bench)
                with about(point=row["point"]):
                    points.run(bench, planned(row), int(row["id"]), predicted[row["id"]])
            if not (rows := growth.next_rows(bench)):
                return
            predicted = self._predictions(rows, bench.beat().T_ambient_C)

    def _predictions(self, rows: Sequence[RowMapping], ambient_C: float) -> dict[int, float]:
        """Predicted efficiency by point id; points that have none yet are simulated, and stored."""
        waiting = [row for row in rows if not row["predicted"]]
        if waiting:
            points = [planned(row) for row in waiting]
            asked = np.array([(row.D1, row.D2, row.power_W) for row in points], dtype=float).reshape(-1, 3)
            D1, D2, power_W = asked.T
            pwm = np.array([row.kind is not Kind.STANDBY for row in points])
            forecast = self.job.predict(Asked(D1=D1, D2=D2, power_W=power_W, ambient_C=ambient_C, pwm=pwm))
            fresh = {row["id"]: forecast.row(k) for k, row in enumerate(waiting)}
            self.store.predict(self.id, fresh, time_s=self._time_s())
        else:
            fresh = {}
        known = {row["id"]: fresh.get(row["id"], row["predicted"]) for row in rows}
        return {key: _number(columns["efficiency"]) for key, columns in known.items()}

    def _wait_for_start(self) -> None:
        start_at = self.job.campaign.schedule.start_at
        if start_at is None or self.state is not State.PLANNED:
            return
        self._move(State.WAITING)
        today = self.around.today
        now = today() if start_at.tzinfo is None else today().astimezone()
        end_s = self.clock.now() + (start_at - now).total_seconds()
        self.tracker.say(f"waiting until {start_at:%Y-%m-%d %H:%M:%S}")
        while (left_s := end_s - self.clock.now()) > 0:
            self._attend()
            self.reporter.moment("waiting")
            self.clock.sleep(min(left_s, WAIT_STEP_S))

    def _pause(self, bench: Bench) -> None:
        """Bench off until the operator lets the campaign go on."""
        report = self.campaign.off_in_between(bench)
        self._move(State.PAUSED, str(report))
        self.tracker.say("paused; the bench is off")
        while self.request == "pause":
            self.reporter.moment("paused")
            bench.wait(ASK_EVERY_S)
            self._attend()
        self._move(State.CHECKING)
        self.campaign.power_up(bench)
        self._move(State.RUNNING)

    # --- states and requests ------------------------------------------------------------------------

    def _move(self, state: State, detail: str = "") -> None:
        check_transition(self.state, state)
        self.store.move(self.id, self.state, state, time_s=self._time_s(), detail=detail)
        self.state = state

    def _end(self, state: State, power_off: str, error: BaseException | None) -> None:
        check_transition(self.state, state)
        said = named(error) if error else None
        self.store.end(self.id, state, power_off=power_off, error=said, time_s=self._time_s())
        self.state = state

    def _attend(self) -> None:
        """Look for the operator's request; raises Aborted when it is to stop."""
        if self.clock.now() - self.asked_s < ASK_EVERY_S or not self.around.listens():
            return
        self.asked_s = self.clock.now()
        self.request = self.store.asked(self.id)
        if self.request == "abort":
            raise Aborted("the operator asked the campaign to stop")

    def _time_s(self) -> float:
        return self.before_s + self.clock.now() - self.start_s


def _seen_off(bench: Bench) -> PowerOffReport:
    """Power off, to the end: an interruption in the middle of it begins it again."""
    for attempt in range(OFF_TRIES):
        try:
            return bench.power_off()
        except (Aborted, KeyboardInterrupt):
            if attempt == OFF_TRIES - 1:
                raise
    raise AssertionError("unreachable")


def _number(value: float | None) -> float:
    return np.nan if value is None else float(value)


def _end_state(error: BaseException) -> State:
    return State.ABORTED if isinstance(error, Aborted | KeyboardInterrupt) else State.FAILED
