"""Long work in a process of its own, while this one keeps the bench alive; given up, it ends at once."""

import multiprocessing
from collections.abc import Callable
from multiprocessing.connection import Connection
from typing import TypeVar

from bench.errors import BenchError
from bench.processes import end_with_parent, one_thread_each

T = TypeVar("T")


class WorkLost(BenchError):
    """The process that worked beside this one ended without a result."""


def beside(work: Callable[[], T], meanwhile: Callable[[], None], every_s: float) -> T:
    """The result of ``work``, which is sent to another process; ``meanwhile`` is called every so many real seconds.

    What ``work`` raises is raised here. What ``meanwhile`` raises ends the work.
    """
    fresh = multiprocessing.get_context("spawn")
    ours, theirs = fresh.Pipe(duplex=False)
    worker = fresh.Process(target=_work, args=(work, theirs), daemon=True)
    with one_thread_each():
        worker.start()
    theirs.close()
    try:
        while not ours.poll(every_s):
            meanwhile()
        done, result = ours.recv()
    except EOFError as lost:
        worker.join()
        raise WorkLost(f"a process working for the campaign ended with code {worker.exitcode}") from lost
    finally:
        worker.kill()
        worker.join()
        ours.close()
    if not done:
        raise result
    return result  # type: ignore[no-any-return]


def _work(work: Callable[[], object], answer: Connection) -> None:
    end_with_parent()
    try:
        answer.send((True, work()))
    except Exception as error:  # noqa: BLE001  told to those who wait, and raised there
        answer.send((False, error))
