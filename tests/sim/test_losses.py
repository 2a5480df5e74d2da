"""Losses: conduction closes the waveform's balance, switching costs nothing where it is soft and unloaded."""

from dataclasses import replace

import numpy as np
import pytest

from sim.circuit import Temperatures
from sim.commutation import Commutation
from sim.losses import conduction_losses, switching_losses
from sim.magnetics import link_current, magnetic_losses
from sim.parameters import Converter
from sim.prototype import prototype
from tests.sim.orbits import JUNCTION_C, Array, Case, random_case

COUNT = 100


def everywhere(count: int) -> Temperatures:
    return Temperatures.everywhere(prototype(), np.full(count, JUNCTION_C))


def conducted_W(converter: Converter, case: Case) -> Array:
    """Conduction, copper and link resistance, part by part."""
    pieces, t = case.orbit.pieces, everywhere(COUNT)
    parts = conduction_losses(converter, t, pieces, case.circuit.V1_V)
    magnetic = magnetic_losses(converter, t, pieces, link_current(pieces, converter.frequency_Hz))
    return sum(parts.values()) + sum(magnetic[p] for p in magnetic if not p.endswith("core"))


def test_conduction_and_copper_are_what_the_waveform_loses() -> None:
    case = random_case(COUNT, seed=11)
    between = case.orbit.input_power_W() - case.orbit.output_power_W()
    # two closed forms of the same integrals: rounding and the closing error of 1e-10
    np.testing.assert_allclose(conducted_W(prototype(), case), between, atol=1e-9 * between.max())


def test_terminal_powers_are_those_of_the_sampled_waveform() -> None:
    case, samples = random_case(20, seed=11), 200_000
    place = (np.arange(samples) + 0.5)[:, None] / samples * case.circuit.half_period_s
    current, pieces = case.orbit.pieces.current_at(place), case.orbit.pieces
    slope = np.gradient(current, axis=0) / (case.circuit.half_period_s / samples)
    which = np.clip(np.sum(place[None] >= pieces.start_s[:, None], axis=0) - 1, 0, 9)
    vp_V = np.take_along_axis(pieces.vp_V, which, axis=0)
    sampled_W = np.mean(vp_V * (current + case.circuit.eddy_s * slope), axis=0)
    # a step of the bridge falls inside a sample of 0.1 ns: 300 V * 20 A / 200,000
    np.testing.assert_allclose(case.orbit.input_power_W(), sampled_W, atol=0.06)


def test_eddy_currents_lose_what_the_windings_rise_of_resistance_says() -> None:
    case = random_case(COUNT, seed=11)
    pieces, converter = case.orbit.pieces, prototype()
    branch_W = np.sum(pieces.squared_slope(), axis=0) * case.circuit.inductance_H * case.circuit.eddy_s
    measures = link_current(pieces, converter.frequency_Hz)
    warm = 1 + 0.0039 * (JUNCTION_C - 25.0)
    extra_Ohm = warm * (0.045 * 0.10 + 0.060 * 0.15)  # of the prototype's two windings
    expected_W = extra_Ohm * measures.slope_share_A2
    np.testing.assert_allclose(branch_W / case.circuit.half_period_s, expected_W, rtol=1e-12)


def nothing_happens(count: int = 1) -> Commutation:
    none = np.zeros((4, count))
    return Commutation(
        delay_s=none,
        delay_per_A=none,
        missing=none,
        opposite_C=none,
        same_C=none,
        turn_off_A=none,
        turn_on_A=none,
    )


def switched_W(**edges: Array) -> dict[str, Array]:
    """Switching losses when only these things happen at the edges."""
    case = random_case(1, seed=12)
    orbit = replace(case.orbit, commutation=replace(nothing_happens(), **edges))
    return switching_losses(prototype(), everywhere(1), orbit, case.circuit.V1_V, np.full(1, 140.0))


def test_a_full_swing_without_current_costs_nothing() -> None:
    assert all(abs(loss.item()) < 1e-9 for loss in switched_W().values())  # W; rounding


def test_a_hard_secondary_edge_costs_its_charge() -> None:
    missing = np.array([[0.0], [0.0], [1.0], [0.0]])
    charge_C = prototype().secondary.switch.capacitance.charge_C(140.0)
    # one leg, two edges a period, each Q V for two equal junctions
    expected_W = 2 * 20e3 * charge_C * 140.0
    assert switched_W(missing=missing)["secondary_switching"].item() == pytest.approx(expected_W, rel=1e-9)


def test_turn_off_scales_from_its_datasheet_point() -> None:
    turn_off_A = np.array([[40.0], [0.0], [0.0], [0.0]])
    inner = prototype().primary.inner.turn_off
    per_edge_J = inner.energy_J * (150 / 400) ** inner.voltage_exponent
    per_edge_J *= 1 + inner.energy_per_K * (JUNCTION_C - 25.0)
    # rising edge: an inner switch opens in both legs, twice a period
    loss_W = switched_W(turn_off_A=turn_off_A)["primary_inner_switching"].item()
    assert loss_W == pytest.approx(4 * 20e3 * per_edge_J, rel=1e-9)


def test_the_clamp_shares_its_recovery_with_the_switch_that_takes_over() -> None:
    turn_on_A, primary = np.zeros((4, 1)), prototype().primary
    turn_on_A[0] = 5.0
    charge_C = primary.clamp.recovery.at(current_A=5.0, junction_C=JUNCTION_C)
    channel_J = primary.outer.turn_on.at(current_A=5.0, voltage_V=150.0, junction_C=JUNCTION_C)
    lost_W = switched_W(turn_on_A=turn_on_A)
    half_W = 4 * 20e3 * 0.5 * charge_C * 150.0
    assert lost_W["primary_clamp_recovery"].item() == pytest.approx(half_W, rel=1e-9)
    outer_W = half_W + 4 * 20e3 * channel_J
    assert lost_W["primary_outer_switching"].item() == pytest.approx(outer_W, rel=1e-9)


@pytest.mark.parametrize(
    ("edge", "part"),
    [
        (0, "primary_clamp_recovery"),
        (0, "primary_outer_switching"),
        (1, "primary_inner_switching"),
        (2, "secondary_switching"),
        (3, "secondary_switching"),
    ],
)
def test_taking_over_a_current_costs_the_switch_that_closes(edge: int, part: str) -> None:
    turn_on_A = np.zeros((4, 1))
    turn_on_A[edge] = 5.0
    assert switched_W(turn_on_A=turn_on_A)[part].item() > 0.1  # W: microjoules at 20 kHz


def test_a_body_diode_of_the_dead_time_loses_what_it_drops_beyond_the_channel() -> None:
    charge_C, current_A = 2e-6, np.array([[0.0], [0.0], [8.0], [0.0]])
    carried_C = np.array([[0.0], [0.0], [charge_C], [0.0]])
    switch = prototype().secondary.switch
    (diode_V, diode_Ohm), (channel_V, channel_Ohm) = (
        law.at(JUNCTION_C) for law in (switch.reverse, switch.on)
    )
    beyond_V = diode_V - channel_V + (diode_Ohm - channel_Ohm) * 8.0
    part = "secondary_switching"
    with_diode_W = switched_W(turn_off_A=current_A, opposite_C=carried_C)[part].item()
    extra_W = with_diode_W - switched_W(turn_off_A=current_A)[part].item()
    assert extra_W == pytest.approx(2 * 20e3 * charge_C * beyond_V, rel=1e-9)  # one leg, two edges a period
