"""The instruments of one bench as a whole: sampled together, switched in a safe order.

Not every modulation carries every power, small ones included. So the bench starts, and changes the power,
at one modulation that carries all of them (``converter.start_D1`` and ``start_D2``), and goes from there to
the one asked for at the power asked for: the converter is never asked for what it cannot do on the way.
"""

import math
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace

from bench.config import BenchConfig
from bench.connect import CLEARED_BY_ARMING, BenchFaults, Inspection, Instruments, SpyOf, open_instruments
from bench.errors import LimitReached, OutputLost
from bench.leftovers import off_steps
from bench.plan import Kind, PlannedPoint
from bench.safety import Decision, Limits, PowerOffReport, Readings, decide, power_off
from bench.spy import log_of
from bench.store.live import LinkReport
from bench.wiring import analyzer_columns
from drivers.clock import Clock
from drivers.controller import Applied, Telemetry
from drivers.errors import IdentityError, InstrumentError, LimitError, LinkTimeout, ReplyError
from drivers.reading import Quality, Reading

PATIENCE = 4  # further updates asked for when one carries no data: two of a range change, and a spare
START_UP_S = 5.0  # within this the supply, then the controller, must have brought its voltage up
START_UP_STEP_S = 0.5
REACHED = 0.9  # of the target: the PWM may go on, then the output carries load, from here on
ATTEND_EVERY_S = 0.5  # of the clock: how long an operator waits to be heard at most
HEADROOM = 1.25  # of the load's current at full power and target voltage
BEATS_TRIED = 3  # the controller trips after four that it missed
DEVICES_EVERY_S = 10.0  # of the clock: supply and load are asked for their states at least so often
RECOVER_STEP_S = 0.5  # of real time, as for all that has to do with plugs
NAMES = ("analyzer", "supply", "load", "controller")
TEMPERATURES = ("T_ambient_C", "T_heatsink_C", "T_transformer_C", "T_inductor_C")


@dataclass(frozen=True, slots=True, kw_only=True)
class Sample:
    """One analyzer update and the telemetry beside it, as columns of the measurement table."""

    time_s: float
    values: dict[str, float]
    quality: Quality = Quality.GOOD

    @property
    def efficiency(self) -> float:
        """P2/P1; NaN where one of them is missing or no power flows in."""
        P1_W, P2_W = self.values.get("P1_W", math.nan), self.values.get("P2_W", math.nan)
        return P2_W / P1_W if P1_W > 0 else math.nan


class Bench:
    """All instruments of a bench that is open."""

    def __init__(
        self, config: BenchConfig, instruments: Instruments, clock: Clock, inspection: Inspection
    ) -> None:
        self.config = config
        self.clock = clock
        self._inspection = inspection
        self._limits = Limits.of(config.limits, config.converter)
        self._of = instruments
        self._columns = analyzer_columns(config)
        self._power_W = 0.0  # what the load draws; 0 while it is off
        self._pwm = False
        self._powered = False
        self._input_V = math.nan  # of the last sample
        self._tripped: Decision | None = None  # latched: what was not safe once stays so for this bench
        self._devices_asked_s = -math.inf
        self._last_read_s: dict[str, float] = {}

    @property
    def instruments(self) -> Instruments:
        """The instruments themselves; they refuse what is outside the bench's limits, too."""
        return self._of

    # --- before anything is switched on -----------------------------------------------------------

    def check(self) -> dict[str, str]:
        """Who the instruments are; BenchFaults lists everything that speaks against using them."""
        if self._inspection.faults:
            raise BenchFaults(self._inspection.faults)
        return {
            name: " ".join(part for part in (str(identity), identity.serial, identity.firmware) if part)
            for name, identity in self._inspection.identities.items()
        }

    def configure(self) -> None:
        """Tell the analyzer what to measure."""
        analyzer, wiring = self.config.analyzer, self.config.analyzer.wiring
        links = {element for element in (wiring.link1, wiring.link2) if element is not None}
        self._of.analyzer.configure(
            list(self._columns),
            analyzer.update_s,
            analyzer.ranges,
            ac_elements=links,
            scaled=analyzer.scaled,
        )

    # --- reading ----------------------------------------------------------------------------------

    def beat(self) -> Telemetry:
        """One heartbeat, and what the controller says to it; a beat may be said again, so it is."""
        for attempt in range(1, BEATS_TRIED + 1):
            try:
                telemetry = self._of.controller.heartbeat()
                break
            except (LinkTimeout, ReplyError):
                if attempt == BEATS_TRIED:
                    raise
        self._last_read_s["controller"] = self.clock.now()
        return telemetry

    def links(self) -> dict[str, LinkReport]:
        """How every instrument's link does; ages are against the bench's clock."""
        now = self.clock.now()
        return {name: self._link(name, now) for name in NAMES}

    def _link(self, name: str, now: float) -> LinkReport:
        instrument = getattr(self._of, name)
        health, read_s = instrument.health, self._last_read_s.get(name)
        return LinkReport(
            resource=instrument.resource,
            age_s=None if read_s is None else now - read_s,
            exchanges=health.exchanges,
            failures=health.failures,
            last_error=health.last_error,
        )

    def wait(self, seconds: float, attend: Callable[[], None] = lambda: None) -> None:
        """Let ``seconds`` pass on the bench's clock with the heartbeat kept up; ``attend`` is called meanwhile."""
        end_s = beat_s = self.clock.now()
        end_s += seconds
        while (left_s := end_s - self.clock.now()) > 0:
            self.clock.sleep(min(left_s, ATTEND_EVERY_S, self.config.controller.heartbeat_s))
            attend()
            if self.clock.now() - beat_s >= self.config.controller.heartbeat_s or self.clock.now() >= end_s:
                self.beat()
                beat_s = self.clock.now()

    def sample(self) -> Sample:
        """A fresh update of every channel; LimitReached when it is outside the limits, or incomplete."""
        readings = self._fresh_readings()
        self._last_read_s["analyzer"] = self.clock.now()
        telemetry = self.beat()
        values = {column: _value(readings.get(item)) for item, column in self._columns.items()}
        values["D0"] = telemetry.D0
        values |= {column: getattr(telemetry, column) for column in TEMPERATURES}
        self._guard(values, telemetry)
        self._input_V = values["V1_V"]
        qualities = [reading.quality for reading in readings.values()]
        worst = next((quality for quality in qualities if quality is not Quality.GOOD), Quality.GOOD)
        return Sample(time_s=self.clock.now(), values=values, quality=worst)

    def range_columns(self) -> dict[str, float]:
        """The dc ports' ranges in use, as columns of the measurement table."""
        ranges, wiring = self._of.analyzer.ranges(), self.config.analyzer.wiring
        return {
            f"range_{quantity}{port}_{unit}": ranges[f"{quantity}{element}"]
            for port, element in ((1, wiring.input), (2, wiring.output))
            for quantity, unit in (("U", "V"), ("I", "A"))
        }

    def power_error_limit_W(self, power_W: float, range_W: float) -> float:
        """The analyzer's limit of error of a dc power on a range."""
        return self._of.analyzer.model.error_limit("P", "dc", power_W, range_W)

    def _fresh_readings(self) -> dict[str, Reading]:
        """An update in which every item has data; after some patience, one as it comes."""
        readings: dict[str, Reading] = {}
        for attempt in range(PATIENCE + 1):
            try:
                readings = self._of.analyzer.read()
            except (LinkTimeout, ReplyError):
                if attempt == PATIENCE:
                    raise
            if readings and all(reading.good for reading in readings.values()):
                break
            self.beat()
        return readings

    def guard_devices(self) -> None:
        """LimitReached when supply or load has tripped, or somebody has taken it to local control."""
        if faults := self._device_faults():
            self._trip(Decision(reasons=tuple(f"fault reported: {fault}" for fault in faults)))

    def _device_faults(self) -> tuple[str, ...]:
        """What the states of supply and load say against going on."""
        self._devices_asked_s = self.clock.now()
        found = []
        for name, expected in (("supply", self._powered), ("load", self._power_W > 0.0)):
            state = getattr(self._of, name).state()
            self._last_read_s[name] = self.clock.now()
            found += [f"{name} {alarm}" for alarm in state.alarms]
            if self._powered and not state.remote:
                found.append(f"{name} is under local control (someone pressed LOCAL)")
            if expected and not state.on:
                found.append(f"{name} is off and should be on")
        return tuple(found)

    def _guard(self, values: dict[str, float], telemetry: Telemetry) -> None:
        ignored = frozenset() if self._pwm else CLEARED_BY_ARMING
        faults = tuple(fault for fault in telemetry.faults if fault not in ignored)
        if self.clock.now() - self._devices_asked_s >= DEVICES_EVERY_S:
            faults += self._device_faults()
        readings = Readings(values=values, faults=faults, pwm_on=telemetry.pwm_on, pwm_expected=self._pwm)
        decision = decide(self._limits, readings)
        if decision.output_lost:  # because the supply or the load has gone?
            decision = decide(self._limits, replace(readings, faults=faults + self._device_faults()))
        if not decision.safe:
            self._trip(decision)

    def _trip(self, decision: Decision) -> None:
        reasons = "; ".join(decision.reasons) + self._too_fast(decision)
        if decision.output_lost:
            raise OutputLost(reasons)
        self._tripped = decision
        raise LimitReached(reasons)

    def _too_fast(self, decision: Decision) -> str:
        """What to do where a virtual bench's clock outran the machine that it runs on; else empty."""
        if self.config.speed == 1.0 or not any("heartbeat_lost" in reason for reason in decision.reasons):
            return ""
        return (
            f"; the bench's clock runs {self.config.speed:g} times as fast as real time, and the machine did not "
            "keep up: start d2ea mock again with a lower --speed, then d2ea resume the campaign"
        )

    def _refuse_when_tripped(self) -> None:
        if self._tripped is not None:
            raise LimitReached(f"tripped before, and latched: {'; '.join(self._tripped.reasons)}")

    # --- switching --------------------------------------------------------------------------------

    def power_up(self) -> None:
        """Supply on at its voltage, load ready and off, controller armed with the PWM off."""
        config, supply, load = self.config, self._of.supply, self._of.load
        self._refuse_when_tripped()
        self.sample()  # within the limits before anything is armed
        load.take_remote()
        load.off()
        load.allow_current(HEADROOM * config.limits.power_W / config.converter.output_voltage_V)
        load.accept_any_voltage()
        supply.take_remote()
        supply.set_voltage(config.converter.input_voltage_V)
        supply.set_current_limit(config.limits.current_A)
        supply.set_power_limit(config.limits.power_W)
        supply.on()
        self._powered = True

    def recover(self, cause: InstrumentError) -> None:
        """Wait until every instrument answers again as itself; raises the last failure when one does not.

        The bench is off meanwhile. A port that has come back under another device path is found by its name.
        """
        end = time.monotonic() + self.config.limits.recover_s
        while True:
            try:
                for name in NAMES:
                    self._same_as_before(name)
                return
            except InstrumentError as error:
                if time.monotonic() >= end or isinstance(error, IdentityError):
                    raise error from cause
            time.sleep(RECOVER_STEP_S)

    def _same_as_before(self, name: str) -> None:
        identity, before = getattr(self._of, name).identify(), self._inspection.identities.get(name)
        if before is not None and identity != before:
            raise IdentityError(
                f"the {name} was {before} {before.serial} and is now {identity} {identity.serial}"
            )

    def set_point(self, row: PlannedPoint) -> Applied | None:
        """Bring the bench to a row of the plan; returns the modulation as applied, None with the PWM off.

        Raises LimitError, before anything is sent, for a row outside the limits.
        """
        self._refuse(row)
        self._refuse_when_tripped()
        self.sample()
        if row.kind is Kind.STANDBY:
            self._stand_by()
            return None
        applied = self._go_to_start()
        if row.kind is Kind.NO_LOAD:
            self._unload()
            return applied
        self._draw(row.power_W)
        return self._modulate(row)

    def power_off(self) -> PowerOffReport:
        """PWM, load, supply, discharge; each seen off. Never raises for a part that fails."""
        self._power_W, self._pwm, self._powered = 0.0, False, False
        instruments = {name: getattr(self._of, name) for name in NAMES}
        steps = off_steps(self.config, instruments, self.clock)
        return power_off(steps, again_s=self.config.limits.again_s)

    def _refuse(self, row: PlannedPoint) -> None:
        limit_W = self.config.limits.power_W
        if not (0 <= row.D1 <= 1 and 0 <= row.D2 <= 1 and 0 <= row.power_W <= limit_W):
            raise LimitError(
                f"set point D1 = {row.D1:g}, D2 = {row.D2:g}, {row.power_W:g} W is outside the limits: "
                f"D1 and D2 from 0 to 1, power from 0 to {limit_W:g} W"
            )

    def _modulate(self, row: PlannedPoint) -> Applied:
        """The modulation of a row, with its power already drawn."""
        return self._of.controller.set_modulation(row.D1, row.D2)

    def _unload(self) -> None:
        self._of.load.off()
        self._power_W = 0.0

    def _stand_by(self) -> None:
        if self._pwm:
            self._go_to_start()
        self._unload()
        self._of.controller.disable()
        self._pwm = False

    def _go_to_start(self) -> Applied:
        """PWM on at the modulation that carries every power."""
        controller, converter = self._of.controller, self.config.converter
        if self._pwm:
            return controller.set_modulation(converter.start_D1, converter.start_D2)
        self._await_input()
        controller.arm()
        applied = controller.set_modulation(converter.start_D1, converter.start_D2)
        controller.enable()
        self._pwm = True
        self._await_output()
        return applied

    def _await_input(self) -> None:
        """Wait until the input voltage is up: what is switched on before charges its dc links through the bridges."""
        target_V = self.config.converter.input_voltage_V
        end_s = self.clock.now() + START_UP_S
        while not (input_V := self._input_V) >= REACHED * target_V:
            if self.clock.now() >= end_s:
                raise LimitReached(
                    f"input voltage {input_V:g} V {START_UP_S:g} s after the supply was switched on; target "
                    f"{target_V:g} V: look at the supply's wiring and at the analyzer's element of the input"
                )
            self.clock.sleep(START_UP_STEP_S)
            self.sample()

    def _await_output(self) -> None:
        """Wait until the output voltage is up: a load must not be thrown on before."""
        target_V = self.config.converter.output_voltage_V
        end_s = self.clock.now() + START_UP_S
        while (output_V := self.beat().V2_V) < REACHED * target_V:
            if self.clock.now() >= end_s:
                raise LimitReached(
                    f"output voltage {output_V:g} V after {START_UP_S:g} s; target {target_V:g} V"
                )
            self.clock.sleep(START_UP_STEP_S)

    def _draw(self, power_W: float) -> None:
        """Load the output with ``power_W``, in steps that are no larger than the bench allows."""
        load, step_W = self._of.load, self.config.limits.power_step_W
        steps = max(1, math.ceil(abs(power_W - self._power_W) / step_W))
        for k in range(1, steps + 1):
            target_W = (
                power_W if k == steps else self._power_W + math.copysign(step_W, power_W - self._power_W)
            )
            if target_W != self._power_W:
                load.set_power(target_W)
            if self._power_W == 0.0:
                load.on()
            self._power_W = target_W
            if k < steps:
                self.beat()  # many steps on a slow line outlast the controller's patience


@contextmanager
def open_bench(config: BenchConfig, clock: Clock, spy_of: SpyOf = log_of) -> Iterator[Bench]:
    """A bench with all its instruments open; closes them, and switches nothing."""
    with open_instruments(config, clock, spy_of) as (instruments, inspection):
        yield Bench(config, instruments, clock, inspection)


def _value(reading: Reading | None) -> float:
    return reading.value if reading is not None and reading.good else math.nan
