"""Adaptive against random campaigns: when a lab counts as done, and what is compared."""

import math

from experiments.adaptive.race import ADAPTIVE, ALL, POWERS, RANDOM, Race
from experiments.adaptive_campaign import Record, compared, labs, reached


def race(plan: str, seed: int = 1, channels: str = ALL) -> Race:
    return Race(hidden=(("link_resistance", 0.05),), seed=seed, channels=channels, plan=plan)


def record(*stated: tuple[str, ...], every_min: float = 10.0) -> Record:
    moments = [
        {"rows": 5 * k, "minutes": every_min * k, "verdict": "named", "stated": list(names), "cpu_s": 1.0}
        for k, names in enumerate(stated, start=1)
    ]
    return {"moments": moments, "rows": 5 * len(stated), "minutes": every_min * len(stated), "stopped": ""}


RIGHT, WRONG, MORE = ("link_resistance",), ("fan_step",), ("link_resistance", "fan_step")


def test_a_verdict_counts_from_when_it_stays() -> None:
    assert reached(race(ADAPTIVE), record(RIGHT, WRONG, RIGHT, RIGHT)) == 30.0


def test_a_verdict_that_says_more_or_is_left_again_never_counts() -> None:
    assert reached(race(ADAPTIVE), record(RIGHT, MORE)) == math.inf
    assert reached(race(ADAPTIVE), record(RIGHT, ())) == math.inf


def test_the_first_of_a_group_is_not_named() -> None:
    tied = record(RIGHT)
    tied["moments"][0]["verdict"] = "group"
    assert reached(race(ADAPTIVE), tied) == math.inf


def test_labs_that_only_one_plan_gets_right_are_counted_and_left_out_of_the_ratio() -> None:
    done = [
        (race(ADAPTIVE), record((), RIGHT)), (race(RANDOM), record((), (), (), RIGHT)),
        (race(ADAPTIVE, 2, POWERS), record(RIGHT)), (race(RANDOM, 2, POWERS), record((), WRONG)),
    ]  # fmt: skip
    result = compared(done)
    ratio, missed = result.goals
    assert (ratio.value, ratio.met) == (0.5, True)
    assert (missed.value, missed.met) == (-1.0, True)
    assert [row[4:6] for row in result.tables[1].rows] == [(20.0, 40.0), (10.0, "never")]


def test_half_of_the_labs_are_benches_with_dc_powers_only() -> None:
    channels = [channels for _, channels in labs()]
    assert len(channels) >= 20
    assert channels.count(POWERS) == channels.count(ALL)
