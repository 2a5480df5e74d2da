"""Rows where the optimum is decided: at the hills that might be the highest, not at the others."""

from dataclasses import replace

import numpy as np
import pytest

from models.rival_hills import RivalHills

SIGMA = 2e-4  # of each hill, and of a reading: a usual one of one row


def rivals(efficiency: list[float], load: list[int]) -> RivalHills:
    """Independent hills."""
    count = len(load)
    return RivalHills(
        place=np.zeros((count, 3)),
        load=np.array(load),
        efficiency=np.array(efficiency),
        covariance=SIGMA**2 * np.eye(count),
        noise=SIGMA,
    )


def test_what_is_lost_on_average_is_that_of_drawn_hills() -> None:
    of = rivals([0.970, 0.9698], [0, 0])
    drawn = of.efficiency + SIGMA * np.random.default_rng(1).standard_normal((200_000, 2))
    # the mean of so many is known to 0.3 % of a sigma, twice that of what is lost here
    assert of.lost()[0] == pytest.approx(np.mean(drawn.max(axis=1) - drawn[:, 0]), rel=0.02)


def test_the_best_choice_after_measuring_gains_what_was_said() -> None:
    of, rng = rivals([0.970, 0.9698], [0, 0]), np.random.default_rng(2)
    (row, gain), *_ = of.worth_most(1)
    truth = of.efficiency + SIGMA * rng.standard_normal((200_000, 2))
    read = truth[:, row] + of.noise * rng.standard_normal(len(truth))
    after = np.tile(of.efficiency, (len(truth), 1))
    after[:, row] += 0.5 * (read - of.efficiency[row])  # hill and reading are as sure as each other
    # the mean of so many is known to half a per cent of itself
    assert gain == pytest.approx(np.mean(after.max(axis=1) - after[:, 0]), rel=0.02)


def test_rows_go_where_the_hills_are_as_high_as_each_other() -> None:
    of = rivals([0.970, 0.9699, 0.980, 0.975], [0, 0, 1, 1])
    chosen, gains = zip(*of.worth_most(6), strict=True)
    assert set(chosen) == {0, 1}
    assert np.all(np.diff(gains) < 0)  # every further row tells less
    assert of.lost()[1] < 1e-3 * of.lost()[0]


def test_two_tops_of_one_hill_are_no_rivals() -> None:
    of = replace(rivals([0.970, 0.970], [0, 0]), covariance=np.full((2, 2), SIGMA**2))
    assert of.lost()[0] == pytest.approx(0.0, abs=1e-9)
    assert next(of.worth_most(1))[1] == pytest.approx(0.0, abs=1e-9)


def test_what_may_not_be_set_is_not_chosen() -> None:
    of = rivals([0.970, 0.9699, 0.9698], [0, 0, 0])
    chosen = [row for row, _ in of.worth_most(4, np.array([False, False, True]))]
    assert chosen == [2, 2, 2, 2]
    assert not list(of.worth_most(4, np.zeros(3, dtype=bool)))
