"""Makes a database fail as disks and servers do, for rehearsals, tests and the fault survey. SQLite only.

Nothing is pretended: a full disk is SQLite's own limit of pages, a read-only database its own refusal to write, a
locked one is locked by another connection, and one that is gone has another name.
"""

import shutil
import sqlite3
import threading
from collections.abc import Callable
from functools import partial
from pathlib import Path

from sqlalchemy import Connection, event

from bench.store.database import Database


class Failures:
    """One database file and its bad days; ``heal`` ends them."""

    def __init__(self, database: Database) -> None:
        if database.file is None:
            raise ValueError("only a database in a file can be made to fail")
        self._database = database
        self._file: Path = database.file
        self._healing: list[Callable[[], object]] = []
        self._begun = 0
        self._due: dict[int, list[Callable[[], None]]] = {}
        self._pragma = ""
        event.listen(database.engine, "begin", self._on_begin)

    def after(self, transactions: int, kind: str, seconds: float = 1.0) -> None:
        """Let ``disk_full``, ``read_only``, ``locked`` (so many seconds) or ``gone`` come after so many."""
        acts = {
            "disk_full": self.disk_full,
            "read_only": self.read_only,
            "locked": lambda: self.locked(seconds),
            "gone": self.gone,
        }
        self._due.setdefault(self._begun + transactions + 1, []).append(acts[kind])

    def disk_full(self) -> None:
        """No further page fits on the disk."""
        self._pragma = "PRAGMA max_page_count = 1"  # SQLite takes it for the present size

    def read_only(self) -> None:
        """No connection may write any more."""
        self._pragma = "PRAGMA query_only = ON"

    def locked(self, seconds: float) -> None:
        """Somebody else holds the database for so long."""
        other = sqlite3.connect(self._file, isolation_level=None, check_same_thread=False)
        other.execute("PRAGMA busy_timeout = 5000")
        other.execute("BEGIN IMMEDIATE")
        timer = threading.Timer(seconds, other.close)
        timer.daemon = True
        timer.start()

    def gone(self) -> None:
        """The file has been moved away."""
        away = self._file.with_suffix(".away")
        self._file.rename(away)
        self._healing.append(partial(shutil.move, away, self._file))

    def heal(self) -> None:
        """All is well again."""
        self._due.clear()
        self._pragma = ""
        for act in self._healing:
            act()
        self._healing.clear()
        self._database.close()  # connections that hold a limit of their own are opened anew

    def _on_begin(self, connection: Connection) -> None:
        self._begun += 1
        for act in self._due.pop(self._begun, []):
            act()
        if self._pragma:
            cursor = connection.connection.cursor()
            cursor.execute(self._pragma)
            cursor.close()
