"""The live pictures: bounded however long a campaign is, exact while it is short, every axis with its unit."""

import json

import numpy as np

from bench.dashboard import charts
from bench.dashboard.rows import NO_ROWS, Rows


def rows(count: int, **values: object) -> Rows:
    rng = np.random.default_rng(1)
    made = []
    for D1, D2, P_W, eta in zip(*(rng.random((4, count))), strict=True):
        row = {"kind": "load", "state": "accepted", "D1": D1, "D2": D2, "P_set_W": 200 + 1800 * P_W}
        row |= {
            "P2_W": row["P_set_W"],
            "efficiency": 0.9 + 0.09 * eta,
            "predicted_efficiency": 0.97,
            "u_efficiency": 1e-3,
        }
        made.append(row | values)
    return Rows.of(made)


def test_ten_thousand_points_are_a_bounded_picture() -> None:
    many = rows(10_000)
    drawn = charts.maps(many, many)["measured"]["data"][0]
    assert len(drawn["x"]) <= charts.CELLS**2
    assert sum(drawn["customdata"]) == 10_000
    assert len(json.dumps(charts.maps(many, many))) < 300_000
    assert len(charts.difference_over_power(many, many)["data"][0]["x"]) <= charts.MOST


def test_a_few_points_are_shown_where_they_are() -> None:
    few = rows(3)
    drawn = charts.maps(few, few)["measured"]["data"][0]
    assert sorted(drawn["x"]) == sorted(few.D1.round(4).tolist())
    assert sorted(drawn["marker"]["color"]) == sorted((100 * few.efficiency).round(4).tolist())


def test_a_rejected_point_is_in_no_picture() -> None:
    shown = charts.maps(rows(5, state="rejected"), rows(5))
    assert shown["measured"]["data"][0]["x"] == []
    assert len(shown["simulated"]["data"][0]["x"]) == 5


def test_bands_of_load_share_the_points_among_them() -> None:
    some = rows(200)
    parts = [len(charts.loaded(some, band, 2000.0)) for band in ("light", "medium", "heavy")]
    assert min(parts) > 0
    assert sum(parts) == len(charts.loaded(some, "all loads", 2000.0)) == 200


def test_every_axis_names_its_unit() -> None:
    some = rows(4)
    table = [
        {"P_W": 200.0, "D1": 0.5, "D2": 0.1, "predicted": 0.97, "predicted_low": 0.96, "predicted_high": 0.98}
    ]
    figures = [*charts.maps(some, some).values(), charts.difference_over_power(some, some)]
    figures += [*charts.optimum(table).values(), charts.compared([500.0], [0.001], [0.001])]
    for figure in figures:
        for axis in ("xaxis", "yaxis"):
            assert "(" in figure["layout"][axis]["title"]["text"]


def test_nothing_measured_yet_is_an_empty_picture() -> None:
    assert charts.maps(NO_ROWS, NO_ROWS)["difference"]["data"][0]["x"] == []
