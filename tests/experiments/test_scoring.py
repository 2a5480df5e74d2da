"""What counts as found and as a false name, and the intervals of their shares."""

import math

import pytest
from scipy.stats import beta

from experiments.blind.scoring import Share, covered_share, false_share, found_share
from experiments.first_trials import scored_result
from tests.experiments.fabricated import scored


@pytest.mark.parametrize(
    ("hidden", "verdict", "stated", "outcome"),
    [
        ("dead_time", "named", ("dead_time",), "found"),
        ("dead_time", "group", ("skin_effect", "dead_time"), "found"),
        ("dead_time", "named", ("skin_effect",), "false name"),
        ("dead_time", "group", ("skin_effect", "fan_step"), "false name"),
        ("dead_time", "unknown", (), "missed"),
        ("dead_time", "consistent", (), "missed"),
        ("dead_time", "no answer", (), "missed"),
        (None, "consistent", (), "rightly none"),
        (None, "unknown", (), "not said"),
        (None, "named", ("dead_time",), "false name"),
        (None, "group", ("dead_time", "skin_effect"), "false name"),
    ],
)
def test_an_answer_is_scored(hidden: str | None, verdict: str, stated: tuple[str, ...], outcome: str) -> None:
    one = scored(hidden, verdict, *stated)
    assert one.outcome == outcome
    assert one.found == (outcome == "found")
    assert one.false_name == (outcome == "false name")


def test_labs_with_nothing_hidden_count_for_false_names_only() -> None:
    trials = [
        scored("dead_time", "named", "dead_time"),
        scored("fan_step", "unknown"),
        scored(None, "named", "fan_step"),
        scored(None, "consistent"),
    ]
    assert (found_share(trials).hits, found_share(trials).trials) == (1, 2)
    assert (false_share(trials).hits, false_share(trials).trials) == (1, 4)


@pytest.mark.parametrize(("hits", "trials"), [(0, 6), (1, 6), (140, 156), (156, 156)])
def test_intervals_are_those_of_clopper_and_pearson(hits: int, trials: int) -> None:
    low = beta.ppf(0.025, hits, trials - hits + 1) if hits else 0.0
    high = beta.ppf(0.975, hits + 1, trials - hits) if hits < trials else 1.0
    # both solve the same equation to rounding
    assert Share(hits=hits, trials=trials).ci95 == pytest.approx((100 * low, 100 * high), rel=1e-9)


def test_no_trials_give_no_share() -> None:
    assert math.isnan(Share(hits=0, trials=0).per_cent)
    assert Share(hits=0, trials=0).ci95 == (0.0, 100.0)


def test_misses_stay_visible() -> None:
    right = [scored("dead_time", "named", "dead_time", seed=k) for k in range(17)]
    result = scored_result([*right, scored("fan_step", "unknown"), scored("fan_step", "named", "dead_time")])
    found, false = result.goals
    assert (found.verdict, false.verdict) == ("missed", "missed")  # 17 of 19 are 89.5 %
    assert found.name == "hidden effects found (17 of 19)"
    assert false.value == pytest.approx(100 / 19)
    wrong = next(table for table in result.tables if table.title.startswith("Not found"))
    assert [row[wrong.columns.index("verdict")] for row in wrong.rows] == ["unknown", "named"]
    assert [row[wrong.columns.index("false name")] for row in wrong.rows] == [False, True]
    assert result.virtual


def test_an_interval_is_judged_only_where_its_cause_is_the_hidden_effect() -> None:
    near, far, other = (
        scored("dead_time", "named", stated, value=value)
        for stated, value in (("dead_time", 0.11), ("dead_time", 0.13), ("fan_step", 0.1))
    )
    assert (near.covered, far.covered, other.covered) == (True, False, None)
    assert scored(None, "consistent").covered is None
    assert (covered_share([near, far, other]).hits, covered_share([near, far, other]).trials) == (1, 2)
