"""Databases for the tests of what is stored: each runs on SQLite and on PostgreSQL; and folders for commands."""

import errno
import os
from collections.abc import Iterator
from pathlib import Path
from typing import NoReturn

import pytest

from bench.store import Store
from experiments.harness.postgresql import Cluster, programs


@pytest.fixture(scope="session")
def cluster() -> Iterator[Cluster]:
    """A PostgreSQL server for this run of the tests."""
    bin = programs()
    if bin is None:
        pytest.skip("missing program: postgresql")
    with Cluster(bin) as running:
        yield running


@pytest.fixture(params=["sqlite", "postgresql"])
def url(request: pytest.FixtureRequest, tmp_path: Path) -> str:
    """A database of each kind with nothing in it."""
    if request.param == "sqlite":
        return f"sqlite:///{tmp_path}/bench.sqlite"
    cluster: Cluster = request.getfixturevalue("cluster")
    return cluster.new_schema()


@pytest.fixture
def store(url: str) -> Iterator[Store]:
    """A fresh store on each kind of database."""
    with Store(url) as opened:
        yield opened


def no_room(*_: object, **__: object) -> NoReturn:
    """What a full disk answers."""
    raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


@pytest.fixture
def full_disk(monkeypatch: pytest.MonkeyPatch) -> None:
    """No file gets to the disk whole."""
    monkeypatch.setattr("bench.whole_file.os.fsync", no_room)


@pytest.fixture
def in_a_folder_of_its_own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """What a command reads and writes here, it reads and writes in an empty folder."""
    monkeypatch.chdir(tmp_path)
    for name in ("D2EA_DB", "D2EA_TOKEN"):
        monkeypatch.delenv(name, raising=False)
