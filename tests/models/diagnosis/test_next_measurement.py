"""What to measure next: the action that tells two made-up rivals apart, by what the simulator says."""

from dataclasses import replace
from typing import Any

import numpy as np
import pandas as pd
import pytest

from models.dataset import load_measurements
from models.diagnosis.bench_options import Allowed, _rebuilds, bench_options
from models.diagnosis.diagnose import diagnose
from models.diagnosis.evidence import Hypothesis
from models.diagnosis.missing_channel import missing_channel
from models.diagnosis.next_measurement import MOST_STEPS, next_measurements, rivals_of
from models.diagnosis.observations import Observations, observe
from models.diagnosis.race import SEPARATED, NextMeasurement, Rival
from sim.effects.catalogue import CATALOGUE
from sim.model import Model
from sim.prototype import prototype
from sim.simulate import can_run, simulate
from tests.models.diagnosis.fabricated import fit_of
from tests.models.diagnosis.virtual_campaign import simulated_campaign

POWERS = ["kind", "D1", "D2", "P2_W", "P1_W", "efficiency"]


@pytest.fixture(scope="module")
def observations() -> Observations:
    return observe(simulated_campaign(Model.baseline(), seed=1, count=20), prototype())


def rival(effect: str, value: float, probability: float = 0.5) -> Rival:
    head = CATALOGUE[effect].headline.name
    model = Model.baseline().with_effect(effect, **{head: value})
    return Rival(effects=(effect,), probability=probability, model=model)


OFFSET = [rival("auxiliary_power", 6.0), rival("analyzer_offset", 0.02)]


def test_one_standby_reading_tells_offset_from_auxiliary_power(observations: Observations) -> None:
    (step,) = next_measurements(observations, OFFSET)
    assert step.action == "standby"
    assert step.separates == ("analyzer_offset", "auxiliary_power")
    assert step.expected_sigma > 5  # 6 W against hundredths of a watt


def test_what_must_be_measured_again_has_its_set_point(observations: Observations) -> None:
    steps = next_measurements(observations, [rival("link_resistance", 0.1), rival("sic_on_resistance", 0.5)])
    step = next(step for step in steps if not step.by_hand)
    assert step.set_point is not None
    D1, D2, power_W = step.set_point
    assert step.action == f"measure D1 = {D1:.3f}, D2 = {D2:.3f}, {power_W:.0f} W"


def test_steps_end_when_the_rivals_are_apart(observations: Observations) -> None:
    close = [rival("link_resistance", 0.02), rival("sic_on_resistance", 0.25)]
    steps = next_measurements(observations, close)
    assert len(steps) < MOST_STEPS
    assert sum(s.expected_sigma**2 for s in steps) > SEPARATED**2
    assert sum(s.repeats for s in steps) < MOST_STEPS


def test_what_is_done_by_hand_is_done_once(observations: Observations) -> None:
    """Resistances as near as what four wires are good to: to measure them again errs the same way."""
    near = [rival("link_resistance", value) for value in (0.0600, 0.0615, 0.0630)]
    steps = [step for step in next_measurements(observations, near) if step.by_hand]
    assert any("four wires" in step.action for step in steps)
    assert [step.repeats for step in steps] == [1] * len(steps)


def test_without_a_channel_that_tells_it_is_asked_for() -> None:
    skew = [rival("gate_delay_skew", 60e-9), Rival(effects=(), probability=0.5, model=Model.baseline())]
    steps = next_measurements(observe(efficiency_alone(), prototype()), skew)
    assert "D0" in steps[-1].action  # the bridges' skew is a phase: power hardly knows of it
    assert steps[-1].expected_sigma > SEPARATED


def test_the_cheapest_channel_that_will_do_is_asked_for() -> None:
    """Both cables heat about alike; the voltage that each takes from the converter shows in D0, current, ac powers."""
    cables = [rival("cable_resistance_input", 0.04), rival("cable_resistance_output", 0.0088)]
    *_, needed = next_measurements(observe(efficiency_alone(), prototype()), cables)
    assert "measure D0 too" in needed.action
    assert "sigma at most" in needed.action  # what rows tell without it
    assert needed.by_hand


def test_no_channel_is_asked_for_that_would_not_tell_either() -> None:
    nearly_alike = [rival("link_resistance", 0.02), rival("link_resistance", 0.02001)]
    assert next_measurements(observe(efficiency_alone(), prototype()), nearly_alike) == []


@pytest.mark.parametrize(("times", "asked"), [(1, False), (10, True)])
def test_a_channel_is_judged_by_as_many_rows_as_were_measured(times: int, asked: bool) -> None:
    """Ten rows of any channel tell 10 % of a resistance by less than a sigma, 240 by more."""
    alike = [rival("link_resistance", 0.02), rival("link_resistance", 0.022)]
    measured = pd.concat([efficiency_alone()] * times, ignore_index=True)
    steps = next_measurements(observe(measured, prototype()), alike)
    assert any("P_link1_W too" in step.action for step in steps) == asked


class UsedUp:
    """A race of one pair that few rows tell little of and many much, until its steps are taken as measured."""

    pairs = np.array([[0, 1]])
    used = False

    def weight(self) -> np.ndarray:
        return np.ones(1)

    def among(self, rows: list[int], channels: list[int]) -> "UsedUp":
        return self

    def steps(self, most: int, allowed: Allowed) -> tuple[list[NextMeasurement], list[float]]:
        self.used = True
        step = NextMeasurement(action="measure", separates=("a", "b"), expected_sigma=0.5, minutes=1.0)
        return [step], [0.25]

    def altogether(self, measured: int) -> np.ndarray:
        return np.array([0.0 if self.used else 25.0])


def test_a_channel_is_asked_about_before_any_row_counts_as_measured() -> None:
    race: Any = UsedUp()
    (step,) = missing_channel(race, [0], ["D0"], most=1, measured=40, told=0.0)
    assert "measure D0 too" in step.action


def test_every_cause_that_is_stated_as_tied_takes_part() -> None:
    refinery = diagnose(load_measurements(simulated_campaign(Model.baseline(), seed=1, count=20))).refinery
    shift = np.zeros(refinery.residual.size)
    likely, hardly, never = (
        Hypothesis(fit=fit_of(name, shift, value=0.1), leftover=None, probability=probability)
        for name, probability in (("link_resistance", 0.98), ("skin_effect", 0.015), ("fan_step", 0.005))
    )
    alone = rivals_of([likely, hardly, never], refinery)
    assert [r.effects for r in alone] == [("link_resistance",)]
    tied = rivals_of([likely, hardly, never], refinery, ("skin_effect", "link_resistance"))
    assert [r.effects for r in tied] == [("link_resistance",), ("skin_effect",)]


def test_the_channel_is_asked_for_that_the_stated_causes_need() -> None:
    """Cables that are stated, one of them improbable, beside a skew that may be there too: that needs D0 alone."""
    cables = [rival("cable_resistance_input", 0.04, 0.94), rival("cable_resistance_output", 0.0092, 0.02)]
    skewed = replace(cables[0], effects=("cable_resistance_input", "gate_delay_skew"), probability=0.04)
    skew = CATALOGUE["gate_delay_skew"].headline
    skewed = replace(skewed, model=skewed.model.with_effect("gate_delay_skew", **{skew.name: 20e-9}))
    told = []
    for stated in (False, True):
        rivals = [*(replace(cable, stated=stated) for cable in cables), skewed]
        *_, needed = next_measurements(observe(efficiency_alone(), prototype()), rivals)
        told.append(needed.separates)
    assert told == [("gate_delay_skew",), ("cable_resistance_input", "cable_resistance_output")]


def test_points_are_proposed_up_to_what_a_diagnosis_takes() -> None:
    observations = observe(efficiency_alone(), prototype())
    points = bench_options(observations, [Model.baseline()], observations.channels).points
    power_W = np.asarray(points.power_W)
    share = [can_run(Model.baseline(), replace(points, power_W=spare * power_W)) for spare in (1.03, 1.08)]
    assert np.all(share[0])  # efficiency alone is read to 3 % from the limit
    assert np.count_nonzero(~share[1]) > 5  # of 25 pairs of D1 and D2: those that do not carry all


def test_an_output_voltage_that_nobody_read_is_held_where_it_was_when_measured() -> None:
    """In front of the output cable, in what is proposed as in what was measured."""
    observations = observe(efficiency_alone(), prototype())
    model = rival("cable_resistance_output", 0.1).model
    assert np.all(observations.points.held)
    measured = observations.points.take(np.argsort(observations.points.power_W)[[2, 8, 14]])
    again = Allowed(set_points=np.stack([measured.D1, measured.D2, measured.power_W], axis=1), by_hand=False)
    options = bench_options(observations, [model], observations.channels, again)
    place = [c.column for c in observations.channels].index("P1_W")
    # W: where two solutions from different starts end; with V2 behind the cable they are 0.05 to 0.2 W apart
    np.testing.assert_allclose(options.readings[0, -3:, place], simulate(model, measured)["P1_W"], atol=1e-4)


def test_points_are_proposed_for_the_room_that_was_measured_in(observations: Observations) -> None:
    warm = replace(observations, points=replace(observations.points, ambient_C=31.0))
    options = bench_options(warm, [Model.baseline()], warm.channels, Allowed(by_hand=False))
    assert np.unique(options.points.ambient_C) == [31.0]


@pytest.mark.parametrize(("own_s", "proposed"), [(400e-9, "200"), (100e-9, "50"), (0.0, None), (4e-6, None)])
def test_more_dead_time_goes_by_the_converters_own_and_stays_allowed(
    own_s: float, proposed: str | None
) -> None:
    converter = replace(prototype(), dead_time_s=own_s)
    observations = observe(efficiency_alone(), converter)
    options = bench_options(observations, [Model(converter=converter)], observations.channels)
    said = [o.action for o in options.what if "dead time" in o.action]
    assert [s.split()[1] for s in said] == ([] if proposed is None else [proposed])
    assert len(options.what) == options.readings.shape[1] == len(options.sigma)


def test_more_dead_time_is_more_of_each_explanations_own() -> None:
    longer, *_ = _rebuilds(prototype()).values()
    own = replace(prototype(), dead_time_s=424e-9)  # a part off by its spread
    assert longer(Model(converter=own)).converter.dead_time_s == pytest.approx(624e-9, rel=1e-12)  # rounding


def efficiency_alone() -> pd.DataFrame:
    return simulated_campaign(Model.baseline(), seed=1, count=20)[POWERS]


def test_one_explanation_needs_no_further_measurement(observations: Observations) -> None:
    assert next_measurements(observations, [rival("link_resistance", 0.1, 0.96)]) == []
