"""Charge, energy and the curve of a swing, against closed forms."""

import numpy as np
import pytest

from sim.parameters import Capacitance
from sim.soft_switching import residual_energy, swing_curve

CONSTANT = Capacitance(zero_bias_F=200e-12, junction_V=1e6, grading=0.5)
SIC = Capacitance(zero_bias_F=4.24e-9, junction_V=1.0, grading=0.55)


def test_hard_switching_of_two_constant_capacitances_costs_c_dv_squared() -> None:
    missing = np.array([0.0, 0.2, 0.7, 1.0])
    lost_J = residual_energy([CONSTANT], [CONSTANT], 140.0, missing)
    # "constant" is 1e-4 of a junction of 1 MV
    np.testing.assert_allclose(lost_J, 200e-12 * (missing * 140.0) ** 2, rtol=2e-4, atol=1e-15)


def test_hard_switching_of_equal_junctions_over_the_whole_swing_costs_q_v() -> None:
    lost_J = residual_energy([SIC], [SIC], 140.0, 1.0)
    assert lost_J == pytest.approx(SIC.charge_C(140.0) * 140.0, rel=1e-12)


def test_energy_lost_grows_with_what_is_missing() -> None:
    lost_J = np.asarray(residual_energy([SIC], [SIC], 140.0, np.linspace(0, 1, 101)))
    assert lost_J[0] == 0.0
    assert np.all(np.diff(lost_J) > 0)


def test_swing_of_equal_junctions_is_symmetric_about_the_middle() -> None:
    curve = swing_curve([SIC], [SIC], 140.0)
    assert np.all(np.diff(curve) > 0)
    np.testing.assert_allclose(curve + curve[::-1], 1.0, atol=1e-9)  # same table read from both ends


def test_swing_of_a_constant_capacitance_is_straight() -> None:
    np.testing.assert_allclose(swing_curve([CONSTANT], [], 150.0), np.linspace(0, 1, 65), atol=1e-4)


def test_swing_charge_is_that_of_all_junctions() -> None:
    curve = swing_curve([SIC, CONSTANT], [SIC], 140.0)
    v = 140.0 * curve[13]  # a fifth of the charge
    moved = SIC.charge_C(v) + CONSTANT.charge_C(v) + SIC.charge_C(140.0) - SIC.charge_C(140.0 - v)
    whole = 2 * SIC.charge_C(140.0) + CONSTANT.charge_C(140.0)
    assert moved / whole == pytest.approx(13 / 64, rel=1e-2)  # the table has 513 voltages
