"""Decisions are pure; the way to off is ordered, tried twice, and honest."""

import math
import threading

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bench.errors import LimitReached
from bench.leftovers import discharged
from bench.plan import Kind, PlannedPoint
from bench.safety import Limits, Readings, Step, decide, power_off
from drivers.clock import StepClock
from drivers.errors import ReadbackError
from drivers.reading import Quality, Reading
from tests.bench.fake_bench import BENCH, FakeInstruments, bench_config

LIMITS = Limits.of(bench_config().limits, bench_config().converter)
GOOD = {
    "V1_V": 300.0, "I1_A": 5.0, "P1_W": 1500.0, "V2_V": 140.0,
    "T_heatsink_C": 60.0, "T_transformer_C": 80.0, "T_inductor_C": 80.0,
}  # fmt: skip

SAID = {
    "V1_V": ("input voltage", "V"), "I1_A": ("input current", "A"), "P1_W": ("input power", "W"),
    "V2_V": ("output voltage", "V"), "T_heatsink_C": ("heatsink", "°C"),
    "T_transformer_C": ("transformer winding", "°C"), "T_inductor_C": ("inductor winding", "°C"),
}  # fmt: skip


def reasons(**changed: object) -> tuple[str, ...]:
    state: dict[str, object] = {"pwm_on": True, "pwm_expected": True, **changed}
    return decide(LIMITS, Readings(values=GOOD | state.pop("values", {}), **state)).reasons  # type: ignore[arg-type,operator]


def test_a_good_moment_is_safe() -> None:
    assert reasons() == ()


@pytest.mark.parametrize("name", GOOD)
def test_each_guarded_value_is_guarded(name: str) -> None:
    limit, (said, unit) = LIMITS.upper[name], SAID[name]
    assert reasons(values={name: limit}) == ()
    assert reasons(values={name: math.nextafter(limit, math.inf)}) == (
        f"{said} {limit:g} {unit} is above its limit {limit:g} {unit}",
    )
    assert reasons(values={name: math.nan}) == (f"{said} has no reading",)


def test_silence_is_a_fault() -> None:
    assert len(decide(LIMITS, Readings(values={})).reasons) == len(LIMITS.upper)


def test_pwm_against_expectation_either_way_is_unsafe() -> None:
    assert reasons(pwm_on=False) == ("the PWM is off and should be on",)
    assert reasons(pwm_expected=False) == ("the PWM is on and should be off",)


def test_a_collapsed_output_is_unsafe_only_while_the_pwm_runs() -> None:
    assert "collapsed" in reasons(values={"V2_V": 69.0})[0]
    assert reasons(values={"V2_V": 0.0}, pwm_on=False, pwm_expected=False) == ()


@given(st.dictionaries(st.sampled_from(sorted(GOOD)), st.floats(allow_nan=True)))
def test_safe_means_every_value_is_known_and_within(values: dict[str, float]) -> None:
    safe = not reasons(values={**values, "V2_V": 140.0})
    measured = {name: value for name, value in values.items() if name != "V2_V"}
    sizes = {name: value if name.startswith("T_") else abs(value) for name, value in measured.items()}
    assert safe == all(size <= LIMITS.upper[name] for name, size in sizes.items())


def test_what_is_measured_backwards_is_guarded_too() -> None:
    assert reasons(values={"I1_A": -50.0}) == ("input current -50 A is beyond its limit 10 A",)
    assert reasons(values={"I1_A": -0.01, "P1_W": -3.0, "T_heatsink_C": -150.0}) == ()


def test_the_controller_hears_from_the_bench_between_two_steps_of_the_load() -> None:
    fake = FakeInstruments()
    config = bench_config(limits={**BENCH["limits"], "power_step_W": 50.0})
    bench = fake.bench(config)
    bench.power_up()
    bench.set_point(PlannedPoint(point=1, repeat=1, kind=Kind.LOAD, D1=0.9, D2=0.1, power_W=500.0))
    steps = [name for name in fake.done if name in ("load power", "beat")]
    first = steps.index("load power")
    assert steps[first:][:19] == ["load power", *9 * ["beat", "load power"]]


def test_a_lost_output_is_told_from_everything_else() -> None:
    def judge(**state: object) -> bool:
        everything = {"values": GOOD, "pwm_expected": True, **state}
        return decide(LIMITS, Readings(**everything)).output_lost  # type: ignore[arg-type]

    tripped = {"faults": ("output_undervoltage",), "pwm_on": False}
    assert judge(**tripped)
    assert not judge(**tripped | {"faults": ("output_undervoltage", "overcurrent")})
    assert not judge(**tripped | {"values": GOOD | {"T_heatsink_C": 99.0}})
    assert not judge(pwm_on=False)  # off without a reason told: a lost heartbeat, a restart
    assert not judge(pwm_on=True)


def test_every_step_is_taken_and_a_failed_one_is_tried_twice() -> None:
    done: list[str] = []

    def fail() -> None:
        done.append("load")
        raise OSError("no answer")

    report = power_off(
        [
            Step(name="PWM", act=lambda: done.append("PWM")),
            Step(name="load", act=fail),
            Step(name="supply", act=lambda: done.append("supply")),
        ],
        again_s=0.0,
    )
    assert done == ["PWM", "load", "load", "supply"]
    assert not report.safe
    assert str(report) == "PWM off; load NOT confirmed off: no answer; supply off"
    assert report.told.splitlines() == ["PWM off", "load NOT confirmed off: no answer", "supply off"]


def test_a_step_that_works_the_second_time_is_confirmed() -> None:
    results = iter([OSError("late"), None])

    def step() -> None:
        if error := next(results):
            raise error

    assert power_off([Step(name="PWM", act=step)]).safe


def test_a_step_that_hangs_is_left_behind_and_the_next_one_taken() -> None:
    release, done = threading.Event(), []
    steps = [
        Step(name="PWM", act=lambda: release.wait(30) and None, deadline_s=0.05),
        Step(name="load", act=lambda: done.append("load")),
    ]
    report = power_off(steps, again_s=0.0)
    release.set()
    assert done == ["load"]
    assert str(report) == "PWM NOT confirmed off: no answer within 0.05 s; load off"


def test_a_step_that_failed_is_taken_again_after_all_the_others() -> None:
    order: list[str] = []

    def plugged_in_late() -> None:
        order.append("PWM")
        if order.count("PWM") < 4:
            raise OSError("unplugged")

    steps = [Step(name="PWM", act=plugged_in_late), Step(name="load", act=lambda: order.append("load"))]
    assert power_off(steps, again_s=5.0).safe
    assert order[:3] == ["PWM", "PWM", "load"]


class Terminals:
    """A supply or load whose terminals discharge by half with each look."""

    def __init__(self, voltage_V: float, *, quality: Quality = Quality.GOOD) -> None:
        self.voltage_V, self.quality = voltage_V, quality

    def actual(self) -> dict[str, Reading]:
        self.voltage_V /= 2
        return {"U": Reading(value=self.voltage_V, unit="V", time_s=0.0, quality=self.quality)}


def test_discharged_is_said_when_both_ports_are_below_the_safe_voltage() -> None:
    clock = StepClock()
    discharged(bench_config(), Terminals(300.0), Terminals(140.0), clock)  # type: ignore[arg-type]
    assert 0.5 <= clock.now() <= 1.5  # 300 V, 150, 75, 37.5: three looks, half a second apart


@pytest.mark.parametrize("quality", [Quality.GOOD, Quality.OVERRANGE])
def test_a_port_that_stays_high_or_unknown_is_not_discharged(quality: Quality) -> None:
    high = Terminals(1e12 if quality is Quality.GOOD else 50.0, quality=quality)
    config = bench_config(limits={**BENCH["limits"], "discharge_s": 3})  # type: ignore[dict-item]
    with pytest.raises(ReadbackError, match=r"input at .* after 3 s; safe is 60 V"):
        discharged(config, high, Terminals(1.0), StepClock())  # type: ignore[arg-type]


def test_a_bench_that_tripped_stays_tripped() -> None:
    fake = FakeInstruments()
    bench = fake.bench(bench_config())
    bench.power_up()
    fake.alarms = (("supply", "OVP"),)
    with pytest.raises(LimitReached, match="supply OVP"):
        bench.guard_devices()
    fake.alarms = ()
    bench.power_off()
    with pytest.raises(LimitReached, match="tripped before, and latched"):
        bench.power_up()
