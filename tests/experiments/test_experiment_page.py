"""Goals, tables and pages: the same numbers in print, JSON and HTML, and misses in all of them."""

import json
from pathlib import Path

import pytest

from experiments.harness.page import Page
from experiments.harness.plain import plain_lines
from experiments.harness.result import Goal, Table
from experiments.harness.settings import Settings
from tests.experiments.fabricated import ENTRY, result


def page() -> Page:
    return Page(entry=ENTRY, result=result(), scale=0.1, seconds=1.5, created="2024-01-01T00:00:00+00:00")


@pytest.mark.parametrize(
    ("value", "at_least", "verdict"),
    [
        (2.0, True, "met"), (1.9, True, "missed"), (2.0, False, "met"), (2.1, False, "missed"),
        (float("nan"), True, "missed"), (float("nan"), False, "missed"),
    ],
)  # fmt: skip
def test_a_goal_is_met_at_its_bar(value: float, at_least: bool, verdict: str) -> None:
    assert Goal(name="g", value=value, bar=2.0, at_least=at_least).verdict == verdict


def test_a_row_must_fill_its_columns() -> None:
    with pytest.raises(ValueError, match="1 cells for 2 columns"):
        Table(title="t", columns=("a", "b"), rows=((1,),))


def test_goals_are_told_with_value_interval_bar_and_verdict() -> None:
    assert plain_lines(result().goal_table())[2:] == [
        "found   93 % (95 %: 88 to 96)  ≥ 90 %         met",
        "regret  0.5 points             ≤ 0.01 points  missed",
    ]


def test_json_and_page_are_written(tmp_path: Path) -> None:
    for path in page().write(tmp_path / "deep"):
        assert path.exists()
    plain = json.loads((tmp_path / "deep" / "made_up.json").read_text())
    assert plain["experiment"] == "made_up"
    assert [goal["verdict"] for goal in plain["goals"]] == ["met", "missed"]
    assert plain["tables"][0]["rows"] == [["grid <1>", 2.5], ["[swarm]", None]]
    assert plain["virtual"] is True
    assert sorted(p.name for p in (tmp_path / "deep").iterdir()) == ["made_up.html", "made_up.json"]


def test_the_page_shows_the_miss_the_lab_and_escaped_text() -> None:
    html = page().html()
    assert '<td class="missed">missed</td>' in html
    assert "VIRTUAL LAB" in html
    assert "grid &lt;1&gt;" in html
    assert "thinned to 0.1 of all" in html


def test_a_scale_outside_its_range_is_refused() -> None:
    with pytest.raises(ValueError, match=r"scale is 1\.5"):
        Settings(out=Path(), scale=1.5)
