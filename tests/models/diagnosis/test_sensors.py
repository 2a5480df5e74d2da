"""A sensor that is off is told as such: which, and how far; a cause beside it keeps its name."""

import numpy as np
import pandas as pd
import pytest

from models.diagnosis.diagnose import Diagnosis
from models.diagnosis.sensors import SensorError, sensor_error, sensor_steps
from sim.model import Model
from tests.models.diagnosis.virtual_campaign import lab_table, seen, simulated_campaign

SEED = 160


def lab(**hidden: float) -> pd.DataFrame:
    return lab_table(hidden, seed=SEED)


def sensor_of(found: Diagnosis) -> SensorError:
    assert found.unexplained is not None
    assert found.unexplained.sensor is not None
    return found.unexplained.sensor


@pytest.mark.parametrize("ratio", [1.03, 2.0**0.5])
def test_a_probe_on_another_ratio_is_no_loss_and_no_timing(ratio: float) -> None:
    frame = lab()
    found = seen(frame.assign(I_L_rms_A=ratio * frame["I_L_rms_A"]))
    assert (found.verdict.kind, found.verdict.stated) == ("unknown", ())
    sensor = sensor_of(found)
    assert (sensor.column, sensor.kind, sensor.unit) == ("I_L_rms_A", "gain", "1")
    assert sensor.value == pytest.approx(
        ratio - 1.0, abs=0.005
    )  # of which 0.3 % is what a sound one may have


def test_what_an_element_has_to_be_off_by_where_nothing_else_is_wrong_is_told() -> None:
    frame = lab()
    found = seen(frame.assign(P_link1_W=1.01 * frame["P_link1_W"]))
    assert found.verdict.kind == "consistent"
    assert set(found.parts) == {"P_link1_W gain"}


def test_a_thermometer_that_reads_high_heats_nothing() -> None:
    frame = lab()
    sensor = sensor_of(seen(frame.assign(T_heatsink_C=frame["T_heatsink_C"] + 6.0)))
    assert (sensor.column, sensor.kind, sensor.unit) == ("T_heatsink_C", "offset", "degC")
    assert sensor.value == pytest.approx(6.0, abs=1.5)  # three sigmas of what a sound one may be off by


def test_a_cause_beside_a_sensor_that_is_off_is_named() -> None:
    frame = lab(link_resistance=0.08)
    found = seen(frame.assign(T_heatsink_C=frame["T_heatsink_C"] + 6.0))
    assert found.verdict.named == ("link_resistance",)
    assert found.verdict.unknown_probability > 0.95
    assert sensor_of(found).column == "T_heatsink_C"
    assert not found.parts  # a thermometer's own spread is not asked to do it


@pytest.mark.parametrize(
    ("column", "gain", "offset"), [("V1_V", 1.01, 0.0), ("V2_V", 0.99, 0.0), ("T_ambient_C", 1.0, 8.0)]
)
def test_a_condition_that_is_read_wrong_is_told(column: str, gain: float, offset: float) -> None:
    frame = lab()
    sensor = sensor_of(seen(frame.assign(**{column: gain * frame[column] + offset})))
    assert (sensor.column, sensor.kind) == (column, "offset" if offset else "gain")
    assert sensor.value == pytest.approx(
        offset or gain - 1.0, rel=0.25
    )  # the lab's own instruments are off, too


def test_what_is_read_back_of_a_sensor_is_what_it_is_off_by() -> None:
    found = seen(simulated_campaign(Model.baseline(), seed=1, count=20).assign(V1_V=300.0, V2_V=140.0))
    steps = list(sensor_steps(found.observations, found.refinery.known))
    channels = {c.column for c in found.observations.channels} - {"P1_W", "D0"}
    assert {step.error.column for step in steps} == channels | {"V1_V", "V2_V"}  # the room was not read
    for step in steps:
        off = sensor_error(steps, step.place, -2.0 * step.direction)
        assert off is not None
        assert off.value == pytest.approx(-2.0 * step.error.value, rel=1e-12)  # rounding
    assert sensor_error(steps, "input", np.zeros(found.residual.size)) is None
