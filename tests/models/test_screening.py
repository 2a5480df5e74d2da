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


def test_an_input_power_that_counts_the_other_way_is_told_the_option_that_turns_it() -> None:
    turned = efficiencies(P1_W=[-515.0, -625.0, -737.0], efficiency=None)
    with pytest.raises(
        DatasetError, match=r"P1_W = -515.0: not above 0 W.*--column P1_W=P1_W\*-1 converts it"
    ):
        load_measurements(turned)


def exchanged(**columns: object) -> str:
    """What is said of three rows whose powers are the wrong way round."""
    with pytest.raises(DatasetError) as refused:
        load_measurements(efficiencies(P1_W=[485.0, 582.0, 679.0], efficiency=None, **columns))
    return str(refused.value)


VOLTAGES = "--column V1_V=V2_V --column V2_V=V1_V"
CURRENTS = "--column I1_A=I2_A --column I2_A=I1_A"


def test_exchanged_powers_alone_are_told_to_be_exchanged_alone() -> None:
    assert (
        "if the two are exchanged, d2ea import --column P1_W=P2_W --column P2_W=P1_W puts them right"
        in exchanged()
    )
    assert "V1_V" not in exchanged()


def test_exchanged_powers_ask_for_the_voltages_where_nothing_tells() -> None:
    assert f"puts them right, and if V1_V and V2_V are exchanged too, with {VOLTAGES}" in exchanged(
        V1_V=140.0, V2_V=300.0
    )


def test_exchanged_powers_are_told_with_voltages_and_currents_that_are_exchanged_too() -> None:
    whole = exchanged(V1_V=140.0, V2_V=300.0, I1_A=[3.464, 4.157, 4.85], I2_A=[1.667, 2.0, 2.333])
    assert f"puts them right, with {VOLTAGES} {CURRENTS}: V1_V * I1_A is P1_W there" in whole
    alone = exchanged(V1_V=300.0, V2_V=140.0, I1_A=[1.667, 2.0, 2.333], I2_A=[3.464, 4.157, 4.85])
    assert VOLTAGES not in alone


def test_what_exchanges_is_told_with_the_names_that_the_table_has() -> None:
    table = efficiencies(P1_W=[485.0, 582.0, 679.0], efficiency=None, Uin=140.0, V2_V=300.0)
    with pytest.raises(DatasetError, match=r'--column V1_V=V2_V --column "V2_V=Uin"'):
        load_measurements(table, [OtherName.parse("V1_V=Uin")])


def test_the_options_that_exchange_a_whole_table_do_so() -> None:
    table = efficiencies(P1_W=[485.0, 582.0, 679.0], efficiency=None, V1_V=140.0, V2_V=300.0)
    pairs = ("P1_W=P2_W", "P2_W=P1_W", "V1_V=V2_V", "V2_V=V1_V")
    read = load_measurements(table, [OtherName.parse(pair) for pair in pairs])
    assert (read.frame["V1_V"][0], read.frame["P1_W"][0], len(read.rejected)) == (300.0, 500.0, 0)
