"""Who does the chunks of a long computation: processes of this machine, or a Dask cluster.

Both take tasks as they have room for them, so that neither the inputs nor the results of all tasks are ever in memory.
"""

import logging
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, wait
from dataclasses import dataclass
from itertools import islice
from typing import Any, TypeVar

from bench.errors import BenchError, InputError
from bench.processes import pool_of

LOCAL = "local"
_AHEAD = 2  # tasks under way for each worker
_PATIENCE = "10s"  # for a scheduler to answer

T = TypeVar("T")
Arguments = tuple[Any, ...]
Tasks = Iterable[tuple[int, Arguments]]


@dataclass(frozen=True, slots=True, kw_only=True)
class Workers:
    """``processes`` on this machine, or a Dask scheduler's address (``local``: a cluster of so many processes here)."""

    processes: int = 2
    dask: str | None = None


def on_processes(work: Callable[..., T], tasks: Tasks, workers: Workers) -> Iterator[tuple[int, T]]:
    """Number and result of every task, as they come."""
    with pool_of(workers.processes) as pool:
        waiting, running = iter(tasks), dict[Future[T], int]()
        while True:
            for number, arguments in islice(waiting, _AHEAD * workers.processes - len(running)):
                running[pool.submit(work, *arguments)] = number
            if not running:
                return
            for future in wait(running, return_when=FIRST_COMPLETED).done:
                yield running.pop(future), future.result()


def on_dask(work: Callable[..., T], tasks: Tasks, workers: Workers) -> Iterator[tuple[int, T]]:
    """The same on a cluster; its workers need this program installed, and share no files with this machine."""
    try:
        from distributed import Client, LocalCluster, as_completed
    except ImportError as error:
        raise BenchError("--dask needs Dask: install this program with its extra 'cluster'") from error
    logging.getLogger("distributed").setLevel(logging.getLogger().getEffectiveLevel())
    here = workers.dask == LOCAL
    cluster = (
        LocalCluster(n_workers=workers.processes, threads_per_worker=1, dashboard_address=None)
        if here
        else None
    )
    try:
        client = Client(cluster or workers.dask, timeout=_PATIENCE)
    except (OSError, ValueError) as error:
        allowed = f"no scheduler answers there ({error}); an address such as tcp://host:8786, or {LOCAL}"
        raise InputError.of("command line", "--dask", workers.dask, allowed) from error
    try:
        waiting, running, finished = iter(tasks), dict[Any, int](), as_completed()
        room = _AHEAD * max(1, sum(client.nthreads().values()))
        while True:
            for number, arguments in islice(waiting, room - len(running)):
                future = client.submit(work, *arguments, pure=False)
                running[future.key] = number
                finished.add(future)
            if not running:
                return
            done = next(finished)
            yield running.pop(done.key), done.result()
    finally:
        client.close()
        if cluster is not None:
            cluster.close()
