"""Safety as pure functions of what is known, and the ordered way to a bench that is off.

Silence is a fault: a guarded quantity without a reading is as unsafe as one above its limit.
Power goes off in the order PWM, load, supply, and then the dc link and the output are seen discharged. Each step is
seen off by reading it back, is tried twice, has a deadline on the real clock, and never keeps the next one from being
tried: a driver that hangs is left behind in a thread of its own.
"""

import math
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from bench.config import ConverterConfig, LimitsConfig
from bench.wording import channel_name, unit_of

ATTEMPTS = 2
AGAIN_S = 10.0  # real time in which steps that failed are tried again, after all the others
AGAIN_STEP_S = 0.5
DEADLINE_S = 15.0  # of a step: three goes of a driver, each with its timeout and its quarantine, and again
UNDERVOLTAGE = "output_undervoltage"  # what the controller reports when it cannot hold the output
_EITHER_WAY = ("V", "A", "W")  # units of what may be measured backwards
COLLAPSED = 0.5  # of the target: below this the output voltage is gone, not merely off its target


@dataclass(frozen=True, slots=True, kw_only=True)
class Limits:
    """Upper limits by column of the measurement table, and the output voltage that is to be held."""

    upper: Mapping[str, float]
    output_voltage_V: float

    @classmethod
    def of(cls, limits: LimitsConfig, converter: ConverterConfig) -> "Limits":
        """The limits of a bench."""
        return cls(
            upper={
                "V1_V": limits.voltage_V,
                "I1_A": limits.current_A,
                "P1_W": limits.power_W,
                "V2_V": limits.output_voltage_V,
                "T_heatsink_C": limits.heatsink_C,
                "T_transformer_C": limits.winding_C,
                "T_inductor_C": limits.winding_C,
            },
            output_voltage_V=converter.output_voltage_V,
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class Readings:
    """What is known of the bench at one moment: columns of the measurement table, and reported states."""

    values: Mapping[str, float]
    faults: tuple[str, ...] = ()
    pwm_on: bool = False
    pwm_expected: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class Decision:
    """Whether to go on; every reason against it, and whether they all are a lost output voltage."""

    reasons: tuple[str, ...] = ()
    output_lost: bool = False

    @property
    def safe(self) -> bool:
        """True when nothing speaks against going on."""
        return not self.reasons


def decide(limits: Limits, readings: Readings) -> Decision:
    """Judge one moment. Pure: the same limits and readings give the same decision.

    >>> limits = Limits(upper={"V1_V": 320.0}, output_voltage_V=140.0)
    >>> decide(limits, Readings(values={"V1_V": 331.5})).reasons
    ('input voltage 331.5 V is above its limit 320 V',)
    >>> decide(limits, Readings(values={})).reasons
    ('input voltage has no reading',)
    """
    reasons = [reason for name, limit in limits.upper.items() if (reason := _above(name, limit, readings))]
    reasons += [f"fault reported: {fault}" for fault in readings.faults if fault != UNDERVOLTAGE]
    if readings.pwm_on and not readings.pwm_expected:
        reasons.append("the PWM is on and should be off")
    lost = _output_lost(limits, readings) if readings.pwm_expected else []
    if readings.pwm_expected and not readings.pwm_on:
        (lost if lost else reasons).append("the PWM is off and should be on")
    return Decision(reasons=(*reasons, *lost), output_lost=bool(lost) and not reasons)


def _output_lost(limits: Limits, readings: Readings) -> list[str]:
    """Signs that the converter cannot hold its output, where it should."""
    signs = [f"fault reported: {UNDERVOLTAGE}"] if UNDERVOLTAGE in readings.faults else []
    output_V = readings.values.get("V2_V", math.nan)
    if readings.pwm_on and output_V < COLLAPSED * limits.output_voltage_V:
        signs.append(f"output voltage {output_V:g} V has collapsed (target {limits.output_voltage_V:g} V)")
    return signs


def _above(name: str, limit: float, readings: Readings) -> str | None:
    value, unit, said = readings.values.get(name, math.nan), unit_of(name), channel_name(name)
    if math.isnan(value):
        return f"{said} has no reading"
    backwards = value < 0 and unit in _EITHER_WAY  # a lead or a current transformer that is swapped
    if (-value if backwards else value) <= limit:
        return None
    return f"{said} {value:g} {unit} is {'beyond' if backwards else 'above'} its limit {limit:g} {unit}"


@dataclass(frozen=True, slots=True, kw_only=True)
class StepReport:
    """How one step of the power-off went."""

    step: str
    confirmed: bool
    said: str


@dataclass(frozen=True, slots=True, kw_only=True)
class PowerOffReport:
    """How the whole power-off went."""

    steps: tuple[StepReport, ...]

    @property
    def safe(self) -> bool:
        """True only when every step was seen off."""
        return all(step.confirmed for step in self.steps)

    @property
    def lines(self) -> tuple[str, ...]:
        """What each step says."""
        return tuple(f"{step.step} {step.said}" for step in self.steps)

    @property
    def told(self) -> str:
        """What is known of the bench: in one line where it is off, else in a line for each step."""
        return str(self) if self.safe else "\n".join(self.lines)

    def __str__(self) -> str:
        return "; ".join(self.lines)


@dataclass(frozen=True, slots=True, kw_only=True)
class Step:
    """One step: ``act`` returns only when its part was seen off, and raises otherwise; real seconds it may take."""

    name: str
    act: Callable[[], None]
    deadline_s: float = DEADLINE_S
    done: str = "off"


def power_off(steps: Sequence[Step], *, again_s: float = AGAIN_S) -> PowerOffReport:
    """Run every step, whatever becomes of the one before; then again, for so long, those that were not confirmed.

    So a plug that is put back in time is no unsafe bench, and nothing waits for it while more can be switched off.
    """
    reports = {step.name: _attempt(step) for step in steps}
    end = time.monotonic() + again_s
    while time.monotonic() < end and (left := [s for s in steps if not reports[s.name].confirmed]):
        time.sleep(AGAIN_STEP_S)
        reports |= {step.name: _attempt(step) for step in left}
    return PowerOffReport(steps=tuple(reports[step.name] for step in steps))


def _attempt(step: Step) -> StepReport:
    failed: list[str] = []
    done = threading.Event()
    end = time.monotonic() + step.deadline_s

    def attempts() -> None:
        for _ in range(ATTEMPTS):
            try:
                step.act()
            except Exception as error:  # noqa: BLE001  the safety layer: whatever failed, the next step is tried
                failed.append(getattr(error, "message", None) or str(error))
            else:
                done.set()
                return
            if time.monotonic() > end:
                return

    thread = threading.Thread(target=attempts, name=f"power-off {step.name}", daemon=True)
    thread.start()
    thread.join(step.deadline_s)
    if done.is_set():
        return StepReport(step=step.name, confirmed=True, said=step.done)
    why = failed[-1] if failed else f"no answer within {step.deadline_s:g} s"
    return StepReport(step=step.name, confirmed=False, said=f"NOT confirmed off: {why}")
