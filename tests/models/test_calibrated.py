"""Calibrated physics: the simulator at the most probable state of its parts, and a smooth leftover."""

import numpy as np
import pytest

from models.calibrated import CalibratedPhysics, Leftover
from models.dataset import load_measurements
from models.diagnosis.diagnose import diagnose
from sim.model import Model
from sim.simulate import Points, simulate
from sim.spread import everyday_spread
from tests.models.diagnosis.virtual_campaign import set_points, simulated_campaign

SHIFTED = "primary.inner.on.threshold_V"


@pytest.fixture(scope="module")
def truth() -> Model:
    """The baseline with one part off by two of its everyday sigmas."""
    converter = Model.baseline().converter
    (spread,) = (entry for entry in everyday_spread(converter) if entry.path == SHIFTED)
    return Model(converter=spread.shifted(converter, 2.0))


@pytest.fixture(scope="module")
def calibrated(truth: Model) -> CalibratedPhysics:
    return diagnose(load_measurements(simulated_campaign(truth, seed=4, count=40))).calibrated


def test_calibration_takes_a_spread_up(truth: Model, calibrated: CalibratedPhysics) -> None:
    D1, D2, power = set_points(80, seed=5)  # not the points that were fitted
    wanted, baseline = (
        simulate(model, Points(D1=D1, D2=D2, power_W=power))["efficiency"]
        for model in (truth, Model.baseline())
    )
    before = np.nanmean(np.abs(baseline - wanted))
    after = np.nanmean(np.abs(calibrated.predict(D1, D2, power) - wanted))
    assert before > 3e-4  # there is something to take up
    # between measured points the smooth leftover knows less than at them; without noise, a fiftieth is safe
    assert after < 0.02 * before


def test_predictions_have_the_inputs_broadcast_shape(calibrated: CalibratedPhysics) -> None:
    power = np.array([[500.0], [900.0]])
    assert calibrated.predict(np.array([0.8, 0.9, 1.0]), 0.0, power).shape == (2, 3)


def test_where_the_model_cannot_run_there_is_no_prediction(calibrated: CalibratedPhysics) -> None:
    assert np.isnan(calibrated.predict(0.2, 0.8, 2000.0))


def leftover(place: np.ndarray) -> Leftover:
    none = np.zeros(len(place))
    return Leftover(place=place, weight=none, noise_W=none, length=np.array([0.2, 0.2, 400.0, 1.0]))


def test_a_leftover_goes_through_quiet_readings() -> None:
    rng = np.random.default_rng(1)
    place = rng.uniform([0.4, 0.0, 200.0, 0.0], [1.0, 0.5, 1800.0, 1.0], (30, 4))
    residual = 0.3 * np.sin(place[:, 2] / 400.0)
    fitted = leftover(place).fitted(residual, np.full(30, 1e-3))
    np.testing.assert_allclose(fitted.watts(place), residual, atol=0.01)  # ten sigmas of a reading


def test_a_leftover_ignores_what_noise_explains() -> None:
    rng = np.random.default_rng(2)
    place = rng.uniform([0.4, 0.0, 200.0, 0.0], [1.0, 0.5, 1800.0, 1.0], (30, 4))
    fitted = leftover(place).fitted(0.1 * rng.standard_normal(30), np.full(30, 10.0))
    assert np.max(np.abs(fitted.watts(place))) < 0.01  # readings a hundred times worse than the prior
