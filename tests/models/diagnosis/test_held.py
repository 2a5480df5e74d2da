"""Stretches of a stuck sensor are found, thermometers of whole kelvins and readings of one set point are not."""

import numpy as np
import pandas as pd
import pytest

from models.diagnosis.held import held
from models.diagnosis.observations import observe
from sim.prototype import prototype

RNG = np.random.default_rng(11)
EXPECTED_C = RNG.uniform(30.0, 60.0, 60)  # heatsink, at loads in random order
WHOLE_KELVINS = np.round(EXPECTED_C)


def stuck_rows(heatsink_C: np.ndarray, expected_C: np.ndarray = EXPECTED_C) -> list[int]:
    frame = pd.DataFrame(
        {"D1": 0.9, "D2": 0.1, "P2_W": 1000.0, "P1_W": 1020.0, "kind": "load"}, index=range(60)
    )
    observations = observe(frame.assign(T_heatsink_C=heatsink_C, time_s=60.0 * np.arange(60)), prototype())
    thermometer = observations.of("T_heatsink_C")
    expected = np.where(thermometer, expected_C[observations.row], 1020.0)
    stuck, _ = held(observations, expected, range(1, 61))
    return observations.row[stuck].tolist()


def test_a_stretch_of_one_value_is_stuck() -> None:
    readings = WHOLE_KELVINS.copy()
    readings[25:40] = 47.0
    assert stuck_rows(readings) == list(range(25, 40))


def test_whole_kelvins_are_not() -> None:
    assert stuck_rows(WHOLE_KELVINS) == []


def test_a_slow_rise_read_in_whole_kelvins_is_not() -> None:
    rise_C = np.linspace(30.0, 36.0, 60)  # a sweep sorted by power: ten rows a kelvin
    assert stuck_rows(np.round(rise_C), rise_C) == []


@pytest.mark.parametrize("length", [10, 30])
def test_one_set_point_read_again_is_not(length: int) -> None:
    readings, expected_C = WHOLE_KELVINS.copy(), EXPECTED_C.copy()
    readings[:length], expected_C[:length] = 47.0, 47.0
    assert stuck_rows(readings, expected_C) == []
