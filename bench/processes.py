"""Processes that work beside this one: they end when it does, and each uses one thread."""

import multiprocessing
import os
import threading
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from functools import cache

NICE = 10
_THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")


@contextmanager
def pool_of(processes: int) -> Iterator[ProcessPoolExecutor]:
    """Processes started afresh; work that waits is dropped when the block is left by an error."""
    with _pool(processes) as pool, _left_by_errors(pool):
        yield pool


@contextmanager
def lasting_pool(processes: int) -> Iterator[ProcessPoolExecutor]:
    """The same processes for all who ask, so that what they keep in memory serves again; an error ends them."""
    try:
        with _left_by_errors(_lasting(processes)) as pool:
            yield pool
    except BaseException:
        _lasting.cache_clear()
        raise


@cache
def _lasting(processes: int) -> ProcessPoolExecutor:
    return _pool(processes)


def _pool(processes: int) -> ProcessPoolExecutor:
    fresh = multiprocessing.get_context("spawn")
    return ProcessPoolExecutor(processes, mp_context=fresh, initializer=end_with_parent)


@contextmanager
def _left_by_errors(pool: ProcessPoolExecutor) -> Iterator[ProcessPoolExecutor]:
    """A pool that gives up what waits when an error comes through; its processes use one thread each."""
    with one_thread_each():
        try:
            yield pool
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            raise


def end_with_parent() -> None:
    """Let this process end when the one that started it does, however that ends: none is left behind."""
    parent = multiprocessing.parent_process()

    def watch() -> None:
        if parent is not None:
            parent.join()
            os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


def behind_the_campaign() -> None:
    """Let a campaign's process go first where this one and it want the same core."""
    os.nice(NICE)


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
