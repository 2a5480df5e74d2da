"""Blocks kept from every model: the same ones however many measurements there are."""

import numpy as np
import pandas as pd

from models.held_blocks import held_out

RATED_W = 2000.0


def points(count, seed=1):
    rng = np.random.default_rng(seed)
    return pd.DataFrame(
        {"D1": rng.random(count), "D2": rng.random(count), "P2_W": rng.uniform(200, 2000, count)}
    )


def test_a_point_keeps_its_side_when_others_come():
    table = points(400)
    np.testing.assert_array_equal(held_out(table, RATED_W)[:100], held_out(table.iloc[:100], RATED_W))


def test_about_a_fifth_is_held_out():
    # 4000 points in 800 cells: the share of cells is 0.2 +- 0.014, of points 0.2 +- 0.02
    assert abs(held_out(points(4000), RATED_W).mean() - 0.2) < 0.06


def test_readings_of_one_set_point_stay_together():
    table = points(200)
    again = table.assign(P_set_W=table["P2_W"], P2_W=table["P2_W"] * 1.01)
    np.testing.assert_array_equal(held_out(again, RATED_W), held_out(table, RATED_W))


def test_a_round_set_point_belongs_to_the_cell_above():
    tenths = np.arange(1, 10) / 10  # 0.3 / 0.1 is less than 3 in floating point
    D1, D2 = (x.ravel() for x in np.meshgrid(tenths, tenths))
    on_edges = pd.DataFrame({"D1": D1, "D2": D2, "P2_W": 500.0})
    inside = pd.DataFrame({"D1": D1 + 0.05, "D2": D2 + 0.05, "P2_W": 600.0})
    np.testing.assert_array_equal(held_out(on_edges, RATED_W), held_out(inside, RATED_W))


def test_a_converter_of_another_size_has_blocks_of_its_own_size():
    table = points(400)
    small = table.assign(P2_W=table["P2_W"] / 20.0)
    np.testing.assert_array_equal(held_out(small, RATED_W / 20.0), held_out(table, RATED_W))
    band = np.linspace(10.0, 100.0, 200)  # in one cell of a 2-kW converter
    sides = held_out(pd.DataFrame({"D1": 0.85, "D2": 0.15, "P2_W": band}), RATED_W / 20.0)
    assert 0 < sides.sum() < sides.size
