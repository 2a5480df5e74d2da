"""One point of a campaign: set, settled, measured, judged; each step in the ledger before the next one is taken."""

from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass

import numpy as np
from sqlalchemy import RowMapping

from bench.errors import BenchUnsafe, OutputLost, StoreError
from bench.instruments import Bench, Sample
from bench.job import Job, planned
from bench.log import log
from bench.measure import Measurement, Target, measure, rejected, settle
from bench.plan import Kind, PlannedPoint
from bench.progress import Tracker
from bench.reporting import Reporter
from bench.safety import PowerOffReport
from bench.states import PointState
from bench.store import Store, StoredReading
from drivers.errors import InstrumentError, LinkError, ReplyError, SetPointRefused
from drivers.modbus_errors import DeviceBusy

MOST_LOST = 3  # set points in a row that were given up: then something else is wrong
MOST_TRIES = 4  # of one point whose measurement a disturbed link ended
PASSING = (LinkError, ReplyError, DeviceBusy)  # worth another try, once the bench was seen off


@dataclass(frozen=True, slots=True, kw_only=True)
class Campaign:
    """What a point has to know of its campaign."""

    id: int
    job: Job
    store: Store
    tracker: Tracker
    reporter: Reporter
    time_s: Callable[[], float]  # of the campaign
    began_s: float  # of the campaign, on the bench's clock
    attend: Callable[[], None]  # raises Aborted when the operator asks for it

    def note_bench(self, report: PowerOffReport) -> None:
        """How the bench was left: seen off, or UNSAFE."""
        benches, name = self.store.benches, self.job.bench.name
        if report.safe:
            benches.seen_off(name, str(report))
        else:
            benches.latch(name, report.told)

    def power_up(self, bench: Bench) -> None:
        """Switched on, which is in the database before it is done."""
        self.store.benches.energise(self.job.bench.name, self.job.bench.settings())
        bench.power_up()

    def off_in_between(self, bench: Bench, because: Exception | None = None) -> PowerOffReport:
        """Off, and seen off, in the middle of a campaign; ``because`` of what went wrong there, if anything did."""
        report = bench.power_off()
        if not report.safe:
            with suppress(StoreError):  # a bench that is not safe outranks it
                self.store.note(self.id, "not seen off", time_s=self.time_s(), detail=str(report))
            raise BenchUnsafe(report.told) from because
        self.note_bench(report)
        return report


class PointRunner:
    """Measures points on a bench that is switched on; ``session_id`` is their provenance."""

    def __init__(self, campaign: Campaign, session_id: int | None) -> None:
        self._of = campaign
        self._session_id = session_id
        self._lost_in_a_row = 0

    def run(self, bench: Bench, row: PlannedPoint, point_id: int, predicted: float) -> None:
        """Measure a point; a disturbed link costs a try of it, an output that cannot be held the point."""
        self._of.tracker.begin(row)
        disturbed: InstrumentError | None = None
        for attempt in range(1, MOST_TRIES + 1):
            try:
                if disturbed is not None:
                    self._come_back(bench, disturbed)
                self._of.reporter.moment("setting", point_id=point_id)
                self._measure_point(bench, row, point_id, predicted)
                return
            except (OutputLost, SetPointRefused) as given_up:
                self._give_up_point(bench, row, point_id, given_up)
                return
            except PASSING as error:
                if attempt == MOST_TRIES:
                    raise
                self._undo(bench, point_id, error)
                disturbed = error

    def _undo(self, bench: Bench, point_id: int, error: InstrumentError) -> None:
        """Off, and seen off: the point has not happened."""
        report = self._of.off_in_between(bench, error)
        log.warning("point disturbed", extra={"detail": str(error)})
        self._of.reporter.moment("recovering", point_id=point_id, faults=(str(error),))
        self._of.store.note(self._of.id, "disturbed", time_s=self._of.time_s(), detail=f"{error}; {report}")
        self._of.store.plan_again(self._of.id, point_id, time_s=self._of.time_s())

    def _come_back(self, bench: Bench, cause: InstrumentError) -> None:
        """Every link in step again, and the bench on."""
        bench.recover(cause)
        bench.configure()
        self._of.power_up(bench)

    def _give_up_point(
        self, bench: Bench, row: PlannedPoint, point_id: int, because: OutputLost | SetPointRefused
    ) -> None:
        """A set point that the converter cannot hold, or its controller does not take, costs that point, not the night.

        Many in a row do.
        """
        report = self._of.off_in_between(bench, because)
        event = "output lost" if isinstance(because, OutputLost) else "set point refused"
        self._of.store.note(self._of.id, event, time_s=self._of.time_s(), detail=f"{because}; {report}")
        self._advance(point_id, PointState.REJECTED, str(because))
        self._of.tracker.finish(row, str(because), measured=None, predicted=np.nan)
        self._lost_in_a_row += 1
        if self._lost_in_a_row >= MOST_LOST:
            raise because
        self._of.power_up(bench)

    def _measure_point(self, bench: Bench, row: PlannedPoint, point_id: int, predicted: float) -> None:
        job = self._of.job
        applied = bench.set_point(row)
        self._advance(point_id, PointState.SET)

        def take() -> Sample:
            self._of.attend()
            sample = bench.sample()
            self._of.reporter.sampled(sample)
            return sample

        self._of.reporter.phase("settling", point_id)
        settled = settle(
            take,
            lambda seconds: bench.wait(seconds, self._of.attend),
            job.campaign.settling,
            power_W=job.bench.limits.power_W,
            told=self._of.reporter.settles,
        )
        self._advance(point_id, PointState.SETTLED, settled.said or None)
        self._of.reporter.phase("measuring", point_id)
        measured = measure(take, job.campaign.measure, bench.power_error_limit_W, bench.range_columns())
        bench.guard_devices()  # a row counts only if nothing had tripped when it was complete
        duties = {"D1": applied.D1, "D2": applied.D2} if applied else {}
        numbers = self._row_numbers(row, measured) | duties
        reading = StoredReading(
            numbers=numbers,
            settled=settled.ok,
            quality=measured.quality,
            samples=measured.samples,
            session_id=self._session_id,
        )
        self._of.store.add_reading(self._of.id, point_id, reading)
        reason = self.judge(point_id, row, numbers, measured.quality)
        self._lost_in_a_row = 0
        self._of.tracker.finish(row, reason, measured=numbers.get("efficiency"), predicted=predicted)

    def judge_stored(self, row: RowMapping) -> None:
        """Judge a point that was measured when the campaign stopped."""
        reading = self._of.store.stored_reading(row["id"])
        numbers = {key: value for key, value in reading.items() if isinstance(value, float)}
        self.judge(int(row["id"]), planned(row), numbers, str(reading["quality"]))

    def judge(
        self, point_id: int, row: PlannedPoint, numbers: Mapping[str, float], quality: str
    ) -> str | None:
        """Accept the measured row, or reject it for the reason returned."""
        job = self._of.job
        target = Target(output_voltage_V=job.bench.converter.output_voltage_V, settings=job.campaign.measure)
        reason = rejected(row, numbers, quality, target)
        self._advance(point_id, PointState.REJECTED if reason else PointState.ACCEPTED, reason)
        return reason

    def _row_numbers(self, row: PlannedPoint, measured: Measurement) -> dict[str, float]:
        numbers = dict(measured.numbers)
        numbers["time_s"] -= self._of.began_s
        numbers["P_set_W"] = row.power_W
        if row.kind in (Kind.STANDBY, Kind.NO_LOAD):
            for name in ("efficiency", "u_efficiency"):
                numbers.pop(name, None)
        if row.kind is Kind.STANDBY:
            numbers.pop("D0", None)
        return numbers

    def _advance(self, point_id: int, state: PointState, reason: str | None = None) -> None:
        self._of.store.advance(self._of.id, point_id, state, time_s=self._of.time_s(), reason=reason)
