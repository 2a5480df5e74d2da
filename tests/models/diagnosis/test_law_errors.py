"""What formulas are known to leave out, at every reading."""

import numpy as np
import pytest

from models.diagnosis.law_errors import law_errors, no_errors
from models.diagnosis.observations import Observations
from sim.effects.catalogue import CATALOGUE, effect
from sim.effects.parameter_effect import ParameterEffect
from sim.harmonics import eddy_share
from sim.model import Model
from sim.prototype import prototype
from sim.simulate import Result
from tests.models.diagnosis.fabricated import loads

LOADS = loads(np.array([1500.0, 300.0, 900.0, 1200.0, 600.0, 1800.0]))


@pytest.fixture(scope="module")
def near() -> Result:
    return LOADS.reference(Model.baseline())


def errors(name: str, near: Result, observations: Observations = LOADS) -> np.ndarray:
    return np.array(law_errors(observations, near, prototype())(effect(name)))


@pytest.mark.parametrize("part", ["inductor", "transformer"])
@pytest.mark.parametrize("least_loss_C", [25.0, 95.0, 120.0])
def test_a_core_that_loses_least_at_any_temperature_is_a_level_and_the_two_errors(
    part: str, least_loss_C: float, near: Result
) -> None:
    resistance = getattr(prototype(), part).thermal_K_per_W
    hot_C = near[f"T_{part}_C"] + 2.0 * resistance * near[f"loss_{part}_core_W"]
    truth = (hot_C - least_loss_C) ** 2
    shapes = np.stack([np.ones(hot_C.size), *errors(f"core_loss_{part}", near)], axis=1)
    weights = np.linalg.lstsq(shapes, truth, rcond=None)[0]
    np.testing.assert_allclose(shapes @ weights, truth, rtol=1e-9)  # rounding


def test_a_core_loses_a_fifth_more_or_less_at_sixty_kelvin(near: Result) -> None:
    line, parabola = errors("core_loss_inductor", near)
    hot_C = near["T_inductor_C"] + 2.0 * 7.0 * near["loss_inductor_core_W"]
    np.testing.assert_allclose(np.diff(line), 0.2 * np.diff(hot_C) / 60.0, rtol=1e-9)  # rounding
    assert np.ptp(hot_C) > 20.0  # so that there is something to tell
    assert np.mean(line) == pytest.approx(0.0, abs=1e-12)
    assert np.mean(parabola) == pytest.approx(0.0, abs=1e-12)


def test_eddy_currents_may_flatten_half_as_much_again_or_half_as_much(near: Result) -> None:
    at = LOADS.points, near["D0"]
    share = eddy_share(prototype(), *at)
    (found,) = errors("skin_effect", near)
    np.testing.assert_allclose(found * share, 0.5 * (1.0 - share), rtol=1e-12)  # rounding
    assert np.ptp(share) > 0.01


def test_a_plain_resistance_has_no_such_error(near: Result) -> None:
    assert errors("link_resistance", near).size == 0
    assert no_errors(effect("core_loss_inductor")) == []


def test_where_nothing_is_simulated_no_error_is_known(near: Result) -> None:
    lost = near["T_inductor_C"].copy()
    lost[2] = np.nan
    nowhere = {"T_inductor_C": lost, "loss_inductor_core_W": near["loss_inductor_core_W"]}
    found = np.array(law_errors(LOADS, nowhere, prototype())(effect("core_loss_inductor")))  # type: ignore[arg-type]
    assert np.all(np.isfinite(found))
    np.testing.assert_array_equal(found[:, 2], 0.0)


def test_every_effect_of_a_cores_loss_says_whose() -> None:
    of_cores = {
        name: entry.core_of
        for name, entry in CATALOGUE.items()
        if isinstance(entry, ParameterEffect) and any(".core." in path for path in entry.paths)
    }
    assert of_cores == {"core_loss_inductor": "inductor", "core_loss_transformer": "transformer"}
