"""Calibrated physics: the simulator at the most probable state of its parts, and a smooth leftover."""

from dataclasses import replace

import numpy as np
import pytest

from models.calibrated import CalibratedPhysics, Leftover
from models.dataset import load_measurements
from models.diagnosis.diagnose import diagnose
from models.near_optimum import least_known
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
    place = rng.uniform([0.4, 0.0, 200.0, 0.0, 5.0], [1.0, 0.5, 1800.0, 1.0, 50.0], (30, 5))
    residual = 0.3 * np.sin(place[:, 2] / 400.0)
    fitted = leftover(place).fitted(residual, np.full(30, 1e-3))
    np.testing.assert_allclose(fitted.watts(place), residual, atol=0.01)  # ten sigmas of a reading


def test_a_leftover_ignores_what_noise_explains() -> None:
    rng = np.random.default_rng(2)
    place = rng.uniform([0.4, 0.0, 200.0, 0.0, 5.0], [1.0, 0.5, 1800.0, 1.0, 50.0], (30, 5))
    fitted = leftover(place).fitted(0.1 * rng.standard_normal(30), np.full(30, 10.0))
    assert np.max(np.abs(fitted.watts(place))) < 0.01  # readings a hundred times worse than the prior


def test_a_drift_of_the_losses_is_predicted_at_the_end_of_the_campaign() -> None:
    late = Leftover(
        place=np.array([[0.8, 0.1, 1000.0, t, 20.0] for t in np.linspace(0.0, 1.0, 30)]),
        weight=np.zeros(30),
        noise_W=np.zeros(30),
        length=np.array([0.2, 0.2, 400.0, 0.2]),
        drift=0.1,
    )
    rise_W = 1.5 * (1 - np.exp(-3 * late.place[:, 3]))
    fitted = late.fitted(rise_W, np.full(30, 0.02))
    assert fitted.watts(late.place[-1:])[0] == pytest.approx(rise_W[-1], abs=0.04)  # two sigmas of a reading


def test_predictions_are_surer_where_something_was_measured(calibrated: CalibratedPhysics) -> None:
    at = calibrated.leftover.place[:5, :3]
    away = np.array([[0.95, 0.55, 250.0], [0.35, 0.02, 210.0]])
    known, unknown = (np.sqrt(np.diag(calibrated.left_open(place))) for place in (at, away))
    assert known.max() < unknown.min()
    assert unknown.max() < 0.01  # a part's everyday spread, no more


def test_what_is_left_open_of_the_inductance_keeps_the_model_off_the_edge(
    calibrated: CalibratedPhysics,
) -> None:
    def with_inductance(share: float) -> Model:
        converter = calibrated.model.converter
        inductor = replace(converter.inductor, inductance_H=(1 + share) * converter.inductor.inductance_H)
        return Model(converter=replace(converter, inductor=inductor))

    unsure = replace(calibrated, variants=(with_inductance(0.01),)).vouched()
    assert unsure.spare == pytest.approx(0.02, rel=0.1)  # two sigmas; power goes with 1 / inductance
    power = np.linspace(1900.0, 2200.0, 301)
    carried, vouched = (
        np.count_nonzero(np.isfinite(model.predict(1.0, 0.0, power))) for model in (calibrated, unsure)
    )
    assert carried - vouched == pytest.approx(0.02 * 2100, rel=0.2)  # W, as the powers are 1 W apart


@pytest.mark.parametrize("rated_W", [100.0, 700.0, 8000.0])
def test_the_most_is_found_wherever_it_lies_beside_the_rated_power(
    calibrated: CalibratedPhysics, rated_W: float
) -> None:
    def rated(model: Model) -> Model:
        return Model(converter=replace(model.converter, rated_power_W=rated_W), effects=model.effects)

    inductor = replace(calibrated.model.converter.inductor, inductance_H=2.5e-4)
    other = Model(converter=replace(calibrated.model.converter, inductor=inductor))
    plain = replace(calibrated, variants=(other,))
    elsewhere = replace(plain, model=rated(plain.model), variants=(rated(other),))
    # powers are tried in steps of a part in five thousand
    assert elsewhere.vouched().spare == pytest.approx(plain.vouched().spare, abs=2e-3)


def test_points_are_chosen_near_the_optimum_where_least_is_known(calibrated: CalibratedPhysics) -> None:
    place = np.array([[0.9, 0.05, 900.0], [0.35, 0.02, 890.0], [0.9, 0.05, 900.0]])
    efficiency, sigma = calibrated.predict(*place.T), np.sqrt(np.diag(calibrated.left_open(place)))
    assert efficiency[1] < efficiency[0] - 0.01  # far below the best at its load
    assert sigma[1] > sigma[0]  # and less certain
    found = least_known(calibrated, place, 2)
    assert found.chosen[0] in (0, 2)
    assert found.sigma == pytest.approx(sigma[0], rel=1e-6)


def test_no_point_is_chosen_twice(calibrated: CalibratedPhysics) -> None:
    place = np.array([[0.9, 0.05, 900.0], [0.8, 0.1, 600.0], [0.2, 0.8, 2000.0]])  # the last one cannot run
    assert sorted(least_known(calibrated, place, 9).chosen) == [0, 1]


def test_of_two_neighbours_one_is_enough() -> None:
    class Model:
        def predict(self, D1: np.ndarray, D2: np.ndarray, power_W: np.ndarray) -> np.ndarray:
            return np.full(3, 0.98)

        def left_open(self, place: np.ndarray) -> np.ndarray:
            return 1e-6 * np.array([[1.0, 0.99, 0.0], [0.99, 1.0, 0.0], [0.0, 0.0, 0.5]])

    found = least_known(Model(), np.zeros((3, 3)), 2)  # type: ignore[arg-type]
    assert found.chosen == (0, 2)
    assert found.sigma == pytest.approx(1e-3)


def test_a_zero_state_about_as_long_as_the_dead_time_is_not_vouched_for(
    calibrated: CalibratedPhysics,
) -> None:
    converter = calibrated.model.altered_converter()
    dead = float(converter.dead_share)
    D1 = 1.0 - dead * np.array([1.05, 1.15, 0.0])  # a real dead time may be a tenth longer
    assert np.isfinite(calibrated.predict(D1, 0.1, 1000.0)).all()
    assert np.isfinite(calibrated.vouched().predict(D1, 0.1, 1000.0)).tolist() == [False, True, True]


def test_a_load_of_which_nobody_knows_whether_it_is_carried_is_worth_a_try(
    calibrated: CalibratedPhysics,
) -> None:
    power = np.arange(2000.0, 2300.0)
    most_W = power[np.isfinite(calibrated.predict(1.0, 0.0, power))].max()
    spare = calibrated.vouched().spare
    loads = most_W * (1 + np.array([-1.2, -0.5, 1.2, 1.7]) * spare)
    np.testing.assert_array_equal(calibrated.worth_a_try(loads), [[1.0, 0.0, P] for P in loads[1:3]])
