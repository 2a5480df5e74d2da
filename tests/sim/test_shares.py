"""Who solves which circuits: each once, the slow ones where they cost least."""

import numpy as np
import pytest

from sim.shares import Share, shares


@pytest.mark.parametrize("processes", [1, 2, 3])
@pytest.mark.parametrize("rows", [1, 95, 400, 5000])
def test_every_circuit_is_solved_once(rows: int, processes: int) -> None:
    rng = np.random.default_rng([rows, processes])
    for size in (1, 2, 7, 60):
        saturates = (rng.random(size) < 0.2).tolist()
        found = shares(saturates, rows, processes)
        assert 1 <= len(found) <= processes
        assert sorted(k for own in found for call in own.calls for k in call) == list(range(size))


def test_few_rows_are_one_call_of_one_process() -> None:
    (whole,) = shares([False, True, False], 20, 2)
    assert whole.calls == [[0, 1, 2]]


def test_many_circuits_are_not_slowed_down_by_one_that_saturates() -> None:
    assert Share((0, 2, 3), (1,), 5000).calls == [[0, 2, 3], [1]]


def test_what_saturates_stays_together_where_processes_are_as_busy_without() -> None:
    saturating, others = shares([True, True, True, *[False] * 25], 100, 2)
    assert saturating.circuits[:3] == (0, 1, 2)
    assert not {0, 1, 2}.intersection(others.circuits)


def test_a_second_process_takes_about_half_of_many_rows() -> None:
    one, two = shares([False] * 100, 400, 2)
    assert len(one.circuits) == len(two.circuits) == 50
