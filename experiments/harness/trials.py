"""Runs trials side by side in processes of their own, each finished one kept at once."""

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import as_completed
from typing import Protocol, TypeVar

from bench.processes import lasting_pool
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
        with lasting_pool(processes) as pool:
            running = {pool.submit(work, trial): trial for trial in trials}
            for future in as_completed(running):
                yield running[future], future.result()

    return finished
