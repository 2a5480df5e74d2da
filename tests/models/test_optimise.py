"""Optimum over load: the mask, the exact optimum of the trees, and the regret of a search against it."""

import numpy as np
import pytest

from models.exhaustive import NEAR, exact_optimum
from models.feasibility import FeasibleMap
from models.optimise import OptimumTable, optimise, optimise_exactly
from models.pso import PSO_SAVL, PSO_SAVL_POLISHED
from models.surrogate import train_d2ea, train_simulator_first


@pytest.fixture(scope="module")
def mask(converter):
    return FeasibleMap.build(converter.feasible, converter.loads_W, edge_gap=converter.edge_gap)


@pytest.fixture(scope="module")
def model(converter):
    grid = converter.simulated_grid((25, 25, 20))
    feasible = grid[grid["feasible"]]
    return train_d2ea(feasible.sample(frac=0.1, random_state=0), converter.measured_table(120, seed=1))


def test_what_the_mask_allows_the_simulator_confirms(converter, mask):
    rng = np.random.default_rng(0)
    D1, D2, load = rng.random(20_000), rng.random(20_000), rng.integers(0, 19, 20_000)
    allowed = mask.allowed(D1, D2, load)
    carried = converter.feasible(*mask.snap(D1, D2), converter.loads_W[load])
    assert carried[allowed].all()
    # refused although carried: a strip of under one lattice step (0.02) along a border about 1.5 long
    assert (carried & ~allowed).mean() < 0.03


def test_the_strip_the_dead_time_swallows_stands_for_its_edge(mask):
    D1, D2 = mask.snap(np.array([0.99, 0.98, 1.0]), np.array([0.01, 0.02, 0.0]))
    assert D1.tolist() == [1.0, 0.98, 1.0]
    assert D2.tolist() == [0.0, 0.02, 0.0]
    assert mask.allowed(np.array(0.99), np.array(0.01), 18)  # D1 = 1, D2 = 0 carries 2 kW


def test_without_a_gap_no_strip_is_made(converter):
    mask = FeasibleMap.build(lambda D1, D2, P: D1 * 2000 >= P, [1000.0], lattice=10)
    assert mask.cells.sum() == 50  # of a hundred
    assert mask.snap(np.array(0.999), np.array(0.001)) == (0.999, 0.001)


def test_bisection_over_unsorted_loads_equals_asking_for_each(converter):
    loads = np.array([1500.0, 300.0, 2000.0, 900.0])
    mask = FeasibleMap.build(converter.feasible, loads, edge_gap=converter.edge_gap, lattice=20)
    each = [
        FeasibleMap.build(converter.feasible, [p], edge_gap=converter.edge_gap, lattice=20).cells[0]
        for p in loads
    ]
    np.testing.assert_array_equal(mask.cells, each)


def test_no_point_of_a_fine_lattice_beats_the_exact_optimum(converter, mask, model):
    exact = exact_optimum(model, mask)
    axis = np.linspace(0, 1, 401)
    D1, D2 = (a.ravel() for a in np.meshgrid(axis, axis))
    for load in (0, 9, 18):
        efficiency = model.predict(*mask.snap(D1, D2), converter.loads_W[load])
        best = efficiency[mask.allowed(D1, D2, load)].max()
        assert best <= exact.value[load] + 1e-6  # rounding of 234 single-precision sums
        assert best > exact.value[load] - 5e-4  # and it is no mirage: a nearby lattice point comes close


def test_the_target_is_the_share_of_the_square_that_is_as_good(converter, mask, model):
    best = exact_optimum(model, mask)
    rng, load = np.random.default_rng(5), 4
    D1, D2 = mask.snap(rng.random(200_000), rng.random(200_000))
    value = np.where(mask.allowed(D1, D2, load), model.predict(D1, D2, mask.loads_W[load]), -np.inf)
    share = np.mean(value >= best.value[load] - NEAR)
    # binomial: five standard deviations of a share of about 1e-3 in 200,000 draws
    assert abs(share - best.near_share[load]) < 5 * np.sqrt(max(share, 1e-4) / 200_000)


def test_the_exact_optimum_is_allowed_and_confirmed(converter, mask, model):
    exact = exact_optimum(model, mask)
    assert mask.allowed(exact.D1, exact.D2, np.arange(19)).all()
    assert converter.feasible(exact.D1, exact.D2, converter.loads_W).all()


def test_polished_search_is_within_a_hundredth_of_a_point(converter, mask, model):
    table = optimise(model, converter.loads_W, mask, seed=1, optimiser=PSO_SAVL_POLISHED)
    assert table.worst_regret <= 1e-4
    assert table.regret.min() > -1e-6  # a search that beats the exact optimum would prove it wrong
    assert table.confirmed.all()


def test_the_exact_table_has_no_regret(converter, mask, model):
    table = optimise_exactly(model, converter.loads_W, mask)
    assert table.worst_regret == 0.0
    assert table.confirmed.all()
    searched = optimise(model, converter.loads_W, mask, seed=1)
    assert (table.predicted >= searched.predicted - 1e-6).all()


def test_plain_search_reports_its_regret(converter, mask, model):
    table = optimise(model, converter.loads_W, mask, seed=1)
    assert table.optimiser == "PSO-SAVL"
    assert table.evaluations == 500
    exact = exact_optimum(model, mask).value
    np.testing.assert_allclose(
        table.regret, exact - model.predict(table.D1, table.D2, table.power_W), atol=1e-9
    )
    assert table.worst_regret == table.regret.max()


def test_same_seed_same_table(converter, mask, model):
    one, two = (
        optimise(model, converter.loads_W, mask, seed=9, optimiser=PSO_SAVL).frame() for _ in range(2)
    )
    assert one.equals(two)


def test_a_load_that_nothing_carries_is_told(converter, model):
    mask = FeasibleMap.build(converter.feasible, [1000.0, 2500.0], edge_gap=converter.edge_gap)
    table = optimise(model, [1000.0, 2500.0], mask, seed=1)
    assert np.isfinite(table.predicted).tolist() == [True, False]
    assert np.isnan(table.D1[1])
    assert table.confirmed.tolist() == [True, False]


def test_a_model_that_is_not_trees_has_no_exact_optimum(converter, mask):
    model = train_simulator_first(converter.simulated_efficiency, converter.measured_table(60, seed=1))
    table = optimise(model, converter.loads_W, mask, seed=1)
    assert np.isfinite(table.predicted).all()
    assert np.isnan(table.worst_regret)
    with pytest.raises(TypeError, match="tree ensembles"):
        exact_optimum(model, mask)


def test_a_callable_is_enough_and_a_map_of_other_loads_is_refused(converter, mask, model):
    table = optimise(model, [600.0], converter.feasible, seed=1)
    assert table.confirmed.all()
    with pytest.raises(ValueError, match="built for"):
        optimise(model, [600.0], mask, seed=1)


def test_loads_searched_apart_make_one_table_in_the_order_of_power():
    def optimum(*loads):
        values = np.array(loads)
        return OptimumTable(power_W=values, D1=values, D2=values, predicted=values, regret=values,
                            confirmed=np.ones(len(loads), bool), optimiser="any", evaluations=1)  # fmt: skip

    both = optimum(200.0, 400.0).with_loads_of(optimum(300.0, 500.0))
    assert both.frame()["D2"].tolist() == [200.0, 300.0, 400.0, 500.0]
