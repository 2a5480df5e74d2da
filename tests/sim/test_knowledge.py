"""The knowledge-based methods: right where nothing is lost, equal in the limit, whole in their columns."""

from dataclasses import replace

import numpy as np
import pytest

from sim.harmonic import odd_orders
from sim.knowledge import harmonic_method, piecewise_method
from sim.model import Model
from sim.operating_points import Points, grid
from sim.parameters import FullBridge, ParameterError
from sim.prototype import prototype
from sim.simulate import simulate
from tests.sim.orbits import random_duties, solve, without_losses

POINT = Points(D1=0.8, D2=0.1, power_W=800.0)


def test_without_losses_the_piecewise_method_is_exact() -> None:
    D1, D2 = random_duties(40, seed=51)
    phase = np.random.default_rng(51).uniform(0.02, 0.4, 40)
    converter = without_losses(prototype())
    case = solve(D1, D2, phase, converter)
    result = piecewise_method(
        Model(converter=converter), Points(D1=D1, D2=D2, power_W=case.orbit.output_power_W())
    )
    flat = case.orbit.output_power_W() < 1.0  # where the phase does not matter
    assert np.sum(~flat) > 20
    # rounding: without resistance both are polygons
    np.testing.assert_allclose(result["I_L_rms_A"][~flat], case.rms_A[~flat], rtol=1e-9)


def test_many_harmonics_are_the_straight_lines() -> None:
    points = grid((7, 7, 4))
    exact, series = (
        piecewise_method(Model.baseline(), points),
        harmonic_method(Model.baseline(), points, harmonics=80),
    )
    both = exact.feasible & series.feasible
    assert both.sum() > 50
    # a triangle's corner is 0.25 % low: 80 terms of 1/k^2; four of them in a current, of which corners are a part
    np.testing.assert_allclose(series["I_L_rms_A"][both], exact["I_L_rms_A"][both], rtol=1e-3)
    np.testing.assert_allclose(series["D0"][both], exact["D0"][both], atol=1e-5)  # 80 terms of 1/k^3


def test_one_harmonic_is_a_sine() -> None:
    result = harmonic_method(Model.baseline(), Points(D1=1.0, D2=0.0, power_W=1000.0), harmonics=1)
    assert result["I_L_pp_A"] / result["I_L_rms_A"] == pytest.approx(2 * np.sqrt(2), rel=2e-3)  # 64 places


@pytest.mark.parametrize("method", [piecewise_method, harmonic_method])
def test_the_columns_are_the_simulators(method) -> None:  # type: ignore[no-untyped-def]
    ours, theirs = method(Model.baseline(), POINT), simulate(Model.baseline(), POINT)
    assert set(ours.columns()) == set(theirs.columns())


@pytest.mark.parametrize("method", [piecewise_method, harmonic_method])
def test_losses_add_up_to_the_difference_of_powers(method) -> None:  # type: ignore[no-untyped-def]
    result = method(Model.baseline(), grid((7, 7, 4)))
    parts = sum(v for name, v in result.values.items() if name.startswith("loss_"))
    k = result.feasible
    np.testing.assert_allclose((result["P1_W"] - result["P2_W"])[k], parts[k], atol=1e-9)  # rounding


def test_the_piecewise_method_is_near_the_simulator_at_full_load() -> None:
    point = Points(D1=1.0, D2=0.0, power_W=1800.0)
    ours, theirs = piecewise_method(Model.baseline(), point), simulate(Model.baseline(), point)
    assert ours["I_L_rms_A"] == pytest.approx(theirs["I_L_rms_A"], rel=0.05)  # drops and dead time
    assert abs(ours["efficiency"][0] - theirs["efficiency"][0]) < 0.01


def test_an_unreachable_power_is_told_and_has_no_numbers() -> None:
    result = piecewise_method(Model.baseline(), Points(D1=0.5, D2=0.5, power_W=1900.0))
    assert not result.feasible[0]
    assert "carry at most" in result.reason[0]
    assert np.isnan(result["efficiency"][0])


def test_power_back_is_the_mirror_image() -> None:
    there = piecewise_method(Model.baseline(), POINT)
    back = piecewise_method(Model.baseline(), replace(POINT, power_W=-POINT.power_W))
    centre = (1 + 0.1 - 0.8) / 2
    assert back["D0"] + centre == pytest.approx(-(there["D0"] + centre))
    assert back["I_L_rms_A"] == pytest.approx(there["I_L_rms_A"])


def test_another_topology_has_its_own_parts() -> None:
    converter = prototype()
    two_level = replace(converter, primary=FullBridge(switch=converter.secondary.switch), modulation="tps")
    result = piecewise_method(Model(converter=two_level), POINT)
    assert result["loss_primary_conduction_W"][0] > 0
    assert "loss_primary_clamp_conduction_W" not in result.values


def test_no_harmonics_are_refused() -> None:
    with pytest.raises(ParameterError, match="harmonics is 0"):
        odd_orders(0)
