"""The device data files: complete, sourced, and loaded into the right fields."""

import tomllib
from importlib.resources import files

import pytest

from sim.datasheet import datasheet, load_diode, load_switch
from sim.parameters import ParameterError

PARTS = sorted(
    p.name.removesuffix(".toml") for p in files("sim.devices").iterdir() if p.name.endswith("toml")
)
ENTRIES = [(part, name) for part in PARTS for name in datasheet(part)]


@pytest.mark.parametrize("part", PARTS)
def test_every_entry_of_a_file_has_value_tolerance_and_source(part: str) -> None:
    document = tomllib.loads((files("sim.devices") / f"{part}.toml").read_text(encoding="utf-8"))
    sections = {name: table for name, table in document.items() if isinstance(table, dict)}
    for section, entries in sections.items():
        for name, entry in entries.items():
            assert set(entry) == {"value", "tolerance", "source"}, f"{part} {section}.{name}"


@pytest.mark.parametrize(("part", "name"), ENTRIES)
def test_a_value_is_a_number_with_a_believable_tolerance_and_a_source(part: str, name: str) -> None:
    entry = datasheet(part)[name]
    assert isinstance(entry.value, float)
    assert 0.0 <= entry.tolerance <= 0.5
    assert len(entry.source) > 5


def test_the_three_parts_of_the_prototype_are_there() -> None:
    assert PARTS == ["APT30DQ60BG", "IKW40N65ES5", "UF3C065030K4S"]


def test_the_igbt_drops_its_datasheet_voltage() -> None:
    threshold_V, resistance_Ohm = load_switch("IKW40N65ES5").on.at(25.0)
    assert threshold_V + 40 * resistance_Ohm == pytest.approx(1.35, abs=0.01)  # typical, 40 A, 25 degC


@pytest.mark.parametrize(("junction_C", "drop_V"), [(25.0, 2.0), (125.0, 1.7)])
def test_the_clamp_diode_drops_its_datasheet_voltage(junction_C: float, drop_V: float) -> None:
    threshold_V, resistance_Ohm = load_diode("APT30DQ60BG").on.at(junction_C)
    assert threshold_V + 30 * resistance_Ohm == pytest.approx(drop_V, abs=0.02)


@pytest.mark.parametrize(("junction_C", "factor"), [(125.0, 1.32), (175.0, 1.59)])
def test_the_sic_channel_grows_by_its_datasheet_factors(junction_C: float, factor: float) -> None:
    on = load_switch("UF3C065030K4S").on
    assert on.at(junction_C)[1] / on.at(25.0)[1] == pytest.approx(factor, abs=0.005)  # two digits


def test_an_unknown_part_names_those_there_are() -> None:
    with pytest.raises(ParameterError, match=r"'IRF540'.*UF3C065030K4S"):
        load_switch("IRF540")
