"""Work in another process: its result, its error, its end when those who wait give up."""

import os
import signal
from functools import partial

import pytest

from bench.beside import WorkLost, beside

SOON_S = 0.05


def nothing() -> None:
    """Meanwhile."""


def test_the_result_comes_from_another_process() -> None:
    assert beside(os.getpid, nothing, SOON_S) != os.getpid()


def test_what_the_work_raises_is_raised_here() -> None:
    with pytest.raises(ValueError, match="invalid literal"):
        beside(partial(int, "no number"), nothing, SOON_S)


def test_work_that_dies_is_told() -> None:
    with pytest.raises(WorkLost, match="code 3"):
        beside(partial(os._exit, 3), nothing, SOON_S)


def test_those_who_wait_are_heard_and_may_give_up() -> None:
    def meanwhile() -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        beside(signal.pause, meanwhile, SOON_S)  # until it is killed
