"""A table that says at which frequency it was measured: every way of saying it, and what is no such thing."""

from typing import Any

import pandas as pd
import pytest

from models.dataset import load_measurements
from models.switching_frequency import stated_frequencies

ROWS = pd.DataFrame({"D1": [0.9] * 3, "D2": [0.1] * 3, "P2_W": [900.0, 901.0, 902.0], "P1_W": [920.0] * 3})


@pytest.mark.parametrize(
    ("column", "value"),
    [("fs_kHz", 30), ("f_sw [kHz]", "30,0"), ("switching frequency (Hz)", 30e3), ("fsw", 30),
     ("Schaltfrequenz/kHz", 30),
     ("frequency_Hz", 30e3)],
)  # fmt: skip
def test_a_frequency_is_understood_in_its_unit(column: str, value: Any) -> None:
    (stated,) = stated_frequencies(ROWS.assign(**{column: value}), (1, 2, 3))
    assert stated.frequency_Hz == 30e3
    assert stated.column == column
    assert stated.differs_from(25e3)
    assert not stated.differs_from(30.1e3)


def test_the_first_row_of_each_value_is_named_as_the_file_counts() -> None:
    stated = stated_frequencies(ROWS.assign(fs_kHz=[25.0, 30.0, 30.0]), (4, 6, 7))
    assert [(each.row, each.frequency_Hz) for each in stated] == [(4, 25e3), (6, 30e3)]


@pytest.mark.parametrize(
    ("column", "value"), [("freq_Hz", 50.0), ("frequency (kHz)", 0.0), ("D1", 0.9), ("fs", None)]
)
def test_the_mains_and_what_is_empty_are_no_switching_frequency(column: str, value: Any) -> None:
    stated = stated_frequencies(ROWS.assign(**{column: value}), (1, 2, 3))
    assert not any(each.differs_from(25e3) for each in stated)


@pytest.mark.parametrize(("value", "counts"), [(2.4e3, False), (2.6e3, True), (240e3, True), (260e3, False)])
def test_a_name_that_may_mean_another_frequency_counts_within_a_factor_of_ten(
    value: float, counts: bool
) -> None:
    (stated,) = stated_frequencies(ROWS.assign(freq_Hz=value), (1, 2, 3))
    assert stated.differs_from(25e3) is counts


def test_such_a_column_is_not_called_ignored() -> None:
    assert load_measurements(ROWS.assign(fs_kHz=25.0)).notes == ()
