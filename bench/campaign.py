"""The campaign engine: runs a plan on a bench, stores every step, and leaves the bench off.

A campaign and each of its points move along one table of transitions; anything else is an error.
For every point the simulator's prediction is stored before the point is set. Whatever goes wrong, the
power goes off first, then it is recorded, then it is raised.
"""

import time
from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager
from dataclasses import dataclass
from datetime import datetime
from enum import StrEnum

import numpy as np
import pandas as pd

from bench.config import BenchConfig, CampaignConfig, config_hash
from bench.errors import Aborted, BenchUnsafe, OutputLost, StateError
from bench.instruments import Bench, Sample, open_bench
from bench.measure import Measurement, Target, measure, rejected, settle
from bench.plan import Kind, Plan, PlannedPoint, make_plan
from bench.prediction import Asked, Forecast, Predictor, SimulatedConverter
from bench.progress import Progress, Tracker, silent
from bench.safety import PowerOffReport
from bench.store import Provenance, Store, StoredReading
from drivers.clock import Clock

ASK_EVERY_S = 2.0  # of the clock: how often a request of the operator is looked for
WAIT_STEP_S = 5.0  # of the clock: how long a wait goes on before requests are looked for

MOST_LOST = 3  # set points in a row whose output could not be held: then something else is wrong


class State(StrEnum):
    """Where a campaign stands."""

    PLANNED = "planned"
    WAITING = "waiting"  # for its time
    CHECKING = "checking"
    RUNNING = "running"
    PAUSED = "paused"  # bench off, the operator will say when
    DONE = "done"
    ABORTED = "aborted"
    FAILED = "failed"
    UNSAFE = "unsafe"  # ended, and the bench could not be seen off


_ENDS = frozenset({State.ABORTED, State.FAILED, State.UNSAFE})
TRANSITIONS: Mapping[State, frozenset[State]] = {
    State.PLANNED: frozenset({State.WAITING, State.CHECKING}) | _ENDS,
    State.WAITING: frozenset({State.CHECKING}) | _ENDS,
    State.CHECKING: frozenset({State.RUNNING}) | _ENDS,
    State.RUNNING: frozenset({State.PAUSED, State.DONE}) | _ENDS,
    State.PAUSED: frozenset({State.CHECKING}) | _ENDS,
    State.DONE: frozenset(),
    State.ABORTED: frozenset(),
    State.FAILED: frozenset(),
    State.UNSAFE: frozenset(),
}


class PointState(StrEnum):
    """Where a point stands; the order is the only one there is."""

    PREDICTED = "predicted"
    SET = "set"
    SETTLED = "settled"  # or out of time: the row's ``settled`` tells
    MEASURED = "measured"
    ACCEPTED = "accepted"
    REJECTED = "rejected"


@dataclass(frozen=True, slots=True, kw_only=True)
class Job:
    """A campaign, the bench it runs on, its plan, and who predicts."""

    campaign: CampaignConfig
    bench: BenchConfig
    plan: Plan
    predict: Predictor

    @classmethod
    def prepare(
        cls,
        campaign: CampaignConfig,
        bench: BenchConfig,
        *,
        predict: Predictor | None = None,
        file: str = "campaign.toml",
    ) -> "Job":
        """Plan the campaign; InputError names ``file`` and what is wrong with its points."""
        predict = predict or SimulatedConverter.of(bench.converter)
        return cls(
            campaign=campaign,
            bench=bench,
            plan=make_plan(campaign, bench, predict, file=file),
            predict=predict,
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class CampaignOutcome:
    """How a campaign that reached its last point ended."""

    campaign_id: int
    accepted: int
    rejected: int
    settled: int
    power_off: PowerOffReport
    bench_seconds: float  # on the bench's clock
    real_seconds: float


OpenBench = Callable[[BenchConfig, Clock], AbstractContextManager[Bench]]


def run_campaign(
    job: Job,
    store: Store,
    clock: Clock,
    *,
    progress: Callable[[Progress], None] = silent,
    connect: OpenBench = open_bench,
    today: Callable[[], datetime] = datetime.now,
) -> CampaignOutcome:
    """Run ``job`` to its last point; the bench is off when this returns, and when it raises.

    Raises
    ------
    CampaignStopped : a limit was reached, or the operator asked.
    InstrumentError : an instrument, or the link to it, failed.
    BenchUnsafe : the bench could not be seen off; the cause is attached.
    """
    return _Run(job, store, clock, Tracker(job.plan.points, clock, progress)).run(connect, today)


def measurement_table(store: Store, outcome: CampaignOutcome) -> pd.DataFrame:
    """The accepted rows of a campaign as a measurement table."""
    return store.measurement_table(outcome.campaign_id)


class _Run:
    """One run of one job."""

    def __init__(self, job: Job, store: Store, clock: Clock, tracker: Tracker) -> None:
        self.job, self.store, self.clock, self.tracker = job, store, clock, tracker
        self.state = State.PLANNED
        self.start_s = clock.now()
        self.asked_s = -np.inf
        self.request: str | None = None
        self.settled = 0
        self.lost_in_a_row = 0
        self.id = store.create_campaign(
            job.campaign.name,
            Provenance(
                config={
                    "campaign": job.campaign.model_dump(mode="json"),
                    "bench": job.bench.model_dump(mode="json"),
                },
                config_hash=config_hash(job.campaign, job.bench),
                virtual=job.bench.virtual,
            ),
            planned=len(job.plan.points),
            state=self.state,
        )
        store.note(self.id, "plan", detail=job.plan.said())

    # --- the campaign -------------------------------------------------------------------------------

    def run(self, connect: OpenBench, today: Callable[[], datetime]) -> CampaignOutcome:
        started = time.perf_counter()
        try:
            self._wait_for_start(today)
            self._move(State.CHECKING)
            opened = connect(self.job.bench, self.clock)
            with opened as bench:
                report = self._on(bench)
        except BaseException as error:
            if self.state not in _ENDS:  # nothing was switched on
                self._end(_end_state(error), "nothing was switched on", error)
            raise
        return CampaignOutcome(
            campaign_id=self.id,
            accepted=self.tracker.accepted,
            rejected=self.tracker.rejected,
            settled=self.settled,
            power_off=report,
            bench_seconds=self._time_s(),
            real_seconds=time.perf_counter() - started,
        )

    def _on(self, bench: Bench) -> PowerOffReport:
        """Everything between the first contact and the bench seen off."""
        try:
            self._measure_all(bench)
        except BaseException as error:
            self._make_safe(bench, error)
            raise
        report = bench.power_off()
        if not report.safe:
            self._end(State.UNSAFE, str(report), None)
            raise BenchUnsafe(str(report))
        self._end(State.DONE, str(report), None)
        return report

    def _make_safe(self, bench: Bench, error: BaseException) -> None:
        """Power off, then record; what could not be seen off outranks what caused it."""
        report = bench.power_off()
        try:
            self._end(_end_state(error) if report.safe else State.UNSAFE, str(report), error)
        finally:
            if not report.safe:
                raise BenchUnsafe(f"{report}; after: {error}") from error

    def _measure_all(self, bench: Bench) -> None:
        self.store.identify(self.id, bench.check())
        bench.configure()
        forecast = self._forecast(bench.beat().T_ambient_C)
        bench.power_up()
        self._move(State.RUNNING)
        for index, row in enumerate(self.job.plan.points):
            self._attend()
            if self.request == "pause":
                self._pause(bench)
            self._point(bench, row, forecast.row(index))

    def _forecast(self, ambient_C: float) -> Forecast:
        points = self.job.plan.points
        asked = np.array([(row.D1, row.D2, row.power_W) for row in points], dtype=float).reshape(-1, 3)
        D1, D2, power_W = asked.T
        pwm = np.array([row.kind is not Kind.STANDBY for row in points])
        return self.job.predict(Asked(D1=D1, D2=D2, power_W=power_W, ambient_C=ambient_C, pwm=pwm))

    def _wait_for_start(self, today: Callable[[], datetime]) -> None:
        start_at = self.job.campaign.schedule.start_at
        if start_at is None:
            return
        self._move(State.WAITING)
        now = today() if start_at.tzinfo is None else today().astimezone()
        end_s = self.clock.now() + (start_at - now).total_seconds()
        self.tracker.say(f"waiting until {start_at:%Y-%m-%d %H:%M:%S}")
        while (left_s := end_s - self.clock.now()) > 0:
            self._attend()
            self.clock.sleep(min(left_s, WAIT_STEP_S))

    def _pause(self, bench: Bench) -> None:
        """Bench off until the operator lets the campaign go on."""
        report = bench.power_off()
        if not report.safe:
            raise BenchUnsafe(str(report))
        self._move(State.PAUSED, str(report))
        self.tracker.say("paused; the bench is off")
        while self.request == "pause":
            bench.wait(ASK_EVERY_S)
            self._attend()
        self._move(State.CHECKING)
        bench.power_up()
        self._move(State.RUNNING)

    # --- one point ----------------------------------------------------------------------------------

    def _point(self, bench: Bench, row: PlannedPoint, predicted: Mapping[str, float]) -> None:
        point_id = self.store.add_prediction(self.id, row, predicted, time_s=self._time_s())
        self.tracker.begin(row)
        try:
            self._measure_point(bench, row, point_id, predicted["efficiency"])
        except OutputLost as lost:
            self._give_up_point(bench, row, point_id, lost)

    def _give_up_point(self, bench: Bench, row: PlannedPoint, point_id: int, lost: OutputLost) -> None:
        """A set point that the converter cannot hold costs that point, not the night; many in a row do."""
        report = bench.power_off()
        self.store.note(self.id, "output lost", time_s=self._time_s(), detail=f"{lost}; {report}")
        if not report.safe:
            raise BenchUnsafe(str(report)) from lost
        self._advance(point_id, PointState.REJECTED, str(lost))
        self.tracker.finish(row, str(lost), measured=None, predicted=np.nan)
        self.lost_in_a_row += 1
        if self.lost_in_a_row >= MOST_LOST:
            raise lost
        bench.power_up()

    def _measure_point(self, bench: Bench, row: PlannedPoint, point_id: int, predicted: float) -> None:
        job = self.job
        applied = bench.set_point(row)
        self._advance(point_id, PointState.SET)

        def take() -> Sample:
            self._attend()
            return bench.sample()

        settled = settle(take, bench.wait, job.campaign.settling, power_W=job.bench.limits.power_W)
        self._advance(point_id, PointState.SETTLED, settled.said or None)
        measured = measure(take, job.campaign.measure, bench.power_error_limit_W, bench.range_columns())
        duties = {"D1": applied.D1, "D2": applied.D2} if applied else {}
        numbers = self._row_numbers(row, measured) | duties
        self.store.add_reading(
            self.id,
            point_id,
            StoredReading(
                numbers=numbers, settled=settled.ok, quality=measured.quality, samples=measured.samples
            ),
        )
        target = Target(output_voltage_V=job.bench.converter.output_voltage_V, settings=job.campaign.measure)
        reason = rejected(row, numbers, measured.quality, target)
        self._advance(point_id, PointState.REJECTED if reason else PointState.ACCEPTED, reason)
        self.settled += settled.ok
        self.lost_in_a_row = 0
        self.tracker.finish(row, reason, measured=numbers.get("efficiency"), predicted=predicted)

    def _row_numbers(self, row: PlannedPoint, measured: Measurement) -> dict[str, float]:
        numbers = dict(measured.numbers)
        numbers["time_s"] -= self.start_s
        numbers["P_set_W"] = row.power_W
        if row.kind in (Kind.STANDBY, Kind.NO_LOAD):
            for name in ("efficiency", "u_efficiency"):
                numbers.pop(name, None)
        if row.kind is Kind.STANDBY:
            numbers.pop("D0", None)
        return numbers

    def _advance(self, point_id: int, state: PointState, reason: str | None = None) -> None:
        self.store.advance(self.id, point_id, state, time_s=self._time_s(), reason=reason)

    # --- states and requests ------------------------------------------------------------------------

    def _move(self, state: State, detail: str = "") -> None:
        check_transition(self.state, state)
        self.state = state
        self.store.set_state(self.id, state, time_s=self._time_s(), detail=detail)

    def _end(self, state: State, power_off: str, error: BaseException | None) -> None:
        check_transition(self.state, state)
        self.state = state
        said = f"{type(error).__name__}: {error}" if error else None
        self.store.end(self.id, state, power_off=power_off, error=said)

    def _attend(self) -> None:
        """Look for the operator's request; raises Aborted when it is to stop."""
        if self.clock.now() - self.asked_s < ASK_EVERY_S:
            return
        self.asked_s = self.clock.now()
        self.request = self.store.asked(self.id)
        if self.request == "abort":
            raise Aborted("the operator asked the campaign to stop")

    def _time_s(self) -> float:
        return self.clock.now() - self.start_s


def check_transition(old: State, new: State) -> None:
    """Raises StateError when the table does not lead from ``old`` to ``new``."""
    if new not in TRANSITIONS[old]:
        allowed = ", ".join(sorted(TRANSITIONS[old])) or "nothing: it has ended"
        raise StateError(f"a campaign that is {old} cannot become {new}; allowed: {allowed}")


def _end_state(error: BaseException) -> State:
    return State.ABORTED if isinstance(error, Aborted | KeyboardInterrupt) else State.FAILED
