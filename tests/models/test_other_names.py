"""Which column of a stranger's table is meant."""

import pytest

from models.other_names import meant

REQUIRED = ("D1", "D2", "P2_W", "P1_W", "efficiency")
OPTIONAL = ("time_s", "V1_V", "V2_V", "I1_A", "I2_A", "T_heatsink_C", "T_ambient_C")


@pytest.mark.parametrize(
    ("ours", "theirs"),
    [
        ("D1", "Duty ratio"),
        ("D1", "Tastgrad"),
        ("D2", "inner phase shift [deg]"),
        ("P1_W", "Input Power (kW)"),
        ("P2_W", "Ausgangsleistung [W]"),
        ("efficiency", "Wirkungsgrad [%]"),
        ("efficiency", "η1"),
        ("time_s", "Zeitstempel"),
        ("V1_V", "Uin/V"),
        ("V2_V", "output voltage"),
        ("I1_A", "I_in (mA)"),
        ("I2_A", "Ausgangsstrom"),
        ("T_heatsink_C", "temp hs [°C]"),
        ("T_heatsink_C", "Kühlkörpertemperatur"),
        ("T_ambient_C", "Umgebung [°C]"),
        ("T_ambient_C", "Ambient temperature"),
    ],
)
def test_what_a_laboratory_calls_a_column_is_understood(ours: str, theirs: str) -> None:
    assert meant(REQUIRED, OPTIONAL, ["No.", theirs, "remark"])[ours] == theirs


def test_no_column_is_meant_twice() -> None:
    found = meant(REQUIRED, OPTIONAL, ["U1", "U2", "P", "eta"])
    assert len(set(found.values())) == len(found)
    assert (found["V1_V"], found["V2_V"], found["efficiency"]) == ("U1", "U2", "eta")
