"""The dead time's law by charge, of legs alone and legs that meet, against closed forms and scipy's own integration."""

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from sim.commutation import Commutation, Curves, Drops, Meeting, mean_sign
from sim.soft_switching import CURVE_POINTS
from sim.swings import commutate

Array = NDArray[np.float64]

DEAD_S, CHARGE_C = 400e-9, 60e-9
DRIVE, OWN = 2.0e5, -6.4e5  # A/s: from the other legs, and from this leg's own 150 V on 236 uH
STRAIGHT = Curves.of(np.linspace(0.0, 1.0, CURVE_POINTS))


def legs(current_A: Array, opens_s: Array, drive: float, coupling: Array, threshold: float = 0.0) -> Meeting:
    """Groups (m, K) of legs of constant capacitance; ``threshold`` (A/s) is what drops take from the slope."""
    size, none = current_A.shape, np.zeros(current_A.shape[1])
    drops = Drops.of(none, np.zeros(size), *(none + threshold for _ in range(3)))
    return Meeting(
        current_A=current_A, per_current=np.ones(size), outside_A_per_s=np.full(size, drive),
        coupling_A_per_s=np.broadcast_to(coupling[..., None], (*coupling.shape, size[1])), drops=(drops,),
        magnetizing_A=none, shunted_A=none, damping_per_s=none, eddy_s=none, charge_C=np.full(size, CHARGE_C),
        curve=np.zeros(size, dtype=np.intp), opens_s=np.broadcast_to(opens_s[:, None], size),
        dead_time_s=none + DEAD_S,
    )  # fmt: skip


def alone(current_A: Array, *, drive: float = DRIVE, own: float = OWN, threshold: float = 0.0) -> Meeting:
    """Legs that meet no other."""
    return legs(current_A[None], np.zeros(1), drive, np.array([[own]]), threshold)


def constant_capacitance(current_A: Array, *, drive: float = DRIVE, own: float = OWN) -> Commutation:
    """Dead times of legs of constant capacitance that open at these currents."""
    return commutate(alone(np.ravel(current_A), drive=drive, own=own), STRAIGHT)


def by_scipy(meeting: Meeting) -> tuple[Array, Array]:
    """Delays and missing shares of the legs of one group, its diodes by clipping, its drops by the current's sign."""
    m, drop = len(meeting.current_A), float(meeting.drops[0].zero[0])
    opens, coupling = meeting.opens_s[:, 0], meeting.coupling_A_per_s[..., 0]

    def law(t: float, state: Array) -> Array:
        q, x = state[:m], state[m : 2 * m]
        open_ = (t >= opens) & (t < opens + DEAD_S)
        share = np.where(t < opens, 0.0, np.where(open_, np.clip(q / CHARGE_C, 0.0, 1.0), 1.0))
        stopped = ~open_ | ((q >= CHARGE_C) & (x > 0)) | ((q <= 0) & (x < 0))
        slope = meeting.outside_A_per_s[:, 0] + coupling @ (2 * share - 1) - np.sign(x[0]) * drop
        return np.concatenate([np.where(stopped, 0.0, x), slope, np.where(open_, 1 - share, 0.0)])

    start = np.concatenate([np.zeros(m), meeting.current_A[:, 0], np.zeros(m)])
    run = solve_ivp(law, (0, opens.max() + DEAD_S), start, max_step=1e-9, rtol=1e-6, dense_output=True)
    at_end = np.array([run.sol(t)[k] for k, t in enumerate(opens + DEAD_S - 1e-12)])
    return run.y[2 * m :, -1], 1 - np.clip(at_end / CHARGE_C, 0.0, 1.0)


@pytest.mark.parametrize("current_A", [-0.1, 0.0, 0.05, 0.12, 0.3, 1.0, 4.0, 12.0])
def test_commutation_of_constant_capacitances_is_that_of_the_lc_circuit(current_A: float) -> None:
    meeting = alone(np.array([current_A]))
    ours, (delay_s, missing) = commutate(meeting, STRAIGHT), by_scipy(meeting)
    # eight graded steps; 2 ns of 300 V are 3 mA of link current
    assert ours.delay_s.item() == pytest.approx(delay_s.item(), abs=0.005 * DEAD_S)
    assert ours.missing.item() == pytest.approx(missing.item(), abs=0.01)


@pytest.mark.parametrize("current_A", [-0.02, 0.005, 0.02, 0.05])
def test_drops_act_against_the_current_on_both_sides_of_its_zero(current_A: float) -> None:
    meeting = alone(np.array([current_A]), drive=6.2e5, threshold=1.2e5)
    ours, (delay_s, _) = commutate(meeting, STRAIGHT), by_scipy(meeting)
    without = commutate(alone(np.array([current_A]), drive=6.2e5), STRAIGHT)
    assert ours.delay_s.item() == pytest.approx(delay_s.item(), abs=0.005 * DEAD_S)  # as above
    assert abs(ours.delay_s.item() - without.delay_s.item()) > 0.01 * DEAD_S  # and it matters


@pytest.mark.parametrize("apart_s", [0.0, 30e-9, 150e-9, 390e-9])
def test_legs_that_meet_are_one_circuit(apart_s: float) -> None:
    coupling = np.array([[OWN, 4e5], [8e5, -9e5]])
    meeting = legs(np.array([[0.25], [0.3]]), np.array([0.0, apart_s]), 1e5, coupling, threshold=1e4)
    ours, (delay_s, missing) = commutate(meeting, STRAIGHT), by_scipy(meeting)
    np.testing.assert_allclose(ours.delay_s[:, 0], delay_s, atol=0.005 * DEAD_S)  # as above
    np.testing.assert_allclose(ours.missing[:, 0], missing, atol=0.015)


def test_a_leg_that_opens_when_another_closes_sees_it_alone() -> None:
    coupling, current_A = np.array([[OWN, 0.0], [0.0, OWN]]), np.array([[0.2], [0.2]])
    meeting = legs(current_A, np.array([0.0, DEAD_S]), DRIVE, coupling)
    # of the second nothing but its current has moved, by (drive - own swing) since
    alike = constant_capacitance(np.array([0.2])).delay_s.item()
    pair = commutate(meeting, STRAIGHT).delay_s[:, 0]
    assert pair[0] == pytest.approx(alike, abs=0.003 * DEAD_S)  # the same steps
    assert pair[1] != pytest.approx(alike, abs=0.05 * DEAD_S)


def test_a_group_without_a_number_leaves_the_others_theirs() -> None:
    """A state that ran away is none; groups follow each other in the same rows, and it must not be left there."""
    coupling = np.array([[OWN, 4e5], [8e5, -9e5]])
    opens_s, current_A = np.array([0.0, 30e-9]), np.array([[0.25, np.nan, 0.25], [0.3, 0.3, 0.3]])
    ours = commutate(legs(current_A, opens_s, 1e5, coupling), STRAIGHT).delay_s
    by_itself = commutate(legs(current_A[:, :1], opens_s, 1e5, coupling), STRAIGHT).delay_s
    np.testing.assert_array_equal(ours[:, [0, 2]], np.repeat(by_itself, 2, axis=1))


def test_a_current_that_drops_hold_stays() -> None:
    sign = mean_sign(np.array([0.0, 0.5, 0.0, 3.0, 0.5]), np.array([0.4, 0.0, 4.0, 0.4, -2.0]), np.ones(5))
    # held; comes to rest; pulled off; does not get to zero; turns a sixth of the way
    np.testing.assert_allclose(sign, [0.4, 0.5, 1.0, 1.0, 2 * 0.5 / 3 - 1])


def test_the_tangent_is_that_of_differences() -> None:
    current_A = np.linspace(-0.3, 2.0, 41)
    near = constant_capacitance(current_A + 1e-7).delay_s - constant_capacitance(current_A).delay_s
    ours = constant_capacitance(current_A).delay_per_A
    off = np.abs(ours - near / 1e-7)[0]
    assert np.quantile(off, 0.8) < 0.03 * np.abs(ours).max()  # where a step ends at a rail it is one-sided


def test_legs_done_with_early_end_as_those_that_are_stepped() -> None:
    import sim.swings as swings

    current_A = np.linspace(-3.0, 6.0, 91)
    early = constant_capacitance(current_A)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(swings, "_LOOKS", ())
        stepped = constant_capacitance(current_A)
    for name in ("delay_s", "missing", "opposite_C", "same_C", "turn_on_A"):
        np.testing.assert_allclose(getattr(early, name), getattr(stepped, name), rtol=1e-9, atol=1e-18)


def test_no_current_waits_for_the_end_of_the_dead_time() -> None:
    idle = constant_capacitance(np.zeros(1), drive=0.0, own=0.0)
    assert idle.delay_s.item() == pytest.approx(DEAD_S, rel=1e-12)
    assert idle.missing.item() == 1.0


def test_a_large_current_swings_the_node_at_once() -> None:
    swift = constant_capacitance(np.array([1e4]))
    assert swift.delay_s.item() <= 0.5 * CHARGE_C / 1e4 * 1.001  # half of Q/i
    assert swift.missing.item() < 1e-9  # the curve is read to rounding


def test_delay_is_continuous_and_falls_with_the_current() -> None:
    current_A = np.linspace(-2.0, 10.0, 24001)
    delay_s = constant_capacitance(current_A).delay_s[0]
    step = np.diff(delay_s)
    assert step.max() <= 1e-13  # rounding
    # 0.5 mA more carry at most 0.2 fC, 0.3 % of the charge; the swing then ends 0.3 % of 400 ns earlier
    assert -step.min() < 0.01 * DEAD_S


def test_charge_is_conserved() -> None:
    current_A = np.linspace(-1.0, 3.0, 201)
    c = constant_capacitance(current_A, own=0.0)
    carried_C = current_A * DEAD_S + 0.5 * DRIVE * DEAD_S**2
    kept_C = CHARGE_C * (1 - c.missing) + c.opposite_C - c.same_C
    # a constant slope: leapfrog is exact
    np.testing.assert_allclose(kept_C[0], carried_C, atol=1e-9 * CHARGE_C)


def test_a_current_that_reverses_takes_the_charge_back() -> None:
    back = constant_capacitance(np.array([0.1]), drive=-2e6, own=0.0)
    assert back.missing.item() == 1.0
    assert back.same_C.item() > 0
    assert back.turn_on_A.item() == pytest.approx(2e6 * DEAD_S - 0.1)


def test_turn_off_current_is_what_the_opening_switch_carried_forward() -> None:
    c = constant_capacitance(np.array([-3.0, 5.0]))
    assert c.turn_off_A.tolist() == [[0.0, 5.0]]
