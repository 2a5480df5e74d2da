"""When rows were taken: seconds, times of day, a calendar; what is no time is left empty and said."""

import re

import pandas as pd
import pytest

from models.dataset import load_measurements
from tests.models.small_tables import efficiencies


@pytest.mark.parametrize(
    ("time_s", "says"),
    [
        (7.0, "reads 7 in all rows: time does not go on"),
        ([46350.0, 46350.0021, 46350.0042], r"0.0021 s apart \(median\).*a spreadsheet's days, \*86400"),
        ([0.0, 0.05, 0.1], r"hours.*time_s\*3600"),
        ([0.0, 180_000.0, 360_000.0], r"180000 s apart \(median\).*time_s\*0.001"),
    ],
)
def test_times_that_are_none_are_left_empty_and_said(time_s: object, says: str) -> None:
    read = load_measurements(efficiencies(time_s=time_s))
    assert any(re.search(says, note) for note in read.notes)
    assert read.frame["time_s"].isna().all()


def test_times_of_a_calendar_and_an_index_with_a_name_are_columns() -> None:
    when = pd.date_range("2026-11-20 22:14", periods=3, freq="3min", name="time_s")
    read = load_measurements(efficiencies().set_index(when))
    assert read.frame["time_s"].tolist() == [0.0, 180.0, 360.0]


def test_a_calendar_in_any_order_is_read_as_its_text_is() -> None:
    when = pd.to_datetime(["2026-11-20 22:14:05", "2026-11-20 01:02:03", "2026-11-20 13:00:00"])
    dates, text, objects = (
        load_measurements(efficiencies(time_s=given)).frame["time_s"].tolist()
        for given in (when, when.strftime("%Y-%m-%dT%H:%M:%S"), when.astype(object))
    )
    assert dates == text == objects == [76_322.0, 0.0, 43_077.0]


def test_after_midnight_it_is_the_next_day() -> None:
    read = load_measurements(efficiencies(time_s=["23:58:00", "23:59:30.5", "00:01:00"]))
    assert read.frame["time_s"].tolist() == [0.0, 90.5, 180.0]
