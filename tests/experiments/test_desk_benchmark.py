"""What viewers cost, as it is told."""

import pytest

from experiments.desk_benchmark import cost_of_viewers


def test_what_viewers_cost_is_told_in_per_cent_with_its_interval() -> None:
    goal = cost_of_viewers("a campaign's wall time", 0.015, 0.01, 0.03)
    assert (goal.value, goal.unit, goal.verdict) == (pytest.approx(1.5), "%", "met")
    assert goal.ci95 == pytest.approx((1.0, 3.0))


def test_one_pair_alone_has_no_interval() -> None:
    assert cost_of_viewers("a campaign's wall time", 0.42, 0.42, 0.42).ci95 is None
