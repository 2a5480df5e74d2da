"""What a lab can hide: every name of the catalogue, each visible in some reading."""

import numpy as np
import pytest

from drivers.mocks.lab.hidden import HIDDEN, UnknownEffect, drawn_values, hidden, hide
from drivers.mocks.lab.laboratory import Laboratory
from drivers.mocks.plant import Plant
from sim.effects.catalogue import CATALOGUE
from sim.model import Model
from sim.prototype import prototype

SETTLED_S = 300.0
LOADS = ((0.95, 0.05, 1500.0), (0.8, 0.4, 400.0))
# one sigma of what one update shows: power 0.01 % (ac 0.04 %), a D0 count of 2 ns, temperatures
NOISE = {"P1": 1e-4, "P3": 4e-4, "D0": 1e-4, "heatsink": 0.1, "inductor": 0.1, "transformer": 0.1}


def readings(concealed: dict[str, float | None]) -> dict[str, np.ndarray]:
    """Each channel over standby and two loads, an hour into a campaign; the same noise in every lab."""
    plant = Plant.virtual(seed=11, hidden=concealed)
    plant.clock.sleep(3600.0)
    plant.set_supply(on=True, voltage_V=300.0, current_limit_A=10.0)
    rows = [row(plant)]
    for D1, D2, power_W in LOADS:
        plant.set_load(on=True, power_W=power_W)
        plant.set_bridge(pwm=True, D1=D1, D2=D2)
        plant.clock.sleep(SETTLED_S)
        rows.append(row(plant))
    return {name: np.array([r[name] for r in rows]) for name in NOISE}


def row(plant: Plant) -> dict[str, float]:
    shown, state = plant.analyzer(int(plant.clock.now() / 0.5), 0.5, {}), plant.state()
    return {
        "P1": shown["P1"],
        "P3": shown["P3"],
        "D0": state.D0,
        "heatsink": state.T_heatsink_C,
        "inductor": state.T_inductor_C,
        "transformer": state.T_transformer_C,
    }


@pytest.fixture(scope="module")
def unspoilt() -> dict[str, np.ndarray]:
    return readings({})


@pytest.mark.parametrize("name", HIDDEN)
def test_a_hidden_effect_shows_above_the_noise(name: str, unspoilt: dict[str, np.ndarray]) -> None:
    spoilt, sigmas = readings({name: hidden(name).drawn[0]}), []
    for channel, noise in NOISE.items():
        unit = np.maximum(np.abs(unspoilt[channel]), 10.0) * noise if channel in ("P1", "P3") else noise
        sigmas.append(np.abs(spoilt[channel] - unspoilt[channel]) / unit)
    assert np.max(sigmas) > 2.0  # in a single update of two points; a campaign has hundreds


def test_every_name_of_the_catalogue_can_be_hidden() -> None:
    assert set(CATALOGUE) <= set(HIDDEN)


def test_what_can_be_hidden_is_inside_what_the_catalogue_can_say() -> None:
    for name, entry in ((name, HIDDEN[name]) for name in CATALOGUE):
        headline = CATALOGUE[name].headline
        assert headline.lower <= entry.drawn[0] < entry.drawn[1] <= headline.upper, name


def test_each_hides_in_one_place_of_its_own() -> None:
    assert all((entry.part is None) != (entry.quirk is None) for entry in HIDDEN.values())
    quirks = [entry.quirk for entry in HIDDEN.values() if entry.quirk]
    assert len(set(quirks)) == len(quirks)


@pytest.mark.parametrize("name", [name for name, entry in HIDDEN.items() if entry.part])
def test_a_value_means_the_same_to_lab_and_catalogue(name: str) -> None:
    value = hidden(name).drawn[1]
    concealed, _ = hide(prototype(), {name: value})
    assert concealed == Model.baseline().with_effect(name, **headline(name, value)).altered_converter()


def headline(name: str, value: float) -> dict[str, float]:
    return {CATALOGUE[name].headline.name: value}


def test_a_hidden_drift_of_the_room_is_in_kelvin_per_hour() -> None:
    lab, plain = Laboratory.draw(seed=1, hidden={"ambient_drift": 3.0}), Laboratory.draw(seed=1)
    assert lab.ambient_C(7200.0) - plain.ambient_C(7200.0) == pytest.approx(6.0)


def test_a_value_that_is_given_is_taken() -> None:
    assert Laboratory.draw(seed=1, hidden={"fan_step": 4.0}).quirks.fan_W == 4.0


def test_a_value_that_is_not_given_is_drawn_by_the_seed_from_its_range() -> None:
    first, again = (Laboratory.draw(seed=2, hidden={"dead_time": None}).hidden for _ in range(2))
    low, high = hidden("dead_time").drawn
    assert first == again
    assert low <= first["dead_time"] <= high


def test_draws_fill_their_range_evenly_in_proportion() -> None:
    rng, (low, high) = np.random.default_rng(1), hidden("link_resistance").drawn
    drawn = [drawn_values({"link_resistance": None}, rng)["link_resistance"] for _ in range(2000)]
    assert np.median(drawn) == pytest.approx(np.sqrt(low * high), rel=0.03)  # 2000 draws


def test_an_unknown_name_is_refused_with_the_nearest() -> None:
    with pytest.raises(UnknownEffect, match="did you mean 'reverse_recovery'"):
        Laboratory.draw(seed=1, hidden={"reverse_recovry": None})
