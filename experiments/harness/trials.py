"""Runs trials side by side in processes of their own, or on a Dask cluster, each finished one kept at once."""

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import as_completed
from typing import Protocol, TypeVar

from bench.processes import lasting_pool, one_thread_each
from bench.workers import Workers, on_dask
from experiments.harness.journal import Journal, Record
from experiments.harness.settings import Countdown, Settings


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

    ``work`` must be a function of a module, for it runs in processes that are started afresh, or on other machines.
    """
    kept = journal.read()
    waiting = [trial for trial in trials if trial.key not in kept]
    countdown = Countdown(len(trials), settings, before=len(trials) - len(waiting))
    for trial, record in _finished(work, waiting, settings):
        journal.append(trial.key, record)
        kept[trial.key] = record
        countdown.finished(trial.key)
    return [kept[trial.key] for trial in trials]


def _finished(
    work: Callable[[T], Record], trials: Sequence[T], settings: Settings
) -> Iterator[tuple[T, Record]]:
    """Trials and their records, as they come."""
    if not trials:
        return
    if settings.dask is not None:
        workers = Workers(processes=settings.processes, dask=settings.dask)
        with one_thread_each():
            for number, record in on_dask(work, enumerate((trial,) for trial in trials), workers):
                yield trials[number], record
    elif settings.processes == 1:
        for trial in trials:
            yield trial, work(trial)
    else:
        with lasting_pool(settings.processes) as pool:
            running = {pool.submit(work, trial): trial for trial in trials}
            for future in as_completed(running):
                yield running[future], future.result()
