"""One contract for every foreign family: nothing when off, finite, growing with its size, and where it says."""

from functools import cache

import numpy as np
import pandas as pd
import pytest

from drivers.mocks.lab.foreign.base import ForeignEffect
from drivers.mocks.lab.foreign.families import FOREIGN
from drivers.mocks.lab.hidden import HIDDEN, UnknownEffect
from drivers.mocks.lab.laboratory import Laboratory
from drivers.mocks.lab.survey import schedule, survey
from drivers.mocks.plant import Plant
from sim.effects.catalogue import CATALOGUE

# what one row's reading is good to, one sigma; powers and the rms current relative to the reading
NOISE = {"P1_W": 5e-5, "P_link1_W": 1.5e-4, "P_link2_W": 1.5e-4, "I_L_rms_A": 1.5e-4, "D0": 1.2e-4,
         "T_heatsink_C": 0.2, "T_transformer_C": 0.3, "T_inductor_C": 0.3}  # fmt: skip
RELATIVE = ("P1_W", "P_link1_W", "P_link2_W", "I_L_rms_A")
D1 = np.array([0.95, 0.6, 0.85, 0.7, 0.98, 0.9, 0.5, 0.8])
D2 = np.array([0.05, 0.3, 0.15, 0.0, 0.4, 0.1, 0.2, 0.5])
POWER_W = np.array([1500.0, 300.0, 900.0, 700.0, 400.0, 1700.0, 250.0, 500.0])

Families = pytest.mark.parametrize("family", FOREIGN.values(), ids=lambda family: family.name)


@cache
def readings(name: str = "", size: float = 0.0) -> pd.DataFrame:
    """A quiet campaign of a lab that hides this much of one family."""
    lab = Laboratory.draw(seed=5, hidden={name: size} if name else {}).without_noise()
    return survey(lab, schedule(D1, D2, POWER_W, reference_every=3), seed=1)


def sigmas(name: str, size: float, channel: str) -> np.ndarray:
    """How far the readings of a channel move, in what a reading is good to."""
    before, after = readings()[channel].to_numpy(), readings(name, size)[channel].to_numpy()
    noise = np.full(before.size, NOISE[channel])
    if channel in RELATIVE:
        noise = noise * np.maximum(np.abs(before), 0.1 if channel == "I_L_rms_A" else 50.0)
    return np.asarray((after - before) / noise)


def strength(name: str, size: float) -> float:
    return sum(float(np.nansum(sigmas(name, size, channel) ** 2)) for channel in NOISE)


def test_there_are_at_least_ten_and_none_is_in_the_catalogue() -> None:
    assert len(FOREIGN) >= 10
    assert not set(FOREIGN) & (set(CATALOGUE) | set(HIDDEN))


@Families
def test_each_says_where_it_is_and_what_it_does(family: type[ForeignEffect]) -> None:
    assert family.where
    assert family.says
    assert 0 < family.drawn[0] < family.drawn[1]
    assert family.touches <= set(NOISE)


@Families
def test_off_is_nothing_at_all(family: type[ForeignEffect]) -> None:
    pd.testing.assert_frame_equal(readings(family.name, 0.0), readings(), check_exact=True)


@Families
def test_every_reading_stays_finite(family: type[ForeignEffect]) -> None:
    columns = ["P1_W", "V1_V", "P2_W"]
    assert np.isfinite(readings(family.name, family.drawn[1])[columns].to_numpy()).all()


@Families
def test_it_grows_with_its_size(family: type[ForeignEffect]) -> None:
    small, large = (strength(family.name, size) for size in family.drawn)
    assert 25.0 < small < large  # five sigmas over the whole of a short campaign, at the least


@Families
def test_it_shows_where_it_says_and_nowhere_else(family: type[ForeignEffect]) -> None:
    largest = {c: float(np.nanmax(np.abs(sigmas(family.name, family.drawn[1], c)))) for c in NOISE}
    moved = {channel for channel, value in largest.items() if value > 4.0}  # a count of D0 is 3.3
    assert moved == set(family.touches), largest


def test_a_leak_is_there_in_standby_and_a_capacitors_loss_is_not() -> None:
    standby = (readings()["kind"] == "standby").to_numpy()
    for name, expected in (("board_leakage", True), ("dc_link_esr", False)):
        moved = readings(name, FOREIGN[name].drawn[1])["P1_W"][standby] - readings()["P1_W"][standby]
        assert np.all((moved > 1.0) == expected), name


def test_energy_added_behind_the_link_comes_through_it() -> None:
    before, after = readings(), readings("load_leakage", 10.0)
    loaded = (before["kind"] != "standby").to_numpy()
    extra = (after["P_link2_W"] - before["P_link2_W"])[loaded]
    assert extra.to_numpy() == pytest.approx(10.0, abs=0.5)  # conduction behind it grows a little too


def test_it_can_be_hidden_behind_the_wires() -> None:
    def standby_W(hidden: dict[str, float | None]) -> float:
        plant = Plant.virtual(seed=5, hidden=hidden)
        plant.set_supply(on=True, voltage_V=300.0, current_limit_A=10.0)
        return plant.analyzer(1, 0.5, {})["P1"]

    assert standby_W({"board_leakage": 8.0}) - standby_W({}) == pytest.approx(8.0, abs=0.1)


def test_a_size_that_is_not_given_is_drawn_by_the_seed_from_its_range() -> None:
    def draw() -> dict[str, float]:
        return Laboratory.draw(seed=2, hidden={"dc_link_esr": None}).hidden

    low, high = FOREIGN["dc_link_esr"].drawn
    assert draw() == draw()
    assert low <= draw()["dc_link_esr"] <= high


def test_an_unknown_name_is_answered_with_the_nearest_family() -> None:
    with pytest.raises(UnknownEffect, match="did you mean 'edge_ringing'"):
        Laboratory.draw(seed=1, hidden={"edge_ringin": None})
