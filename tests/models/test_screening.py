"""Rows and values that cannot be: which are left out or left empty, and what is said of them."""

import pytest

from models.dataset import DatasetError, load_measurements
from models.other_names import OtherName
from tests.models.small_tables import efficiencies


def test_input_powers_that_are_no_numbers_are_said_where_efficiency_stands_in() -> None:
    read = load_measurements(efficiencies(P1_W=["515 W", None, "737"]))
    assert read.notes == (
        "P1_W: 1 of 3 values are no numbers (row 1: 515 W); taken from efficiency and P2_W there",
    )


def test_power_that_flows_back_is_said_as_that_and_not_how_to_turn_it_round() -> None:
    back = efficiencies(P2_W=[-500.0, 600.0, 700.0], P1_W=[-490.0, 625.0, 737.0], efficiency=None)
    (row,) = load_measurements(back).rejected
    assert (row.row, row.column) == (1, "P2_W")
    assert "from the output to the input; such rows are not diagnosed" in row.reason
    assert "import" not in row.reason


def test_a_row_without_load_is_told_which_kind_it_is() -> None:
    (row,) = load_measurements(efficiencies(P2_W=[0.0, 600.0, 700.0])).rejected
    assert "the kind no_load or standby" in row.reason


def test_a_spike_of_the_room_is_left_empty_and_said() -> None:
    read = load_measurements(efficiencies(T_ambient_C=[24.0, 999.0, 25.0]))
    assert read.frame["T_ambient_C"].isna().tolist() == [False, True, False]
    assert "T_ambient_C: 1 of 3 values cannot be and are left empty (row 2: 999.0)" in read.notes
    kelvin = load_measurements(
        efficiencies(T_ambient_C=[297.0, 298.0, 299.0])
    )  # a unit: refused as a whole later
    assert kelvin.frame["T_ambient_C"].notna().all()


def test_an_efficiency_with_a_sign_of_per_cent_is_told_how_to_be_converted() -> None:
    signed = efficiencies(efficiency=["97 %", "96 %", "95%"])
    with pytest.raises(DatasetError, match=r"efficiency = 97 %: this looks like per cent.*efficiency\*0.01"):
        load_measurements(signed)
    read = load_measurements(signed, [OtherName.parse("efficiency=efficiency*0.01")])
    assert read.frame["efficiency"].tolist() == pytest.approx([0.97, 0.96, 0.95])  # to rounding


def test_a_missing_efficiency_is_called_so_where_there_is_no_input_power() -> None:
    with pytest.raises(DatasetError, match="efficiency = n/a: neither P1_W nor efficiency"):
        load_measurements(efficiencies(efficiency="n/a"))
