"""Which column of a stranger's table is meant."""

import pandas as pd
import pytest

from models.dataset import load_measurements
from models.other_names import factor_of, meant

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
        ("time_s", "time min"),
        ("time_s", "Zeit_h"),
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


@pytest.mark.parametrize(
    ("theirs", "factor"), [("time min", 60.0), ("Elapsed time (hours)", 3600.0), ("time", 1.0)]
)
def test_minutes_and_hours_become_seconds(theirs: str, factor: float) -> None:
    assert meant(REQUIRED, OPTIONAL, [theirs])["time_s"] == theirs
    assert factor_of("time_s", theirs) == factor


def test_a_least_power_is_no_power_in_minutes() -> None:
    assert factor_of("P1_W", "P1_min") == 1.0


def test_no_column_is_meant_twice() -> None:
    found = meant(REQUIRED, OPTIONAL, ["U1", "U2", "P", "eta"])
    assert len(set(found.values())) == len(found)
    assert (found["V1_V"], found["V2_V"], found["efficiency"]) == ("U1", "U2", "eta")


def test_what_is_known_in_other_letters_is_asked_for() -> None:
    rows = {"D1": 0.8, "D2": 0.2, "P2_W": [600.0, 700.0], "efficiency": 0.96}
    read = load_measurements(pd.DataFrame(rows | {"KIND": "load", "T_HEATSINK_C": 30.0}))
    assert '--column "kind=KIND"' in read.notes[0]
    assert '--column "T_heatsink_C=T_HEATSINK_C"' in read.notes[0]
