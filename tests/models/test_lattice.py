"""The optimum on a lattice: the highest hill, however narrow, and nothing that cannot run."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from models.boosting import Floats
from models.lattice import hills_on_lattice, optimise_on_lattice

LOADS = np.array([300.0, 900.0])


@dataclass(frozen=True)
class Hills:
    """A broad hill, and a narrow one between two nodes that is a little higher."""

    broad: tuple[float, float] = (0.72, 0.24)
    narrow: tuple[float, float] = (0.46, 0.62)

    def predict(self, D1: ArrayLike, D2: ArrayLike, power_W: ArrayLike) -> Floats:
        def hill(top: tuple[float, float], width: float) -> Floats:
            return np.exp(-((np.asarray(D1) - top[0]) ** 2 + (np.asarray(D2) - top[1]) ** 2) / width**2)

        value = 0.96 + 0.01 * hill(self.broad, 0.3) + 0.012 * hill(self.narrow, 0.03)
        return np.where(np.asarray(D1) + np.asarray(D2) < 1.2, value, np.nan)


def test_a_narrow_hill_between_nodes_is_found_where_it_is_the_highest() -> None:
    found = optimise_on_lattice(Hills(), LOADS)
    # the last steps are 0.04 x 0.4^3 / 2 = 0.0013 apart
    np.testing.assert_allclose(found.D1, 0.46, atol=2e-3)
    np.testing.assert_allclose(found.D2, 0.62, atol=2e-3)
    assert np.all(found.predicted > 0.972)


def test_a_narrow_hill_that_is_low_at_its_nodes_is_climbed_beside_broader_ones() -> None:
    class Crowded:
        def predict(self, D1: ArrayLike, D2: ArrayLike, power_W: ArrayLike) -> Floats:
            def hill(first: float, second: float, width: float) -> Floats:
                apart = (np.asarray(D1) - first) ** 2 + (np.asarray(D2) - second) ** 2
                return np.exp(-apart / width**2)

            broad = sum(hill(0.2 * k, 0.2 * j, 0.05) for k in range(1, 5) for j in (1, 2))
            return 0.96 + 0.008 * broad + 0.012 * hill(0.5, 0.82, 0.02)

    found = optimise_on_lattice(Crowded(), LOADS)  # eight hills are higher at their nodes
    assert np.all(found.predicted > 0.971)


def test_where_nothing_runs_there_is_no_optimum() -> None:
    class Nothing:
        def predict(self, D1: ArrayLike, D2: ArrayLike, power_W: ArrayLike) -> Floats:
            return np.full(np.shape(D1), np.nan)

    found = optimise_on_lattice(Nothing(), LOADS)
    assert np.isnan(found.D1).all()
    assert not found.confirmed.any()


def test_a_point_that_cannot_run_is_no_optimum() -> None:
    found = optimise_on_lattice(Hills(narrow=(0.8, 0.6)), LOADS)  # beyond the edge
    assert np.all(found.D1 + found.D2 < 1.2)
    assert np.all(np.isfinite(found.predicted))


def test_a_hill_that_the_nodes_miss_at_one_load_is_found_from_the_next() -> None:
    class Ridge:
        """A ridge whose many tops are higher at their nodes than a hill that is narrow at the lower load."""

        def predict(self, D1: ArrayLike, D2: ArrayLike, power_W: ArrayLike) -> Floats:
            x, y = np.asarray(D1), np.asarray(D2)
            ridge = np.exp(-((x + y - 0.9) ** 2) / 0.05**2) * (1 + 0.1 * np.sin(40 * (x - y)) ** 2)
            width = np.where(np.asarray(power_W) > 500.0, 0.05, 0.008)
            hill = np.exp(-((x - 0.86) ** 2 + (y - 0.42) ** 2) / width**2)  # two hundredths off the nodes
            return np.asarray(0.96 + 0.005 * ridge + 0.008 * hill)

    found = optimise_on_lattice(Ridge(), LOADS)
    np.testing.assert_allclose(found.D1, 0.86, atol=2e-3)  # the last steps are 0.0013 apart
    assert np.all(found.predicted > 0.967)


def test_tops_are_kept_that_lie_apart_from_the_highest() -> None:
    class Ridge:
        """Sixteen tops on one ridge, and a lower hill far from it."""

        def predict(self, D1: ArrayLike, D2: ArrayLike, power_W: ArrayLike) -> Floats:
            x, y = np.asarray(D1), np.asarray(D2)
            ridge = np.exp(-((y - 0.2) ** 2) / 0.03**2) * (1 + 0.01 * np.cos(100 * x))
            return np.asarray(
                0.96 + 0.01 * ridge + 0.008 * np.exp(-((x - 0.5) ** 2 + (y - 0.8) ** 2) / 0.1**2)
            )

    tops = hills_on_lattice(Ridge(), LOADS)
    assert np.any(np.hypot(tops.D1 - 0.5, tops.D2 - 0.8) < 2e-3, axis=1).all()


def test_no_point_is_asked_twice() -> None:
    asked: list[tuple[float, ...]] = []

    class Counting(Hills):
        def predict(self, D1: ArrayLike, D2: ArrayLike, power_W: ArrayLike) -> Floats:
            asked.extend(zip(*(np.round(x, 9).tolist() for x in (D1, D2, power_W)), strict=True))
            return super().predict(D1, D2, power_W)

    hills_on_lattice(Counting(), LOADS)
    assert len(asked) == len(set(asked))


@dataclass(frozen=True)
class Cliff:
    """A slope up to a line along which it ends, and a very little less all the way behind that line."""

    edges_known_to: float = 0.002

    def predict(self, D1: ArrayLike, D2: ArrayLike, power_W: ArrayLike) -> Floats:
        beyond = np.asarray(D1) - 0.6
        return (
            0.97 + np.where(beyond < 0.0, 5e-2 * beyond, -1e-4 * beyond) - 1e-3 * np.abs(np.asarray(D2) - 0.2)
        )


def test_a_model_that_is_unsure_of_its_edges_keeps_off_the_slope_before_one() -> None:
    @dataclass(frozen=True)
    class Sure:
        of: Cliff

        def predict(self, D1: ArrayLike, D2: ArrayLike, power_W: ArrayLike) -> Floats:
            return self.of.predict(D1, D2, power_W)

    unsure = optimise_on_lattice(Cliff(), LOADS)
    sure = optimise_on_lattice(Sure(Cliff()), LOADS)
    np.testing.assert_allclose(sure.D1, 0.6, atol=2e-3)  # of the last steps
    assert np.all(unsure.D1 >= 0.602 - 1e-9)  # nothing that it is averaged over lies before the edge
    assert np.all(unsure.D1 <= sure.D1 + 0.002 + 1e-9)
    np.testing.assert_array_equal(unsure.predicted, Cliff().predict(unsure.D1, unsure.D2, LOADS))


def test_what_is_averaged_over_can_run() -> None:
    class Fenced(Cliff):
        def predict(self, D1: ArrayLike, D2: ArrayLike, power_W: ArrayLike) -> Floats:
            free = np.asarray(D1) < 0.603
            return np.where(free, 0.97 - np.abs(np.asarray(D1) - 0.6), np.nan)

    found = optimise_on_lattice(Fenced(), LOADS)
    assert np.all(found.D1 + 0.002 < 0.603)


def test_a_load_that_can_run_at_one_place_only_keeps_it() -> None:
    class Lonely(Cliff):
        def predict(self, D1: ArrayLike, D2: ArrayLike, power_W: ArrayLike) -> Floats:
            alone = (np.abs(np.asarray(D1) - 0.6) < 1e-4) & (np.abs(np.asarray(D2) - 0.2) < 1e-4)
            return np.where(alone, 0.97, np.nan)

    found = optimise_on_lattice(Lonely(), LOADS)
    np.testing.assert_allclose(found.D1, 0.6, atol=1e-9)
    assert found.confirmed.all()


def test_a_full_pulse_has_no_edge_that_could_be_elsewhere() -> None:
    class Full(Cliff):
        def predict(self, D1: ArrayLike, D2: ArrayLike, power_W: ArrayLike) -> Floats:
            shorter = 0.965 - np.abs(np.asarray(D1) - 0.9)
            short_notch = (np.asarray(D1) > 0.99) & (np.asarray(D1) < 1.0)  # too short to be made
            value = np.where(np.asarray(D1) == 1.0, 0.9655, np.where(short_notch, np.nan, shorter))
            return value - np.abs(np.asarray(D2) - 0.2)

    found = optimise_on_lattice(Full(), LOADS)
    np.testing.assert_array_equal(found.D1, 1.0)
