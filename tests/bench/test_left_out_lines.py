"""What a command says of rows that it leaves out: each reason once."""

from dataclasses import replace

import pandas as pd

from bench.commands.measurements import left_out_lines
from models.dataset import load_measurements
from models.screening import RejectedRow

REJECTED = RejectedRow(row=1, column="P2_W", value="-1.0", reason="")


def lines(*powers: float) -> list[str]:
    rows = [{"D1": 0.8, "D2": 0.2, "P2_W": power, "P1_W": power / 0.98} for power in powers]
    return left_out_lines(load_measurements(pd.DataFrame(rows)))


def test_nothing_is_said_of_a_whole_table() -> None:
    assert lines(600.0, 700.0) == []


def test_rows_of_one_reason_are_told_together() -> None:
    first, others = lines(600.0, -1.0, 700.0, -2.0, -3.0, 800.0)
    assert first.startswith("row 2, P2_W = -1.0: below 0 W, and P1_W too")
    assert others == "2 rows more for that reason: 4, 5"


def test_many_rows_are_not_listed_to_the_last() -> None:
    _, others, most = lines(600.0, *([-1.0] * 40))
    assert others.endswith("22, …")
    assert others.startswith("39 rows more")
    assert most.startswith("40 of 41 rows are left out, most of the table")


def test_each_reason_is_told() -> None:
    assert [line.split(":")[0] for line in lines(600.0, -1.0, 0.5, 700.0, 800.0)] == [
        "row 2, P2_W = -1.0",
        "row 3, P2_W = 0.5",
    ]


def test_no_more_than_twenty_reasons_are_told() -> None:
    power = [600.0 + k for k in range(90)]
    rows = {"D1": 0.8, "D2": 0.2, "P2_W": power, "P1_W": [1.02 * watts for watts in power]}
    table = load_measurements(pd.DataFrame(rows))
    many = tuple(replace(REJECTED, row=k, reason=f"reason {k}") for k in range(25))
    said = left_out_lines(replace(table, rejected=many))
    assert len(said) == 21
    assert said[-1] == "and 5 rows more left out"
