"""An inductance that falls with current: against integration of its flux, in its limits, and by conservation."""

from dataclasses import replace

import numpy as np
import pytest

from sim.fixed_point import operate
from sim.model import Model
from sim.operating_points import Points
from sim.parameters import Converter, ParameterError
from sim.prototype import prototype
from sim.simulate import simulate, simulate_many
from tests.sim.orbits import Array, Case, random_case


def saturating(drop: float) -> Converter:
    return replace(prototype(), inductor=replace(prototype().inductor, saturation=drop))


def by_flux(case: Case, drop: float, steps: int) -> tuple[Array, Array]:
    """End current and rms of a half period in which the flux follows its arctangent, by Heun's rule."""
    c, p = case.circuit, case.orbit.pieces
    own_A = 15.0 * np.sqrt((1 - drop) / drop)
    flux = own_A * np.arctan(case.orbit.start_A / own_A)  # over the inductance of a small current
    begin, square = p.start_s, np.zeros_like(flux)

    def current(flux: Array) -> Array:
        return own_A * np.tan(flux / own_A)

    def slope(k: int, flux: Array) -> Array:
        i, live = current(flux), np.abs(p.vp_V[k]) > 1.0
        V0, R = np.where(live, np.where(p.vp_V[k] * p.sign[k] > 0, c.forward, c.reverse), c.zero)
        v = p.vp_V[k] - p.nvs_V[k]
        return np.where(p.drive_A_per_s[k] == 0.0, 0.0, (v - p.sign[k] * V0 - R * i) / c.inductance_H)

    for k in range(begin.shape[0]):
        h = p.duration_s[k] / steps
        for _ in range(steps):
            first = slope(k, flux)
            after = flux + 0.5 * h * (first + slope(k, flux + h * first))
            i, j = current(flux), current(after)
            flux, square = after, square + h * (i * i + i * j + j * j) / 3
    return current(flux), np.sqrt(square / c.half_period_s)


def test_the_waveform_is_that_of_the_flux() -> None:
    case = random_case(60, seed=51, converter=saturating(0.3))
    end_A, rms_A = by_flux(case, 0.3, steps=20)
    strong = case.rms_A > 2.0
    # lines between fifths of 15 A lie up to a hundredth beside the arctangent
    np.testing.assert_allclose(rms_A[strong], case.rms_A[strong], rtol=0.01)
    np.testing.assert_allclose(end_A, -case.orbit.start_A, atol=0.02 * np.abs(case.orbit.start_A).max())


def test_every_orbit_closes_and_conserves_energy() -> None:
    points = Points(D1=[0.9, 0.7, 1.0], D2=[0.1, 0.2, 0.0], power_W=[1700.0, 900.0, -1200.0])
    outcome = operate(saturating(0.4), points.with_voltages_of(prototype()))
    balance, orbit = outcome.state.balance, outcome.state.regulated.orbit
    carried = [k for k in balance.losses if k.endswith(("_conduction", "_copper")) or k == "link_resistance"]
    between_W = orbit.input_power_W() - orbit.output_power_W()
    assert outcome.reached.all()
    np.testing.assert_allclose(sum(balance.losses[k] for k in carried), between_W, atol=1e-6)  # of 1 kW: 1e-9


def test_nothing_saturates_at_small_currents() -> None:
    points = Points(D1=[0.9, 1.0], D2=[0.1, 0.0], power_W=[100.0, 2000.0])
    plain, bent = (simulate(Model(converter=c), points) for c in (prototype(), saturating(0.3)))
    light, heavy = np.abs(bent["D0"] - plain["D0"])
    assert light < 1e-3
    assert heavy > 0.02


def test_a_saturating_inductor_carries_more_at_less_phase() -> None:
    points = Points(D1=0.9, D2=0.1, power_W=1500.0)
    plain, bent = (simulate(Model(converter=c), points) for c in (prototype(), saturating(0.3)))
    assert bent["D0"][0] < plain["D0"][0]


def test_flux_is_that_of_the_bands() -> None:
    inductor = saturating(0.25).inductor
    own_A = 15.0 * np.sqrt(0.75 / 0.25)
    at = np.array([3.0, 9.0, 18.0])  # where the lines meet the arctangent
    np.testing.assert_allclose(inductor.flux_Vs(at), 236e-6 * own_A * np.arctan(at / own_A), rtol=1e-12)


@pytest.mark.parametrize("drop", [-0.1, 0.95, float("nan")])
def test_a_drop_that_no_core_has_is_refused(drop: float) -> None:
    with pytest.raises(ParameterError, match=r"Inductor\.saturation.*allowed: finite and in \[0, 0.9\]"):
        saturating(drop)


def test_variants_that_saturate_come_back_in_their_places() -> None:
    points = Points(D1=0.9, D2=0.1, power_W=1500.0)
    models = [Model.baseline().with_effect("inductor_saturation", relative_drop=x) for x in (0.2, 0.0, 0.1)]
    D0 = [r["D0"][0] for r in simulate_many(models, points)]
    assert D0[0] < D0[2] < D0[1]
