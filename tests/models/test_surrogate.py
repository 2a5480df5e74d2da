"""D²EA and its comparators: each stage must earn its place on points that nothing was fitted to."""

import numpy as np
import pandas as pd
import pytest

from models.accuracy import accuracy, accuracy_of
from models.baselines import BASELINES, train_baseline
from models.splits import split_simulation
from models.surrogate import (
    train_d2ea,
    train_experiment_only,
    train_simulation_only,
    train_simulator_first,
)


@pytest.fixture(scope="module")
def simulated(converter):
    grid = converter.simulated_grid((25, 25, 20))
    feasible = grid[grid["feasible"]]
    return feasible.iloc[split_simulation(feasible, seed=0).train]


@pytest.fixture(scope="module")
def measured(converter):
    return converter.measured_table(100, seed=1)


@pytest.fixture(scope="module")
def judge(converter):
    return converter.measured_table(2000, seed=2, noise=0.0)


def test_the_second_stage_beats_either_source_alone(simulated, measured, judge):
    both = accuracy(train_d2ea(simulated, measured), judge).mean_abs
    assert both < 0.8 * accuracy(train_simulation_only(simulated), judge).mean_abs
    assert both < 0.8 * accuracy(train_experiment_only(measured), judge).mean_abs


def test_the_second_stage_learns_the_gap_and_not_the_whole(simulated, measured):
    model = train_d2ea(simulated, measured)
    gap = model.stages[1].predict(measured["D1"], measured["D2"], measured["P2_W"])
    first = model.stages[0].predict(measured["D1"], measured["D2"], measured["P2_W"])
    # 94 trees at rate 0.1 leave little of the training gap: XGBoost makes no split that gains less than 1e-6
    # of squared error, 0.001 of efficiency at one point
    np.testing.assert_allclose(first + gap, measured["efficiency"], atol=2e-3)
    assert np.abs(gap).max() < 0.1


def test_the_simulator_as_first_stage_beats_trees_that_imitate_it(converter, simulated, measured, judge):
    model = train_simulator_first(converter.simulated_efficiency, measured)
    assert accuracy(model, judge).mean_abs < 0.5 * accuracy(train_d2ea(simulated, measured), judge).mean_abs


def test_the_simulator_as_first_stage_predicts_nothing_where_infeasible(converter, measured):
    model = train_simulator_first(converter.simulated_efficiency, measured)
    assert np.isnan(model.predict(0.1, 0.9, 2000.0))
    assert np.isfinite(model.predict(0.8, 0.2, 500.0))


def test_measured_points_that_the_simulator_cannot_reach_are_left_out(converter, measured):
    stray = pd.DataFrame({"D1": [0.1], "D2": [0.9], "P2_W": [1900.0], "efficiency": [0.9]})
    with_stray = train_simulator_first(converter.simulated_efficiency, pd.concat([measured, stray]))
    without = train_simulator_first(converter.simulated_efficiency, measured)
    assert with_stray.predict(0.8, 0.2, 900.0) == without.predict(0.8, 0.2, 900.0)


def test_infeasible_rows_do_not_train(converter, simulated):
    whole = converter.simulated_grid((9, 9, 5))
    feasible = whole[whole["feasible"]]
    x = (simulated["D1"], simulated["D2"], simulated["P2_W"])
    np.testing.assert_array_equal(
        train_simulation_only(whole).predict(*x), train_simulation_only(feasible).predict(*x)
    )


@pytest.mark.parametrize("kind", BASELINES)
def test_every_baseline_learns_and_repeats_itself(kind, measured, judge):
    model = train_baseline(kind, measured, seed=3)
    guess = accuracy_of(np.full(len(judge), measured["efficiency"].mean()), judge["efficiency"].to_numpy())
    assert accuracy(model, judge).mean_abs < 0.7 * guess.mean_abs  # the mean is what knowing nothing gives
    again = train_baseline(kind, measured, seed=3)
    assert again.predict(0.7, 0.2, 900.0) == model.predict(0.7, 0.2, 900.0)


def test_an_unknown_baseline_is_named():
    with pytest.raises(ValueError, match="svr, br, rf, nn, gp"):
        train_baseline("oracle", pd.DataFrame(), seed=0)


def test_accuracy_by_hand():
    result = accuracy_of(np.array([0.91, 0.98, np.nan]), np.array([0.90, 1.00, 0.5]))
    assert result.mean_abs == pytest.approx(0.015)
    assert result.worst_abs == pytest.approx(0.02)
    assert result.percentage == pytest.approx(1 - (0.01 / 0.9 + 0.02) / 2)
    assert (result.points, result.unpredicted) == (2, 1)


def test_accuracy_of_nothing_is_refused():
    with pytest.raises(ValueError, match="none of 1 points"):
        accuracy_of(np.array([np.nan]), np.array([0.9]))
