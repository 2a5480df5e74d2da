"""Databases for the tests of what is stored, each run on SQLite and on PostgreSQL; folders for commands; residuals."""

import errno
import os
from collections.abc import Iterator
from pathlib import Path
from typing import NoReturn

import numpy as np
import pandas as pd
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


@pytest.fixture
def residuals() -> pd.DataFrame:
    """What a diagnosis of 30 rows leaves of their input power; D0 is not in the table."""
    rng = np.random.default_rng(1)
    D1, D2, power = rng.uniform(0.4, 1, 30), rng.uniform(0, 0.5, 30), rng.uniform(200, 1800, 30)
    return pd.DataFrame(
        {"kind": "load", "D1": D1, "D2": D2, "P2_W": power, "time_s": 60.0 * np.arange(30),
         "residual_P1_W": power / 100, "residual_D0": np.nan, "leftover_W": power / 500}
    )  # fmt: skip
