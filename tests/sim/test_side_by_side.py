"""Parts in processes of their own: the same results in the same order, and no process left whatever happens."""

import multiprocessing
import os
import signal
import threading

import numpy as np
import pytest

from sim.model import Model
from sim.operating_points import grid
from sim.side_by_side import ProcessEnded, side_by_side
from sim.space import Columns, solve_rows


def grid_columns() -> Columns:
    points = grid((12, 12, 15))
    return {"D1": np.asarray(points.D1), "D2": np.asarray(points.D2), "P_set_W": np.asarray(points.power_W)}


def test_parts_keep_their_order_and_have_processes_of_their_own() -> None:
    found = side_by_side(lambda part: (part, os.getpid()), [1, 2, 3])
    assert [part for part, _ in found] == [1, 2, 3]
    assert len({pid for _, pid in found}) == 3
    assert found[0][1] == os.getpid()


def test_beside_a_thread_nothing_is_forked() -> None:
    ended = threading.Event()
    thread = threading.Thread(target=ended.wait)
    thread.start()
    try:
        assert set(side_by_side(lambda _: os.getpid(), [1, 2])) == {os.getpid()}
    finally:
        ended.set()
        thread.join()


@pytest.mark.parametrize("failing", [0, 1])
def test_an_error_of_a_part_is_raised_here(failing: int) -> None:
    def work(part: int) -> int:
        if part == failing:
            raise ValueError("not this one")
        return part

    with pytest.raises(ValueError, match="not this one"):
        side_by_side(work, [0, 1])
    assert not multiprocessing.active_children()


def test_a_killed_process_is_told() -> None:
    def work(part: int) -> None:
        if part:
            os.kill(os.getpid(), signal.SIGKILL)

    with pytest.raises(ProcessEnded):
        side_by_side(work, [0, 1])


def test_two_processes_simulate_what_one_does() -> None:
    columns = grid_columns()
    alone, shared = (solve_rows(Model.baseline(), columns, processes) for processes in (1, 2))
    assert list(shared) == list(alone)
    for name, values in alone.items():
        if values.dtype.kind == "f":
            # neighbours in a call change the order of sums
            np.testing.assert_allclose(shared[name], values, rtol=1e-6, atol=1e-6, err_msg=name)
        else:
            np.testing.assert_array_equal(shared[name], values)
