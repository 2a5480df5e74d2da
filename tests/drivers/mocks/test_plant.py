"""The plant: one converter in time, seen through instruments that disagree a little."""

import math

import numpy as np
import pytest

from drivers.mocks.lab.laboratory import Laboratory
from drivers.mocks.plant import Plant, PlantState

UPDATE_S = 0.5
AT = {"D1": 0.95, "D2": 0.05}


def powered(seed: int = 1, hidden: dict[str, float | None] | None = None) -> Plant:
    """A plant whose supply is on."""
    plant = Plant.virtual(seed=seed, hidden=hidden)
    plant.set_supply(on=True, voltage_V=300.0, current_limit_A=10.0)
    return plant


def running(power_W: float = 1500.0, *, D1: float = 0.95, D2: float = 0.05, **options: object) -> Plant:
    """A plant under load."""
    plant = powered(**options)  # type: ignore[arg-type]
    plant.set_load(on=True, power_W=power_W)
    plant.set_bridge(pwm=True, D1=D1, D2=D2)
    return plant


def update(plant: Plant, ranges: dict[str, float] | None = None) -> dict[str, float]:
    """The analyzer's update at this moment."""
    return plant.analyzer(int(plant.clock.now() / UPDATE_S), UPDATE_S, ranges or {})


def visit(plant: Plant, power_W: float) -> float:
    """Input power as read over input power as it is, ten seconds after a load was set."""
    plant.set_load(on=True, power_W=power_W)
    plant.clock.sleep(10.0)
    return update(plant)["P1"] / input_W(plant.state())


def test_without_a_supply_nothing_is_there() -> None:
    state = Plant.virtual(seed=1).state()
    assert (state.supply_V, state.supply_A, state.load_V, state.load_A) == (0.0, 0.0, 0.0, 0.0)
    assert not state.pwm
    assert state.faults == ()


def test_standby_reads_the_analyzers_offset_alone() -> None:
    plant = powered(hidden={"auxiliary_power": 5.0, "analyzer_offset": 0.02})
    fixed_A = plant.laboratory.errors.offset_A[1]
    # the converter takes nothing while it does not switch; noise of the offset is 5 ppm
    assert update(plant)["P1"] == pytest.approx(300.0 * (0.02 + fixed_A), rel=1e-3)


def test_the_auxiliary_power_is_drawn_while_it_switches() -> None:
    plain, hiding = (running(hidden=h).state() for h in ({}, {"auxiliary_power": 5.0}))
    assert input_W(hiding) - input_W(plain) == pytest.approx(5.0, abs=0.01)  # the cable's share


def input_W(state: PlantState) -> float:
    return state.supply_V * state.supply_A


def test_it_delivers_what_the_load_draws() -> None:
    state = running(800.0).state()
    assert state.pwm
    assert state.load_V * state.load_A == pytest.approx(800.0, rel=1e-6)
    assert state.load_V == pytest.approx(140.0, rel=1e-3)  # the sensor's own error
    assert 0.9 < 800.0 / input_W(state) < 0.99


def test_powers_fall_along_the_chain() -> None:
    state = running(800.0).state()
    assert input_W(state) > state.link1_W > state.link2_W > 800.0


def test_nothing_flows_through_a_bridge_that_rests() -> None:
    resting = powered().state()
    assert (resting.link1_W, resting.link2_W, resting.link_rms_A) == (0.0, 0.0, 0.0)


def test_it_warms_up_and_settles() -> None:
    plant, heatsink_C = running(), []
    for _ in range(6):
        heatsink_C.append(plant.state().T_heatsink_C)
        plant.clock.sleep(60.0)
    rise = np.diff(heatsink_C)
    assert rise[0] > 15.0
    assert np.all(rise > 0)
    assert rise[-1] < 0.05 * rise[0]  # a time constant of 40 s


def test_it_cools_when_switched_off() -> None:
    plant = running()
    plant.clock.sleep(300.0)
    warm_C = plant.state().T_heatsink_C
    plant.set_bridge(pwm=False, **AT)
    plant.clock.sleep(400.0)
    assert plant.state().T_heatsink_C == pytest.approx(25.0, abs=2.0)  # a sensor's offset of 0.3 K, ten tau
    assert warm_C > 45.0


def test_warming_moves_the_losses_slowly() -> None:
    plant, power_W = running(), []
    for _ in range(5):
        power_W.append(input_W(plant.state()))
        plant.clock.sleep(60.0)
    steps = np.abs(np.diff(power_W))
    assert steps[0] > 5 * steps[-1]
    assert steps[0] < 3.0  # W: a few per cent of the loss


def test_how_often_it_is_looked_at_does_not_matter() -> None:
    seldom, often = running(), running()
    seldom.clock.sleep(100.0)
    for _ in range(100):
        often.clock.sleep(1.0)
        often.state()
    assert often.state().T_heatsink_C == pytest.approx(seldom.state().T_heatsink_C, abs=1e-9)
    assert input_W(often.state()) == pytest.approx(input_W(seldom.state()), abs=1e-9)


def test_what_lasts_no_time_is_not_solved(monkeypatch: pytest.MonkeyPatch) -> None:
    plant, solved = running(), []
    plant.clock.sleep(60.0)
    plant.state()
    run = Laboratory.run
    monkeypatch.setattr(Laboratory, "run", lambda *a: solved.append(a) or run(*a))
    plant.set_bridge(pwm=True, D1=0.9, D2=0.0)
    plant.set_load(on=True, power_W=800.0)
    # what the load and the controller look at while the set point is on its way
    assert (plant.output_V, plant.faults) == (pytest.approx(140.0, rel=0.01), ())  # sensing error and cable
    assert not solved


def test_what_is_set_wrong_trips_once_time_has_passed() -> None:
    plant = running()
    plant.clock.sleep(1.0)
    plant.set_bridge(pwm=True, D1=0.3, D2=0.6)
    assert plant.faults == ()
    plant.clock.sleep(0.1)
    assert plant.faults == ("output_undervoltage",)
    assert plant.output_V == 0.0


def test_a_run_repeats_to_the_last_digit() -> None:
    first, again = ([visit(plant, p) for p in (900.0, 500.0, 900.0)] for plant in (running(), running()))
    assert first == again


def test_noise_of_another_visit_is_other_noise() -> None:
    plant = running(900.0)
    first, _, second = visit(plant, 901.0), visit(plant, 500.0), visit(plant, 901.0)
    assert abs(first - second) > 1e-5  # a tenth of a sigma; fixed errors differ by 1e-6 at most
    assert first == pytest.approx(second, abs=2e-3)


def test_each_update_has_noise_of_its_own() -> None:
    plant, shown = running(900.0), []
    plant.clock.sleep(600.0)
    for _ in range(40):
        shown.append(update(plant)["P1"])
        plant.clock.sleep(UPDATE_S)
    spread = np.std(shown) / np.mean(shown)
    assert 0.5e-4 < spread < 2e-4  # 0.01 %, from forty


def test_another_seed_is_another_lab() -> None:
    assert update(running(seed=1))["P1"] != update(running(seed=2))["P1"]


def test_a_point_that_cannot_carry_its_power_trips() -> None:
    state = running(1800.0, D1=0.3, D2=0.6).state()
    assert state.faults == ("output_undervoltage",)
    assert not state.pwm
    assert state.load_V == 0.0


def test_a_pulse_shorter_than_the_dead_time_trips() -> None:
    assert running(300.0, D1=0.99, D2=0.3).state().faults == ("output_undervoltage",)


def test_a_supply_that_limits_its_current_trips_the_converter() -> None:
    plant = running(1500.0)
    plant.set_supply(on=True, voltage_V=300.0, current_limit_A=3.0)
    state = plant.state()
    assert state.faults == ("input_undervoltage",)
    assert (state.pwm, state.supply_A) == (False, 0.0)


def test_a_hot_heatsink_trips() -> None:
    plant = running(2000.0, D1=1.0, D2=0.0, hidden={"thermal_resistance": 2.0, "sic_on_resistance": 2.0})
    plant.clock.sleep(600.0)
    assert plant.state().faults == ("heatsink_overtemperature",)
    assert not plant.state().pwm


def test_a_fault_stays_until_the_bridges_are_switched_on_again() -> None:
    plant = running(1800.0, D1=0.3, D2=0.6)
    plant.state()
    plant.set_bridge(pwm=True, **AT)
    assert plant.state().faults
    plant.set_bridge(pwm=False, **AT)
    plant.set_bridge(pwm=True, **AT)
    assert plant.state().faults == ()
    assert plant.state().pwm


@pytest.mark.parametrize(("D1", "D2"), [(1.0, 0.0), (1.0, 0.26), (0.7, 0.3), (0.4, 0.5)])
def test_it_runs_without_a_load(D1: float, D2: float) -> None:
    plant = powered()
    plant.set_bridge(pwm=True, D1=D1, D2=D2)
    state = plant.state()
    assert (state.pwm, state.faults) == (True, ())
    assert 0.5 < input_W(state) < 50.0  # W: core and commutation


def test_four_elements_agree_on_the_power_along_the_chain() -> None:
    shown = update(running(1500.0))
    assert shown["P1"] > shown["P3"] > shown["P4"] > shown["P2"]
    for element in (1, 2):
        product = shown[f"U{element}"] * shown[f"I{element}"]
        assert shown[f"P{element}"] == pytest.approx(product, rel=2e-3)  # dc: gains and noise of 0.05 %


def test_apparent_power_of_the_ac_link_is_more_than_its_power() -> None:
    shown = update(running(800.0))
    for element in (3, 4):
        assert shown[f"U{element}"] * shown[f"I{element}"] > shown[f"P{element}"]


def test_beyond_its_range_an_element_shows_no_number() -> None:
    shown = update(running(1500.0), {"U1": 300.0, "I1": 2.0})
    assert math.isinf(shown["P1"])
    assert math.isfinite(shown["P2"])


def test_a_little_over_the_range_is_still_shown() -> None:
    assert math.isfinite(update(running(1500.0), {"U1": 300.0, "I1": 5.0})["P1"])  # 5.1 A


def test_a_modulation_that_it_cannot_make_is_refused() -> None:
    with pytest.raises(ValueError, match="'TPS'; it has hybrid, tps"):
        powered().set_bridge(pwm=True, D1=0.9, D2=0.1, mode="TPS")


def test_the_bridges_make_what_the_controller_asks_for() -> None:
    plant, drawn_W = running(600.0), {}
    for mode in ("hybrid", "tps"):
        plant.set_bridge(pwm=True, D1=0.7, D2=0.1, mode=mode)
        drawn_W[mode] = plant.state().supply_A * plant.state().supply_V
    # shifted legs switch both devices of a rail at the full current: more than a clamped leg, by watts
    assert 0.2 < drawn_W["tps"] - drawn_W["hybrid"] < 5.0
