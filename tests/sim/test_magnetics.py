"""Copper against a Fourier series, core loss against Steinmetz for a sine."""

import numpy as np
import pytest

from sim.circuit import Temperatures
from sim.magnetics import core_loss_W, link_current, magnetic_losses, steinmetz_rate
from sim.model import Model
from sim.operating_points import Points
from sim.parameters import Core
from sim.prototype import prototype
from sim.solved import solve_points
from tests.sim.orbits import random_case

CORE = Core(k=3.9, alpha=1.36, beta=2.6, area_m2=354e-6, volume_m3=43.5e-6, turns=30.0)


def test_copper_is_the_sum_over_harmonics() -> None:
    case, samples = random_case(40, seed=13), 20000
    place = (np.arange(samples) + 0.5) / samples
    current = case.orbit.pieces.current_at(place[:, None] * case.circuit.half_period_s)
    spectrum = np.fft.rfft(np.concatenate([current, -current]), axis=0) / samples
    squares, k = 0.5 * np.abs(spectrum[1:]) ** 2, np.arange(1, samples + 1)[:, None]
    winding = prototype().inductor.winding
    harmonic_W = winding.resistance_Ohm * np.sum((1 + winding.ac_extra * k**2) * squares, axis=0)
    at_25 = Temperatures.everywhere(prototype(), np.full(40, 25.0))
    measures = link_current(case.orbit.pieces, 20e3)
    ours_W = magnetic_losses(prototype(), at_25, case.orbit.pieces, measures)["inductor_copper"]
    # the k^2 series of a current with corners converges like 1/k: 20,000 harmonics leave 1e-4
    np.testing.assert_allclose(ours_W, harmonic_W, rtol=1e-4)


def test_mean_squared_slope_is_that_of_the_exponentials() -> None:
    pieces, squared = random_case(40, seed=13).orbit.pieces, 0.0
    nodes, weights = np.polynomial.legendre.leggauss(6)
    for node, weight in zip(0.5 * (nodes + 1), 0.5 * weights, strict=True):
        t = node * pieces.duration_s
        current_A = np.stack([pieces.current_at(row) for row in pieces.start_s + t])
        squared = squared + weight * pieces.duration_s * pieces.slope_at(current_A, t) ** 2
    expected = squared.sum(axis=0) / 25e-6 / (2 * np.pi * 20e3) ** 2
    np.testing.assert_allclose(link_current(pieces, 20e3).slope_share_A2, expected, rtol=1e-9)  # closed forms


def test_peak_to_peak_is_that_of_the_waveform() -> None:
    case = random_case(40, seed=14)
    place = np.linspace(0, 1, 20001)[:, None] * case.circuit.half_period_s
    swing = 2 * np.abs(case.orbit.pieces.current_at(place)).max(axis=0)
    ours = link_current(case.orbit.pieces, 20e3).peak_to_peak_A
    np.testing.assert_allclose(ours, swing, atol=2e-3)  # 1 ns of sampling at 1 A/us


def test_a_sine_loses_what_steinmetz_says() -> None:
    frequency_Hz, amplitude_T = 20e3, 0.1
    theta = (np.arange(100000) + 0.5) / 100000 * 2 * np.pi
    linkage = CORE.turns * CORE.area_m2 * amplitude_T
    volts = linkage * 2 * np.pi * frequency_Hz * np.abs(np.cos(theta))
    ours_W = core_loss_W(CORE, np.array([2 * linkage]), np.array([np.mean(volts**CORE.alpha)]))
    expected_W = CORE.k * frequency_Hz**CORE.alpha * amplitude_T**CORE.beta * CORE.volume_m3
    assert ours_W[0] == pytest.approx(expected_W, rel=1e-6)  # the midpoint rule of |cos|^1.36


def test_the_rate_is_the_integral_of_its_definition() -> None:
    theta = (np.arange(200000) + 0.5) / 200000 * 2 * np.pi
    integral = np.mean(np.abs(np.cos(theta)) ** CORE.alpha) * 2 * np.pi * 2 ** (CORE.beta - CORE.alpha)
    expected = CORE.k / ((2 * np.pi) ** (CORE.alpha - 1) * integral)
    assert steinmetz_rate(CORE) == pytest.approx(expected, rel=1e-7)


def test_a_square_voltage_swings_the_transformer_by_its_volt_seconds() -> None:
    case = random_case(8, seed=15)
    no_zero_state = np.flatnonzero(np.abs(case.edges[3] - case.edges[2]) < 1e-12)
    measures = link_current(case.orbit.pieces, 20e3)
    t = Temperatures.everywhere(prototype(), np.full(8, 25.0))
    core = prototype().transformer.core
    ours_W = magnetic_losses(prototype(), t, case.orbit.pieces, measures)["transformer_core"]
    expected_W = core_loss_W(core, np.array([280.0 * 25e-6]), np.array([280.0**core.alpha]))
    # the two legs' delays differ by nanoseconds of the 25 us at most
    np.testing.assert_allclose(ours_W[no_zero_state], expected_W[0], rtol=0.02)


def test_the_inductor_s_core_swings_by_the_flux_of_its_current() -> None:
    case, samples = random_case(40, seed=16), 20_000
    place = (np.arange(samples) + 0.5)[:, None] / samples * case.circuit.half_period_s
    current_A = case.orbit.pieces.current_at(place)
    core, inductance_H = prototype().inductor.core, 236e-6
    induced_V = inductance_H * np.abs(np.gradient(current_A, axis=0)) / (25e-6 / samples)
    expected_W = core_loss_W(
        core, inductance_H * 2 * np.abs(current_A).max(axis=0), np.mean(induced_V**core.alpha, axis=0)
    )
    t = Temperatures.everywhere(prototype(), np.full(40, 25.0))
    ours_W = magnetic_losses(prototype(), t, case.orbit.pieces, link_current(case.orbit.pieces, 20e3))
    # a stretch between two edges counts with its mean slope, which resistance bends a little
    np.testing.assert_allclose(ours_W["inductor_core"], expected_W, rtol=1e-3)


def test_eddy_currents_that_flatten_lose_what_the_harmonics_of_the_simulated_current_do() -> None:
    """Another way to the same: a Fourier transform of each point's own current instead of lossless square waves."""
    D1, D2 = np.array([1.0, 0.95, 0.8, 0.6, 1.0]), np.array([0.05, 0.1, 0.0, 0.4, 0.3])
    points = Points(D1=D1, D2=D2, power_W=np.array([1800.0, 1000.0, 600.0, 400.0, -900.0]))
    solved, samples = solve_points(Model.baseline(), points), 20000
    place = (np.arange(samples) + 0.5) / samples
    current = solved.orbit.pieces.current_at(place[:, None] * solved.circuit.half_period_s)
    spectrum = np.fft.rfft(np.concatenate([current, -current]), axis=0) / samples
    squares, k = 0.5 * np.abs(spectrum[1:]) ** 2, np.arange(1, samples + 1)[:, None]
    winding = prototype().inductor.winding
    corner = winding.flattens_at_harmonic
    rise = winding.ac_extra * k**2 * (1 + corner**-2) / (1 + (k / corner) ** 2)
    expected_W = winding.at(solved.temperatures.inductor_C) * np.sum((1 + rise) * squares, axis=0)
    # eddy currents are an eighth of it and less, and the waves' drops and swings move their harmonics by some per cent
    np.testing.assert_allclose(solved.result["loss_inductor_copper_W"], expected_W, rtol=5e-3)
