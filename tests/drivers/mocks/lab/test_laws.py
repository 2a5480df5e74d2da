"""The shapes of a lab's laws: what they keep whatever is drawn, and that every one of them is at work."""

from dataclasses import fields, replace

import numpy as np
import pytest

from drivers.mocks.lab.laboratory import Laboratory
from drivers.mocks.lab.laws import Laws
from sim.prototype import prototype
from tests.drivers.mocks.lab.laboratories import nominal, settled

SHAPES = [f.name for f in fields(Laws) if f.name != "choke"]
DRAWN = [Laboratory.draw(seed=seed).laws for seed in range(8)]


@pytest.mark.parametrize("shape", SHAPES)
def test_every_lab_has_a_shape_of_its_own(shape: str) -> None:
    assert len({getattr(laws, shape) for laws in DRAWN}) == len(DRAWN)


@pytest.mark.parametrize("laws", DRAWN)
def test_a_switching_energy_is_the_datasheets_at_its_point(laws: Laws) -> None:
    law = prototype().secondary.switch.turn_off
    at = (np.array([current]) for current in (0.0, law.reference_A))
    none_J, own_J = (
        laws.switching_J(law, current_A, np.array([law.reference_V]), np.array([25.0])) for current_A in at
    )
    assert none_J == 0.0
    assert own_J == pytest.approx(law.energy_J, rel=1e-12)  # rounding


@pytest.mark.parametrize("laws", DRAWN)
def test_eddy_currents_grow_with_the_harmonic_and_less_than_its_square(laws: Laws) -> None:
    harmonic = np.arange(1, 40, 2)
    rise = laws.eddy_rise(harmonic)
    assert rise[0] == 1.0
    assert np.all(np.diff(rise) > 0.0)
    assert np.all(rise[1:] < harmonic[1:] ** 2)


@pytest.mark.parametrize("laws", DRAWN)
def test_a_core_loses_least_at_its_temperature(laws: Laws) -> None:
    core_C = np.arange(20.0, 131.0, 0.1)
    warmth = laws.core_warmth(core_C)
    assert core_C[np.argmin(warmth)] == pytest.approx(laws.least_core_C, abs=0.05)  # half a step
    assert laws.core_warmth(np.array(60.0)) == 1.0  # where its data are stated


@pytest.mark.parametrize("shape", sorted(set(SHAPES) - {"diode_share"}))
def test_every_shape_moves_the_input_power(shape: str) -> None:
    lab = nominal()
    other = replace(lab, laws=replace(lab.laws, **{shape: 1.2 * getattr(lab.laws, shape)}))
    plain_W, moved_W = (settled(each)[2] for each in (lab, other))
    assert np.max(np.abs(moved_W - plain_W)) > 1e-3  # losses are tens of watts, the solver's target 1e-5


def test_where_recovery_is_lost_moves_heat_and_hardly_power() -> None:
    lab = nominal()
    other = replace(lab, laws=replace(lab.laws, diode_share=0.6))
    (now, _, plain_W), (moved, _, moved_W) = settled(lab), settled(other)
    clamp_W, outer_W = (moved.losses.by_kind[k] - now.losses.by_kind[k] for k in ("clamp", "outer"))
    assert np.max(clamp_W) > 1e-3  # else there is nothing to compare
    little_W = 0.1 * np.max(clamp_W)  # what is warmer loses otherwise
    np.testing.assert_allclose(clamp_W, -outer_W, atol=little_W)
    np.testing.assert_allclose(moved_W, plain_W, atol=little_W)
