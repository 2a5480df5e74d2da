"""Measured rows that tell explanations apart, and steps that are worth it together."""

from dataclasses import replace

import numpy as np
import pytest

from models.dataset import load_measurements
from models.diagnosis.bench_options import ANYTHING, Allowed
from models.diagnosis.diagnose import Diagnosis, diagnose
from models.diagnosis.measured_again import telling_rows
from models.diagnosis.next_measurement import Rival, next_measurements, worth_doing
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


def test_rows_with_the_most_current_tell_most_of_a_resistance(found: Diagnosis, rivals: list[Rival]) -> None:
    loaded = np.flatnonzero((found.observations.frame["kind"] == "load").to_numpy())
    loaded = loaded[np.isin(loaded, found.observations.row)]
    rows = telling_rows(found.refinery, [(r.fit, r.probability) for r in rivals], loaded)
    current_A = found.observations.frame["I_L_rms_A"].to_numpy()
    assert sorted(rows) == sorted(loaded)
    # the link's loss goes by the current's square, and so do sigmas: rows in no order have equal means, to a standard
    # error of 0.15 for ten of a square that scatters by half of itself; two of them
    assert np.mean(current_A[rows[:10]] ** 2) > 1.3 * np.mean(current_A[rows[-30:]] ** 2)


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
