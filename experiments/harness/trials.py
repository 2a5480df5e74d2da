"""Runs trials side by side in processes of their own, each finished one kept at once."""

import multiprocessing
import os
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from contextlib import contextmanager
from typing import Protocol, TypeVar

from experiments.harness.journal import Journal, Record
from experiments.harness.settings import Countdown, Settings

_THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")


class Trial(Protocol):
    """Anything with a key that tells it from all other trials of its experiment."""

    @property
    def key(self) -> str:
        """What the journal files it under."""
        ...


T = TypeVar("T", bound=Trial)


def perform(
    work: Callable[[T], Record], trials: Sequence[T], journal: Journal, settings: Settings
) -> list[Record]:
    """The record of every trial in their order; those in the journal are not run again.

    ``work`` must be a function of a module, for it runs in processes that are started afresh.
    """
    kept = journal.read()
    waiting = [trial for trial in trials if trial.key not in kept]
    countdown = Countdown(len(trials), settings, before=len(trials) - len(waiting))
    finished = _here if settings.processes == 1 else _spread(settings.processes)
    for trial, record in finished(work, waiting):
        journal.append(trial.key, record)
        kept[trial.key] = record
        countdown.finished(trial.key)
    return [kept[trial.key] for trial in trials]


def _here(work: Callable[[T], Record], trials: Sequence[T]) -> Iterator[tuple[T, Record]]:
    for trial in trials:
        yield trial, work(trial)


def _spread(processes: int) -> Callable[[Callable[[T], Record], Sequence[T]], Iterator[tuple[T, Record]]]:
    def finished(work: Callable[[T], Record], trials: Sequence[T]) -> Iterator[tuple[T, Record]]:
        if not trials:
            return
        fresh = multiprocessing.get_context("spawn")
        pool = ProcessPoolExecutor(processes, mp_context=fresh, initializer=end_with_parent)
        with one_thread_each(), pool:
            running = {pool.submit(work, trial): trial for trial in trials}
            try:
                for future in as_completed(running):
                    yield running[future], future.result()
            finally:
                pool.shutdown(wait=False, cancel_futures=True)

    return finished


def end_with_parent() -> None:
    """Let this process end when the one that started it does, however that ends: none is left behind."""
    parent = multiprocessing.parent_process()

    def watch() -> None:
        if parent is not None:
            parent.join()
            os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


@contextmanager
def one_thread_each() -> Iterator[None]:
    """Processes started inside use one thread each; libraries read this when they are loaded."""
    before = {name: os.environ.get(name) for name in _THREADS}
    os.environ.update(dict.fromkeys(_THREADS, "1"))
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value
