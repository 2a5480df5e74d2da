"""From a fit to calibrated physics: the edge tells the inductance, and a drift's own course is followed."""

from dataclasses import replace

import numpy as np
import pandas as pd

from drivers.mocks.lab.laboratory import Laboratory
from drivers.mocks.lab.survey import noise_free_efficiency, schedule, survey
from models.dataset import load_measurements
from models.diagnosis.diagnose import diagnose
from sim.effects.catalogue import effect
from sim.model import Model
from sim.simulate import Points, simulate
from tests.models.diagnosis.virtual_campaign import COLUMNS, set_points, simulated_campaign


def test_rows_near_the_edge_tell_the_inductance_from_efficiency_alone() -> None:
    converter = Model.baseline().converter
    inductance_H = 1.006 * converter.inductor.inductance_H
    truth = Model(
        converter=replace(converter, inductor=replace(converter.inductor, inductance_H=inductance_H))
    )
    table = simulated_campaign(truth, seed=11, count=60)
    table = table[["D1", "D2", "P2_W", "P1_W", "efficiency", "kind", "time_s"]]
    found = diagnose(load_measurements(table))
    # some are too near the edge for the diagnosis
    assert {row["column"] for row in found.rejected} == {"P1_W", "P2_W"}
    known_H = found.calibrated.model.converter.inductor.inductance_H
    # its everyday spread is 1 %, what the edge is held to be known to 0.2 %
    assert abs(known_H / inductance_H - 1) < 2e-3


def test_a_drift_is_followed_to_its_end() -> None:
    """Losses that saturate with the lab's own time constant, which none of the catalogue's is."""
    lab = Laboratory.draw(seed=150_004, hidden={"warm_up_drift": 0.11})
    plan = schedule(*set_points(60, seed=12))
    found = diagnose(load_measurements(survey(lab, plan, seed=1)))
    assert found.verdict.stated == ("warm_up_drift",)
    D1, D2, power_W = set_points(60, seed=13)
    now = noise_free_efficiency(lab, D1, D2, power_W, time_s=float(plan.time_s[-1]))
    bias = np.nanmean(found.calibrated.predict(D1, D2, power_W) - now)
    # a straight line through a saturating course ends 0.1 points below it; what is left is the last rows' noise
    assert abs(bias) < 3e-4


def test_the_time_constant_of_a_drift_is_found() -> None:
    """It comes to its end long before the campaign does, where a straight line would have risen all the time."""
    truth = Model.baseline().with_effect("warm_up_drift", relative_loss_at_end=0.15, time_constant_s=18e3)
    table = simulated_campaign(truth, seed=4, count=60, every_s=1200.0)
    found = diagnose(load_measurements(table))
    assert found.verdict.stated == ("warm_up_drift",)
    assert found.leading.term("warm_up_drift").signature.other == {"time_constant_s": 18e3}
    # without noise, and parts hardly follow the time; a straight line reads it two fifths too large
    assert abs(found.leading.term("warm_up_drift").value / 0.15 - 1) < 0.01


def test_an_everyday_creep_is_followed_though_it_is_no_cause() -> None:
    end = 1.5 * effect("warm_up_drift").headline.tolerance
    truth = Model.baseline().with_effect("warm_up_drift", relative_loss_at_end=end)
    found = diagnose(load_measurements(simulated_campaign(truth, seed=4, count=40)))
    assert found.verdict.kind == "consistent"
    D1, D2, power_W = set_points(80, seed=5)  # not the points that were fitted
    now = Points(D1=D1, D2=D2, power_W=power_W, time_s=found.calibrated.time_s)
    baseline, wanted = (simulate(m, now)["efficiency"] for m in (Model.baseline(), truth))
    before, after = (
        np.nanmean(np.abs(said - wanted)) for said in (baseline, found.calibrated.predict(D1, D2, power_W))
    )
    # without noise; a model that knew no time would stand at the middle of the campaign, a half off
    assert after < 0.2 * before


def test_what_a_fit_leaves_is_smooth_over_half_of_the_map() -> None:
    table = simulated_campaign(Model.baseline(), seed=4, count=40)
    leftover = diagnose(load_measurements(table)).calibrated.leftover
    loads = table[table["kind"].isin(["load", "reference"])]
    ranges = np.ptp(loads[["D1", "D2", "P2_W"]].to_numpy(), axis=0)
    # D1, D2, and two thirds of the power; rows too near the edge take no part in the lengths
    np.testing.assert_allclose(leftover.length[:3], [0.5, 0.5, 2 / 3] * ranges, rtol=0.1)


def test_what_ran_near_the_most_is_carried() -> None:
    """A choke that drops a little carries more than a model whose choke does not."""
    converter = Model.baseline().converter
    inductor = replace(converter.inductor, inductance_H=1.06 * converter.inductor.inductance_H)
    truth = Model(converter=replace(converter, inductor=inductor))
    truth = truth.with_effect("inductor_saturation", relative_drop=0.02)
    power = np.arange(1950.0, 2150.0, 0.5)
    most_W = power[simulate(truth, Points(D1=1.0, D2=0.0, power_W=power)).feasible].max()
    table = simulated_campaign(truth, seed=4, count=40)
    last = Points(D1=1.0, D2=0.0, power_W=most_W, time_s=table["time_s"].max() + 180.0)
    shown = simulate(truth, last)
    row = table.tail(1).assign(**{name: shown[name] for name in COLUMNS}, D1=1.0, D2=0.0, time_s=last.time_s)
    before, after = (
        diagnose(load_measurements(each)).calibrated for each in (table, pd.concat([table, row]))
    )
    assert np.isnan(before.vouched().predict(1.0, 0.0, most_W))
    assert before.worth_a_try(np.array([most_W])).tolist() == [[1.0, 0.0, most_W]]
    # D0 goes there by the root of the power that is left to the most: a thousandth of that is 3 % of D0's range,
    # and some watts of reactive current
    assert abs(float(after.vouched().predict(1.0, 0.0, most_W)) / shown["efficiency"][0] - 1) < 3e-3
    # no more is vouched for than what was seen, but for steps of 2e-4
    assert np.isnan(after.vouched().predict(1.0, 0.0, most_W * 1.0005))
    assert after.worth_a_try(np.array([most_W])).size == 0


def test_what_ran_is_known_by_the_power_that_was_set() -> None:
    """A meter that reads a thousandth less shows no smaller most, where the table says what was set."""
    truth, power = Model.baseline(), np.arange(2100.0, 2250.0, 0.5)
    most_W = float(power[simulate(truth, Points(D1=1.0, D2=0.0, power_W=power)).feasible].max())
    table = simulated_campaign(truth, seed=4, count=40)
    last = Points(D1=1.0, D2=0.0, power_W=most_W, time_s=table["time_s"].max() + 180.0)
    shown = simulate(truth, last)
    row = table.tail(1).assign(**{name: shown[name] for name in COLUMNS}, D1=1.0, D2=0.0, time_s=last.time_s)
    read = pd.concat([table, row.assign(P1_W=0.999 * row["P1_W"], P2_W=0.999 * row["P2_W"])])
    noted = read.assign(P_set_W=[*table["P2_W"], most_W])
    by_reading, by_setting = (
        diagnose(load_measurements(each)).calibrated.vouched().predict(1.0, 0.0, most_W)
        for each in (read, noted)
    )
    assert np.isnan(by_reading)
    assert np.isfinite(by_setting)
