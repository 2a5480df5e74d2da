"""The tree ensembles: their settings, their leaves as boxes, and that a file gives back the same model."""

from dataclasses import replace

import numpy as np
import pytest

from models.boosting import XGBOOST_I, XGBOOST_II, BoostedTrees, BoostSettings


@pytest.fixture(scope="module")
def trees(converter):
    table = converter.measured_table(150, seed=1)
    return BoostedTrees.fit((table["D1"], table["D2"], table["P2_W"]), table["efficiency"], XGBOOST_II)


def test_table_3_settings():
    assert (XGBOOST_I.depth, XGBOOST_I.trees, XGBOOST_I.l2, XGBOOST_I.rate) == (11, 140, 1.0, 0.05)
    assert (XGBOOST_II.depth, XGBOOST_II.trees, XGBOOST_II.l2, XGBOOST_II.rate) == (9, 94, 0.01, 0.1)


def test_boxes_sum_to_the_prediction(trees):
    x = np.random.default_rng(0).random((200, 3)) * [1, 1, 1800] + [0, 0, 200]
    boxes = trees.boxes()
    point = x.astype(np.float32)[:, None, :]
    inside = ((boxes.low <= point) & (point < boxes.high)).all(axis=2)
    assert (inside.sum(axis=1) == XGBOOST_II.trees).all()  # one leaf of every tree
    total = boxes.base + inside @ boxes.value
    # 94 single-precision additions of about 1 lose at most about 94 * 6e-8
    np.testing.assert_allclose(total, trees.predict(*x.T), atol=6e-6)


def test_leaves_at_a_power_are_those_that_hold_there(trees):
    boxes = trees.boxes()
    holds = (boxes.low[:, 2] <= 700.0) & (boxes.high[:, 2] > 700.0)
    assert 0 < holds.sum() < len(holds)
    np.testing.assert_array_equal(boxes.at_power(700.0).value, boxes.value[holds])


def test_training_is_deterministic(converter):
    table = converter.measured_table(150, seed=1)
    inputs = (table["D1"], table["D2"], table["P2_W"])
    one, two = (BoostedTrees.fit(inputs, table["efficiency"], XGBOOST_II).predict(*inputs) for _ in range(2))
    np.testing.assert_array_equal(one, two)


def test_prediction_keeps_the_broadcast_shape(trees):
    assert trees.predict(np.zeros((3, 1)), np.zeros(4), 500.0).shape == (3, 4)
    assert trees.predict(0.5, 0.5, 500.0).shape == ()


def test_a_saved_ensemble_predicts_the_same(trees, tmp_path, converter):
    trees.save(tmp_path / "trees.ubj")
    again = BoostedTrees.load(tmp_path / "trees.ubj")
    table = converter.measured_table(50, seed=2)
    x = (table["D1"], table["D2"], table["P2_W"])
    np.testing.assert_array_equal(again.predict(*x), trees.predict(*x))
    assert again.settings == XGBOOST_II


def test_what_is_not_finite_is_refused():
    with pytest.raises(ValueError, match="infeasible"):
        BoostedTrees.fit(([0.1, 0.2], [0.1, 0.2], [500, 600]), [0.9, np.nan], XGBOOST_I)
    with pytest.raises(ValueError, match="at least one"):
        BoostedTrees.fit(([], [], []), [], XGBOOST_I)


def test_settings_out_of_range_are_refused():
    with pytest.raises(ValueError, match="rate"):
        BoostSettings(depth=3, trees=5, l2=1.0, rate=0.0)
    with pytest.raises(ValueError, match="depth"):
        BoostSettings(depth=0, trees=5, l2=1.0, rate=0.1)


def test_the_first_trees_are_what_shorter_training_gives(trees, converter):
    table = converter.measured_table(150, seed=1)
    inputs = (table["D1"], table["D2"], table["P2_W"])
    short = BoostedTrees.fit(inputs, table["efficiency"], replace(XGBOOST_II, trees=20))
    np.testing.assert_array_equal(trees.first(20).predict(*inputs), short.predict(*inputs))


def test_further_inputs_are_learned_and_have_no_boxes():
    rng = np.random.default_rng(3)
    x = rng.random((4, 400))
    five = BoostedTrees.fit(list(x), x[3] > 0.5, XGBOOST_II, ("voltage_ratio",))
    assert five.predict(0.5, 0.5, 0.5, np.array([0.2, 0.8])).round(2).tolist() == [0.0, 1.0]
    with pytest.raises(ValueError, match="further inputs"):
        five.boxes()
