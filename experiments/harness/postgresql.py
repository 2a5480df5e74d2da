"""A private PostgreSQL server in a folder of its own, for tests and experiments: no port, no password, gone at the end.

It listens on a socket inside that folder, and forces nothing to the disk: nothing here outlives the machine. Started by
root it runs as the user ``postgres``, since it refuses to run as root; the program is looked for where Debian puts it,
and on the PATH.
"""

import itertools
import os
import shutil
import subprocess
import tempfile
import time
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Self

DEBIAN = "/usr/lib/postgresql/*/bin/initdb"
ROLE = "d2ea"
START_S = 60
STOP_S = 10.0


def programs() -> Path | None:
    """The folder with ``initdb`` and ``pg_ctl``; None where PostgreSQL is not installed."""
    found = shutil.which("initdb")
    if found:
        return Path(found).resolve().parent
    known = sorted(Path("/").glob(DEBIAN.lstrip("/")))
    return known[-1].parent if known else None


class Cluster:
    """A server that can be stopped and started again, as servers are at night."""

    def __init__(self, bin: Path) -> None:
        self._bin = bin
        self._folder = Path(tempfile.mkdtemp(prefix="d2ea-pg-"))
        self._numbers = itertools.count(1)
        if os.geteuid() == 0:
            shutil.chown(self._folder, "postgres", "postgres")
        self._call("initdb", "-D", str(self.data), "-U", ROLE, "--auth=trust", "-E", "UTF8", "--no-sync")
        self.start()

    @property
    def data(self) -> Path:
        """Where the server keeps its files."""
        return self._folder / "data"

    def start(self) -> None:
        """Start, and wait until it answers."""
        options = f"-k {self._folder} -c listen_addresses='' -c max_connections=60 -c fsync=off"
        log = str(self._folder / "log")
        self._call(
            "pg_ctl", "-D", str(self.data), "-l", log, "-o", options, "-w", "-t", str(START_S), "start"
        )

    def stop(self) -> None:
        """Cut every connection and stop at once."""
        self._call("pg_ctl", "-D", str(self.data), "-m", "immediate", "-w", "stop")

    def url(self, name: str = "postgres") -> str:
        """How SQLAlchemy reaches a database of this server."""
        return f"postgresql://{ROLE}@/{name}?host={self._folder}"

    def new_schema(self) -> str:
        """The URL of a fresh, empty schema: a database of its own to all who use it, and cheaper."""
        name = f"bench_{next(self._numbers)}"
        self._call("psql", "-h", str(self._folder), "-U", ROLE, "-c", f"CREATE SCHEMA {name}", "postgres")
        return f"{self.url()}&options=-csearch_path%3D{name}"

    def close(self) -> None:
        """Stop, and remove everything."""
        with suppress(subprocess.CalledProcessError):  # it was stopped before
            self._call("pg_ctl", "-D", str(self.data), "-m", "immediate", "-W", "stop")
        until = time.monotonic() + STOP_S
        while (self.data / "postmaster.pid").exists() and time.monotonic() < until:
            time.sleep(0.05)
        shutil.rmtree(self._folder, ignore_errors=True)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _call(self, program: str, *arguments: str) -> None:
        command: Sequence[str] = [str(self._bin / program), *arguments]
        if os.geteuid() == 0:
            command = ["runuser", "-u", "postgres", "--", *command]
        subprocess.run(command, check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, cwd="/")
