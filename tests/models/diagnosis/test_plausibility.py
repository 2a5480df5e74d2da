"""Columns that are something else than their name says are found, named, and left out."""

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from models.dataset import load_measurements
from models.diagnosis.diagnose import diagnose
from models.diagnosis.near_limit import LEAST_SPARE
from models.diagnosis.observations import observe
from models.diagnosis.plausibility import (
    ImplausibleTable,
    RejectedColumn,
    check_inputs,
    check_set_points,
    implausible,
)
from models.diagnosis.usable import usable_readings
from models.screening import numbers
from sim.model import Model
from sim.prototype import prototype
from sim.simulate import can_run
from tests.models.diagnosis.virtual_campaign import simulated_campaign

BASELINE = Model.baseline()


@pytest.fixture(scope="module")
def frame() -> pd.DataFrame:
    return simulated_campaign(BASELINE, seed=4, count=16)


def rejected(frame: pd.DataFrame) -> list[RejectedColumn]:
    observations = observe(frame, prototype())
    wrong, found = implausible(observations, observations.solved([BASELINE])[0][0])
    assert {observations.channels[k].column for k in observations.channel[wrong]} == {r.column for r in found}
    return found


def test_a_campaign_as_it_should_be_keeps_all_columns(frame: pd.DataFrame) -> None:
    assert rejected(frame) == []


@pytest.mark.parametrize(
    ("column", "change", "said"),
    [
        ("D0", lambda f: 0.05 + 0 * f["D0"], "stuck"),
        ("T_heatsink_C", lambda f: 25.0 + 0 * f["D0"], "stuck"),
        ("I_L_rms_A", lambda f: 1000 * f["I_L_rms_A"], "another unit"),
        ("P_link1_W", lambda f: f["P_link1_W"] / 1000, "another unit"),
        ("T_inductor_C", lambda f: f["T_inductor_C"] + 273.15, "kelvin"),
        ("T_heatsink_C", lambda f: 1.8 * f["T_heatsink_C"] + 32, "degrees Fahrenheit"),
        ("D0", lambda f: f["D0"] + 1 - f["D1"], "S2's edge"),
        ("D0", lambda f: -f["D0"], "give -D0"),
        ("D0", lambda f: math.pi * f["D0"], "in radians"),
        ("D0", lambda f: 0.5 * f["D0"], "in whole periods"),
        ("D0", lambda f: f["D0"] + (1 + f["D2"] - f["D1"]) / 2, "between the pulses' centres"),
        ("D0", lambda f: 180 * f["D0"], "d2ea import --column D0=D0*0.005556 converts"),
        ("D0", lambda f: f["D0"] + 2.0 * (f["D0"] < f["D0"].median()), "half periods from 0 to 2"),
        ("D0", lambda f: 180 * f["D0"] + 360 * (f["D0"] < f["D0"].median()), "degrees from 0 to 360"),
        ("P_link1_W", lambda f: -f["P_link1_W"], "a probe turned round"),
    ],
)
def test_a_column_that_is_something_else_is_left_out(
    frame: pd.DataFrame, column: str, change, said: str
) -> None:
    (found,) = rejected(frame.assign(**{column: change}))
    assert found.column == column
    assert said in found.reason


def test_exchanged_link_powers_are_left_out_together(frame: pd.DataFrame) -> None:
    crossed = frame.rename(columns={"P_link1_W": "P_link2_W", "P_link2_W": "P_link1_W"})
    found = rejected(crossed)
    assert [r.column for r in found] == ["P_link1_W", "P_link2_W"]
    assert "exchanged" in found[0].reason


def test_two_elements_inside_their_specification_are_not_exchanged(frame: pd.DataFrame) -> None:
    low = frame.assign(P_link1_W=0.997 * frame["P_link1_W"] - 3.0, P_link2_W=1.003 * frame["P_link2_W"] + 3.0)
    assert (low["P_link1_W"] < low["P_link2_W"]).mean() > 0.5  # more behind the link than before it
    assert rejected(low) == []
    swapped = low.rename(columns={"P_link1_W": "P_link2_W", "P_link2_W": "P_link1_W"})
    assert [r.column for r in rejected(swapped)] == ["P_link1_W", "P_link2_W"]


def test_a_constant_that_has_to_be_constant_is_kept(frame: pd.DataFrame) -> None:
    one = pd.concat([frame.head(1)] * 8, ignore_index=True)
    assert rejected(one) == []


@pytest.mark.parametrize(("column", "value"), [("P1_W", 2100.0), ("efficiency", 0.97)])
def test_an_efficiency_that_never_changes_is_refused(frame: pd.DataFrame, column: str, value: float) -> None:
    with pytest.raises(ImplausibleTable, match=f"{column}: reads {value:g} in all"):
        check_inputs(observe(frame.assign(**{column: value}), prototype()), prototype())


@pytest.mark.parametrize(("column", "value"), [("V1_V", 0.3), ("V2_V", 0.14)])
def test_voltages_in_kilovolts_are_refused(frame: pd.DataFrame, column: str, value: float) -> None:
    with pytest.raises(ImplausibleTable, match=rf"{column}: median {value}.*another unit"):
        check_inputs(observe(frame.assign(**{column: value}), prototype()), prototype())


def test_exchanged_duty_ratios_are_refused_with_the_hint(frame: pd.DataFrame) -> None:
    exchanged = frame.assign(D1=frame["D2"], D2=frame["D1"])
    with pytest.raises(ImplausibleTable, match="are the columns exchanged"):
        check_set_points(observe(exchanged, prototype()), BASELINE)


@pytest.mark.parametrize(
    ("written", "hint"),
    [
        (
            lambda f: {"D1": 0.5 * f["D1"], "D2": 0.5 * f["D2"]},
            r"both doubled.*--column D1=D1\*2 --column D2=D2\*2",
        ),
        (lambda f: {"D2": 1 - f["D2"]}, "1 - D2 for D2 it could: is it the width"),
        (lambda f: {"D1": 1 - f["D1"]}, "1 - D1 for D1 it could: is it the share without"),
    ],
)
def test_duty_ratios_in_another_convention_are_refused_with_it(
    frame: pd.DataFrame, written: Callable[[pd.DataFrame], dict[str, pd.Series]], hint: str
) -> None:
    """Also where the model could run most of the rows."""
    other, o = observe(frame.assign(**written(frame)), prototype()), observe(frame, prototype())
    with pytest.raises(ImplausibleTable, match=hint):
        check_set_points(other, BASELINE)
    with pytest.raises(ImplausibleTable, match=hint):
        diagnose(load_measurements(frame.assign(**written(frame))))
    check_set_points(o, BASELINE)


def test_what_most_rows_can_run_as_they_are_is_believed(frame: pd.DataFrame) -> None:
    """Where no other convention runs them all: a cause may take power from some."""
    weak = replace(
        BASELINE, converter=replace(prototype(), inductor=replace(prototype().inductor, inductance_H=4e-4))
    )
    o = observe(frame, weak.converter)
    assert 0.5 < np.mean(can_run(weak, o.points.take(np.flatnonzero(o.loaded)))) < 0.9
    check_set_points(o, weak)


def test_the_table_of_another_converter_is_refused(frame: pd.DataFrame) -> None:
    weak = replace(
        BASELINE, converter=replace(prototype(), inductor=replace(prototype().inductor, inductance_H=2e-3))
    )
    with pytest.raises(ImplausibleTable, match="model file that of this converter"):
        check_set_points(observe(frame, weak.converter), weak)


def test_a_room_in_kelvin_is_refused(frame: pd.DataFrame) -> None:
    with pytest.raises(ImplausibleTable, match=r"T_ambient_C: median 298.*kelvin.*T_ambient_C in K"):
        check_inputs(observe(frame.assign(T_ambient_C=298.0), prototype()), prototype())


def test_a_room_in_fahrenheit_without_any_part_beside_it_is_refused(frame: pd.DataFrame) -> None:
    bare = frame[["kind", "D1", "D2", "P2_W", "P1_W", "efficiency"]]
    check_inputs(observe(bare.assign(T_ambient_C=41.0), prototype()), prototype())
    with pytest.raises(ImplausibleTable, match=r"T_ambient_C: median 77.*Fahrenheit.*T_ambient_C in degF"):
        check_inputs(observe(bare.assign(T_ambient_C=77.0), prototype()), prototype())


def test_a_part_that_is_colder_than_its_room_is_refused(frame: pd.DataFrame) -> None:
    room = frame["T_heatsink_C"].median() + 10.0
    with pytest.raises(ImplausibleTable, match=r"T_ambient_C, T_heatsink_C: the part is .* K colder"):
        check_inputs(observe(frame.assign(T_ambient_C=room), prototype()), prototype())


def test_temperatures_and_a_room_in_fahrenheit_are_refused(frame: pd.DataFrame) -> None:
    whole = frame.assign(T_ambient_C=25.0)
    places = [name for name in whole if str(name).startswith("T_")]
    with pytest.raises(ImplausibleTable, match=r"T_ambient_C, T_heatsink_C: a room of 77.*Fahrenheit"):
        rejected(whole.assign(**{name: 1.8 * whole[name] + 32 for name in places}))


def test_a_warm_chamber_is_a_room_like_others(frame: pd.DataFrame) -> None:
    whole = frame.assign(T_ambient_C=25.0)
    places = [name for name in whole if str(name).startswith("T_")]
    assert rejected(whole.assign(**{name: whole[name] + 40.0 for name in places})) == []


def test_a_table_counts_as_one_without_the_column_that_is_refused(frame: pd.DataFrame) -> None:
    """Nearer the limit, too: with efficiency alone rows count up to 3 % from it."""
    alone = frame[["kind", "D1", "D2", "P2_W", "P1_W", "efficiency"]]
    degrees = alone.assign(D0=180 * frame["D0"])
    bare, refused = (
        usable_readings(observe(table, prototype()), BASELINE, frozenset(), range(len(table)))
        for table in (alone, degrees)
    )
    assert [column.column for column in refused.rejected_columns] == ["D0"]
    assert refused.margin == bare.margin == LEAST_SPARE
    assert refused.observations.row.tolist() == bare.observations.row.tolist()
    assert refused.edge.row.tolist() == bare.edge.row.tolist()


def test_kilowatts_of_a_large_converter_are_refused_with_the_option() -> None:
    """Above 10 kW they pass for watts of a small one, and a current in amperes for one of another unit."""
    large = replace(prototype(), rated_power_W=22e3)
    power = np.linspace(12.0, 20.0, 12)
    eta = np.linspace(0.96, 0.97, 12)
    frame = pd.DataFrame(
        {"kind": "load", "D1": 0.8, "D2": 0.1, "P2_W": power, "P1_W": power / eta, "efficiency": eta}
    )
    with pytest.raises(ImplausibleTable, match=r"P2_W: 20 at most.*22000 W.*kilowatts.*P2_W=P2_W\*1000"):
        check_inputs(observe(frame, large), large)
    in_watts = frame.assign(P2_W=1e3 * frame["P2_W"], P1_W=1e3 * frame["P1_W"])
    check_inputs(observe(in_watts, large), large)


def test_a_current_that_disagrees_by_a_thousand_may_be_right_beside_kilowatts() -> None:
    raw = pd.DataFrame({"P2_W": [15.0, 16.0], "P1_W": [15.5, 16.5], "V1_V": 800.0, "I1_A": [19.375, 20.625]})
    (note,) = (note for note in numbers(raw)[1] if note.startswith("I1_A"))
    assert "I1_A=I1_A*0.001" in note
    assert "unless it is P1_W that is in kilowatts: d2ea import --column P1_W=P1_W*1000" in note
