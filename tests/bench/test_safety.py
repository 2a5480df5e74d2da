"""Decisions are pure; the way to off is ordered, tried twice, and honest."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bench.safety import Limits, Readings, Step, decide, power_off
from tests.bench.fake_bench import bench_config

LIMITS = Limits.of(bench_config().limits, bench_config().converter)
GOOD = {
    "V1_V": 300.0, "I1_A": 5.0, "P1_W": 1500.0, "V2_V": 140.0,
    "T_heatsink_C": 60.0, "T_transformer_C": 80.0, "T_inductor_C": 80.0,
}  # fmt: skip


def reasons(**changed: object) -> tuple[str, ...]:
    state: dict[str, object] = {"pwm_on": True, "pwm_expected": True, **changed}
    return decide(LIMITS, Readings(values=GOOD | state.pop("values", {}), **state)).reasons  # type: ignore[arg-type,operator]


def test_a_good_moment_is_safe() -> None:
    assert reasons() == ()


@pytest.mark.parametrize("name", GOOD)
def test_each_guarded_value_is_guarded(name: str) -> None:
    limit = LIMITS.upper[name]
    assert reasons(values={name: limit}) == ()
    assert reasons(values={name: math.nextafter(limit, math.inf)}) == (
        f"{name} = {limit:g} is above its limit {limit:g}",
    )
    assert reasons(values={name: math.nan}) == (f"{name} has no reading",)


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
    assert safe == all(value <= LIMITS.upper[name] for name, value in values.items() if name != "V2_V")


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


def test_a_step_that_works_the_second_time_is_confirmed() -> None:
    results = iter([OSError("late"), None])

    def step() -> None:
        if error := next(results):
            raise error

    assert power_off([Step(name="PWM", act=step)]).safe
