"""Rows where the optimum is decided: at the hills that might be the highest, not at the others."""

from dataclasses import dataclass, replace
from types import SimpleNamespace

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


@dataclass(frozen=True)
class Hill:
    """One hill over (D1, D2) that bends by ``bend`` and ends at ``most``; a point of it is as unsure as a row."""

    bend: float
    most: float = 1.0
    leftover = SimpleNamespace(noise_W=np.full(1, 0.1), place=np.array([[0.5, 0.5, 500.0, 0.0, 10.0]]))

    def vouched(self) -> "Hill":
        return self

    def predict(self, D1: np.ndarray, D2: np.ndarray, power_W: np.ndarray) -> np.ndarray:
        return np.where(self.most < D2, np.nan, 0.98 - self.bend * ((D1 - 0.5) ** 2 + (D2 - 0.3) ** 2))

    def left_open(self, place: np.ndarray) -> np.ndarray:
        return np.asarray(SIGMA**2 * np.eye(len(place)))


@pytest.mark.parametrize(
    ("hill", "around"),
    # 0.02 aside a hill of bend 1 is 4e-4 lower, at the corners 8e-4: rivals; one of bend 2 is 16e-4 lower there
    [(Hill(1.0), 8), (Hill(2.0), 4), (Hill(1.0, most=0.315), 5), (Hill(100.0), 0)],
)
def test_points_around_a_top_are_rivals_where_they_are_nearly_as_high(hill: Hill, around: int) -> None:
    of = RivalHills.of(hill, np.array([400.0, 800.0]))  # type: ignore[arg-type]
    steps = (of.place[:, :2] - (0.5, 0.3)) / 0.02
    whole = np.all(np.abs(steps - np.round(steps)) < 1e-6, axis=1)  # what is around tops, not around slopes
    assert np.bincount(of.load[whole]).tolist() == [1 + around, 1 + around]
    np.testing.assert_allclose(of.efficiency, hill.predict(*of.place.T))
    assert np.all(of.efficiency >= 0.979)
    # each load's best point stands against its own rivals: none is 1e-3 above it
    assert np.all(of.lost() < SIGMA)


def test_many_points_of_one_rival_hill_count_once() -> None:
    one, three = rivals([0.970, 0.9698], [0, 0]), rivals([0.970, *[0.9698] * 3], [0] * 4)
    assert three.lost()[0] == pytest.approx(one.lost()[0])


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
    assert of.chosen(4, np.array([False, False, True])) == [2, 2, 2, 2]
    assert not of.chosen(4, np.zeros(3, dtype=bool))


def test_rows_go_where_a_hill_may_be_much_higher_than_the_model_sees_it() -> None:
    """Two of its sigmas below the best, six times as vague as a row: little is lost on average, much in a rare case."""
    of = rivals([0.970, 0.9699, 0.980, 0.9776], [0, 0, 1, 1])
    of = replace(of, covariance=np.diag([1.0, 1.0, 0.0, 36.0]) * SIGMA**2)
    assert of.lost()[1] < 0.2 * of.lost()[0]
    assert next(of.worth_most(1))[0] in (0, 1)
    assert of.chosen(1) == [3]
