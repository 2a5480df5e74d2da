"""What to measure next: the action that tells two made-up rivals apart, by what the simulator says."""

import numpy as np
import pytest

from models.diagnosis.next_measurement import next_measurements
from models.diagnosis.observations import Observations, observe
from models.diagnosis.verdict import Cause
from sim.model import Model
from sim.prototype import prototype
from tests.models.diagnosis.fabricated import fit_of
from tests.models.diagnosis.virtual_campaign import simulated_campaign


@pytest.fixture(scope="module")
def observations() -> Observations:
    return observe(simulated_campaign(Model.baseline(), seed=1, count=20), prototype())


def cause(effect: str, value: float, probability: float = 0.5) -> Cause:
    return Cause(fit=fit_of(effect, np.zeros(1), value=value), probability=probability)


def test_one_standby_reading_tells_offset_from_auxiliary_power(observations: Observations) -> None:
    rivals = [cause("auxiliary_power", 6.0), cause("analyzer_offset", 0.02)]
    steps = next_measurements(observations, Model.baseline(), rivals)
    assert steps[0].action == "standby"
    assert set(steps[0].separates) == {"auxiliary_power", "analyzer_offset"}
    assert steps[0].expected_sigma > 5  # 6 W against hundredths of a watt


def test_the_best_per_minute_comes_first(observations: Observations) -> None:
    rivals = [cause("link_resistance", 0.1), cause("core_loss_transformer", 0.8)]
    steps = next_measurements(observations, Model.baseline(), rivals)
    worth = [step.expected_sigma**2 / step.minutes for step in steps]
    assert steps
    assert worth == sorted(worth, reverse=True)


def test_one_cause_needs_no_further_measurement(observations: Observations) -> None:
    assert next_measurements(observations, Model.baseline(), [cause("link_resistance", 0.1, 0.96)]) == []


def test_an_improbable_rival_takes_no_part(observations: Observations) -> None:
    rivals = [cause("link_resistance", 0.1, 0.99), cause("auxiliary_power", 3.0, 0.005)]
    assert next_measurements(observations, Model.baseline(), rivals) == []
