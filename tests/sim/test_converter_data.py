"""A converter as plain data: there and back, and everything wrong with it named."""

import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from sim.converter_data import ConverterDataError, converter_from_plain, converter_to_plain
from sim.model import Model
from sim.parameters import FullBridge
from sim.prototype import prototype
from sim.simulate import grid_of, simulate
from sim.spread import everyday_spread

EXAMPLE = Path(__file__).resolve().parents[2] / "docs" / "examples" / "two_level_dab.toml"


def example() -> dict[str, Any]:
    """The example's tables, fresh."""
    return tomllib.loads(EXAMPLE.read_text(encoding="utf-8"))["converter"]


def wrong_with(data: dict[str, Any]) -> dict[str, str]:
    with pytest.raises(ConverterDataError) as caught:
        converter_from_plain(data)
    return {".".join(w.keys): w.allowed for w in caught.value.wrong}


def test_the_prototype_comes_back_as_it_was() -> None:
    assert converter_from_plain(converter_to_plain(prototype()), "hybrid") == prototype()


def test_the_example_comes_back_as_it_was() -> None:
    converter = converter_from_plain(example())
    assert isinstance(converter.primary, FullBridge)
    assert converter_from_plain(converter_to_plain(converter)) == converter


def test_the_example_runs_at_a_believable_efficiency() -> None:
    converter = converter_from_plain(example())
    result = simulate(Model(converter=converter), grid_of(converter, (9, 9, 4)))
    assert result.feasible.mean() > 0.2
    assert 0.95 < np.nanmax(result["efficiency"]) < 0.995


def test_a_value_brings_its_tolerance_to_the_spreads() -> None:
    found = {s.path: s.sigma for s in everyday_spread(converter_from_plain(example()))}
    assert found["secondary.switch.on.resistance_Ohm"] == 0.05
    assert found["primary.switch.on.resistance_Ohm"] == 0.05  # of the part's data file


def test_an_unknown_key_is_named_with_the_nearest() -> None:
    data = example()
    data["inductor"]["inductence_H"] = 1e-4
    assert "did you mean 'inductance_H'" in wrong_with(data)["inductor.inductence_H"]


def test_everything_wrong_is_listed_at_once() -> None:
    data = example()
    del data["transformer"]["turns_ratio"]
    data["primary"]["switch"] = "IRF540"
    data["secondary"]["switch"]["on"]["resistance_Ohm"] = -1.0
    data["V1_V"] = "400 V"
    assert set(wrong_with(data)) == {
        "transformer.turns_ratio", "primary.switch", "secondary.switch.on", "V1_V",
    }  # fmt: skip


def test_a_rated_power_that_cannot_flow_is_a_contradiction() -> None:
    assert "carry no more" in wrong_with(example() | {"rated_power_W": 5000.0})["rated_power_W"]


def test_kilohertz_given_as_hertz_are_a_contradiction() -> None:
    said = wrong_with(example() | {"frequency_Hz": 100.0})["frequency_Hz"]
    assert "1067 times the rated power" in said
    assert "check it, the voltages, and inductor.inductance_H = 0.00012" in said


def test_a_bridge_is_three_level_or_two_level_not_both() -> None:
    data = example()
    data["primary"]["clamp"] = "APT30DQ60BG"
    assert "unknown key" in wrong_with(data)["primary.clamp"]


@pytest.mark.parametrize("value", [float("nan"), float("inf"), 0.0, -1.0])
def test_values_that_no_converter_has_are_refused(value: float) -> None:
    assert "allowed: finite and > 0" in wrong_with(example() | {"frequency_Hz": value})[""]


def test_a_dead_time_longer_than_the_half_period_allows_is_refused() -> None:
    assert "up to a quarter of the half period" in wrong_with(example() | {"dead_time_s": 2e-6})[""]


def test_a_choke_saturates_where_one_of_the_converters_size_does_unless_the_file_says_where() -> None:
    data = converter_to_plain(prototype())
    of_prototype = data["inductor"].pop("saturation_A")
    assert converter_from_plain(data).inductor.saturation_A == of_prototype
    tenfold = data | {"rated_power_W": 20e3, "inductor": data["inductor"] | {"inductance_H": 23.6e-6}}
    assert converter_from_plain(tenfold).inductor.saturation_A == pytest.approx(10 * of_prototype)
    data["inductor"]["saturation_A"] = 40.0
    assert converter_from_plain(data).inductor.saturation_A == 40.0


def test_a_saturation_is_stated_at_a_current() -> None:
    data = example()
    data["inductor"]["saturation"] = 0.2
    assert wrong_with(data)["inductor.saturation_A"].startswith("is missing")


@pytest.mark.parametrize("tolerance", ["5 %", [0.05], -0.05, 5.0, float("nan"), True])
def test_a_tolerance_that_is_no_share_is_named(tolerance: object) -> None:
    data = converter_to_plain(prototype())
    switch = dict(example()["secondary"]["switch"])
    switch["on"] = switch["on"] | {"resistance_Ohm": {"value": 0.01, "tolerance": tolerance}}
    data["secondary"] = {"switch": switch}
    assert "a share of the value" in wrong_with(data)["secondary.switch.on.resistance_Ohm.tolerance"]


def test_a_value_of_the_link_may_state_its_own_tolerance() -> None:
    data = example() | {"dead_time_s": {"value": 150e-9, "tolerance": 0.1, "source": "gate driver"}}
    data["inductor"]["inductance_H"] = {"value": 120e-6, "tolerance": 0.05}
    data["transformer"]["winding"]["resistance_Ohm"] = {"value": 0.05}  # a source, or nothing, beside it
    converter = converter_from_plain(data)
    assert (converter.dead_time_s, converter.inductor.inductance_H) == (150e-9, 120e-6)
    spreads = {s.path: s for s in everyday_spread(converter)}
    usual = {s.path: s for s in everyday_spread(converter_from_plain(example()))}
    assert (spreads["inductor.inductance_H"].sigma, usual["inductor.inductance_H"].sigma) == (0.05, 0.01)
    assert spreads["dead_time_s"].moved(150e-9, 1.0) == pytest.approx(165e-9)
    same = set(spreads) - {"inductor.inductance_H", "dead_time_s"}
    assert all(spreads[path] == usual[path] for path in same)
    assert converter_from_plain(converter_to_plain(converter)) == converter


@pytest.mark.parametrize(
    ("key", "value", "told"),
    [
        ("link_resistance_Ohm", {"value": 0.0, "tolerance": 0.1}, "a share of the value, which is 0"),
        ("dead_time_s", {"value": 150e-9, "tolerance": -1.0}, "a share of the value: 0 or more"),
        ("dead_time_s", {"value": 150e-9, "tolerance": 0.0}, "above 0; what is left out has its usual"),
        ("V1_V", {"value": 400.0, "tolerance": 0.1}, "a number, and states no tolerance"),
        ("tolerances", {"dead_time_s": 0.1}, "belongs to each value"),
    ],
)
def test_a_tolerance_that_means_nothing_is_named(key: str, value: object, told: str) -> None:
    assert any(told in allowed for allowed in wrong_with(example() | {key: value}).values())


def test_a_device_without_thermal_resistance_is_told_the_key_of_the_file() -> None:
    data = example()
    del data["secondary"]["switch"]["thermal"]
    wrong = wrong_with(data)
    assert list(wrong) == ["secondary.switch.thermal.resistance_K_per_W"]
    data["secondary"]["switch"]["termal"] = 1.0
    known = wrong_with(data)["secondary.switch.termal"].partition("known here: ")[2].split(", ")
    assert "thermal" in known
    assert not {"thermal_K_per_W", "tolerances"} & set(known)


def test_a_link_that_carries_nothing_is_told_with_its_inductance() -> None:
    data = example()
    data["inductor"]["inductance_H"] = 120.0
    assert "inductor.inductance_H = 120" in wrong_with(data)["rated_power_W"]
