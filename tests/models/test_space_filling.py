"""Points far from each other: each the farthest of all candidates, in the units that axes are counted in."""

from itertools import islice

import numpy as np

from models.space_filling import farthest

SPAN = np.array([1.0, 2000.0])


def test_each_point_is_the_farthest_from_what_is_known_and_from_those_before() -> None:
    rng = np.random.default_rng(3)
    candidates, known = SPAN * rng.uniform(size=(60, 2)), SPAN * rng.uniform(size=(4, 2))
    chosen = list(islice(farthest(candidates, known, SPAN), 8))
    for turn, row in enumerate(chosen):
        before = np.concatenate([known, candidates[chosen[:turn]]]) / SPAN
        nearest = np.linalg.norm((candidates / SPAN)[:, None] - before, axis=2).min(axis=1)
        assert nearest[row] == nearest.max()


def test_corners_of_a_box_come_before_its_inside() -> None:
    inside = SPAN * np.random.default_rng(4).uniform(0.1, 0.9, size=(50, 2))
    corners = SPAN * np.array([[0.0, 0.0], [0.0, 1.0], [1.0, 0.0], [1.0, 1.0]])
    chosen = list(islice(farthest(np.concatenate([inside, corners]), corners[:1], SPAN), 3))
    assert sorted(chosen) == [51, 52, 53]


def test_the_first_candidate_comes_first_where_nothing_is_known_and_an_axis_without_span_does_no_harm() -> (
    None
):
    candidates = np.array([[0.2, 7.0], [0.9, 7.0], [0.3, 7.0]])
    assert list(farthest(candidates, np.empty((0, 2)), np.ptp(candidates, axis=0))) == [0, 1, 2]
