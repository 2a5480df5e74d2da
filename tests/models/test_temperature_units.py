"""Temperatures in degrees Fahrenheit and kelvin: asked for, suggested, and taken."""

import re
from pathlib import Path

import pytest

from models.dataset import DatasetError, load_measurements
from models.other_names import OtherName
from tests.models.small_tables import efficiencies


def written(folder: Path, text: str) -> Path:
    (folder / "theirs.csv").write_text(text, encoding="utf-8")
    return folder / "theirs.csv"


@pytest.mark.parametrize(
    ("column", "units", "reading"),
    [
        ("T_hs/°F", None, 95.0),
        ("T_hs [degF]", None, 95.0),
        ("T hs (F)", None, 95.0),
        ("T_hs_K", None, 308.15),
        ("T_hs [K]", None, 308.15),
        ("T_hs [°C]", None, 35.0),
        ("T_hs", "°F", 95.0),
        ("T_hs", "K", 308.15),
        ("T_hs in K", None, 308.15),
    ],
)
def test_a_heatsink_in_any_unit_is_suggested_with_it_and_read_in_degC(
    column: str, units: str | None, reading: float, tmp_path: Path
) -> None:
    below = f"W,W,,,{units}\n" if units else ""
    file = written(tmp_path, f"Pin,Pout,D1,D2,{column}\n{below}612,600,0.8,0.2,{reading}\n")
    with pytest.raises(DatasetError) as refused:
        load_measurements(file)
    options = re.findall(r'--column "([^"]*)"', str(refused.value))
    read = load_measurements(file, [OtherName.parse(option) for option in options])
    assert read.frame["T_heatsink_C"].tolist() == pytest.approx([35.0])  # to rounding


def test_what_is_no_number_stays_as_it_stood_beside_a_unit() -> None:
    (note,) = load_measurements(
        efficiencies(hs=[95.0, "open", 104.0]), [OtherName.parse("T_heatsink_C=hs in degF")]
    ).notes
    assert "(row 2: open)" in note


def test_kelvin_under_our_own_name_is_told_with_the_option_that_converts_it() -> None:
    table = efficiencies(T_heatsink_C=[308.0, 309.0, 310.0])
    (note,) = load_measurements(table).notes
    assert "T_heatsink_C: median 309" in note
    assert "kelvin" in note
    (option,) = re.findall(r'--column "([^"]*)"', note)
    read = load_measurements(table, [OtherName.parse(option)])
    assert read.frame["T_heatsink_C"].tolist() == pytest.approx([34.85, 35.85, 36.85])
    assert read.notes == ()


def test_a_warm_room_is_told_as_one_in_degrees_fahrenheit_with_all_options() -> None:
    table = efficiencies(T_ambient_C=77.0, T_heatsink_C=95.0, T_inductor_C=40.0)
    (note,) = load_measurements(table).notes
    assert "as degrees Fahrenheit it is 25 degC" in note
    options = re.findall(r'--column "([^"]*)"', note)
    assert options == ["T_ambient_C=T_ambient_C in degF", "T_heatsink_C=T_heatsink_C in degF"]
    (row,) = load_measurements(table.iloc[:1], [OtherName.parse(option) for option in options]).frame.to_dict(
        "records"
    )
    assert [row[name] for name in ("T_ambient_C", "T_heatsink_C")] == pytest.approx([25.0, 35.0])


def test_temperatures_in_degC_are_not_remarked_upon() -> None:
    assert load_measurements(efficiencies(T_ambient_C=25.0, T_heatsink_C=120.0)).notes == ()


def test_the_option_is_told_with_the_name_that_the_table_has() -> None:
    table = efficiencies(hs=[308.0, 309.0, 310.0])
    (note,) = load_measurements(table, [OtherName.parse("T_heatsink_C=hs")]).notes
    assert '"T_heatsink_C=hs in K"' in note


def test_another_column_has_no_such_unit() -> None:
    assert OtherName.parse("P1_W=power in K").theirs == "power in K"
