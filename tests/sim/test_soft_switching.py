"""The dead time's law by charge, against closed forms and scipy's own integration."""

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from sim.parameters import Capacitance
from sim.soft_switching import (
    CURVE_POINTS,
    Commutation,
    Curves,
    Drive,
    commutate,
    residual_energy,
    swing_curve,
)

Array = NDArray[np.float64]

DEAD_S, CHARGE_C = 400e-9, 60e-9
DRIVE, OWN = 2.0e5, -6.4e5  # A/s: from the other legs, and from this leg's own 150 V on 236 uH
CONSTANT = Capacitance(zero_bias_F=200e-12, junction_V=1e6, grading=0.5)
SIC = Capacitance(zero_bias_F=4.24e-9, junction_V=1.0, grading=0.55)


def constant_capacitance(current_A: Array, *, drive: float = DRIVE, own: float = OWN) -> Commutation:
    """Legs of constant capacitance that open at these currents."""
    return commutate(
        current_A,
        Drive(outside_A_per_s=np.full(current_A.shape, drive), own_A_per_s=own),
        np.full(current_A.shape[-1], DEAD_S),
        np.full(current_A.shape, CHARGE_C),
        Curves(values=np.linspace(0.0, 1.0, CURVE_POINTS), first=np.zeros(current_A.shape, dtype=np.intp)),
    )


def by_scipy(current_A: float) -> tuple[float, float]:
    """Delay and missing share of the same LC circuit, its diodes by clipping."""

    def law(t: float, state: Array) -> list[float]:
        q, j, _ = state
        u = min(max(q / CHARGE_C, 0.0), 1.0)
        stopped = (q >= CHARGE_C and j > 0) or (q <= 0 and j < 0)
        return [0.0 if stopped else j, DRIVE + OWN * (2 * u - 1), 1 - u]

    end = solve_ivp(law, (0, DEAD_S), [0.0, current_A, 0.0], max_step=1e-10, rtol=1e-8).y[:, -1]
    return end[2], 1 - min(max(end[0] / CHARGE_C, 0.0), 1.0)


@pytest.mark.parametrize("current_A", [-0.1, 0.0, 0.05, 0.12, 0.3, 1.0, 4.0, 12.0])
def test_commutation_of_constant_capacitances_is_that_of_the_lc_circuit(current_A: float) -> None:
    ours = constant_capacitance(np.array([[current_A]]))
    delay_s, missing = by_scipy(current_A)
    assert ours.delay_s.item() == pytest.approx(delay_s, abs=0.01 * DEAD_S)  # 16 graded steps
    # the last of them are an eighth of the dead time: 0.04 of a swing where its end is slow, 10 mW of loss
    assert ours.missing.item() == pytest.approx(missing, abs=0.04)


def test_no_current_waits_for_the_end_of_the_dead_time() -> None:
    idle = constant_capacitance(np.zeros((1, 1)), drive=0.0, own=0.0)
    assert idle.delay_s.item() == pytest.approx(DEAD_S, rel=1e-12)
    assert idle.missing.item() == 1.0


def test_a_large_current_swings_the_node_at_once() -> None:
    swift = constant_capacitance(np.array([[1e4]]))
    assert swift.delay_s.item() <= 0.5 * DEAD_S / 16**2 * 1.001  # half of the first graded step
    assert swift.missing.item() < 1e-9  # the curve is read to rounding


def test_delay_is_continuous_and_falls_with_the_current() -> None:
    current_A = np.linspace(-2.0, 10.0, 24001)
    delay_s = constant_capacitance(current_A[None]).delay_s[0]
    step = np.diff(delay_s)
    assert step.max() <= 1e-13  # rounding
    # 0.5 mA more carry at most 0.2 fC, 0.3 % of the charge; the swing then ends 0.3 % of 400 ns earlier
    assert -step.min() < 0.01 * DEAD_S


def test_charge_is_conserved() -> None:
    current_A = np.linspace(-1.0, 3.0, 201)
    c = constant_capacitance(current_A[None], own=0.0)
    carried_C = current_A * DEAD_S + 0.5 * DRIVE * DEAD_S**2
    kept_C = CHARGE_C * (1 - c.missing) + c.opposite_C - c.same_C
    np.testing.assert_allclose(
        kept_C[0], carried_C, atol=1e-9 * CHARGE_C
    )  # a constant slope: leapfrog is exact


def test_a_current_that_reverses_takes_the_charge_back() -> None:
    back = constant_capacitance(np.array([[0.1]]), drive=-2e6, own=0.0)
    assert back.missing.item() == 1.0
    assert back.same_C.item() > 0
    assert back.turn_on_A.item() == pytest.approx(2e6 * DEAD_S - 0.1)


def test_turn_off_current_is_what_the_opening_switch_carried_forward() -> None:
    c = constant_capacitance(np.array([[-3.0, 5.0]]))
    assert c.turn_off_A.tolist() == [[0.0, 5.0]]


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
