"""Conditions of a row that nobody noted are those of the rows around it, never a constant among measured ones."""

import numpy as np
import pandas as pd
import pytest

from models.diagnosis.observations import observe, points_of, taken_for_granted
from sim.prototype import prototype

CONVERTER = prototype()
TIME_S = np.array([0.0, 60.0, 120.0, 180.0, 240.0])
FRAME = pd.DataFrame(
    {
        "kind": ["load", "load", "standby", "load", "load"],
        "D1": 0.9, "D2": 0.1, "P2_W": 500.0, "P1_W": 510.0, "time_s": TIME_S,
        "V1_V": [310.0, 311.0, 305.0, 312.0, 313.0], "V2_V": [139.0, 139.0, 0.0, 139.0, 139.0],
        "T_ambient_C": [36.0, 37.0, 38.0, 39.0, 40.0],
    }
)  # fmt: skip


def without(**rows: int) -> pd.DataFrame:
    """The table with one cell of each of these columns empty."""
    frame = FRAME.copy()
    for column, row in rows.items():
        frame.loc[row, column] = np.nan
    return frame


def test_a_room_and_a_time_lie_between_the_rows_around() -> None:
    points = points_of(without(T_ambient_C=3, time_s=1), CONVERTER)
    np.testing.assert_allclose(points.ambient_C, FRAME["T_ambient_C"], rtol=1e-12)  # rounding
    np.testing.assert_allclose(points.time_s, TIME_S, rtol=1e-12)


def test_a_voltage_is_the_median_of_the_rows_that_carry_power() -> None:
    points = points_of(without(V1_V=3, V2_V=0), CONVERTER)
    assert np.asarray(points.V1_V)[3] == 311.0  # of 310, 311 and 313; standby has another
    assert np.asarray(points.V2_V)[0] == 139.0


def test_a_column_without_any_value_is_taken_as_nominal() -> None:
    nobody = FRAME.assign(T_ambient_C=np.nan, V1_V=np.nan, time_s=np.nan)
    points = points_of(nobody, CONVERTER)
    assert set(np.asarray(points.ambient_C)) == {25.0}
    assert set(np.asarray(points.V1_V)) == {CONVERTER.V1_V}
    assert set(np.asarray(points.time_s)) == {0.0}


@pytest.mark.parametrize("read", [True, False])
def test_an_output_voltage_that_nobody_read_is_the_converters_own(read: bool) -> None:
    frame = FRAME.assign(V2_V=139.5 if read else np.nan)
    assert set(np.asarray(points_of(frame, CONVERTER).held)) == {not read}


def test_a_condition_that_readings_have_told_is_as_little_read_as_before() -> None:
    there = observe(FRAME.assign(V2_V=np.nan), CONVERTER).where({"V2_V": 138.0}, CONVERTER)
    assert set(np.asarray(there.points.V2_V)[there.loaded]) == {138.0}
    assert np.all(there.points.held)
    assert "V2_V" in there.unread


def test_duty_ratios_that_may_be_rounded_are_said_and_a_plans_grid_is_not() -> None:
    rng = np.random.default_rng(3)
    drawn = pd.DataFrame({"D1": rng.uniform(0.4, 1.0, 60), "D2": rng.uniform(0.0, 0.5, 60)})
    conditions = {"V1_V": 300.0, "V2_V": 140.0, "T_ambient_C": 25.0}
    (said,) = taken_for_granted(drawn.round(2).assign(**conditions), CONVERTER)
    assert "multiples of 0.01" in said
    for table in (drawn, drawn.round(1), drawn.round({"D1": 2})):
        assert taken_for_granted(table.assign(**conditions), CONVERTER) == []


def test_what_was_taken_is_said_once_for_each_column() -> None:
    assert taken_for_granted(FRAME, CONVERTER) == []
    assert taken_for_granted(without(T_ambient_C=3, V1_V=0), CONVERTER) == [
        "V1_V is missing in 1 of 5 rows: taken as the median of the others",
        "T_ambient_C is missing in 1 of 5 rows: taken from the rows around",
    ]
