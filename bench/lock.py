"""One owner per port on this machine: held by the operating system, so it ends with the process, however it ends.

The database says who owns a bench; this holds also for two programs that use two databases. A serial port is opened
for one program alone anyway (``drivers.transport``), so only what the operating system would share is locked here:
addresses on a network.
"""

import fcntl
import hashlib
import os
import tempfile
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

from bench.config import BenchConfig
from bench.errors import BenchTaken


@contextmanager
def ports_of_bench(config: BenchConfig) -> Iterator[None]:
    """Hold every network address of a bench; BenchTaken says which one somebody else has, and who."""
    parts = (config.analyzer, config.supply, config.load, config.controller)
    resources = {part.resource for part in parts if "://" in part.resource}
    with ExitStack() as held:
        for resource in sorted(resources):
            held.enter_context(_port(resource))
        yield


@contextmanager
def _port(resource: str) -> Iterator[None]:
    path = _folder() / hashlib.sha256(resource.encode()).hexdigest()[:24]
    handle = os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o666)
    try:
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            holder = os.read(handle, 100).decode("ascii", "replace").strip() or "another program"
            raise BenchTaken(f"{resource} is in use by {holder}; wait for it, or end it") from None
        os.ftruncate(handle, 0)
        os.pwrite(handle, f"process {os.getpid()}".encode(), 0)
        yield
    finally:
        os.close(handle)  # and with it the lock


def _folder() -> Path:
    folder = Path(tempfile.gettempdir()) / "d2ea-ports"
    if not folder.is_dir():
        folder.mkdir(exist_ok=True)
        folder.chmod(0o1777)  # any user may use a bench, none may take another's lock away
    return folder
