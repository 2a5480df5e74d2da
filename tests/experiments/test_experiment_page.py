"""Goals, tables and pages: the same numbers in print, JSON and HTML, and misses in all of them."""

import json
import math
from pathlib import Path

import pytest

from experiments.harness.page import Page
from experiments.harness.plain import plain_lines
from experiments.harness.result import Comparison, Goal, Table
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
    written = sorted(p.name for p in (tmp_path / "deep").iterdir())
    assert written == ["made_up-dot.png", "made_up.html", "made_up.json"]


def test_what_was_written_is_read_back(tmp_path: Path) -> None:
    page().write(tmp_path)
    assert Page.read(tmp_path, ENTRY) == page()
    (tmp_path / "made_up-dot.png").unlink()
    assert Page.read(tmp_path, ENTRY) is None


@pytest.mark.parametrize(
    ("ours", "tolerance", "verdict"),
    [(1.2, 0.2, "met"), (1.31, 0.2, "missed"), (math.nan, 0.2, "missed"), (5.0, math.inf, "shown")],
)
def test_a_comparison_is_met_within_its_tolerance(ours: float, tolerance: float, verdict: str) -> None:
    compared = Comparison(name="c", paper=1.1, ours=ours, unit="", tolerance=tolerance, reason="")
    assert compared.verdict == verdict


def test_the_page_shows_the_miss_the_lab_and_escaped_text() -> None:
    html = page().html()
    assert '<td class="missed">missed</td>' in html
    assert "VIRTUAL LAB" in html
    assert "grid &lt;1&gt;" in html
    assert "<p>And <code>a &lt;paragraph&gt;</code>.</p>" in html
    assert "thinned to 0.1 of all" in html
    assert "th { color: var(--soft); }" in html  # long headings wrap: a wide table fits on paper


def test_a_scale_outside_its_range_is_refused() -> None:
    with pytest.raises(ValueError, match=r"scale is 1\.5"):
        Settings(out=Path(), scale=1.5)
