"""Decimal signs and thousands are told column by column; what may be two numbers is refused with both."""

import re
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from models.dataset import DatasetError, load_measurements
from models.number_forms import AmbiguousNumberError, in_one_form

POINTS, COMMAS = ["0.8064", "0.642", "0.7"], ["0,8064", "0,642", "0,7"]


def read(cells: list[str], beside: list[str]) -> list[str | None]:
    """A column as it is read beside another one."""
    columns = {"P1_W": pd.Series(cells), "D1": pd.Series(beside)}
    return in_one_form(columns, range(2, 2 + len(cells)))["P1_W"]


@pytest.mark.parametrize(
    ("cells", "beside", "numbers"),
    [
        (["814", "998", "1.039"], COMMAS, ["814", "998", "1039"]),
        (["814", "998", "1,039"], POINTS, ["814", "998", "1039"]),
        (["814", "998", "1.039"], ["81", "64", "70"], ["814", "998", "1039"]),
        (["814.5", "998.25", "1,039"], POINTS, ["814.5", "998.25", "1039"]),
        (["814,227", "751,152", "1039,005"], COMMAS, ["814.227", "751.152", "1039.005"]),
        (["814,227", "751,152", "998,1"], POINTS, ["814.227", "751.152", "998.1"]),
        (["814,227", "751,152", "998,390"], COMMAS, ["814.227", "751.152", "998.390"]),
        (["428.973", "475.981", "1045.92"], COMMAS, ["428.973", "475.981", "1045.92"]),
        (["25", "25.125", "25"], COMMAS, ["25", "25.125", "25"]),
        (["814.227", "751.152", "998.390"], ["81", "64", "70"], ["814.227", "751.152", "998.390"]),
        (["814,5", "9.91E+37", "998,25"], COMMAS, ["814.5", "9.91E+37", "998.25"]),
        (["814,5", "9,91E+37", "998,25"], POINTS, ["814.5", "9.91E+37", "998.25"]),
        (["814,228", "751,152", "1,069,050"], ["81", "64", "70"], ["814228", "751152", "1069050"]),
        (["1.814,5", "1.277,25", "1.039"], COMMAS, ["1814.5", "1277.25", "1039"]),
        (["1.039.500", "2.814.227", "998"], POINTS, ["1039500", "2814227", "998"]),
        (["20.11.2026", "x", "22:14:05,5"], COMMAS, ["20.11.2026", "x", "22:14:05,5"]),
    ],
)
def test_a_number_is_read_as_its_column_and_its_table_tell(
    cells: list[str], beside: list[str], numbers: list[str]
) -> None:
    assert read(cells, beside) == numbers


@pytest.mark.parametrize(
    ("cells", "beside", "named"),
    [
        (
            ["1.039", "1.277", "2.814"],
            COMMAS,
            ["line 2, P1_W = 1.039", "line 2, D1 = 0,8064 has a decimal comma"],
        ),
        (
            ["1,039", "1,277", "2,814"],
            POINTS,
            ["line 2, P1_W = 1,039", "line 2, D1 = 0.8064 has a decimal point"],
        ),
        (["814,228", "814.5", "81,5"], POINTS, ["line 2, P1_W = 814,228", "line 3, P1_W = 814.5"]),
        (["814.22", "751.15", "81,453"], POINTS, ["line 4, P1_W = 81,453", "may be 81.453, or 81453"]),
        (["1039.22", "751.15", "1,277"], POINTS, ["line 4, P1_W = 1,277", "line 2, P1_W = 1039.22"]),
    ],
)
def test_a_number_that_may_be_two_is_refused_with_the_cell_that_tells_otherwise(
    cells: list[str], beside: list[str], named: list[str]
) -> None:
    with pytest.raises(AmbiguousNumberError) as refused:
        read(cells, beside)
    assert all(each in str(refused.value) for each in named)


def test_numbers_of_thousands_alone_in_a_table_of_whole_ones_are_refused() -> None:
    with pytest.raises(
        AmbiguousNumberError, match=r"1,039: this may be 1.039, or 1039 with its thousands apart\. Write"
    ):
        read(["1,039", "1,277", "2,814"], ["81", "64", "70"])


@pytest.mark.parametrize(("decimal", "thousands"), [(",", "."), (".", ","), (",", " "), (".", "'")])
@pytest.mark.parametrize("digits", [0, 1, 2, 3, 4])
def test_any_powers_are_read_as_they_were_written(decimal: str, thousands: str, digits: int) -> None:
    powers = np.random.default_rng(digits).uniform(20.0, 2000.0, 60)
    written = [f"{power:_.{digits}f}".replace(".", decimal).replace("_", thousands) for power in powers]
    duties = [each.replace(".", decimal) for each in POINTS * 20]
    numbers = [float(cell or "nan") for cell in read(written, duties)]
    assert numbers == pytest.approx([float(f"{power:.{digits}f}") for power in powers])


def test_a_file_with_such_a_number_is_refused_with_its_line(tmp_path: Path) -> None:
    (tmp_path / "m.csv").write_text("D1;D2;P2_W;P1_W\n\n0,8;0,2;1.200;1.224\n0,8;0,2;1.300;1.325\n")
    with pytest.raises(
        DatasetError, match=re.escape("m.csv: line 3, P2_W = 1.200: this may be 1.200, or 1200")
    ):
        load_measurements(tmp_path / "m.csv")


def test_a_code_for_no_data_in_a_table_with_commas_costs_its_row_only(tmp_path: Path) -> None:
    rows = "0,8;0,2;600,5;612,5\n0,8;0,2;700,5;9.91E+37\n"
    (tmp_path / "m.csv").write_text(f"D1;D2;P2_W;P1_W\n{rows}")
    (row,) = load_measurements(tmp_path / "m.csv").rejected
    assert (row.row, row.column, row.value, row.reason) == (2, "P1_W", "9.91E+37", "overrange or no data")
