"""Rows that sum a table up are no readings, whatever they are called; remarks and codes for no data make none."""

from pathlib import Path

import pandas as pd
import pytest

from models.dataset import load_measurements

POWERS = [500.0 + 10.0 * k for k in range(16)]


def readings(**columns: object) -> pd.DataFrame:
    """Sixteen readings and a row more that could be one, with other columns of seventeen cells."""
    powers = [*POWERS, 575.0]
    return pd.DataFrame({**columns, "D1": 0.8, "D2": 0.2, "P2_W": powers, "P1_W": [1.02 * P for P in powers]})


def left_out(**columns: object) -> list[tuple[int, str, str]]:
    return [(row.row, row.column, row.value) for row in load_measurements(readings(**columns)).rejected]


@pytest.mark.parametrize(
    "word", ["Average", "Std Dev", "Max:", "MIN", "Mittelwert", "Moyenne", "Summe", "RMS", "Total", "(Mean)"]
)
@pytest.mark.parametrize(
    "others",
    [
        [*range(1, 17)],
        [f"{k},25" for k in range(16)],
        [f"22:14:{k:02d}" for k in range(16)],
        [f"2026-11-20T22:14:{k:02d}" for k in range(16)],
        [None] * 16,
    ],
)
def test_a_word_for_a_summary_where_else_a_number_stands_or_nothing_makes_no_reading(
    word: str, others: list[object]
) -> None:
    assert left_out(Point=[*others, word]) == [(17, "Point", word)]


def test_a_summary_may_stand_below_each_part_of_a_table() -> None:
    numbers: list[object] = [*range(1, 18)]
    numbers[8] = "Average"
    assert left_out(Nr=numbers) == [(9, "Nr", "Average")]


def test_a_summary_in_a_column_of_ours_is_none_of_its_missing_values() -> None:
    (row,) = load_measurements(readings(time_s=[*(30.0 * k for k in range(16)), "Average"])).rejected
    assert str(row) == "row 17, time_s = Average: a summary, not a reading"


def test_a_word_that_is_not_known_is_told_with_what_to_do() -> None:
    (row,) = load_measurements(readings(Point=[*range(1, 17), "Gesamtlauf"])).rejected
    assert (row.row, row.column) == (17, "Point")
    assert "if it is one, write a number there, or nothing" in row.reason
    assert left_out(Point=["ref", *range(1, 17)]) == [(1, "Point", "ref")]


@pytest.mark.parametrize(
    "remark",
    [
        [None] * 8 + ["fan louder"] + [None] * 8,
        [None] * 16 + ["the end"],
        [None] * 8 + ["max"] + [None] * 8,
        ["warm"] * 16 + ["max"],
        ["sweep A"] * 8 + ["sweep B"] * 9,
        [*(f"{k}" for k in range(16)), "16b"],
    ],
)
def test_remarks_and_labels_cost_no_row(remark: list[object]) -> None:
    assert left_out(note=remark) == []


@pytest.mark.parametrize(
    "code", ["---", "OVER", "-OL-", "NaN", "-INF", "9.91E+37", "1.#QNAN", "#N/A", "", "> 300", "err"]
)
@pytest.mark.parametrize("place", [4, 16])
def test_a_code_for_no_data_in_an_unknown_column_costs_no_row(code: str, place: int) -> None:
    fan: list[object] = [*range(1200, 1217)]
    fan[place] = code
    assert left_out(fan_rpm=fan) == []


def test_text_amid_readings_of_an_unknown_channel_is_no_summary() -> None:
    current: list[object] = [f"{3.5 + k / 8}" for k in range(17)]
    current[4] = "gestört"
    assert left_out(I_fan=current) == []


def test_a_row_of_units_is_still_told_as_no_number(tmp_path: Path) -> None:
    rows = "".join(f"{k};0.8;0.2;{P};{1.02 * P}\n" for k, P in enumerate(POWERS))
    (tmp_path / "m.csv").write_text(f"Nr;D1;D2;P2_W;P1_W\nNo.;1;-;W;W\n{rows}")
    (row,) = load_measurements(tmp_path / "m.csv").rejected
    assert (row.row, row.column) == (1, "D2")
