"""Points: what broadcasts, what is refused, what is kept."""

from dataclasses import replace

import numpy as np
import pytest

from sim.model import Model
from sim.operating_points import Points, grid
from sim.parameters import ParameterError
from sim.prototype import prototype
from sim.simulate import can_run, simulate
from sim.solved import solve_points


def test_floats_become_arrays_of_the_longest() -> None:
    points = Points(D1=[0.8, 0.9, 1.0], D2=0.1, power_W=500.0)
    assert len(points) == 3
    np.testing.assert_array_equal(points.D2, [0.1, 0.1, 0.1])
    assert points.pwm.dtype == bool


def test_taking_and_joining_are_inverse() -> None:
    points = Points(D1=np.linspace(0.5, 1, 6), D2=0.1, power_W=500.0, time_s=np.arange(6.0))
    again = Points.join([points.take(np.arange(2)), points.take(np.arange(2, 6))])
    np.testing.assert_array_equal(again.time_s, points.time_s)
    np.testing.assert_array_equal(again.D1, points.D1)


def test_a_voltage_of_zero_is_refused() -> None:
    with pytest.raises(ParameterError, match="V1_V"):
        Points(D1=0.9, D2=0.1, power_W=100.0, V1_V=[300.0, 0.0])


def test_voltages_that_are_not_given_are_those_of_the_converter_that_runs() -> None:
    other = Model(converter=replace(prototype(), V1_V=330.0, V2_V=150.0))
    implied, given = (
        Points(D1=0.9, D2=0.1, power_W=900.0),
        Points(D1=0.9, D2=0.1, power_W=900.0, V1_V=330.0, V2_V=150.0),
    )
    expected = simulate(other, given)["efficiency"]
    assert simulate(other, implied)["efficiency"].tolist() == expected.tolist()
    assert solve_points(other, implied).points.V1_V.tolist() == [330.0]
    assert simulate(other, implied).points.V2_V.tolist() == [150.0]
    most = Points(D1=1.0, D2=0.0, power_W=2270.0)  # more than 300 V and 140 V carry
    assert can_run(other, most).all()
    assert not can_run(Model.baseline(), most).any()


def test_a_nominal_output_voltage_is_held_in_front_of_the_cable() -> None:
    """Inside, all is as without a cable that loses as much power: the terminals have less by what it drops."""
    cable_Ohm, power_W = 0.05, np.array([500.0, 1500.0])
    model = Model.baseline().with_effect("cable_resistance_output", resistance_Ohm=cable_Ohm)
    implied = simulate(model, Points(D1=0.9, D2=0.1, power_W=power_W))
    terminals_V = Points(D1=0.9, D2=0.1, power_W=power_W, V2_V=140.0, held=True).behind(cable_Ohm).V2_V
    current_A = power_W / terminals_V
    np.testing.assert_allclose(terminals_V + cable_Ohm * current_A, 140.0, rtol=1e-12)  # rounding
    plain = simulate(Model.baseline(), Points(D1=0.9, D2=0.1, power_W=power_W + cable_Ohm * current_A**2))
    # the power's tolerance of 2e-7
    np.testing.assert_allclose(implied["P1_W"], plain["P1_W"], rtol=1e-6)
    np.testing.assert_allclose(implied["P2_W"], power_W, rtol=1e-6)
    read = simulate(model, Points(D1=0.9, D2=0.1, power_W=power_W, V2_V=terminals_V))
    np.testing.assert_allclose(implied["P1_W"], read["P1_W"], rtol=1e-6)


def test_what_nobody_read_is_no_number_and_everything_else_is_one() -> None:
    points = Points(D1=[0.9, 0.8], D2=0.1, power_W=500.0, seen_heatsink_C=[41.0, np.nan])
    np.testing.assert_array_equal(np.isnan(points.seen_heatsink_C), [False, True])
    assert np.all(np.isnan(points.unseen().seen_heatsink_C))
    for name in ("seen_I1_A", "time_s"):
        with pytest.raises(ParameterError, match=name):
            Points(D1=0.9, D2=0.1, power_W=[500.0], **{name: np.inf})


def test_the_grid_has_its_end_points() -> None:
    points = grid((3, 4, 5))
    assert len(points) == 60
    assert (np.min(points.D1), np.max(points.D1)) == (0.0, 1.0)
    assert set(points.power_W) == {200.0, 650.0, 1100.0, 1550.0, 2000.0}
