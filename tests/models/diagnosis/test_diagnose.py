"""The diagnosis as a whole: what it refuses, and what it says."""

import json

import numpy as np
import pandas as pd
import pytest

from models.dataset import load_measurements
from models.diagnosis.diagnose import Diagnosis, diagnose
from models.diagnosis.observations import observe
from models.diagnosis.usable import LEAST_ROWS, LEAST_SET_POINTS, TooFewPoints, usable_readings
from sim.effects.catalogue import CATALOGUE
from sim.model import Model
from sim.operating_points import Points
from sim.parameters import ParameterError
from sim.prototype import prototype
from sim.simulate import can_run
from tests.models.diagnosis.virtual_campaign import lab_campaign, simulated_campaign

RESISTANCE_Ohm = 0.1
EFFICIENCY_ONLY = ["D1", "D2", "P2_W", "efficiency"]


@pytest.fixture(scope="module")
def named() -> Diagnosis:
    """The diagnosis of a noise-free campaign of the simulator with one effect."""
    model = Model.baseline().with_effect("link_resistance", resistance_Ohm=RESISTANCE_Ohm)
    return diagnose(load_measurements(simulated_campaign(model, seed=2, count=40)))


@pytest.fixture(scope="module")
def efficiency_only() -> Diagnosis:
    """The diagnosis of a table with nothing but set points and efficiency."""
    measured = lab_campaign({"link_resistance": 0.12}, seed=3, count=40)
    return diagnose(load_measurements(measured.loaded()[EFFICIENCY_ONLY]))


# --- what it refuses ----------------------------------------------------------------------------------


def test_too_few_rows_are_refused_with_the_number_needed() -> None:
    frame = simulated_campaign(Model.baseline(), seed=2, count=LEAST_ROWS - 4)
    with pytest.raises(TooFewPoints, match=f"at least {LEAST_ROWS}"):
        diagnose(load_measurements(frame.head(LEAST_ROWS - 1)))


@pytest.mark.parametrize(
    ("rows", "said"), [(1, "1 usable row that carries power;"), (2, "2 usable rows that carry power;")]
)
def test_one_row_is_one(rows: int, said: str) -> None:
    table = load_measurements(simulated_campaign(Model.baseline(), seed=2, count=LEAST_ROWS).head(rows))
    with pytest.raises(TooFewPoints, match=f"^{said}"):
        diagnose(table)


def test_rows_near_the_limit_of_the_right_converter_do_not_accuse_its_model_file(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("models.diagnosis.near_limit._SPARE", 0.3)
    frame = simulated_campaign(Model.baseline(), seed=2, count=40).drop_duplicates(subset=["D1", "D2"])
    spare = can_run(Model.baseline(), Points(D1=frame["D1"], D2=frame["D2"], power_W=1.3 * frame["P2_W"]))
    few = pd.concat([frame[spare].head(LEAST_ROWS - 1), frame[~spare].head(4)])
    with pytest.raises(TooFewPoints, match=r"11 of 15 loaded rows .* further from the most"):
        diagnose(load_measurements(few))


def test_a_row_without_a_power_is_listed_as_one_in_json() -> None:
    frame = simulated_campaign(Model.baseline(), seed=2, count=40)
    stuck = {
        "kind": "no_load",
        "D1": 0.995,
        "D2": 0.0,
        "P1_W": 12.0,
        "time_s": 1e5,
    }  # a pulse inside the dead time
    answer = diagnose(load_measurements(pd.concat([frame, pd.DataFrame([stuck])]))).as_plain()
    values = {row["row"]: row["value"] for row in answer["rejected_rows"]}
    assert values[len(frame) + 1] is None
    json.dumps(answer, allow_nan=False)


def test_a_table_in_which_no_effect_shows_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("models.diagnosis.signatures._imitates", lambda signature, others: True)
    with pytest.raises(ParameterError, match="none of the effects that are left would show"):
        diagnose(load_measurements(simulated_campaign(Model.baseline(), seed=2, count=40)))


def test_a_refused_heatsink_does_not_tell_when_the_fan_runs() -> None:
    frame = simulated_campaign(Model.baseline(), seed=2, count=40)[
        ["kind", "time_s", "D1", "D2", "P1_W", "P2_W"]
    ]
    stuck = observe(load_measurements(frame.assign(T_heatsink_C=45.0)).frame, prototype())
    usable = usable_readings(stuck, Model.baseline(), frozenset(), range(1, len(stuck.frame) + 1))
    assert [c.column for c in usable.rejected_columns] == ["T_heatsink_C"]
    assert np.all(np.isnan(usable.observations.points.seen_heatsink_C))


def test_replicates_of_few_set_points_are_refused() -> None:
    frame = simulated_campaign(Model.baseline(), seed=2, count=40)
    for different, refused in ((LEAST_SET_POINTS - 1, True), (LEAST_SET_POINTS, False)):
        one = frame.drop_duplicates(["D1", "D2"]).head(different)
        wandering = pd.concat([one.assign(P2_W=one["P2_W"] + 0.1 * k, time_s=600.0 * k) for k in range(4)])
        table = load_measurements(wandering.drop(columns="efficiency").reset_index(drop=True))
        if refused:
            with pytest.raises(TooFewPoints, match="5 different set points; a diagnosis needs at least 6"):
                diagnose(table)
        else:
            diagnose(table)


def test_an_unknown_effect_to_leave_out_is_refused_with_the_nearest() -> None:
    frame = simulated_campaign(Model.baseline(), seed=2, count=20)
    with pytest.raises(ParameterError, match="did you mean 'skin_effect'"):
        diagnose(load_measurements(frame), without=["skin_efect"])


def test_a_catalogue_that_is_left_out_altogether_is_refused() -> None:
    frame = simulated_campaign(Model.baseline(), seed=2, count=20)
    with pytest.raises(ParameterError, match="one at least has to stay"):
        diagnose(load_measurements(frame), without=CATALOGUE)


# --- what it says -------------------------------------------------------------------------------------


def test_the_simulators_own_effect_comes_back_exactly(named: Diagnosis) -> None:
    assert named.verdict.kind == "named"
    (name,) = named.verdict.stated
    assert name == "link_resistance"
    # the prior pulls towards 0, and the spreads of winding and switches share what looks alike
    term = named.verdict.causes[0].term
    assert term.value == pytest.approx(RESISTANCE_Ohm, abs=2 * term.sigma)


def test_the_answer_has_every_key(named: Diagnosis) -> None:
    answer = named.as_plain("model.toml")
    assert {
        "schema", "verdict", "points", "channels", "gap", "causes", "groups", "unknown", "next", "gain",
        "model", "noise", "rejected_rows",
    } <= set(answer)  # fmt: skip
    assert set(answer["gap"]) == {"mean_abs_efficiency", "mean_loss_W", "worst"}
    assert {"probability", "formula", "rows", "strained"} == set(answer["unknown"])
    assert {"blocks", "before", "after", "ci95", "wrong_cause", "leftover_only"} <= set(answer["gain"])
    assert (answer["schema"], answer["model"]) == (1, "model.toml")


def test_every_cause_has_every_key(named: Diagnosis) -> None:
    cause = named.as_plain()["causes"][0]
    assert set(cause) == {
        "effect", "probability", "share_of_gap", "added_W", "parameters", "tied_with", "says", "check",
    }  # fmt: skip
    assert set(cause["added_W"]) == {"mean", "lowest", "highest"}
    (parameter,) = cause["parameters"]
    assert {"name", "value", "ci95", "off"} <= set(parameter)
    low, high = parameter["ci95"]
    assert low < parameter["value"] < high


def test_the_answer_survives_json(named: Diagnosis) -> None:
    answer = named.as_plain("model.toml")
    assert json.loads(json.dumps(answer, allow_nan=False)) == answer


def test_the_gap_is_that_of_the_readings_kept(named: Diagnosis) -> None:
    table = named.residual_table().dropna(subset=["residual_P1_W"])
    assert named.gap["mean_loss_W"] == pytest.approx(table["residual_P1_W"].mean(), rel=1e-12)
    assert named.gap["mean_loss_W"] > 0  # a resistance costs power


def test_readings_at_the_edge_of_what_can_be_carried_are_left_out_and_listed(named: Diagnosis) -> None:
    kept = named.observations.row[named.observations.of("efficiency")]
    near = {row["row"] - 1 for row in named.rejected if "within 12 %" in row["reason"]}
    assert near
    assert near.isdisjoint(kept.tolist())
    assert len(near) + len(set(kept.tolist())) == len(named.observations.frame)


def test_every_reading_is_used_or_listed_with_its_column() -> None:
    frame = simulated_campaign(Model.baseline(), seed=2, count=80)
    found = diagnose(load_measurements(frame))
    o = found.observations
    used = {(int(row), o.channels[channel].column) for row, channel in zip(o.row, o.channel, strict=True)}
    whole = {row["row"] - 1 for row in found.rejected if row["column"] == "P2_W"}
    single = {(row["row"] - 1, row["column"]) for row in found.rejected if row["column"] != "P2_W"}
    assert single  # D0 jumps at some of 80 points
    assert single.isdisjoint(used)
    given = {(row, c.column) for row in range(len(frame)) if row not in whole for c in o.channels}
    assert used | single == given


def test_efficiency_alone_is_enough_to_run(efficiency_only: Diagnosis) -> None:
    assert [channel.name for channel in efficiency_only.observations.channels] == ["efficiency"]
    json.dumps(efficiency_only.as_plain(), allow_nan=False)


def test_efficiency_alone_leaves_the_cause_among_the_first_two(efficiency_only: Diagnosis) -> None:
    # on-resistance and link resistance look alike in efficiency: a cosine of 0.999
    assert "link_resistance" in [cause.effect for cause in efficiency_only.verdict.causes[:2]]


def test_what_is_left_out_of_the_catalogue_cannot_be_a_cause() -> None:
    model = Model.baseline().with_effect("auxiliary_power", power_W=8.0)
    frame = simulated_campaign(model, seed=2, count=24)[EFFICIENCY_ONLY]
    diagnosis = diagnose(load_measurements(frame), without=["auxiliary_power"])
    assert "auxiliary_power" not in [cause.effect for cause in diagnosis.verdict.causes]


def test_a_fan_goes_by_the_heatsinks_measured_temperature_however_far_the_simulation_is_off() -> None:
    frame = simulated_campaign(Model.baseline(), seed=1, count=48)
    frame["T_heatsink_C"] -= np.linspace(0.0, 8.0, len(frame))  # a room that cools, and nobody notes it
    frame["P1_W"] += 4.0 * (frame["T_heatsink_C"] > 40.0)
    frame["efficiency"] = frame["P2_W"] / frame["P1_W"]
    verdict = diagnose(load_measurements(frame)).verdict
    assert verdict.stated == ("fan_step",)
    assert verdict.causes[0].term.value == pytest.approx(4.0, abs=0.05)  # half the smooth inaccuracy of 0.1 W


def test_a_threshold_does_not_go_by_a_sensor_that_is_stuck() -> None:
    fan = Model.baseline().with_effect("fan_step", power_W=4.0, threshold_C=40.0)
    frame = simulated_campaign(fan, seed=1, count=48).assign(T_heatsink_C=45.0)
    found = diagnose(load_measurements(frame))
    assert [c.column for c in found.rejected_columns] == ["T_heatsink_C"]
    assert found.verdict.stated == ("fan_step",)
