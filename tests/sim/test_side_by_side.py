"""Parts in processes of their own: the same results in the same order, and no process left whatever happens.

What forks runs in a fresh interpreter: here threads of other tests may still be alive, beside which nothing is forked.
"""

import os
import subprocess
import sys
import threading

import numpy as np

from sim.model import Model
from sim.operating_points import grid
from sim.side_by_side import side_by_side
from sim.space import Columns, solve_rows

HEAD = "import multiprocessing, os, signal\nfrom sim.side_by_side import ProcessEnded, side_by_side\n"


def fresh(program: str) -> str:
    """What a program prints that begins like this module."""
    command = [sys.executable, "-c", HEAD + program]
    return subprocess.run(command, check=True, capture_output=True, text=True).stdout.strip()


def grid_columns() -> Columns:
    points = grid((12, 12, 15))
    return {"D1": np.asarray(points.D1), "D2": np.asarray(points.D2), "P_set_W": np.asarray(points.power_W)}


def test_parts_keep_their_order_and_have_processes_of_their_own() -> None:
    program = """
found = side_by_side(lambda part: (part, os.getpid()), [1, 2, 3])
print([part for part, _ in found], len({pid for _, pid in found}), found[0][1] == os.getpid())
"""
    assert fresh(program) == "[1, 2, 3] 3 True"


def test_beside_a_thread_nothing_is_forked() -> None:
    ended = threading.Event()
    thread = threading.Thread(target=ended.wait)
    thread.start()
    try:
        assert set(side_by_side(lambda _: os.getpid(), [1, 2])) == {os.getpid()}
    finally:
        ended.set()
        thread.join()


def test_an_error_of_a_part_is_raised_where_they_meet() -> None:
    program = """
for failing in (0, 1):
    def work(part):
        if part == failing:
            raise ValueError(f"not {part}")
    try:
        side_by_side(work, [0, 1])
    except ValueError as error:
        print(error, multiprocessing.active_children())
"""
    assert fresh(program).splitlines() == ["not 0 []", "not 1 []"]


def test_a_killed_process_is_told() -> None:
    program = """
try:
    side_by_side(lambda part: part and os.kill(os.getpid(), signal.SIGKILL), [0, 1])
except ProcessEnded:
    print("told")
"""
    assert fresh(program) == "told"


def test_forks_that_are_kept_answer_again() -> None:
    program = """
from sim.side_by_side import kept
def work(part):
    return part, os.getpid()
with kept(3):
    found = [side_by_side(work, [1, 2, 3]) for _ in range(2)]
print([part for part, _ in found[0]], found[0] == found[1], len({pid for _, pid in found[0]}))
print(multiprocessing.active_children())
"""
    assert fresh(program).splitlines() == ["[1, 2, 3] True 3", "[]"]


def test_forks_that_are_kept_outlive_what_keeps_them_too() -> None:
    program = """
from sim.side_by_side import kept
def work(part):
    return os.getpid()
found = []
with kept(2):
    for _ in range(2):
        with kept(2):
            found.append(side_by_side(work, [1, 2]))
    print(found[0] == found[1], len(multiprocessing.active_children()))
print(multiprocessing.active_children())
"""
    assert fresh(program).splitlines() == ["True 1", "[]"]


def test_garbage_is_looked_for_in_what_is_new_while_forks_are_kept() -> None:
    """And everywhere again afterwards, but for what the program itself had put aside."""
    program = """
import gc
from sim.side_by_side import kept
def aside(processes):
    with kept(processes):
        inside = gc.get_freeze_count()
    return inside > 1000, gc.get_freeze_count() > 1000
print(aside(1), aside(2))
gc.freeze()
print(aside(2))
"""
    assert fresh(program).splitlines() == ["(False, False) (True, False)", "(True, True)"]


def test_an_error_leaves_no_answer_behind() -> None:
    program = """
from sim.side_by_side import kept
def work(part):
    if part < 0:
        raise ValueError(part)
    return part
with kept(2):
    for failing in ([-1, 7], [7, -1]):
        try:
            side_by_side(work, failing)
        except ValueError as error:
            print(error, side_by_side(work, [1, 2]))
"""
    assert fresh(program).splitlines() == ["-1 [1, 2]"] * 2


def test_a_killed_fork_that_was_kept_is_told() -> None:
    program = """
from sim.side_by_side import kept
def work(part):
    return part and os.kill(os.getpid(), signal.SIGKILL)
with kept(2):
    try:
        side_by_side(work, [0, 1])
    except ProcessEnded:
        print("told", side_by_side(abs, [-1, -2]))
"""
    assert fresh(program) == "told [1, 2]"


def test_a_part_shares_no_further() -> None:
    """The fork that is kept is busy with the other part: what comes back next is the answer to that."""
    program = """
from functools import partial
from sim.side_by_side import at_once, kept
with kept(2):
    print(at_once(partial(at_once, partial(min, 3, 4), partial(max, 3, 4)), partial(abs, -5)))
    print(at_once(partial(abs, -1), partial(abs, -2)))
"""
    assert fresh(program).splitlines() == ["[[3, 4], 5]", "[1, 2]"]


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
