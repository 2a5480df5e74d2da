"""What is still open of readings that were not taken, and that proposed steps count nothing else."""

from dataclasses import replace

import numpy as np
import pytest

from models.dataset import load_measurements
from models.diagnosis.bench_options import Allowed
from models.diagnosis.diagnose import Diagnosis, diagnose
from models.diagnosis.left_open import Ahead, left_open
from models.diagnosis.next_measurement import next_measurements
from models.diagnosis.race import NO_FIT, Rival
from models.diagnosis.refinery import Refinery
from sim.model import Model
from sim.operating_points import Points
from tests.models.diagnosis.fabricated import CHANNEL
from tests.models.diagnosis.virtual_campaign import lab_campaign

POWERS = ["kind", "D1", "D2", "P2_W", "P1_W", "efficiency"]
EFFICIENCY = (CHANNEL["efficiency"],)


@pytest.fixture(scope="module")
def found() -> Diagnosis:
    """Dc powers of a lab whose link resistance is higher than modelled: tied with the switches' on-resistance."""
    frame = lab_campaign({"link_resistance": 0.06}, seed=100_007, count=30).frame
    loaded = frame[frame["kind"].isin(["load", "reference"])].reset_index(drop=True)
    return diagnose(load_measurements(loaded[POWERS]))


def watts_open(refinery: Refinery, D1: float, D2: float, power_W: float, rival: Rival) -> float:
    ahead = Ahead(points=Points(D1=[D1], D2=[D2], power_W=[power_W]), channels=EFFICIENCY)
    return float(left_open(refinery, ahead, [rival.fit]).covariance[0, 0, 0] ** 0.5)


NOTHING = Rival(effects=(), probability=0.5, model=Model.baseline(), fit=NO_FIT)


def nothing(refinery: Refinery) -> Rival:
    return replace(NOTHING, fit=replace(NO_FIT, shift=np.zeros_like(refinery.residual)))


@pytest.mark.parametrize("held", [True, False])
def test_what_lies_ahead_has_its_output_voltage_where_its_points_have_it(
    found: Diagnosis, held: bool
) -> None:
    ahead = Ahead(points=Points(D1=0.8, D2=0.1, power_W=600.0, V2_V=140.0, held=held), channels=EFFICIENCY)
    seen, _ = ahead.observed(found.refinery)
    assert np.all(seen.points.held == held)


def test_less_is_open_where_something_was_measured(found: Diagnosis) -> None:
    measured = found.observations.frame.iloc[0]
    here = watts_open(
        found.refinery, measured["D1"], measured["D2"], measured["P2_W"], nothing(found.refinery)
    )
    away = watts_open(found.refinery, 0.35, 0.58, 215.0, nothing(found.refinery))
    assert 0 < here < 0.7 * away


@pytest.mark.parametrize("channel", ["D0", "P_link1_W"])
def test_a_channel_that_agrees_is_known_better_than_by_one_reading(channel: str) -> None:
    found = diagnose(load_measurements(lab_campaign({}, seed=100_011, count=70).frame))
    refinery, first = found.refinery, found.observations.frame.iloc[5]
    where = Points(D1=[first["D1"]], D2=[first["D2"]], power_W=[first["P2_W"]])
    ahead = Ahead(points=where, channels=(CHANNEL[channel],))
    open_ = left_open(refinery, ahead, [nothing(refinery).fit]).covariance[0, 0, 0] ** 0.5
    noise = refinery.noise[refinery.observations.of(channel)]
    assert refinery.known.others_doubt < 1.0
    assert open_ < np.min(noise)  # seventy rows tell it; what was feared of the simulation is twice the noise


def test_an_effect_of_unknown_size_leaves_more_open(found: Diagnosis) -> None:
    hidden = next(rival for rival in found.rivals if "link_resistance" in rival.effects)
    where = (0.9, 0.05, 1900.0)
    assert watts_open(found.refinery, *where, hidden) > watts_open(
        found.refinery, *where, nothing(found.refinery)
    )


def test_what_cannot_run_is_not_a_number(found: Diagnosis) -> None:
    assert np.isnan(watts_open(found.refinery, 0.5, 0.5, 2000.0, nothing(found.refinery)))


def test_what_the_instruments_were_found_to_be_off_by_is_expected_again(found: Diagnosis) -> None:
    seen, rival = found.observations, found.rivals[0]
    ahead = Ahead(points=seen.points.take(seen.row), channels=EFFICIENCY)
    beside = left_open(found.refinery, ahead, [rival.fit]).beside[0]
    off = seen.value - seen.solved([rival.model])[0][0]
    assert np.mean(np.abs(off - beside)) < 0.5 * np.mean(np.abs(off))


def test_a_step_that_was_chosen_makes_room_for_others(found: Diagnosis) -> None:
    few = Allowed(by_hand=False, least_sigma=0.01)
    steps = [step for step in found.steps(few, 6) if not step.by_hand]
    assert sum(step.repeats for step in steps) == 6
    # taken at its word, one point would be the best six times
    assert len({step.set_point for step in steps}) >= 3


def test_what_the_spreads_may_take_up_is_no_separation(found: Diagnosis) -> None:
    alone = Allowed(by_hand=False)
    wary = next_measurements(found.observations, found.rivals, refinery=found.refinery, allowed=alone)
    rash = next_measurements(found.observations, found.rivals, allowed=alone)
    most = [max((s.expected_sigma for s in steps if not s.by_hand), default=0.0) for steps in (wary, rash)]
    assert most[0] < 0.7 * most[1]


def test_a_bench_that_is_noisier_than_usual_is_told_that_a_step_separates_less(found: Diagnosis) -> None:
    noisy = replace(found.refinery, noise=5.0 * found.refinery.noise)
    alone = Allowed(by_hand=False, least_sigma=0.01)
    quiet, loud = (
        next_measurements(found.observations, found.rivals, refinery=refinery, allowed=alone, most=1)
        for refinery in (found.refinery, noisy)
    )
    assert loud[0].action == quiet[0].action
    assert loud[0].expected_sigma < 0.8 * quiet[0].expected_sigma  # noise is not all that is open


def test_somebody_at_the_bench_is_asked_and_the_points_that_help_without_are_told_too(
    found: Diagnosis,
) -> None:
    assert "four wires" in found.next[0].action
    assert found.next[0].by_hand
    assert ", beginning with D1 = " in found.next[-1].action  # no point will do with dc powers alone
    assert all(not step.by_hand for step in found.steps(Allowed(by_hand=False))[:-1])


def test_what_is_measured_again_is_on_the_side_of_a_threshold_where_it_was_read(found: Diagnosis) -> None:
    points = Points(D1=[0.9, 0.9], D2=0.1, power_W=900.0, seen_heatsink_C=[45.0, np.nan])
    seen, _ = Ahead(points=points, channels=(CHANNEL["T_heatsink_C"],)).observed(found.refinery)
    np.testing.assert_array_equal(seen.points.seen_heatsink_C, [45.0, np.nan])
