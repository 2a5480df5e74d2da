"""Parts of one computation in processes of their own, for programs that own their process: commands and benchmarks.

A process that is forked has all that this one has at once, so nothing is imported or handed over again; what comes back
is pickled. Nothing is forked where threads run (a server, a dashboard): a lock that one of them holds would stay locked
in the copy. Then, and for a single part, all is done here, one part after the other.

What a part would share itself is done where that part is: all processes are busy.

A program that computes in parts again and again keeps its forks (:func:`kept`): after a fork both sides copy every page
that they write to, each time anew. A fork that is kept knows nothing of what came later, so its parts are pickled too.
Meanwhile the garbage collector leaves alone what was there before: it would read and mark it again and again, on both
sides.
"""

import gc
import multiprocessing
import signal
import threading
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

P = TypeVar("P")
R = TypeVar("R")

_ENDED = "a process that computed a part of this ended before its result came"


@dataclass(frozen=True, slots=True)
class _Fork:
    """A process and this end of the pipe to it."""

    process: BaseProcess
    pipe: Connection

    @classmethod
    def of(cls, target: Callable[..., None], *arguments: Any) -> "_Fork":
        """A fork that runs the target with its pipes, the one here and the one there, and the arguments."""
        fork = multiprocessing.get_context("fork")
        here, there = fork.Pipe()
        process = fork.Process(target=target, args=(here, there, *arguments), daemon=True)
        with warnings.catch_warnings():
            # of threads that are not Python's: those of linear algebra stand a fork
            warnings.simplefilter("ignore", DeprecationWarning)
            process.start()
        there.close()
        return cls(process, here)

    def ask(self, work: Callable[[P], Any], part: P) -> None:
        """Have a part done, by a fork that serves."""
        try:
            self.pipe.send((work, part))
        except BrokenPipeError:
            raise ProcessEnded(_ENDED) from None

    def result(self) -> Any:
        """What comes back, or its error."""
        try:
            result, error = self.pipe.recv()
        except (EOFError, ConnectionResetError):
            raise ProcessEnded(_ENDED) from None
        if error is not None:
            raise error
        return result

    def end(self) -> None:
        """Whatever it does."""
        self.pipe.close()
        self.process.terminate()
        self.process.join()


_kept: list[_Fork] = []
_parts_run = False  # here, or because this is a fork


class ProcessEnded(RuntimeError):
    """A process ended without a result; its own words are on the standard error."""


def can_fork() -> bool:
    """Whether parts would be done side by side here."""
    alone = threading.active_count() == 1 and not _parts_run
    return alone and "fork" in multiprocessing.get_all_start_methods()


def shared_out(size: int, parts: int) -> list[NDArray[np.intp]]:
    """Rows of each part, in turn, so that neighbours of about the same cost are spread.

    >>> [rows.tolist() for rows in shared_out(5, 2)]
    [[0, 2, 4], [1, 3]]
    """
    return [np.arange(first, size, parts) for first in range(parts)]


def at_once(*calls: Callable[[], Any]) -> list[Any]:
    """What calls return that do not depend on each other; for forks that are kept they are partial functions."""
    return side_by_side(_called, calls)


def _called(call: Callable[[], Any]) -> Any:
    return call()


def side_by_side(work: Callable[[P], R], parts: Sequence[P]) -> list[R]:
    """``work`` of every part, the first one here and each other one in a fork of this process.

    Where forks are :func:`kept` they do it, and ``work`` is a function of a module. An error of a part is raised here
    as it is; the other processes end with it.

    Raises
    ------
    ProcessEnded
        When a process was killed.
    """
    if len(parts) < 2 or not can_fork():
        return [work(part) for part in parts]
    if len(_kept) >= len(parts) - 1:
        return _by_kept(work, parts)
    started = list[_Fork]()
    try:
        for part in parts[1:]:
            started.append(_Fork.of(_answer, work, part))
        return [_here(work, parts[0]), *(fork.result() for fork in started)]
    finally:
        for fork in started:
            fork.end()


@contextmanager
def kept(processes: int) -> Iterator[None]:
    """Keep forks for all that is done side by side inside, so many processes with this one."""
    if processes < 2 or _kept or not can_fork():
        yield
        return
    frozen_before = gc.get_freeze_count() > 0
    gc.freeze()
    try:
        _kept.extend(_Fork.of(_serve) for _ in range(processes - 1))
        yield
    finally:
        _end_kept()
        if not frozen_before:
            gc.unfreeze()


def _here(work: Callable[[P], R], part: P) -> R:
    global _parts_run
    _parts_run = True
    try:
        return work(part)
    finally:
        _parts_run = False


def _by_kept(work: Callable[[P], R], parts: Sequence[P]) -> list[R]:
    helping = _kept[: len(parts) - 1]
    try:
        for fork, part in zip(helping, parts[1:], strict=True):
            fork.ask(work, part)
        return [_here(work, parts[0]), *(fork.result() for fork in helping)]
    except BaseException:  # what still comes back would be taken for an answer to the next question
        _end_kept()
        raise


def _end_kept() -> None:
    while _kept:
        _kept.pop().end()


def _answer(here: Connection, there: Connection, work: Callable[[P], R], part: P) -> None:
    """In the fork: send the result or the error, and end; an interrupt is the parent's business."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    here.close()
    _send(there, work, part)
    there.close()


def _serve(here: Connection, there: Connection) -> None:
    """In a fork that is kept: answer until nobody asks any more."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    here.close()
    _kept.clear()
    while True:
        try:
            work, part = there.recv()
        except EOFError:
            return
        _send(there, work, part)


def _send(there: Connection, work: Callable[[P], R], part: P) -> None:
    try:
        answer: tuple[R | None, Exception | None] = (_here(work, part), None)
    except Exception as error:  # noqa: BLE001  raised again where the parts meet
        answer = (None, error)
    there.send(answer)
