"""Every scripted fault at every instrument, one campaign each: it completes, or stops safe with the cause named.

Whatever happens, no number that is stored as a measurement may be wrong: each is held against what the plant shows
without noise at the row's own set point.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import pandas as pd

from bench.campaign import run_campaign
from bench.errors import BenchError, BenchUnsafe
from bench.store import BenchState, Store
from drivers.clock import StepClock
from drivers.errors import InstrumentError
from drivers.mocks.fault_kinds import KINDS, WIRES
from drivers.mocks.faults import Fault, FaultFile
from drivers.mocks.rack import Rack
from experiments.survey.campaign import job
from experiments.survey.steady_plant import NOISE, Setting, SteadyPlant, truth
from models.screening import LOADED_KINDS

CODES = (1, 2, 3, 4, 6)
ALARMS = {"supply": ("OVP", "OCP", "OT"), "load": ("OVP", "OCP", "OPP", "OT")}
TRIPS = ("heatsink_overtemperature", "overcurrent")
LATCHED = frozenset({"trip", "heartbeat_lost"})
MUST_STOP = LATCHED | {"local", "clip"}
RHYTHM = {"analyzer": (120, 97), "supply": (40, 41), "load": (45, 61), "controller": (30, 23)}
# exchanges that go well first, so that the bench is on; then one of so many is struck: not every try of a point
SIGMAS = 6.0  # of one update: thousands of numbers are looked at, and each is the mean of four updates
ROUNDING = 6e-6  # relative: analyzers tell six digits


@dataclass(frozen=True, slots=True, kw_only=True)
class Script:
    """One fault at one instrument, struck again and again."""

    instrument: str
    kind: str
    value: int | str | None = None

    @property
    def name(self) -> str:
        """For tables."""
        what = f"{self.kind} {self.value}" if self.value is not None else self.kind
        return f"{what} at the {self.instrument}"

    def faults(self, strikes: int) -> FaultFile:
        """The file: after the bench is up, every few exchanges, so often."""
        lasting = self.kind in MUST_STOP
        after, every = RHYTHM[self.instrument]
        fault = Fault(
            instrument=self.instrument,
            kind=self.kind,
            value=self.value,
            after=after,
            every=every,
            count=1 if lasting else strikes,
            seconds=0.2,
        )
        return FaultFile(seed=7, fault=[fault])


@dataclass(frozen=True, slots=True, kw_only=True)
class FaultReport:
    """What became of a campaign with one script."""

    name: str
    struck: int
    outcome: str  # completed, stopped, or unsafe
    cause: str
    rows: int
    wrong: tuple[str, ...]
    truly_off: bool
    said_off: bool
    latched: bool | None  # None where nothing latches

    @property
    def good(self) -> bool:
        """Completed or stopped safe, with the cause named, nothing wrong stored, and every trip latched."""
        ended = self.outcome == "completed" or (self.outcome == "stopped" and bool(self.cause))
        honest = self.truly_off == self.said_off
        return (
            ended
            and honest
            and self.truly_off
            and not self.wrong
            and self.latched is not False
            and self.struck > 0
        )


def scripts() -> Iterator[Script]:
    """Every kind at every instrument where it can happen."""
    for instrument, wires in WIRES.items():
        for kind, entry in KINDS.items():
            if not entry.wires & wires:
                continue
            for value in _values(instrument, kind):
                yield Script(instrument=instrument, kind=kind, value=value)


def _values(instrument: str, kind: str) -> tuple[int | str | None, ...]:
    if kind == "exception":
        return CODES
    if kind == "trip":
        return ALARMS.get(instrument, TRIPS)
    return (None,)


def perform(script: Script, *, strikes: int, points: int = 10, seed: int = 11) -> FaultReport:
    """Run one campaign with the fault, on mock instruments over real wires."""
    clock = StepClock()
    plant = SteadyPlant(clock, seed=seed, row=lambda: (0, 0))
    with Rack(plant, faults=script.faults(strikes)) as rack, Store("sqlite://") as store:
        outcome, cause = "completed", ""
        try:
            run_campaign(job(rack, points=points, seed=seed), store, clock)
        except BenchUnsafe as error:
            outcome, cause = "unsafe", "; ".join(str(error).splitlines())
        except (BenchError, InstrumentError) as error:
            outcome, cause = "stopped", f"{type(error).__name__}: {error}"
        rows = store.measurement_table(1)
        return FaultReport(
            name=script.name,
            struck=len(rack.injectors[script.instrument].struck),
            outcome=outcome,
            cause=cause,
            rows=len(rows),
            wrong=tuple(wrong_numbers(rows)),
            truly_off=plant.off,
            said_off=store.benches.all()[0].state is BenchState.OFF,
            latched=_latched(script, rack, store),
        )


def _latched(script: Script, rack: Rack, store: Store) -> bool | None:
    """Whether a trip stopped the campaign and still stands in the instrument."""
    if script.kind not in LATCHED:
        return None
    stopped = bool(store.campaign(1)["state"] == "failed")
    if script.instrument == "controller":
        return stopped
    panel = rack.supply if script.instrument == "supply" else rack.load
    return bool(stopped and script.value in panel.alarms)


def wrong_numbers(table: pd.DataFrame) -> Iterator[str]:
    """Measured numbers of accepted rows that are not what the plant shows there."""
    for row in table.to_dict(orient="records"):
        loaded = row["kind"] in LOADED_KINDS
        setting = Setting(
            supply_on=True,
            supply_V=300.0,
            load_on=loaded,
            load_W=float(row["P_set_W"]) if loaded else 0.0,
            pwm=row["kind"] != "standby",
            D1=float(row["D1"]) if loaded else 0.0,
            D2=float(row["D2"]) if loaded else 0.0,
        )
        for column, right in expected(setting).items():
            got = row.get(column)
            allowed = (SIGMAS * NOISE + ROUNDING + LOAD_COUNTS) * abs(right) + 1e-9
            if got is None or not abs(float(got) - right) <= allowed:
                yield f"{row['kind']} {row['point']}: {column} = {got}, not {right:.6g}"


LOAD_COUNTS = 3500.0 / 0xCCCC / 300.0  # the load takes its set point in counts of its nominal power


def expected(setting: Setting) -> dict[str, float]:
    """Columns of the measurement table at a setting, without noise."""
    shown = truth(setting)
    columns = {
        f"{q}{n}": f"{c}{n}_{unit}"
        for n in (1, 2)
        for q, c, unit in (("U", "V", "V"), ("I", "I", "A"), ("P", "P", "W"))
    }
    found = {column: shown[item] for item, column in columns.items()}
    return found | {"P_link1_W": shown["P3"], "P_link2_W": shown["P4"], "I_L_rms_A": shown["I3"]}
