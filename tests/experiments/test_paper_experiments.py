"""The paper's figures on their smallest scale: they run, show what they promise, and are written and read back."""

import math

import pytest

from experiments.harness.page import Page
from experiments.harness.registry import entry, names
from experiments.harness.result import Result
from experiments.harness.settings import Settings

PAPER = [name for name in names() if name.startswith(("fig_", "table_", "second_"))]
RUN = ("fig_13_accuracy", "fig_15_data_sizes", "table_3_hyperparameters")
PNG = b"\x89PNG"


@pytest.fixture(scope="module")
def results() -> dict[str, Result]:
    return {}


@pytest.fixture(params=RUN)
def result(
    request: pytest.FixtureRequest, small: Settings, results: dict[str, Result], instant_diagnosis: None
) -> Result:
    name = request.param
    if name not in results:
        results[name] = entry(name).experiment.run(small)
    return results[name]


def test_every_table_and_figure_of_the_paper_has_its_experiment() -> None:
    numbers = {name.split("_")[1] for name in PAPER}
    assert {"07", "09", "12", "13", "14", "15", "17", "18", "19", "20", "3", "4", "5"} <= numbers
    assert all(not entry(name).experiment.apart for name in PAPER)


def test_it_is_judged_and_labelled_and_its_pictures_are_pictures(result: Result) -> None:
    assert result.virtual
    assert result.judged_tables()
    assert all(picture.png.startswith(PNG) and picture.caption for picture in result.pictures)
    assert all(c.reason for c in result.comparisons)


def test_no_figure_is_left_unknown(result: Result) -> None:
    assert all(math.isfinite(c.ours) for c in result.comparisons)
    assert all(math.isfinite(goal.value) for goal in result.goals)


def test_it_is_written_and_read_back(result: Result, small: Settings) -> None:
    page = Page(entry=entry(RUN[0]), result=result, scale=1.0, seconds=1.0, created="", code="x")
    page.write(small.out / "written")
    assert Page.read(small.out / "written", entry(RUN[0])) == page


def test_the_papers_accuracies_stand_beside_ours(small: Settings, instant_diagnosis: None) -> None:
    made = entry("fig_13_accuracy").experiment.run(small)  # from the journal, where it ran before
    assert [c.paper for c in made.comparisons] == [1.1, 0.58, 0.08, 0.08, 99.92]
    gap = made.tables[-1].rows
    assert gap[-1][0] == "mean"
    # points: an ideal lab differs from the simulation by its formulas alone
    assert abs(float(gap[-1][-1] or 0)) < 0.1
