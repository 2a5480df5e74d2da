"""What changes on the way and is no cause is not told as one: a sensor, a condition, what no catalogue has."""

import numpy as np
import pandas as pd
import pytest

from experiments.onset_trials import happened
from models.diagnosis.change import Change
from models.diagnosis.diagnose import Diagnosis
from models.diagnosis.sensors import SensorError
from tests.models.diagnosis.virtual_campaign import lab_table, onset_of, seen

SEED = 171
OF_A_PER_CENT = 0.25  # a sensor's gain is known to its specification, 0.17 % of reading


def lab(**hidden: float) -> pd.DataFrame:
    return lab_table(hidden, seed=SEED)


def change_of(found: Diagnosis) -> Change:
    onset = onset_of(found)
    assert onset.change is not None
    assert found.as_plain(ahead=False)["unknown"]["onset"]["effect"] is None
    return onset.change


@pytest.mark.parametrize("column", ["I_L_rms_A", "V2_V"])
def test_a_sensor_that_reads_high_from_some_row_on_is_told_as_one(column: str) -> None:
    whole = lab()
    frame, at_s = happened(whole, whole.assign(**{column: 1.02 * whole[column]}), 0.5)
    found = seen(frame)
    onset, sensor = onset_of(found), change_of(found).sensor
    assert sensor is not None
    assert (sensor.column, sensor.kind) == (column, "gain")
    high = (
        sensor.value if onset.sets_in else -sensor.value
    )  # or low before: which of both is right nobody knows
    assert 100 * high == pytest.approx(2.0, abs=OF_A_PER_CENT)
    assert onset.after_s == at_s


def test_a_supply_that_was_set_anew_is_no_cause_where_nobody_read_it() -> None:
    frame, _ = happened(lab(), lab_table({}, seed=SEED, supply_V=294.0), 0.5)
    found = seen(frame.drop(columns=["V1_V", "I1_A"]))
    assert found.verdict.kind == "unknown"
    assert found.unexplained is not None
    assert found.unexplained.onset is None or found.unexplained.onset.change is not None


def test_a_supply_that_was_set_anew_reads_high_where_it_was_noted_before() -> None:
    whole = lab()
    frame, at_s = happened(whole, lab_table({}, seed=SEED, supply_V=294.0), 0.5)
    found = seen(frame.assign(V1_V=whole["V1_V"].median()).drop(columns="I1_A"))
    sensor = change_of(found).sensor
    assert sensor is not None
    assert (sensor.column, onset_of(found).sets_in, onset_of(found).after_s) == ("V1_V", True, at_s)
    assert 100 * sensor.value == pytest.approx(2.0, abs=OF_A_PER_CENT)


@pytest.mark.parametrize(("foreign", "size"), [("output_capacitor_esr", 0.1), ("edge_ringing", 1.8e-9)])
def test_what_no_catalogue_has_sets_in_without_a_name(foreign: str, size: float) -> None:
    frame, _ = happened(lab(), lab(**{foreign: size}), 0.5)
    assert change_of(seen(frame)).sensor is None


def test_a_change_of_a_sensor_is_read_back() -> None:
    columns = np.array([[0.0, 0.0, 2.0, 4.0]])
    error = SensorError(column="D0", kind="offset", value=0.1, unit="Th")
    change = Change(place="offset of D0", columns=columns, sensor=error).read(0.5 * columns[0])
    assert change.sensor is not None
    assert change.sensor.value == pytest.approx(0.05, rel=1e-12)  # rounding
    strange = Change(place="output", columns=columns)
    assert strange.read(columns[0]) is strange
