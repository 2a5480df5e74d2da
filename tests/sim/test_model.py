"""Models: a baseline with effects, as plain data, refusing what no effect knows."""

import pytest

from sim.model import Model
from sim.parameters import ParameterError


def test_an_unknown_effect_is_refused_with_the_nearest_name() -> None:
    with pytest.raises(ParameterError, match="did you mean 'link_resistance'"):
        Model.baseline().with_effect("link_resistence", resistance_Ohm=0.1)


def test_an_unknown_parameter_is_refused_with_those_there_are() -> None:
    with pytest.raises(ParameterError, match=r"dead_time has no parameter 'seconds'.*error_s"):
        Model.baseline().with_effect("dead_time", seconds=1e-8)


def test_adding_an_effect_leaves_the_model_as_it_was() -> None:
    baseline = Model.baseline()
    more = baseline.with_effect("auxiliary_power", power_W=2.0).with_effect("dead_time", error_s=1e-8)
    assert baseline.effects == {}
    assert list(more.effects) == ["auxiliary_power", "dead_time"]


def test_effects_on_one_parameter_add_up() -> None:
    model = Model.baseline().with_effect("link_resistance", resistance_Ohm=0.1)
    assert model.altered_converter().link_resistance_Ohm == pytest.approx(0.105)


def test_plain_data_names_converter_and_effects() -> None:
    plain = Model.baseline().with_effect("fan_step", power_W=3.0, threshold_C=45.0).as_plain()
    assert plain["effects"] == {"fan_step": {"power_W": 3.0, "threshold_C": 45.0}}
    assert "NPC" in plain["converter"]
