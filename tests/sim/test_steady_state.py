"""The periodic orbit by conservation, symmetry and the lossless limit."""

from dataclasses import replace

import numpy as np
import pytest

from sim.piecewise import power_share
from sim.prototype import prototype
from sim.regulation import lossless_scale_W
from sim.steady_state import half_period, magnetizing_current, periodic
from tests.sim.orbits import Case, circuit, edges_at, random_case, random_duties, solve, without_losses

COUNT = 200


@pytest.fixture(scope="module")
def case() -> Case:
    return random_case(COUNT, seed=1)


@pytest.fixture(scope="module")
def lossless() -> Case:
    return random_case(COUNT, seed=2, converter=without_losses(prototype()))


def test_every_orbit_closes(case: Case) -> None:
    assert case.orbit.closed.all()


def test_power_lost_between_the_bridges_is_what_the_drops_take(case: Case) -> None:
    pieces, c = case.orbit.pieces, case.circuit
    live, along = np.abs(pieces.vp_V) > 1.0, 0.5 + 0.5 * np.sign(pieces.vp_V) * pieces.sign
    mean = along * c.forward[:, None] + (1 - along) * c.reverse[:, None]
    signed = np.sign(pieces.vp_V) * (along * c.forward[0] - (1 - along) * c.reverse[0])
    R, drop_V = np.where(live, mean[1], c.zero[1]), np.where(live, signed, pieces.sign * c.zero[0])
    eddy = c.inductance_H * c.eddy_s * pieces.squared_slope()
    # what lies behind the magnetizing inductance carries the current less the magnetizing one
    heat = R * pieces.square() + c.behind_Ohm * (pieces.secondary_square() - pieces.square())
    lost = np.sum(drop_V * pieces.charge() + heat + eddy, axis=0) / c.half_period_s
    between = case.orbit.input_power_W() - case.orbit.output_power_W()
    # closed forms on both sides: only rounding and the closing error (1e-10) remain
    np.testing.assert_allclose(between, lost, rtol=0, atol=1e-6 * np.abs(case.orbit.input_power_W()).max())


def test_half_a_period_later_everything_is_reversed(case: Case) -> None:
    mirrored = periodic(case.circuit, case.edges + 1.0, case.orbit.start_A, case.orbit.delay)
    # the solver closes to 1e-10 of the current and 1e-9 of Th (0.03 mA of slope)
    np.testing.assert_allclose(mirrored.start_A, -case.orbit.start_A, atol=1e-4)
    np.testing.assert_allclose(mirrored.output_power_W(), case.orbit.output_power_W(), atol=1e-2)


def test_power_does_not_depend_on_where_time_starts(case: Case) -> None:
    later = periodic(case.circuit, case.edges + 0.3137, np.zeros(COUNT), np.zeros((4, COUNT)))
    # the same orbit from another start: the closing tolerance of 1e-9 Th is 10 uW of 9 kW per Th
    np.testing.assert_allclose(later.output_power_W(), case.orbit.output_power_W(), atol=1e-3)


def test_the_current_has_no_jumps(case: Case) -> None:
    pieces = case.orbit.pieces
    just_before = pieces.start_s[1:] - 1e-15
    before_A = np.where(just_before > 0, pieces.current_at(just_before), pieces.current_A[1:])
    # a femtosecond of 1e7 A/s, rounding
    np.testing.assert_allclose(before_A, pieces.current_A[1:], atol=2e-8)
    np.testing.assert_allclose(pieces.end_A[-1], -pieces.current_A[0], atol=1e-8)  # the closing error


def test_pieces_cover_the_half_period(case: Case) -> None:
    pieces = case.orbit.pieces
    assert np.all(pieces.duration_s >= 0)
    np.testing.assert_allclose(pieces.duration_s.sum(axis=0), case.circuit.half_period_s, rtol=1e-12)


def test_integrals_with_the_magnetizing_current_are_those_of_the_waveform(case: Case) -> None:
    place = ((np.arange(4000) + 0.5) / 4000)[:, None] * np.ones(COUNT)
    pieces, c = case.orbit.pieces, case.circuit
    link_A = pieces.current_at(place * c.half_period_s)
    through_A = link_A - magnetizing_current(c, case.edges + case.orbit.delay, place)
    ours_A2 = np.sum(pieces.secondary_square(), axis=0) / c.half_period_s
    np.testing.assert_allclose(ours_A2, np.mean(through_A**2, axis=0), rtol=2e-4, atol=1e-5)  # midpoint rule


def test_current_between_the_pieces_starts_agrees_with_their_integrals(case: Case) -> None:
    place = (np.arange(4000) + 0.5) / 4000
    current = case.orbit.pieces.current_at(place[:, None] * case.circuit.half_period_s)
    rms = np.sqrt(np.mean(current**2, axis=0))
    np.testing.assert_allclose(rms, case.rms_A, rtol=1e-5)  # midpoint rule: (1/4000)^2 and corners


def test_lossless_single_phase_shift_carries_the_textbook_power() -> None:
    phase = np.linspace(0.02, 0.5, 25)
    sps = solve(np.ones(25), np.zeros(25), phase, without_losses(prototype()))
    expected = 300 * 280 * phase * (1 - phase) / (2 * 20e3 * 236e-6)
    np.testing.assert_allclose(sps.orbit.output_power_W(), expected, rtol=1e-9)  # rounding, the closing error


def test_lossless_single_phase_shift_has_the_textbook_rms_current() -> None:
    phase = np.linspace(0.02, 0.5, 25)
    sps = solve(np.ones(25), np.zeros(25), phase, without_losses(prototype()))
    per_V = 1 / (4 * 20e3 * 236e-6)  # Th / 2L
    first, turn = -per_V * (300 + (2 * phase - 1) * 280), per_V * ((2 * phase - 1) * 300 + 280)
    square = phase * (first**2 + first * turn + turn**2) + (1 - phase) * (turn**2 - turn * first + first**2)
    np.testing.assert_allclose(sps.rms_A, np.sqrt(square / 3), rtol=1e-9)  # rounding, the closing error


def test_lossless_hybrid_modulation_carries_the_closed_form_power(lossless: Case) -> None:
    scale_W = lossless_scale_W(lossless.circuit)
    expected = scale_W * power_share(lossless.edges)[0]
    # relative to the scale of 8.9 kW: rounding, the closing error
    np.testing.assert_allclose(lossless.orbit.output_power_W(), expected, atol=1e-9 * scale_W[0])


def test_a_current_that_the_voltage_cannot_lift_over_the_drops_stays_at_zero() -> None:
    converter = prototype()
    # 1 V across the link, less than two IGBT knees, and no magnetizing current to move an edge
    matched = replace(converter, V2_V=149.5, transformer=replace(converter.transformer, magnetizing_H=1e9))
    D1, D2 = np.array([1.0]), np.array([0.0])
    orbit = periodic(circuit(1, matched), edges_at(D1, D2, np.zeros(1)), np.zeros(1), np.full((4, 1), 0.01))
    # the dead times of the four edges differ by a third of a nanosecond; a volt would drive 50 mA
    assert np.abs(orbit.pieces.current_A).max() < 1e-3
    assert np.all(orbit.pieces.drive_A_per_s[:, 0][orbit.pieces.duration_s[:, 0] > 1e-6] == 0.0)


def test_the_magnetizing_current_carries_the_link_current_through_zero() -> None:
    start_A = np.linspace(-1e-3, 1e-3, 41)
    c, ohmic = circuit(start_A.size), np.array([[0.0], [1.0]])  # channels alone have no threshold
    c = replace(c, forward=ohmic * c.forward, reverse=ohmic * c.reverse, zero=ohmic * c.zero, secondary=None)
    edges = edges_at(*np.full((3, start_A.size), [[0.5], [0.5], [0.0]])) + 0.2  # time begins in a zero state
    orbit, missed = half_period(c, edges, np.concatenate([start_A[None], np.zeros((5, start_A.size))]))
    edge_A = orbit.pieces.current_A[len(orbit.pieces.current_A) // 5]  # at the first edge
    assert np.any(edge_A * start_A < 0)  # the magnetizing current has turned some
    # what begins as a straight line ends as one, but for the rounding of differences of 50 uA
    np.testing.assert_allclose(np.diff(missed[0]), np.diff(missed[0])[0], rtol=1e-6)


def test_magnetizing_current_is_the_triangle_of_the_secondary_voltage() -> None:
    D1, D2 = random_duties(20, seed=3)
    edges, c = edges_at(D1, D2, np.full(20, 0.2)), circuit(20)
    peak = magnetizing_current(c, edges, edges[2:3] + 1.0)[0]  # where the positive pulse ends
    expected = 280 * (1 - D2) * 25e-6 / (2 * 12e-3)
    np.testing.assert_allclose(peak, expected, rtol=1e-12)
    np.testing.assert_allclose(magnetizing_current(c, edges, edges[2:3])[0], -peak, rtol=1e-12)
