"""Where a leftover may sit, and what its maps can follow."""

import numpy as np
import pandas as pd
import pytest

from models.diagnosis.leftover import Leftovers, leftovers, smooth_maps
from models.diagnosis.observations import Observations, observe
from sim.prototype import prototype
from tests.models.diagnosis.fabricated import loads

Array = np.ndarray
ROWS = 60
_RNG = np.random.default_rng(5)
POWER_W, HEATSINK_C = np.linspace(200.0, 1800.0, ROWS), _RNG.uniform(30.0, 75.0, ROWS)
CURRENT_A = POWER_W / 200.0


def _bench() -> Observations:
    """Rows whose heatsink has a temperature of its own, whatever their power."""
    frame = pd.DataFrame({"D1": 0.9, "D2": 0.1, "P2_W": POWER_W, "kind": "load", "P1_W": POWER_W / 0.98})
    return observe(
        frame.assign(
            efficiency=0.98, time_s=60.0 * np.arange(ROWS), D0=POWER_W / 1e4, I_L_rms_A=CURRENT_A,
            T_heatsink_C=HEATSINK_C,
        ),
        prototype(),
    )  # fmt: skip


def _missed(rivals: Leftovers, location: str, wanted: Array) -> float:
    """The share of readings (M,) that the columns of a place cannot follow."""
    columns = rivals.basis[next(c for c in rivals.configurations if c.location == location).columns]
    factors = np.linalg.lstsq(columns.T, wanted, rcond=1e-6)[0]
    return float(np.linalg.norm(wanted - columns.T @ factors) / np.linalg.norm(wanted))


def test_a_leftover_sits_only_where_a_channel_shows_it() -> None:
    observations = loads(np.linspace(300.0, 1500.0, ROWS))
    places = {c.location for c in leftovers(observations, np.ones(ROWS)).configurations}
    # with the input power alone the others are the same, or nothing
    assert places == {"input", "input, straight", "over time", "gain over time"}


def test_a_contact_that_worsens_steeply_with_temperature_is_followed() -> None:
    observations = _bench()
    rivals = leftovers(observations, np.ones(observations.value.size))
    watts = CURRENT_A**2 * np.exp(HEATSINK_C / 14.0)
    wanted = np.where(observations.of("efficiency"), watts[observations.row], 0.0)
    assert _missed(rivals, "input, by temperature", wanted) < 0.05  # of a smooth kernel 2 % is left out
    assert _missed(rivals, "input, by power", wanted) > 0.2


def test_what_a_controller_does_in_a_narrow_band_of_power_is_followed() -> None:
    observations = _bench()
    rivals = leftovers(observations, np.ones(observations.value.size))
    watts = np.exp(-0.5 * ((POWER_W - 700.0) / 120.0) ** 2)
    wanted = np.where(observations.of("efficiency"), watts[observations.row], 0.0)
    assert _missed(rivals, "input, by power", wanted) < 0.05
    assert _missed(rivals, "input, straight", wanted) > 0.2


def test_a_loss_in_series_moves_the_phase_shift_as_one_at_the_output_does() -> None:
    observations = _bench()
    shift = observations.of("D0")
    rivals = leftovers(observations, np.where(shift, 5e-4, 1.0))
    place = next(c for c in rivals.configurations if c.location == "ac link, in series, by temperature")
    level = rivals.basis[place.columns[0]]
    assert level[shift] == pytest.approx(5e-4 * level[observations.of("efficiency")], rel=1e-12)


def test_what_stands_still_at_one_place_is_a_level_of_few_columns() -> None:
    frame = pd.DataFrame({"D1": 0.9, "D2": 0.1, "P2_W": POWER_W, "kind": "load", "P1_W": POWER_W / 0.98})
    more = {"P_link1_W": POWER_W / 0.985, "T_transformer_C": HEATSINK_C, "T_inductor_C": HEATSINK_C}
    observations = observe(frame.assign(efficiency=0.98, time_s=60.0 * np.arange(ROWS), **more), prototype())
    rivals = leftovers(observations, np.ones(observations.value.size))
    powers = observations.of("efficiency") | observations.of("P_link1_W")
    rings = 2.0 * powers + 5.0 * observations.of("T_transformer_C")
    assert _missed(rivals, "ac link, level", rings) < 1e-12  # rounding
    places = {c.location: c.columns.size for c in rivals.configurations}
    # always, with the bridges on, and under load, in the powers together and in each temperature
    assert places["ac link, level"] == 9 < places["ac link, straight"]
    assert "input, level" not in places


def test_rows_that_share_a_time_still_have_a_gain_that_wanders() -> None:
    """Three repeats a stamp: between most rows no time has passed."""
    frame = pd.DataFrame({"D1": 0.9, "D2": 0.1, "P2_W": POWER_W, "kind": "load", "P1_W": POWER_W / 0.98})
    stamps = 60.0 * (np.arange(ROWS) // 3)
    observations = observe(frame.assign(efficiency=0.98, time_s=stamps), prototype())
    gain = POWER_W * np.sin(stamps / 400.0)
    assert _missed(leftovers(observations, np.ones(ROWS)), "gain over time", gain) < 0.05


def test_leading_maps_hold_nearly_all_of_a_smooth_kernel() -> None:
    place = np.random.default_rng(2).uniform(0.0, 2.0, (ROWS, 3))
    maps = smooth_maps(place)
    assert len(maps) < ROWS
    assert np.mean(np.sum(maps**2, axis=0)) == pytest.approx(1.0, abs=0.02)  # of which 98 % are asked for
