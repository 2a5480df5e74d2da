"""What is kept of simulated rows is what a simulation says of them again, at another time."""

from dataclasses import replace

import numpy as np
import pytest

from models.diagnosis import predictions
from models.diagnosis.observations import Observations, observe
from models.diagnosis.predictions import Repeated
from models.diagnosis.signatures import Signatures, signatures
from sim.model import Model
from sim.prototype import prototype
from tests.models.diagnosis.virtual_campaign import simulated_campaign

BASELINE = Model.baseline()


@pytest.fixture(scope="module")
def measured() -> Observations:
    frame = simulated_campaign(BASELINE, seed=1, count=16)
    return observe(frame[frame["P2_W"] < 1000.0], prototype())  # well below what D1 and D2 can carry


@pytest.fixture(scope="module")
def known(measured: Observations) -> Signatures:
    return signatures(measured, BASELINE)


@pytest.fixture(scope="module")
def later(measured: Observations) -> Observations:
    """The same rows two hours later, the first one in a warmer room."""
    end_s, ambient_C = float(np.max(measured.points.time_s)) + 7200.0, np.array(measured.points.ambient_C)
    ambient_C[measured.row[0]] += 15.0
    points = replace(measured.points, time_s=np.full(len(measured.points), end_s), ambient_C=ambient_C)
    return replace(measured, points=points)


def test_repeated_rows_have_the_signatures_of_a_simulation_of_their_own(
    measured: Observations, known: Signatures, later: Observations
) -> None:
    used, near = np.unique(measured.row), measured.reference(BASELINE)
    repeated = Repeated(known=known.told, rows=np.where(used == measured.row[0], -1, used))
    kept = signatures(later, BASELINE, near=near, repeated=repeated)
    anew = signatures(later, BASELINE, near=near)
    # a solution is good to 2e-7 of a kilowatt, and two steps are the difference of four; a step is a fifth of the prior
    for one, other in zip(kept.effects, anew.effects, strict=True):
        step = 0.2 * one.entry.headline.prior
        np.testing.assert_allclose(one.slope * step, other.slope * step, atol=1e-3)
    np.testing.assert_allclose(kept.spreads, anew.spreads, atol=1e-3)
    np.testing.assert_allclose(kept.baseline, anew.baseline, atol=1e-3)


def test_what_follows_the_time_is_known_of_the_end_where_a_command_waits(
    measured: Observations, monkeypatch: pytest.MonkeyPatch
) -> None:
    used, near = np.unique(measured.row), measured.reference(BASELINE)
    told = signatures(replace(measured, processes=2), BASELINE, near=near).told
    end_s = np.full(len(measured.points), np.max(measured.points.time_s))
    last = replace(measured, points=replace(measured.points, time_s=end_s))
    anew = signatures(last, BASELINE, near=near)
    monkeypatch.setattr(predictions, "simulate_each", None)  # nothing is asked of the simulator
    kept = signatures(last, BASELINE, near=near, repeated=Repeated(known=told, rows=used))
    for one, other in zip(kept.effects, anew.effects, strict=True):
        step = 0.2 * one.entry.headline.prior  # as above
        np.testing.assert_allclose(one.slope * step, other.slope * step, atol=1e-3)


def test_nothing_is_kept_where_the_baseline_itself_follows_the_time(measured: Observations) -> None:
    drifting = BASELINE.with_effect("ambient_drift", rate_K_per_h=2.0)
    assert not signatures(measured, drifting, among=()).told.tables
