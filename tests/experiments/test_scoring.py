"""What counts as found, exact, wrong and unknown, and the intervals of their shares."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import beta

from experiments.blind.calibration import intervals, reliability, statements
from experiments.blind.scoring import Share, left_by_noise, share
from experiments.blind.verdicts import misses
from tests.experiments.fabricated import answer, scored


@pytest.mark.parametrize(
    ("hidden", "verdict", "stated", "right"),
    [
        ("dead_time", "named", ("dead_time",), {"first", "stated", "exact"}),
        ("dead_time", "group", ("dead_time", "skin_effect"), {"first", "stated"}),
        ("dead_time", "group", ("skin_effect", "dead_time"), {"stated"}),
        ("dead_time", "named", ("skin_effect",), {"wrong"}),
        ("dead_time", "named", ("dead_time", "skin_effect"), {"first", "stated", "wrong"}),
        ("dead_time", "group", ("skin_effect", "fan_step"), {"wrong"}),
        ("dead_time", "unknown", ("dead_time",), {"unknown"}),
        ("dead_time", "consistent", ("dead_time",), {"consistent"}),
        ("dead_time", "no answer", (), set()),
        ("dead_time+fan_step", "named", ("fan_step", "dead_time"), {"first", "stated", "exact"}),
        ("dead_time+fan_step", "named", ("fan_step",), {"first"}),
        (None, "consistent", (), {"consistent"}),
        (None, "named", ("dead_time",), {"wrong"}),
        ("dc_link_esr", "named", ("dead_time",), {"wrong"}),
    ],
)
def test_an_answer_is_scored(
    hidden: str | None, verdict: str, stated: tuple[str, ...], right: set[str]
) -> None:
    one = scored(hidden, answer(verdict, *stated))
    found = {
        "first": one.right_first, "stated": one.stated, "exact": one.exact and one.trial.names != (),
        "wrong": one.wrong, "unknown": one.unknown, "consistent": one.consistent,
    }  # fmt: skip
    assert {name for name, holds in found.items() if holds} == right


def test_a_group_beside_a_name_counts_too() -> None:
    said = replace(answer("named", "dead_time"), groups=(("fan_step", "auxiliary_power"),))
    assert said.stated == ("dead_time", "fan_step", "auxiliary_power")
    assert said.misnames(("dead_time",))
    assert not said.misnames(("dead_time", "fan_step"))


def test_excluded_trials_are_in_no_share() -> None:
    trials = [scored("dead_time", answer("named", "dead_time")), scored("fan_step", None)]
    assert share(trials, lambda s: s.right_first) == Share(hits=1, trials=1)


@pytest.mark.parametrize("against", [0.0, math.log(36)])
def test_noise_leaves_as_many_open_as_of_labs_that_are_drawn(against: float) -> None:
    sigmas, labs = np.array([4.0, 5.5, 7.0]), 100_000
    reading = sigmas + np.random.default_rng(3).standard_normal((labs, 3))
    # of two normal densities, at the cause and at nothing
    log_odds = -0.5 * (reading - sigmas) ** 2 + 0.5 * reading**2 - against
    drawn = np.sum(np.mean(log_odds < math.log(19), axis=0))
    assert left_by_noise(sigmas, against) == pytest.approx(drawn, abs=0.006)  # three sigmas of so many labs


@pytest.mark.parametrize(("hits", "trials"), [(0, 6), (1, 6), (140, 156), (156, 156)])
def test_intervals_are_those_of_clopper_and_pearson(hits: int, trials: int) -> None:
    low = beta.ppf(0.025, hits, trials - hits + 1) if hits else 0.0
    high = beta.ppf(0.975, hits + 1, trials - hits) if hits < trials else 1.0
    # both solve the same equation to rounding
    assert Share(hits=hits, trials=trials).interval() == pytest.approx((100 * low, 100 * high), rel=1e-9)


def test_no_trials_give_no_share_and_meet_no_bar() -> None:
    nothing = Share(hits=0, trials=0)
    assert math.isnan(nothing.per_cent)
    assert nothing.goal("g", 0.0, at_least=True).verdict == "missed"


def test_misses_stay_visible() -> None:
    trials = [
        scored("dead_time", answer("named", "dead_time")),
        scored("fan_step", answer("unknown"), seed=7),
    ]
    table = misses("One", trials, lambda s: s.stated)
    (row,) = (dict(zip(table.columns, row, strict=True)) for row in table.rows)
    assert (row["hidden"], row["seed"], row["points"], row["verdict"]) == (
        "fan_step = 0.1",
        7,
        100,
        "unknown",
    )


def test_an_interval_is_judged_where_the_hidden_effect_is_thought_likely() -> None:
    trials = [
        scored("dead_time", answer("named", "dead_time")),
        scored("dead_time", answer("named", "dead_time", ci95=(0.2, 0.3))),
        scored("dead_time", answer("unknown", "dead_time", probability=0.4, ci95=(0.2, 0.3))),
        scored("dead_time", answer("named", "fan_step", ci95=(0.2, 0.3))),
    ]
    assert intervals(trials) == Share(hits=1, trials=2)


def test_probabilities_that_are_too_sure_put_their_bin_off() -> None:
    right = [scored("dead_time", answer("named", "dead_time", probability=0.97)) for _ in range(97)]
    wrong = [scored("fan_step", answer("named", "dead_time", probability=0.97)) for _ in range(3)]
    assert reliability(statements([*right, *wrong]))[1] == 0
    assert reliability(statements([*right[:50], *wrong * 10]))[1] == 1


def test_a_bin_of_few_statements_does_not_agree() -> None:
    unlikely = [scored("dead_time", answer("consistent", "dead_time", probability=0.03)) for _ in range(4)]
    table, off = reliability(statements(unlikely))
    assert ([row[-1] for row in table.rows], off) == (["too few"] * len(table.rows), 0)
    assert reliability(statements([*unlikely, unlikely[0]]))[1] == 1
