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


@pytest.mark.parametrize(
    ("times", "seconds"),
    [
        (["20/11/2026 14:03:21", "20/11/2026 14:03:51", "21/11/2026 14:03:21"], [0.0, 30.0, 86400.0]),
        (
            ["11/20/2026 11:59:50 AM", "11/20/2026 12:00:20 PM", "11/21/2026 12:00:20 am"],
            [0.0, 30.0, 43230.0],
        ),
        (["20-Nov-2026 14:03:21", "20-Nov-2026 14:03:51.5", "1-Dec-2026 14:03:21"], [0.0, 30.5, 950400.0]),
        (["1. März 2026 14:03", "1. März 2026 14:04", "1. Mai 2026 14:03"], [0.0, 60.0, 5270400.0]),
        (["20 nov. 2026 14:03:21", "20 nov. 2026 14:03:51", "2 déc. 2026 14:03:21"], [0.0, 30.0, 1036800.0]),
        (
            ["Nov 20, 2026 2:03:21 PM", "Nov 20, 2026 2:03:51 PM", "Nov 20, 2026 10:03:21 PM"],
            [0.0, 30.0, 28800.0],
        ),
        (["20.11.26 14:03:21", "20.11.26 14:03:51", "01.12.26 14:03:21"], [0.0, 30.0, 950400.0]),
        (["14:03:21,973", "14:03:22,973", "14:03:52,5"], [0.0, 1.0, 30.527]),
        (["10:21:13 PM", "11:59:59 PM", "12:00:29 AM"], [0.0, 5926.0, 5956.0]),
        (["7:09.0", "7:56.5", "61:00.0"], [0.0, 47.5, 3231.0]),
        (["58:09.0", "59:56.5", "00:30.0"], [0.0, 107.5, 141.0]),  # a spreadsheet's, over the hour
        (["23:03:21.6", "24:03:21.6", "25:00:00"], [0.0, 3600.0, 6998.4]),
        (
            ["2026-11-20 14:03:21 CET", "2026-11-20 13:03:51 UTC", "2026-11-20 15:04:21 CEST"],
            [0.0, 30.0, 60.0],
        ),
        (["2026-11-20 14:03:21 PST", "2026-11-20 14:03:51 PST", "2026-11-20 14:04:21-08"], [0.0, 30.0, 60.0]),
        (
            ["03/04/2026 14:03:21", "03/04/2026 14:03:51", "03/04/2026 14:04:21"],
            [0.0, 30.0, 60.0],
        ),  # either way
    ],
)
def test_times_are_read_as_the_trade_writes_them(times: list[str], seconds: list[float]) -> None:
    read = load_measurements(efficiencies(time_s=times)).frame["time_s"]
    assert (read - read[0]).tolist() == pytest.approx(seconds, abs=1e-4)  # microseconds of two thousand years


@pytest.mark.parametrize(
    ("times", "says"),
    [
        (
            ["03/04/2026 23:59:00", "03/05/2026 00:01:00", "03/05/2026 00:02:00"],
            "03/04/2026 23:59:00 may be 2026-04-03 or 2026-03-04, and no row has a day above 12 to tell, so",
        ),
        (
            ["20/11/2026 14:03:21", "11/20/2026 14:03:51", "11/20/2026 14:04:21"],
            "20/11/2026 14:03:21 has its day first",
        ),
        (["14:03:21", "14:04", "14:05"], "2 of 3 values are no times (row 2: 14:04), more than a fifth, so"),
        ([0.0, "late", "later"], "2 of 3 values are no times (row 2: late)"),
        (["20/11/2026", "20/11/2026", "20/11/2026"], "reads 20/11/2026 in all rows: time does not go on"),
        (
            ["26-11-20 14:03:21", "26-11-20 14:03:51", "26-11-21 14:03:21"],
            "allowed are seconds, or times of day like",
        ),
        (["2026-11-20 14:03:21 XYZ", "2026-11-20 14:03:51 XYZ", "2026-11-20 14:04:21 XYZ"], "are no times"),
        (["13:03:21 PM", "13:03:51 PM", "31.02.2026 14:03"], "3 of 3 values are no times"),
    ],
)
def test_times_that_cannot_be_told_leave_the_column_empty_with_a_reason(
    times: list[object], says: str
) -> None:
    read = load_measurements(efficiencies(time_s=times))
    assert read.frame["time_s"].isna().all()
    (note,) = read.notes
    assert says in note


def several(**columns: object) -> pd.DataFrame:
    """Twenty rows that can be."""
    rows = {"D1": 0.8, "D2": 0.1, "P2_W": [500.0 + k for k in range(20)], "efficiency": 0.97}
    return pd.DataFrame({**rows, **columns})


def test_single_times_that_are_not_read_cost_no_others() -> None:
    times = [f"20/11/2026 14:03:{k:02d}" for k in range(20)]
    read = load_measurements(several(time_s=[*times[:7], "---", *times[8:]]))
    assert read.frame["time_s"].isna().tolist() == [k == 7 for k in range(20)]
    assert "time_s: 1 of 20 values cannot be and are left empty (row 8: ---)" in read.notes


@pytest.mark.parametrize(
    ("times", "says"),
    [
        (
            [*(30.0 * k for k in range(10)), *(30.0 * k for k in range(10))],
            "time_s falls at row 11 by 270 s: rows not",
        ),
        ([30.0 * (k % 7) for k in range(20)], "time_s falls at row 8 by 180 s (and at row 15): rows not"),
        (
            [f"2026-10-25 0{2 if k != 9 else 1}:{k:02d}:00" for k in range(20)],
            "time_s falls at row 10 by 3540 s: rows",
        ),
    ],
)
def test_time_that_falls_now_and_then_is_told_with_its_row(times: list[object], says: str) -> None:
    read = load_measurements(several(time_s=times))
    assert any(note.startswith(says) for note in read.notes)
    assert read.frame["time_s"].notna().all()


def test_rows_in_any_order_are_not_told_to_fall() -> None:
    shuffled = several(time_s=[30.0 * k for k in range(20)]).sample(frac=1.0, random_state=3)
    assert load_measurements(shuffled).notes == ()
