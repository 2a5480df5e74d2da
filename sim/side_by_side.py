"""Parts of one computation in processes of their own, for programs that own their process: commands and benchmarks.

A process that is forked has all that this one has at once, so nothing is imported or handed over again; what comes back
is pickled. Nothing is forked where threads run (a server, a dashboard): a lock that one of them holds would stay locked
in the copy. Then, and for a single part, all is done here, one part after the other.
"""

import multiprocessing
import signal
import threading
import warnings
from collections.abc import Callable, Sequence
from multiprocessing.connection import Connection
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

P = TypeVar("P")
R = TypeVar("R")


class ProcessEnded(RuntimeError):
    """A process ended without a result; its own words are on the standard error."""


def can_fork() -> bool:
    """Whether parts would be done side by side here."""
    return "fork" in multiprocessing.get_all_start_methods() and threading.active_count() == 1


def shared_out(size: int, parts: int) -> list[NDArray[np.intp]]:
    """Rows of each part, in turn, so that neighbours of about the same cost are spread.

    >>> [rows.tolist() for rows in shared_out(5, 2)]
    [[0, 2, 4], [1, 3]]
    """
    return [np.arange(first, size, parts) for first in range(parts)]


def side_by_side(work: Callable[[P], R], parts: Sequence[P]) -> list[R]:
    """``work`` of every part, the first one here and each other one in a fork of this process.

    An error of a part is raised here as it is; the other processes end with it.

    Raises
    ------
    ProcessEnded
        When a process was killed.
    """
    if len(parts) < 2 or not can_fork():
        return [work(part) for part in parts]
    fork = multiprocessing.get_context("fork")
    started = []
    for part in parts[1:]:
        here, there = fork.Pipe(duplex=False)
        process = fork.Process(target=_answer, args=(there, work, part), daemon=True)
        with warnings.catch_warnings():
            # of threads that are not Python's: those of linear algebra stand a fork
            warnings.simplefilter("ignore", DeprecationWarning)
            process.start()
        there.close()
        started.append((process, here))
    try:
        return [work(parts[0]), *(_result(here) for _, here in started)]
    finally:
        for process, here in started:
            here.close()
            process.terminate()
            process.join()


def _answer(there: Connection, work: Callable[[P], R], part: P) -> None:
    """In the fork: send the result or the error, and end; an interrupt is the parent's business."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        answer: tuple[R | None, Exception | None] = (work(part), None)
    except Exception as error:  # noqa: BLE001  raised again where the parts meet
        answer = (None, error)
    there.send(answer)
    there.close()


def _result(here: Connection) -> Any:
    try:
        result, error = here.recv()
    except EOFError:
        raise ProcessEnded("a process that computed a part of this ended before its result came") from None
    if error is not None:
        raise error
    return result
