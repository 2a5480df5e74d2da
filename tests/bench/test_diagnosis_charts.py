"""The charts of the diagnosis page: which panels there are, in which units, and what of a row or a bar is seen."""

import numpy as np
import pandas as pd
import pytest

from bench.diagnosis_charts import (
    cause_bars,
    readings_that_count,
    residual_columns,
    residual_maps,
    residual_over_time,
)


def test_a_channel_without_residuals_has_no_panel(residuals: pd.DataFrame) -> None:
    assert residual_columns(residuals) == {"P1_W": "residual_P1_W"}
    figure = residual_maps(residuals)
    assert figure is not None
    assert len(figure.data) == 1


def test_a_difference_of_temperatures_is_in_kelvin(residuals: pd.DataFrame) -> None:
    warmer = residuals.assign(residual_T_heatsink_C=2.0)
    figure = residual_maps(warmer)
    assert figure is not None
    assert [note.text for note in figure.layout.annotations][-1] == "heatsink<br>±2 K"


def test_a_row_that_was_not_used_is_a_ring(residuals: pd.DataFrame) -> None:
    residuals.loc[4, "residual_P1_W"] = np.nan
    rings, dots = residual_maps(residuals).data
    assert (rings.marker.symbol, list(rings.x)) == ("circle-open", [residuals["D1"][4]])
    assert len(dots.x) == 29


def misread(residuals: pd.DataFrame, off_W: float) -> tuple[pd.DataFrame, pd.DataFrame]:
    """A table whose fifth row is off, as the table counts rows, and the same with what counts alone."""
    wrong = residuals.assign(row=np.arange(30) + 11)
    wrong.loc[4, "residual_P1_W"] = off_W
    rejected = [{"row": 15, "column": "P1_W"}, {"row": 16, "column": "D1"}]
    return wrong, readings_that_count(wrong, rejected)


def test_what_counts_for_nothing_does_not_span_the_colours(residuals: pd.DataFrame) -> None:
    wrong, counted = misread(residuals, 500.0)
    assert list(np.flatnonzero(counted["residual_P1_W"].isna())) == [4]
    assert wrong["residual_P1_W"].notna().all()
    figure = residual_maps(counted)
    assert figure is not None
    assert len(figure.data[0].x) == 1  # a ring
    span_W = float(figure.layout.annotations[0].text.split("±")[1].split()[0])
    assert span_W < 20  # the others are below 18


@pytest.mark.parametrize(
    ("off_W", "text", "symbol"),
    [(500.0, "+500 W", "triangle-up"), (-90.0, "−90 W", "triangle-down"), (3.0, "", "x")],
)
def test_what_counts_for_nothing_stands_at_the_edge_of_the_others(
    residuals: pd.DataFrame, off_W: float, text: str, symbol: str
) -> None:
    figure = residual_over_time(*misread(residuals, off_W))
    assert figure is not None
    *_, lone = figure.data
    low, high = figure.layout.yaxis.range
    assert (list(lone.text), list(lone.marker.symbol), lone.name) == ([text], [symbol], "counts for nothing")
    assert low < lone.y[0] < high < 25  # W: the others are below 18
    assert list(lone.customdata) == [off_W]


def test_where_all_count_the_axis_is_left_to_itself(residuals: pd.DataFrame) -> None:
    figure = residual_over_time(residuals, readings_that_count(residuals, []))
    assert figure is not None
    assert figure.layout.yaxis.range is None


def test_a_bar_that_is_too_short_to_see_still_says_its_probability() -> None:
    figure = cause_bars([{"effect": "link_resistance", "probability": 0.9999}], 0.0001, 0.0)
    assert list(figure.data[0].text) == ["over 99.9 %", "under 0.1 %", "0.0 %"]
