"""The one entry: powers that add up, honest infeasibility, and the same answer every time."""

from dataclasses import replace

import numpy as np
import pytest

from sim.model import Model
from sim.modulation import centre_offset, hybrid_edges
from sim.operating_points import Points, grid
from sim.parameters import Converter, ParameterError
from sim.piecewise import power_share
from sim.prototype import prototype
from sim.simulate import PARTS, Result, simulate, simulate_many
from sim.station import AT_INPUT, AT_OUTPUT, IN_LINK

LOSSLESS_SCALE_W = 300 * 280 / (2 * 20e3 * 236e-6)


def some_points(count: int = 24, seed: int = 8) -> Points:
    """Points that all run."""
    rng = np.random.default_rng(seed)
    D1, D2 = rng.uniform(0.6, 0.97, count), rng.uniform(0.03, 0.3, count)
    return Points(D1=D1, D2=D2, power_W=rng.uniform(200, 1000, count), time_s=np.linspace(0, 3600, count))


def lossy_everywhere() -> Model:
    """Effects at every node of the chain at once."""
    model = Model.baseline().with_effect("auxiliary_power", power_W=3.0)
    model = model.with_effect("cable_resistance_input", resistance_Ohm=0.1)
    model = model.with_effect("cable_resistance_output", resistance_Ohm=0.02)
    return model.with_effect("fan_step", power_W=2.0, threshold_C=30.0)


def loss_W(result: Result, *parts: str) -> np.ndarray:
    return np.sum([result[f"loss_{part}_W"] for part in parts], axis=0)


@pytest.mark.parametrize("model", [Model.baseline(), lossy_everywhere()], ids=["baseline", "with effects"])
def test_losses_add_up_to_input_less_output(model: Model) -> None:
    result = simulate(model, some_points())
    between = result["P1_W"] - result["P2_W"]
    # the output power is met to 2e-7, everything else is arithmetic
    np.testing.assert_allclose(loss_W(result, *PARTS), between, atol=1e-6 * result["P1_W"].max())


def test_each_loss_lies_at_its_node() -> None:
    r = simulate(lossy_everywhere(), some_points())
    np.testing.assert_allclose(r["P_link1_W"] - r["P_link2_W"], loss_W(r, *IN_LINK), atol=1e-9)
    behind = loss_W(r, *AT_OUTPUT, "output_cable")
    np.testing.assert_allclose(r["P_link2_W"] - r["P2_W"], behind, atol=1e-9)
    before = loss_W(r, *AT_INPUT, "auxiliary", "input_cable", "added")
    np.testing.assert_allclose(r["P1_W"] - r["P_link1_W"], before, atol=1e-9)


def test_demanded_power_arrives(baseline_grid: Result) -> None:
    delivered, demanded = baseline_grid["P2_W"], np.asarray(baseline_grid.points.power_W)
    missed = np.abs(delivered / demanded - 1)[baseline_grid.feasible]
    assert missed.max() < 1e-6


def test_every_loss_is_a_loss(baseline_grid: Result) -> None:
    feasible = baseline_grid.feasible
    for part in PARTS:
        assert baseline_grid[f"loss_{part}_W"][feasible].min() > -1e-9, part  # rounding of nothing lost


def test_a_secondary_loss_moves_d0() -> None:
    base, points = prototype(), some_points()
    switch = base.secondary.switch
    lossy = replace(switch, turn_off=replace(switch.turn_off, energy_J=5e-4))
    other = replace(base, secondary=replace(base.secondary, switch=lossy))
    after, before = (simulate(Model(converter=c), points)["D0"] for c in (other, base))
    assert np.all(after > before)
    assert np.max(after - before) > 1e-4  # 1 W more through a slope of some 5 kW per Th


def test_a_primary_loss_does_not_move_d0() -> None:
    def cooled(converter: Converter) -> Converter:
        return replace(converter, heatsink_K_per_W=1e-9)  # else it warms the secondary's switches

    base, points = cooled(prototype()), some_points()
    inner = base.primary.inner
    lossy = replace(inner, turn_off=replace(inner.turn_off, energy_J=2e-3), thermal_K_per_W=1e-9)
    lossless = replace(inner, thermal_K_per_W=1e-9)
    models = [
        Model(converter=replace(base, primary=replace(base.primary, inner=i))) for i in (lossy, lossless)
    ]
    after, before = (simulate(model, points) for model in models)
    assert np.max(after["P1_W"] - before["P1_W"]) > 1.0  # where the inner switches turn off a current
    np.testing.assert_allclose(after["D0"], before["D0"], atol=1e-7)  # regulation's 2e-7 of the power


@pytest.mark.parametrize("name", ["link_resistance", "sic_on_resistance", "cable_resistance_input"])
def test_more_resistance_is_less_efficient_everywhere(name: str) -> None:
    points, steps = some_points(), (0.0, 0.05, 0.1, 0.2)
    models = [Model.baseline().with_effect(name, **{headline(name): step}) for step in steps]
    efficiency = np.array([r["efficiency"] for r in simulate_many(models, points)])
    assert np.all(np.diff(efficiency, axis=0) < 0)


def headline(name: str) -> str:
    return {"sic_on_resistance": "relative_error"}.get(name, "resistance_Ohm")


def test_the_cable_raises_the_voltage_at_the_bridge_over_what_the_analyzer_reads() -> None:
    points = replace(some_points(), V2_V=140.0)
    with_cable = simulate(Model.baseline().with_effect("cable_resistance_output", resistance_Ohm=0.3), points)
    I2 = np.asarray(points.power_W) / 140.0
    raised = replace(points, V2_V=140.0 + 0.3 * I2, power_W=points.power_W + 0.3 * I2**2)
    np.testing.assert_allclose(with_cable["D0"], simulate(Model.baseline(), raised)["D0"], atol=1e-6)


def test_infeasible_points_are_nan_with_a_reason_and_no_others_are(baseline_grid: Result) -> None:
    np.testing.assert_array_equal(baseline_grid.feasible, baseline_grid.reason == "")
    for name, column in baseline_grid.values.items():
        np.testing.assert_array_equal(np.isfinite(column), baseline_grid.feasible, err_msg=name)


def test_the_grid_is_feasible_for_two_fifths(baseline_grid: Result) -> None:
    # the lossless converter carries 41 %; drops and dead time take little more than one point
    assert 0.38 < baseline_grid.feasible.mean() < 0.42


def test_the_lossless_grid_is_feasible_for_two_fifths() -> None:
    points = grid()
    peak = hybrid_edges(0.5 - centre_offset(points.D1, points.D2), points.D1, points.D2)
    carries = LOSSLESS_SCALE_W * power_share(peak)[0] >= points.power_W
    assert carries.mean() == pytest.approx(0.41, abs=0.005)  # two digits are known


@pytest.mark.parametrize(
    ("D1", "D2", "power_W", "says"),
    [
        (0.01, 0.1, 300.0, "primary pulse"),
        (0.99, 0.1, 300.0, "primary zero state"),
        (0.9, 0.995, 300.0, "secondary pulse"),
        (0.9, 0.01, 300.0, "secondary zero state"),
        (1.2, 0.1, 300.0, "D1 outside"),
        (0.9, -0.1, 300.0, "D2 outside"),
        (0.9, 0.1, -2300.0, "carry less than"),
        (0.5, 0.5, 2000.0, "carry less than"),
        (1.0, 0.0, 2200.0, "carry at most"),
    ],
)
def test_the_reason_says_what_is_in_the_way(D1: float, D2: float, power_W: float, says: str) -> None:
    result = simulate(Model.baseline(), Points(D1=D1, D2=D2, power_W=power_W))
    assert not result.feasible[0]
    assert says in result.reason[0]


def test_a_part_too_hot_to_exist_is_infeasible_not_a_number() -> None:
    furnace = Model.baseline().with_effect("thermal_resistance", relative_error=2.0)
    points = Points(D1=0.9, D2=0.1, power_W=1500.0, ambient_C=[25.0, 200.0])
    result = simulate(furnace, points)
    assert result.feasible.tolist() == [True, False]
    assert "hotter than 250 degC" in result.reason[1]
    assert all(np.isnan(column[1]) for column in result.values.values())


@pytest.mark.parametrize(
    ("field", "value"), [("D1", np.nan), ("power_W", np.inf), ("V1_V", 0.0), ("ambient_C", np.nan)]
)
def test_points_that_are_no_numbers_are_refused_by_name(field: str, value: float) -> None:
    good = {"D1": 0.9, "D2": 0.1, "power_W": 500.0}
    with pytest.raises(ParameterError, match=rf"Points\.{field}\[0\] is {value}"):
        Points(**(good | {field: value}))


@pytest.mark.parametrize(("D1", "D2"), [(1.0, 0.0), (1.0, 0.3), (0.7, 0.0), (0.2, 0.6)])
def test_no_load_runs(D1: float, D2: float) -> None:
    result = simulate(Model.baseline(), Points(D1=D1, D2=D2, power_W=0.0))
    assert result.feasible[0]
    assert result["P1_W"][0] > 0
    assert result["P2_W"][0] == pytest.approx(0.0, abs=1e-5)  # 10 W is the least scale of the tolerance


def test_standby_takes_nothing_but_shows_the_offset() -> None:
    points = Points(D1=1.0, D2=0.0, power_W=[0.0, 500.0], pwm=[False, True])
    result = simulate(Model.baseline().with_effect("auxiliary_power", power_W=4.0), points)
    shown = simulate(Model.baseline().with_effect("analyzer_offset", current_A=0.02), points)
    assert result.feasible.all()
    assert result["P1_W"][0] == 0.0
    assert np.isnan(result["efficiency"][0])
    assert shown["P1_W"][0] == pytest.approx(0.02 * 300.0)


def test_many_variants_at_once_are_each_as_alone() -> None:
    points = some_points()
    models = [Model.baseline(), lossy_everywhere(), Model.baseline().with_effect("dead_time", error_s=8e-8)]
    for together, model in zip(simulate_many(models, points), models, strict=True):
        alone = simulate(model, points)
        for name, column in alone.values.items():
            # both stop inside the same tolerances (2e-7 of the power, 0.1 mK)
            np.testing.assert_allclose(together[name], column, rtol=1e-6, atol=2e-5, err_msg=name)


def test_points_do_not_depend_on_their_neighbours(baseline_grid: Result) -> None:
    chosen = np.flatnonzero(baseline_grid.feasible)[::97]
    alone = simulate(Model.baseline(), baseline_grid.points.take(chosen))
    np.testing.assert_allclose(alone["efficiency"], baseline_grid["efficiency"][chosen], rtol=1e-7)


def test_the_same_call_gives_the_same_bits() -> None:
    first, second = (simulate(lossy_everywhere(), some_points()) for _ in range(2))
    for name, column in first.values.items():
        np.testing.assert_array_equal(column, second[name], err_msg=name)


def test_simulating_leaves_model_and_points_as_they_were() -> None:
    points, model = some_points(), lossy_everywhere()
    before = {name: np.array(getattr(points, name)) for name in ("D1", "D2", "power_W", "time_s")}
    simulate(model, points)
    assert all(np.array_equal(getattr(points, name), value) for name, value in before.items())
    assert model == lossy_everywhere()


def test_efficiency_is_that_of_a_good_converter(baseline_grid: Result) -> None:
    best = np.nanmax(baseline_grid["efficiency"])
    assert 0.98 < best < 0.99  # the paper measured 98.45 % at its best point


def test_soft_switching_flags_are_shares_of_none_or_all(baseline_grid: Result) -> None:
    for edge in ("primary_rise", "primary_fall", "secondary_lead", "secondary_lag"):
        flag = baseline_grid[f"zvs_{edge}"][baseline_grid.feasible]
        assert set(np.unique(flag)) <= {0.0, 1.0}, edge
        assert np.mean(flag) > 0.2, edge  # most of the map switches softly at each edge


def test_an_edge_is_soft_where_hardly_anything_of_its_swing_is_missing(baseline_grid: Result) -> None:
    for edge in ("primary_rise", "primary_fall", "secondary_lead", "secondary_lag"):
        missing, soft = (
            baseline_grid[f"{said}_{edge}"][baseline_grid.feasible] for said in ("missing", "zvs")
        )
        assert np.all((missing >= 0.0) & (missing <= 1.0)), edge
        np.testing.assert_array_equal(soft == 1.0, missing < 0.01, err_msg=edge)
    cut_short = baseline_grid["missing_secondary_lead"]
    assert np.any((cut_short > 0.1) & (cut_short < 0.9))  # some swings are, of thousands


def test_the_table_holds_inputs_flags_and_every_result(baseline_grid: Result) -> None:
    table = baseline_grid.columns()
    assert list(table)[:5] == ["D1", "D2", "P_set_W", "feasible", "reason"]
    assert {column.shape for column in table.values()} == {(12500,)}


@pytest.mark.parametrize(
    ("D1", "D2", "power_W"), [(0.731366, 0.607977, 1263.281), (0.780367, 0.763134, 863.871)]
)
def test_near_the_peak_more_power_is_more_phase(D1: float, D2: float, power_W: float) -> None:
    """Newton's rule settles some of these on the falling side, where more power is less phase."""
    power = power_W * np.linspace(0.995, 1.0, 61)
    result = simulate(Model.baseline(), Points(D1=np.full(61, D1), D2=np.full(61, D2), power_W=power))
    assert result.feasible.all()
    assert np.all(np.diff(result["D0"]) > 0)
