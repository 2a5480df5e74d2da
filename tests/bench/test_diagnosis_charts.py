"""The charts of the diagnosis page: which panels there are, in which units, and what of a row or a bar is seen."""

import numpy as np
import pandas as pd

from bench.diagnosis_charts import cause_bars, residual_columns, residual_maps


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


def test_a_bar_that_is_too_short_to_see_still_says_its_probability() -> None:
    figure = cause_bars([{"effect": "link_resistance", "probability": 0.9999}], 0.0001, 0.0)
    assert list(figure.data[0].text) == ["over 99.9 %", "under 0.1 %", "0.0 %"]
