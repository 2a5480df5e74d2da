"""One database, SQLite or PostgreSQL: opened, made durable, and every failure of it a ``StoreError``.

SQLite: WAL lets others read while a campaign writes, ``synchronous = FULL`` puts every commit on the disk before
it returns. A database file that was deleted or replaced is noticed before each transaction: SQLite itself would
go on writing into a file that nobody can open any more. PostgreSQL does all of this by itself.
"""

import os
import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from shlex import quote
from typing import Any

from sqlalchemy import Connection, Engine, create_engine, event, insert, inspect, select, text
from sqlalchemy.engine import URL, make_url
from sqlalchemy.exc import ArgumentError, DBAPIError, NoSuchModuleError, OperationalError, SQLAlchemyError

from bench.errors import InputError, StoreError
from bench.store.tables import SCHEMA, metadata, schema

DEFAULT_URL = "sqlite:///d2ea-data/d2ea.sqlite"
# another process (status, export) may hold the file for a moment; less than beats may be missed
BUSY_MS = 5_000
SCHEMA_LOCK = 0xD2EA  # PostgreSQL: only one process at a time makes the tables
BOUNDED = {  # seconds, and ms: a network that is gone is noticed, not waited for
    "connect_timeout": 5, "keepalives_idle": 5, "keepalives_interval": 2, "keepalives_count": 2,
    "tcp_user_timeout": 8000,
}  # fmt: skip
_PASSWORD = re.compile(r"://[^/@]*:[^/@]+@")  # as a URL holds one
MEMORY = (None, "", ":memory:")

_AGAIN = "then do it again; a campaign that was running goes on with d2ea resume"
_ADVICE = (
    ("disk is full", f"the disk is full: make room, {_AGAIN}"),
    ("No space left", f"the disk is full: make room, {_AGAIN}"),
    ("readonly", f"the database is read-only: give this user the right to write it, {_AGAIN}"),
    ("locked", f"another program has held the database for {BUSY_MS / 1000:g} s: end it, {_AGAIN}"),
    ("disk I/O error", f"the disk failed, or is full: make room, or see the system's log, {_AGAIN}"),
    ("onnection", f"the database server cannot be reached: start it, {_AGAIN}"),
)

_DAMAGED = ("malformed", "not a database")  # what SQLite says of a file that was cut or overwritten


def database_url(option: str | None = None, configured: str | None = None) -> str:
    """The option, else the bench's own, else D2EA_DB, else a file in the working directory.

    InputError for a password in the option: arguments can be seen by everybody on the machine.
    """
    if option and _PASSWORD.search(option):
        allowed = (
            "a password does not belong on a command line; put the URL into D2EA_DB, or it into ~/.pgpass"
        )
        raise InputError.of("command line", "--db", None, allowed)
    return option or configured or os.environ.get("D2EA_DB") or DEFAULT_URL


def how_to_name(url: str) -> str:
    """What a command is told besides to open this database; nothing where it opens that anyway, and no password.

    >>> how_to_name("sqlite:///lab.sqlite"), how_to_name("postgresql://lab:secret@host/db")
    (' --db sqlite:///lab.sqlite', ' with D2EA_DB set to the URL of that database')
    """
    if url == database_url():
        return ""
    return " with D2EA_DB set to the URL of that database" if _PASSWORD.search(url) else f" --db {quote(url)}"


class Database:
    """An open database; ``durable`` transactions survive a power cut, ``passing`` ones need not."""

    def __init__(self, url: str) -> None:
        try:
            parsed = _with_driver(make_url(url))
            self.file = _file_of(parsed)
            if self.file is not None:
                self.file.parent.mkdir(parents=True, exist_ok=True)
            self.engine = _engine(parsed, "FULL")
            self._passing = _engine(parsed, "NORMAL") if self.file is not None else self.engine
            self._make_tables()
        except (ArgumentError, NoSuchModuleError, ModuleNotFoundError) as error:
            raise InputError.of("database", "URL", None, f"not an SQLAlchemy URL: {error}") from error
        except (SQLAlchemyError, OSError) as error:
            where = parsed.render_as_string(hide_password=True)
            raise InputError.of("database", "URL", where, f"cannot be opened: {self._told(error)}") from error
        self.url = parsed.render_as_string(hide_password=True)
        self._inode = self._present()

    @property
    def dialect(self) -> str:
        """``sqlite`` or ``postgresql``."""
        return self.engine.dialect.name

    def close(self) -> None:
        """Close all connections."""
        self.engine.dispose()
        self._passing.dispose()

    @contextmanager
    def durable(self) -> Iterator[Connection]:
        """One transaction, on the disk when the block ends; ``StoreError`` when it is not."""
        with self._telling(), self.engine.begin() as db:
            yield db

    @contextmanager
    def passing(self) -> Iterator[Connection]:
        """One transaction that others see at once, and that a power cut may take back."""
        with self._telling(), self._passing.begin() as db:
            if self.dialect == "postgresql":
                db.execute(text("SET LOCAL synchronous_commit TO off"))
            yield db

    @contextmanager
    def reading(self) -> Iterator[Connection]:
        """One view of the data."""
        with self._telling(), self.engine.connect() as db:
            yield db

    @contextmanager
    def _telling(self) -> Iterator[None]:
        if self.file is not None and self._present() != self._inode:
            raise StoreError(f"the database {self.file} is gone, or another file has taken its place")
        try:
            yield
        except DBAPIError as error:
            raise StoreError(f"{self.url}: {self._told(error)}") from error

    def _told(self, error: Exception) -> str:
        """What the database says, and what to do about it."""
        said = _reason(error)
        if self.file is not None and any(sign in said for sign in _DAMAGED):
            return f"{said}; {_rescue(self.file)}"
        advice = next((advice for sign, advice in _ADVICE if sign in said), "")
        return f"{said}; {advice}" if advice else said

    def _present(self) -> tuple[int, int] | None:
        """Which file has the database's name now."""
        if self.file is None:
            return None
        try:
            found = self.file.stat()
        except OSError:
            return None
        return found.st_dev, found.st_ino

    def _make_tables(self) -> None:
        try:
            self._create_or_check()
        except OperationalError:  # another process made them between our look and our try
            self._create_or_check()

    def _create_or_check(self) -> None:
        with self.engine.begin() as db:
            if self.dialect == "postgresql":
                db.execute(text(f"SELECT pg_advisory_xact_lock({SCHEMA_LOCK})"))
            names = set(inspect(db).get_table_names())
            found = db.execute(select(schema.c.version)).scalar() if schema.name in names else None
            if names & set(metadata.tables) and found != SCHEMA:
                known = "an earlier version" if found is None else f"schema {found}"
                raise InputError.of(
                    "database", "schema", found, f"is of {known}; this program needs {SCHEMA}: name another"
                )
            if found is None:
                metadata.create_all(db)
                db.execute(insert(schema).values(version=SCHEMA))


def _rescue(file: Path) -> str:
    """What to do with a database file that is damaged."""
    rescued = file.with_name(f"rescued-{file.name}")
    dumped = f"""sqlite3 "{file}" .dump | sed 's/^ROLLBACK/COMMIT/' | sqlite3 "{rescued}\""""
    return (
        "the file was cut or overwritten, or is none of SQLite's. If it is the database: end every program that has it "
        f"open, and copy {file}, {file.name}-wal and {file.name}-shm, where they are there, before anything else; then "
        f"take the last copy from your backup, or what can still be read with: {dumped} (.recover for .dump finds "
        f"more, where this sqlite3 has it); name the new file with --db sqlite:///{rescued}, and see d2ea runs"
    )


def _with_driver(url: URL) -> URL:
    """PostgreSQL through psycopg, unless the URL names another driver."""
    return url.set(drivername="postgresql+psycopg") if url.drivername in ("postgresql", "postgres") else url


def _file_of(url: URL) -> Path | None:
    if url.get_backend_name() != "sqlite" or url.database in MEMORY:
        return None
    return Path(str(url.database)).absolute()


def _engine(url: URL, synchronous: str) -> Engine:
    if url.get_backend_name() == "postgresql":
        return create_engine(url, pool_pre_ping=True, connect_args=dict(BOUNDED))
    engine = create_engine(url)
    if engine.dialect.name == "sqlite":

        def configure(connection: Any, _: object) -> None:
            cursor = connection.cursor()
            for pragma in ("journal_mode = WAL", f"synchronous = {synchronous}", "foreign_keys = ON",
                           f"busy_timeout = {BUSY_MS}"):  # fmt: skip
                cursor.execute(f"PRAGMA {pragma}")
            cursor.close()

        event.listen(engine, "connect", configure)
    return engine


def _reason(error: Exception) -> str:
    """What the database itself says, without SQLAlchemy's frame around it."""
    cause = error.orig if isinstance(error, DBAPIError) else error
    return " ".join(str(cause).split())
