"""Where hypotheses start: along straight lines from the baseline."""

import numpy as np

from models.diagnosis.lines import Lines, key_of

KEY = key_of("link_resistance", {})
LINES = Lines.of(
    np.array([[1.0, 2.0]]), np.array([[[0.1, np.nan]], [[0.0, 0.2]]]), {KEY: np.array([[10.0, 20.0]])}
)


def test_the_lines_add_up() -> None:
    there = LINES.at(np.array([2.0, 1.0]), [(KEY, 0.1)])
    np.testing.assert_allclose(there, [[1.0 + 0.2 + 1.0, 2.0 + 0.2 + 2.0]])


def test_what_was_not_solved_has_no_slope() -> None:
    np.testing.assert_allclose(LINES.at(np.array([5.0, 0.0]), [])[0, 1], 2.0)


def test_an_effect_without_a_line_starts_at_the_baseline() -> None:
    np.testing.assert_allclose(LINES.at(np.zeros(2), [(key_of("fan_step", {}), 3.0)]), [[1.0, 2.0]])


def test_some_of_the_points() -> None:
    np.testing.assert_allclose(
        LINES.take(np.array([1])).at(np.array([0.0, 1.0]), [(KEY, 1.0)]), [[2.0 + 0.2 + 20.0]]
    )


def test_other_parameters_tell_variants_apart() -> None:
    assert key_of("fan_step", {"above_C": 60.0}) != key_of("fan_step", {"above_C": 70.0})
