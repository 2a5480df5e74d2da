"""Tables of another laboratory with nothing wrong in them: made by the simulator, with instruments of their own."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from drivers.mocks.lab.laboratory import AMBIENT_C, Laboratory
from drivers.mocks.lab.survey import schedule, survey
from models.dataset import load_measurements
from models.diagnosis import conditions
from models.diagnosis.diagnose import diagnose
from sim.model import Model
from tests.models.diagnosis.virtual_campaign import set_points, simulated_campaign


def read(frame: pd.DataFrame, seed: int) -> pd.DataFrame:
    """What an analyzer with a noise of 0.012 % shows of both powers."""
    rng = np.random.default_rng(seed)
    noisy = {name: frame[name] * (1 + 1.2e-4 * rng.standard_normal(len(frame))) for name in ("P1_W", "P2_W")}
    return frame.assign(**noisy).drop(columns="efficiency")


def test_standby_that_scatters_is_not_something_over_time() -> None:
    loaded = read(simulated_campaign(Model.baseline(), seed=132, count=40), seed=132)
    standby = pd.DataFrame({"kind": ["standby"] * 6, "time_s": np.linspace(10.0, 9000.0, 6)})
    scatter_W = 0.12 * np.random.default_rng(133).standard_normal(6)  # of a range of 1500 W
    table = pd.concat([loaded, standby.assign(P1_W=scatter_W)], ignore_index=True)
    found = diagnose(load_measurements(table))
    assert found.verdict.kind == "consistent"
    assert not [row for row in found.rejected if row["row"] > len(loaded)]  # each counts


def test_a_sensor_that_stuck_on_the_way_tells_nothing_from_then_on() -> None:
    frame = read(simulated_campaign(Model.baseline(), seed=134, count=40), seed=134)
    order = np.random.default_rng(135).permutation(len(frame))
    frame = frame.iloc[order].reset_index(drop=True).assign(time_s=180.0 * np.arange(len(frame)))
    half = len(frame) // 2
    frame["T_heatsink_C"] = frame["T_heatsink_C"].round(1)
    frame.loc[half:, "T_heatsink_C"] = frame["T_heatsink_C"].max()
    found = diagnose(load_measurements(frame))
    assert found.verdict.kind == "consistent"
    (left_out,) = found.rejected_columns
    assert left_out.column == "T_heatsink_C"
    assert f"from row {half + 1} to row {len(frame)}" in left_out.reason


WARM_C = 37.0


def elsewhere(
    V1_V: float, ambient_C: float, *, seed: int = 140, hidden: dict[str, float | None] | None = None
) -> pd.DataFrame:
    """A bench, healthy by default, whose supply and room are not nominal, with both of them read."""
    lab = Laboratory.draw(seed=seed, hidden=hidden)
    lab = replace(lab, quirks=replace(lab.quirks, warmer_K=ambient_C - AMBIENT_C))
    plan = replace(schedule(*set_points(60, seed=seed)), supply_V=V1_V)
    return survey(lab, plan, seed=seed)


def test_a_room_that_was_not_always_read_is_no_drift() -> None:
    frame = elsewhere(300.0, WARM_C)
    gaps = np.random.default_rng(141).random(len(frame)) < 0.15
    found = diagnose(load_measurements(frame.assign(T_ambient_C=frame["T_ambient_C"].mask(gaps))))
    assert found.verdict.kind == "consistent"


@pytest.mark.parametrize(
    ("V1_V", "seed", "hidden"), [(310.0, 1, {}), (295.0, 12, {"magnetizing_inductance": 0.004})]
)
def test_a_supply_that_nobody_read_is_simulated_where_it_was(
    V1_V: float, seed: int, hidden: dict[str, float | None]
) -> None:
    """Over so many volts readings are no straight lines."""
    frame = elsewhere(V1_V, 25.0, seed=seed, hidden=hidden)
    found = diagnose(load_measurements(frame.drop(columns=["V1_V", "I1_A"])))
    assert found.verdict.stated == tuple(hidden)
    assert found.verdict.kind == ("named" if hidden else "consistent")
    (supply,) = found.conditions
    assert supply.value == pytest.approx(frame["V1_V"].median(), abs=0.5)  # V, of 5 and 10 that it is off


def test_a_supply_that_nobody_read_may_be_a_per_cent_off(monkeypatch: pytest.MonkeyPatch) -> None:
    frame = elsewhere(304.0, 25.0)
    found = diagnose(load_measurements(frame.drop(columns=["V1_V", "I1_A"])))
    assert found.verdict.kind == "consistent"
    (supply,) = found.conditions
    assert supply.ci95 is not None
    assert (supply.column, supply.taken) == ("V1_V", 300.0)
    assert supply.ci95[0] < frame["V1_V"].median() < supply.ci95[1]
    assert supply.ci95[1] - supply.ci95[0] < 2.0  # of 18 V beforehand
    monkeypatch.setattr(conditions, "allowed_for", lambda *_: (240.0, 301.0))  # none has what readings fit
    (none,) = conditions.unread_conditions(found.refinery, found.leading)
    assert (none.column, none.taken, none.value, none.ci95) == ("V1_V", 300.0, None, None)


def test_a_room_that_nobody_read_may_be_a_warm_one() -> None:
    found = diagnose(load_measurements(elsewhere(300.0, WARM_C).drop(columns="T_ambient_C")))
    assert found.verdict.kind == "consistent"
    (room,) = found.conditions
    assert room.ci95 is not None
    assert (room.column, room.taken) == ("T_ambient_C", 25.0)
    assert room.ci95[0] < WARM_C < room.ci95[1]
    assert room.ci95[1] - room.ci95[0] < 6.0  # of 20 K beforehand


def test_what_nobody_read_is_taken_as_nominal_where_readings_agree() -> None:
    found = diagnose(load_measurements(elsewhere(300.0, 25.0).drop(columns=["V1_V", "I1_A", "T_ambient_C"])))
    assert [(c.column, c.taken, c.value) for c in found.conditions] == [
        ("V1_V", 300.0, None),
        ("T_ambient_C", 25.0, None),
    ]
