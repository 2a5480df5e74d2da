"""Parameter objects: laws that agree with their definitions, and checks that say what is wrong."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import quad

from sim.parameters import Capacitance, Conduction, ParameterError, Recovery, SwitchingEnergy, leaves
from sim.prototype import prototype

SIC = Capacitance(zero_bias_F=4.24e-9, junction_V=1.0, grading=0.55)


def capacitance_F(v: float) -> float:
    return 4.24e-9 / (1 + v) ** 0.55


@pytest.mark.parametrize("voltage_V", [0.0, 1.0, 75.0, 140.0, 400.0])
def test_charge_is_the_integral_of_the_capacitance(voltage_V: float) -> None:
    charge_C = quad(capacitance_F, 0, voltage_V, epsabs=0)[0]
    assert SIC.charge_C(voltage_V) == pytest.approx(charge_C, rel=1e-9, abs=1e-20)


@pytest.mark.parametrize("voltage_V", [0.0, 1.0, 75.0, 140.0, 400.0])
def test_energy_is_the_integral_of_voltage_over_charge(voltage_V: float) -> None:
    energy_J = quad(lambda v: v * capacitance_F(v), 0, voltage_V, epsabs=0)[0]
    assert SIC.energy_J(voltage_V) == pytest.approx(energy_J, rel=1e-9, abs=1e-20)


def test_the_sic_switch_stores_what_its_datasheet_says() -> None:
    capacitance = prototype().secondary.switch.capacitance
    assert capacitance.charge_C(140.0) == pytest.approx(78e-9, rel=0.01)
    related_F = 2 * capacitance.energy_J(400.0) / 400.0**2
    assert related_F == pytest.approx(212e-12, rel=0.03)  # one law through two points of a curve


def test_switching_energy_is_its_datasheet_point_there_and_zero_without_current() -> None:
    law = SwitchingEnergy(
        energy_J=1e-4, reference_V=400, reference_A=40, current_exponent=0.9, voltage_exponent=1.3
    )
    assert law.at(current_A=40.0, voltage_V=400.0, junction_C=25.0) == pytest.approx(1e-4)
    assert law.at(current_A=-3.0, voltage_V=400.0, junction_C=25.0) == 0.0


def test_recovery_grows_with_the_root_of_the_current() -> None:
    law = Recovery(charge_C=1e-7, reference_A=10.0, charge_per_K=0.01)
    four, one = (law.at(current_A=i, junction_C=125.0) for i in (40.0, 10.0))
    assert four == pytest.approx(2 * one)
    assert one == pytest.approx(2e-7)


@pytest.mark.parametrize(
    ("field", "value"),
    [("V1_V", 0.0), ("dead_time_s", -1e-9), ("heatsink_K_per_W", np.nan), ("link_resistance_Ohm", -0.1)],
)
def test_an_impossible_value_is_refused_by_name(field: str, value: float) -> None:
    with pytest.raises(ParameterError, match=rf"Converter\.{field} is .*allowed"):
        replace(prototype(), **{field: value})


def test_one_impossible_value_of_many_is_refused() -> None:
    with pytest.raises(ParameterError, match=r"Conduction\.threshold_V"):
        Conduction(threshold_V=np.array([0.5, -0.1]), resistance_Ohm=0.01)


def test_a_dead_time_of_half_a_pulse_is_refused() -> None:
    with pytest.raises(ParameterError, match="quarter of the half period"):
        replace(prototype(), dead_time_s=7e-6)


def test_the_prototype_is_fresh_and_equal_each_time() -> None:
    assert prototype() == prototype()
    assert prototype() is not prototype()


def test_leaves_name_every_value_by_its_path() -> None:
    found = leaves(prototype())
    assert found["secondary.switch.capacitance.grading"] == 0.55
    assert found["frequency_Hz"] == 20e3
    assert not any(hasattr(value, "__dataclass_fields__") for value in found.values())


@pytest.mark.parametrize("name", ["threshold_per_K", "resistance_per_K"])
def test_a_drop_that_is_gone_when_hot_is_refused(name: str) -> None:
    with pytest.raises(ParameterError, match=rf"Conduction\.{name} is -0.005; allowed: .* at 250 degC"):
        Conduction(threshold_V=1.0, resistance_Ohm=0.01, **{name: -0.005})


def test_a_resistance_bends_off_the_line_through_25_and_125_degrees() -> None:
    line = Conduction(threshold_V=0.0, resistance_Ohm=0.02, resistance_per_K=0.0032)
    bent = replace(line, resistance_bend_per_K2=1.5e-5)
    junction_C = np.array([25.0, 75.0, 125.0, 175.0])
    off = bent.at(junction_C)[1] / 0.02 - line.at(junction_C)[1] / 0.02
    np.testing.assert_allclose(off, [0.0, -0.0375, 0.0, 0.1125], atol=1e-12)  # rounding


def test_a_resistance_that_bends_far_down_is_some_all_the_same() -> None:
    bent = Conduction(threshold_V=0.0, resistance_Ohm=0.02, resistance_bend_per_K2=-1e-4)
    assert bent.at(250.0)[1] == pytest.approx(0.002)
