"""Measured rows that tell explanations apart, and steps that are worth it together."""

from dataclasses import replace

import numpy as np
import pytest

from models.dataset import load_measurements
from models.diagnosis.bench_options import ANYTHING, Allowed
from models.diagnosis.diagnose import Diagnosis, diagnose
from models.diagnosis.measured_again import telling_rows
from models.diagnosis.next_measurement import next_measurements
from models.diagnosis.race import Rival, worth_doing
from tests.models.diagnosis.virtual_campaign import lab_campaign


@pytest.fixture(scope="module")
def found() -> Diagnosis:
    return diagnose(load_measurements(lab_campaign({}, seed=100_011, count=70).frame))


@pytest.fixture(scope="module")
def rivals(found: Diagnosis) -> list[Rival]:
    """Nothing, and a link resistance that cannot be told from it on its tangent."""
    model, nothing = found.rivals[0].model, found.rivals[0]
    signature = next(s for s in found.refinery.known.effects if s.effect == "link_resistance")
    fit = replace(nothing.fit, shift=nothing.fit.shift + 0.01 * signature.slope)
    resistive = Rival(
        effects=("link_resistance",),
        probability=0.5,
        model=model.with_effect("link_resistance", resistance_Ohm=0.01),
        fit=fit,
    )
    return [replace(nothing, probability=0.5), resistive]


def test_rows_that_would_separate_most_come_first(found: Diagnosis, rivals: list[Rival]) -> None:
    """Against readings that are taken once more in earnest: in the whole covariance, one at a time."""
    refinery, o = found.refinery, found.observations
    loaded = np.flatnonzero((o.frame["kind"] == "load").to_numpy())
    among = loaded[np.isin(loaded, o.row)][::7]
    nothing, resistive = (rival.fit for rival in rivals)
    difference = resistive.shift - nothing.shift
    covariance = np.linalg.inv(refinery.solve(nothing, np.eye(difference.size)))
    told = np.zeros(len(o.frame))
    for k in np.flatnonzero(np.isin(o.row, among)):
        again = covariance[k].copy()
        again[k] -= refinery.noise[k] ** 2
        wider = np.block([[covariance, again[:, None]], [again[None], covariance[k, k]]])
        both = np.append(difference, difference[k])
        told[o.row[k]] += both @ np.linalg.solve(wider, both)
        told[o.row[k]] -= difference @ np.linalg.solve(covariance, difference)
    rows = telling_rows(refinery, [(rival.fit, rival.probability) for rival in rivals], among)
    assert rows.tolist() == among[np.argsort(-told[among])].tolist()


def test_what_is_proposed_was_measured(found: Diagnosis, rivals: list[Rival]) -> None:
    steps = next_measurements(found.observations, rivals, refinery=found.refinery)
    frame = found.observations.frame
    measured = {tuple(row) for row in frame[["D1", "D2", "P2_W"]].to_numpy().tolist()}
    proposed = [s.set_point for s in steps if s.set_point is not None and not s.by_hand]
    assert proposed
    assert set(proposed) <= measured


def test_small_steps_are_worth_it_together() -> None:
    small = [np.array([0.16])] * 10  # 0.4 sigma each, 1.26 together
    assert worth_doing(small, [0] * 10, ANYTHING) == 10
    assert worth_doing(small[:5], [0] * 5, ANYTHING) == 0


def test_what_is_behind_the_last_large_step_is_left_out() -> None:
    gains = [np.array([gain]) for gain in (0.1, 0.3, 0.1)]
    assert worth_doing(gains, [0, 0, 0], ANYTHING) == 2
    assert worth_doing(gains, [0, 0, 0], Allowed(least_sigma=0.6)) == 0
