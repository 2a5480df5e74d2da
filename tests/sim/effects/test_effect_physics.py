"""What each kind of effect does, where the answer is known by hand."""

import math
from dataclasses import replace

import numpy as np
import pytest

from sim.effects.catalogue import CATALOGUE, effect
from sim.model import Model
from sim.simulate import Points, Result, simulate, simulate_many

POINTS = Points(
    D1=[0.9, 0.8, 0.7], D2=[0.1, 0.2, 0.1], power_W=[1500.0, 800.0, 300.0], time_s=[0.0, 900, 1800]
)


def pair(name: str, **values: float) -> tuple[Result, Result]:
    before, after = simulate_many([Model.baseline(), Model.baseline().with_effect(name, **values)], POINTS)
    return before, after


def added_W(name: str, **values: float) -> np.ndarray:
    before, after = pair(name, **values)
    return after["P1_W"] - before["P1_W"]


def test_auxiliary_power_is_added_as_it_is() -> None:
    np.testing.assert_allclose(added_W("auxiliary_power", power_W=4.0), 4.0, atol=1e-3)  # 2e-7 of the power


def test_link_resistance_adds_r_i_squared() -> None:
    _, after = pair("link_resistance", resistance_Ohm=0.1)
    whole_Ohm = Model.baseline().converter.link_resistance_Ohm + 0.1
    np.testing.assert_allclose(
        after["loss_link_resistance_W"], whole_Ohm * after["I_L_rms_A"] ** 2, rtol=1e-9
    )


def test_a_late_secondary_is_made_up_for_by_d0() -> None:
    before, after = pair("gate_delay_skew", skew_s=100e-9)
    np.testing.assert_allclose(after["D0"] - before["D0"], -100e-9 / 25e-6, atol=1e-6)
    np.testing.assert_allclose(after["P1_W"], before["P1_W"], atol=1e-3)


def test_a_warm_room_warms_the_heatsink_with_time() -> None:
    before, after = pair("ambient_drift", rate_K_per_h=4.0)
    rise_K = after["T_heatsink_C"] - before["T_heatsink_C"]
    np.testing.assert_allclose(rise_K, [0.0, 1.0, 2.0], atol=0.1)  # losses follow temperature a little


def test_warm_up_adds_its_share_at_the_end() -> None:
    before, after = pair("warm_up_drift", relative_loss_at_end=0.1, time_constant_s=1e7)
    loss_W = before["P1_W"] - before["P2_W"]
    np.testing.assert_allclose(after["P1_W"] - before["P1_W"], loss_W * [0.0, 0.05, 0.1], atol=1e-3)


def test_what_warms_up_fast_is_warm_long_before_the_end() -> None:
    before, after = pair("warm_up_drift", relative_loss_at_end=0.1, time_constant_s=180.0)
    loss_W = before["P1_W"] - before["P2_W"]
    halfway = 1.0 / (1.0 + math.exp(-900.0 / 180.0))  # a lag's share of its end, at half of the time
    np.testing.assert_allclose(after["P1_W"] - before["P1_W"], 0.1 * loss_W * [0.0, halfway, 1.0], atol=1e-3)


def test_the_fan_runs_where_the_heatsink_is_warm() -> None:
    heatsink_C = simulate(Model.baseline(), POINTS)["T_heatsink_C"]
    threshold_C = float(np.median(heatsink_C)) - 0.1
    added = added_W("fan_step", power_W=3.0, threshold_C=threshold_C)
    np.testing.assert_allclose(added, np.where(heatsink_C > threshold_C, 3.0, 0.0), atol=1e-3)
    assert 0.0 < np.mean(added) < 3.0


@pytest.mark.parametrize(
    ("name", "values", "expected"),
    [
        ("analyzer_gain", {"relative_error": 0.004}, lambda r: 0.004 * r["P1_W"]),
        ("analyzer_offset", {"current_A": -0.02}, lambda r: np.full(3, -6.0)),
        (
            "analyzer_range_step",
            {"relative_step": 0.005, "boundary_A": 3.0},
            lambda r: np.where(r["I1_A"] < 3.0, 0.005 * r["P1_W"], 0.0),
        ),
    ],
)
def test_the_analyzer_shows_another_input_power(name, values, expected) -> None:
    before, after = pair(name, **values)
    np.testing.assert_allclose(after["P1_W"] - before["P1_W"], expected(before), atol=1e-3)
    np.testing.assert_allclose(after["efficiency"], after["P2_W"] / after["P1_W"], rtol=1e-12)
    np.testing.assert_allclose(after["I1_A"], after["P1_W"] / 300.0, rtol=1e-12)


def test_a_measurement_effect_leaves_the_converter_alone() -> None:
    before, after = pair("analyzer_gain", relative_error=0.004)
    for name in ("D0", "P2_W", "P_link1_W", "T_heatsink_C", "loss_secondary_conduction_W"):
        np.testing.assert_allclose(after[name], before[name], rtol=1e-6, err_msg=name)


def test_a_duty_offset_is_another_duty() -> None:
    _, after = pair("duty_offset", offset=0.01)
    moved = Points(D1=np.asarray(POINTS.D1) + 0.01, D2=POINTS.D2, power_W=POINTS.power_W)
    np.testing.assert_allclose(after["P1_W"], simulate(Model.baseline(), moved)["P1_W"], atol=1e-3)


def test_a_duty_of_one_has_no_edge_that_could_be_off() -> None:
    full = Points(D1=1.0, D2=0.1, power_W=1000.0)
    off = simulate(Model.baseline().with_effect("duty_offset", offset=-1e-4), full)
    assert off["P1_W"] == simulate(Model.baseline(), full)["P1_W"]


def test_a_hotter_heatsink_has_its_resistance() -> None:
    _, after = pair("thermal_resistance", relative_error=0.5)
    losses = [f"loss_primary_{d}_{k}_W" for d in ("outer", "inner") for k in ("conduction", "switching")]
    losses += ["loss_primary_clamp_conduction_W", "loss_primary_clamp_recovery_W"]
    losses += ["loss_secondary_conduction_W", "loss_secondary_switching_W"]
    heat_W = np.sum([after[name] for name in losses], axis=0)
    np.testing.assert_allclose(after["T_heatsink_C"], 25.0 + 1.5 * heat_W, atol=1e-3)  # settled to 0.1 mK


def test_the_magnetizing_inductance_takes_the_place_of_the_old_one() -> None:
    model = Model.baseline().with_effect("magnetizing_inductance", inductance_H=4e-3)
    assert model.altered_converter().transformer.magnetizing_H == 4e-3


def test_near_its_threshold_a_point_is_undecided() -> None:
    state = {"T_heatsink_C": np.array([38.0, 39.0, 41.0])}  # the threshold is good to 1.5 K
    fan, none = CATALOGUE["fan_step"], CATALOGUE["auxiliary_power"]
    exact = {"T_heatsink_C": np.zeros(3)}
    np.testing.assert_array_equal(fan.undecided(POINTS, state, exact, {"threshold_C": 40.0}), [0.0, 1.0, 1.0])
    assert not none.undecided(POINTS, state, exact, {}).any()


def test_where_a_temperature_is_simulated_alone_it_is_open_further_from_the_threshold() -> None:
    state, sigma = {"T_heatsink_C": np.array([34.5, 37.5, 41.0])}, {"T_heatsink_C": np.full(3, 1.0)}
    unread = CATALOGUE["fan_step"].undecided(POINTS, state, sigma, {"threshold_C": 40.0})
    p = 0.15866  # of a normal quantity: more than one sigma beyond
    # four digits of the tail beyond four sigmas
    np.testing.assert_allclose(unread, [2 * np.sqrt(3.167e-5), 2 * np.sqrt(p * (1 - p)), 1.0], rtol=1e-4)
    read = replace(POINTS, seen_heatsink_C=state["T_heatsink_C"])
    np.testing.assert_array_equal(
        CATALOGUE["fan_step"].undecided(read, state, sigma, {"threshold_C": 40.0}), [0.0, 0.0, 1.0]
    )


def test_a_threshold_goes_by_what_was_read_where_it_was() -> None:
    before = simulate(Model.baseline(), POINTS)
    shown_C, shown_A = before["T_heatsink_C"] + [9.0, 0.0, np.nan], before["I1_A"] + [0.3, 0.0, np.nan]
    read = replace(POINTS, seen_heatsink_C=shown_C, seen_I1_A=shown_A)
    for name, quantity, other in (
        ("fan_step", "T_heatsink_C", {"power_W": 4.0, "threshold_C": before["T_heatsink_C"][0] + 8.0}),
        ("analyzer_range_step", "I1_A", {"relative_step": 0.01, "boundary_A": before["I1_A"][0] + 0.2}),
    ):
        model = Model.baseline().with_effect(name, **other)
        added = simulate(model, read)["P1_W"] - simulate(model, POINTS)["P1_W"]
        assert np.abs(added[0]) > 3.0, quantity  # the first point was read to lie on the other side
        np.testing.assert_allclose(added[1:], 0.0, atol=1e-6)


def test_a_scaled_parts_spread_is_scaled_and_a_replaced_one_has_none() -> None:
    for name, value, times in (
        ("thermal_resistance", 0.5, 1.5), ("link_resistance", 0.1, 1.0), ("magnetizing_inductance", 3e-3, 0.0),
    ):  # fmt: skip
        entry = CATALOGUE[name]
        assert entry.spread_at(value, everyday=0.06) == pytest.approx(times * 0.06)


@pytest.mark.parametrize("sigmas", [-3.0, -1.96, 1.96])
def test_a_scaled_parts_spread_is_a_ratio_and_leaves_something_of_it(sigmas: float) -> None:
    value, everyday = 2.1, 0.4
    moved = sigmas * CATALOGUE["reverse_recovery"].spread_at(value, everyday, sigmas)
    # rounding
    assert 1.0 + value + moved == pytest.approx((1.0 + value) * np.exp(sigmas * everyday), rel=1e-12)
    watts = CATALOGUE["auxiliary_power"]
    assert watts.spread_at(2.1, 0.4, sigmas) == 0.4


def test_losses_that_fall_while_warming_up_ask_for_the_instrument_first() -> None:
    warm_up = effect("warm_up_drift")
    assert warm_up.check_at(-0.04).startswith(
        "losses that fall while the bench warms up are rather an instrument"
    )
    assert warm_up.check_at(0.04) == warm_up.check_on_bench


def test_an_inductance_that_is_off_asks_for_the_switching_frequency_first() -> None:
    said = effect("leakage_inductance").check_at(0.2)
    assert said.startswith("make sure that the bench switched at the model's frequency")


def test_a_current_that_the_lower_range_shows_has_the_step_in_it() -> None:
    entry, seen_A = effect("analyzer_range_step"), np.array([4.99, 5.02, 5.04, 5.07])
    points = Points(D1=0.9, D2=0.1, power_W=1450.0, seen_I1_A=seen_A)
    truth = {"P1_W": 300.0 * seen_A, "I1_A": seen_A, "P2_W": np.full(4, 1450.0), "efficiency": np.ones(4)}
    for step, low in ((0.006, [1, 1, 0, 0]), (-0.006, [1, 0, 0, 0])):  # 5 A is shown as 5.03 A
        shown = entry.observe(points, truth, {"relative_step": step, "boundary_A": 5.0})["P1_W"]
        np.testing.assert_allclose(shown / truth["P1_W"], 1.0 + step * np.array(low), rtol=1e-12)
    state, sigma = {"I1_A": seen_A}, {"I1_A": np.zeros(4)}
    # as far above as two prior scales of a step show it, and the boundary's own tolerance: 5.06 A
    np.testing.assert_array_equal(entry.undecided(points, state, sigma, {}) > 0.5, [True, True, True, False])


def test_a_saturation_told_at_small_currents_may_be_a_parabolas() -> None:
    """Two cores that are the same there: the interval of the one holds the other's drop where it is stated."""
    entry, stated_A, small_A = effect("inductor_saturation"), 15.0, 3.0
    for drop in (0.1, 0.2, 0.3):
        model = Model.baseline().with_effect("inductor_saturation", relative_drop=drop)
        choke = model.altered_converter().inductor
        lost = 1.0 - choke.flux_Vs(np.array(small_A)).item() / (choke.inductance_H * small_A)
        parabolas = lost * stated_A**2 / (small_A**2 / 3)  # over the mean of i^2 on the way
        assert drop < parabolas < drop * (1 + 1.96 * entry.law_at(drop))
    assert entry.law_at(entry.headline.off) == entry.law
    assert effect("link_resistance").law_at(0.3) == effect("link_resistance").law
