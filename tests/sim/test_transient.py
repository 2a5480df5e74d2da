"""The closed loop in time: it holds the voltage, settles after a step, and ends where the steady state is."""

from dataclasses import replace

import numpy as np
import pytest

from sim.model import Model
from sim.operating_points import Points
from sim.parameters import ParameterError
from sim.prototype import prototype_voltage_loop
from sim.simulate import simulate
from sim.stepping import Steps
from sim.transient import DutyTable, LoadStep, Response, load_step, loop_plant
from sim.voltage_loop import LoopPlant, VoltageLoop, margin

TABLE = DutyTable(power_W=np.array([600.0, 1600.0]), D1=np.array([0.9, 1.0]), D2=np.array([0.05, 0.08]))
COARSE = Steps(in_dead_time=12, in_half_period=30)


@pytest.fixture(scope="module")
def response() -> Response:
    step = LoadStep(from_W=1600.0, to_W=600.0, duration_s=3e-3)
    return load_step(Model.baseline(), prototype_voltage_loop(), TABLE, step, COARSE)


def test_nothing_moves_before_the_step(response: Response) -> None:
    before = response.trace.time_s[:, 0] < response.step.at_s
    # ripple: 11 A less 11 A of load for some microseconds on 1 mF
    np.testing.assert_allclose(response.trace.output_V[before], 140.0, atol=0.1)


def test_the_voltage_rises_when_the_load_falls_and_settles_within_a_millisecond(response: Response) -> None:
    assert 0.002 < response.deviation < 0.03
    assert response.settling_s() < 1e-3


def test_d1_and_d2_follow_the_load(response: Response) -> None:
    assert (response.D1[0], response.D2[0]) == pytest.approx((1.0, 0.08))
    assert (response.D1[-1], response.D2[-1]) == pytest.approx((0.9, 0.05), abs=1e-6)


def test_the_loop_ends_at_the_d0_of_the_steady_state(response: Response) -> None:
    steady = simulate(Model.baseline(), Points(D1=0.9, D2=0.05, power_W=600.0))["D0"][0]
    assert response.D0[-1] == pytest.approx(steady, abs=3e-3)  # V2 is still 0.1 % high, 12 half kW per unit


def test_a_voltage_that_never_comes_back_has_no_settling_time(response: Response) -> None:
    assert np.isnan(replace(response, V2_V=200.0).settling_s())


def test_a_load_that_the_table_cannot_carry_is_refused() -> None:
    with pytest.raises(ParameterError, match="2200 W cannot run"):
        load_step(
            Model.baseline(), prototype_voltage_loop(), TABLE, LoadStep(from_W=600.0, to_W=2200.0), COARSE
        )


def test_without_delay_and_integral_the_margin_is_a_right_angle() -> None:
    loop = VoltageLoop(capacitance_F=1e-3, proportional_per_V=0.1, integral_per_V_s=1e-6, load_filter_s=1e-4)
    found = margin(loop, LoopPlant(slope_A=60.0, load_W=0.0, V2_V=140.0, period_s=1e-12))
    assert found.phase_deg == pytest.approx(90.0, abs=0.1)
    assert found.crossover_Hz == pytest.approx(0.1 * 60.0 / (2 * np.pi * 1e-3), rel=1e-3)  # of the grid


def test_the_delay_costs_its_share_of_phase() -> None:
    loop = prototype_voltage_loop()
    quick, slow = (
        margin(loop, LoopPlant(slope_A=60.0, load_W=600.0, V2_V=140.0, period_s=T)) for T in (1e-12, 50e-6)
    )
    expected = 360.0 * slow.crossover_Hz * 75e-6
    assert quick.phase_deg - slow.phase_deg == pytest.approx(expected, abs=0.1)


def test_the_prototypes_loop_has_a_margin_at_both_loads() -> None:
    for power_W in (600.0, 1600.0):
        plant = loop_plant(Model.baseline(), TABLE, power_W)
        assert margin(prototype_voltage_loop(), plant).phase_deg > 45.0


def test_the_slope_of_the_plant_is_that_of_single_phase_shift() -> None:
    full = DutyTable(power_W=np.array([100.0]), D1=np.array([1.0]), D2=np.array([0.0]))
    phase = simulate(Model.baseline(), Points(D1=1.0, D2=0.0, power_W=1000.0))["D0"][0]
    ideal = 300.0 * 2.0 * 25e-6 / 236e-6 * (1 - 2 * phase)  # n V1 Th / L (1 - 2 phi)
    assert loop_plant(Model.baseline(), full, 1000.0).slope_A == pytest.approx(ideal, rel=0.05)  # drops


def test_gains_must_be_positive() -> None:
    with pytest.raises(ParameterError, match="proportional_per_V is 0"):
        replace(prototype_voltage_loop(), proportional_per_V=0.0)


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"to_W": -1.0}, "to_W is -1"),
        ({"from_W": float("nan")}, "from_W is nan"),
        ({"at_s": 1.0}, "at_s is 1"),
    ],
)
def test_an_impossible_step_is_refused(changes: dict[str, float], said: str) -> None:
    with pytest.raises(ParameterError, match=said):
        LoadStep(**{"from_W": 600.0, "to_W": 1600.0, **changes})


def test_a_table_outside_the_duty_ratios_is_refused() -> None:
    with pytest.raises(ParameterError, match=r"DutyTable.D1 .* one from 0 to 1"):
        replace(TABLE, D1=np.array([0.9, 1.2]))
