"""The campaign database: what goes in comes out, and is on the disk."""

import sqlite3
from pathlib import Path

import pandas as pd
import pytest

from bench.errors import InputError, StateError, StoreError
from bench.states import State
from bench.store import Provenance, Store, database_url
from bench.store.failures import Failures

PROVENANCE = Provenance(config={"a": 1}, config_hash="0" * 64, virtual=True)
TABLE = pd.DataFrame(
    {
        "point": [0, 1, 2],
        "kind": ["load", "reference", "standby"],
        "D1": [0.9, 0.8, None],
        "D2": [0.1, 0.2, None],
        "P1_W": [1030.5, 515.25, 8.125],
        "P2_W": [1000.0, 500.0, None],
        "efficiency": [1000.0 / 1030.5, 500.0 / 515.25, None],
        "T_heatsink_C": [41.0, None, 25.0],
    }
)


def test_an_imported_table_comes_back_the_same(store: Store) -> None:
    back = store.measurement_table(store.import_table("theirs", TABLE, PROVENANCE))
    pd.testing.assert_frame_equal(back[TABLE.columns], TABLE, check_dtype=False)  # integers stay integers


def test_points_with_names_of_their_own_are_numbered_as_they_come(store: Store) -> None:
    named = TABLE.assign(point=["A", "B", "A"])
    assert store.measurement_table(store.import_table("theirs", named, PROVENANCE))["point"].tolist() == [
        0,
        1,
        0,
    ]


def test_a_column_nobody_measured_is_left_out(store: Store) -> None:
    back = store.measurement_table(store.import_table("theirs", TABLE, PROVENANCE))
    assert "I_L_rms_A" not in back
    assert "T_heatsink_C" in back


def test_a_failed_import_leaves_nothing(store: Store) -> None:
    broken = TABLE.assign(P1_W=["x", "y", "z"])
    with pytest.raises(ValueError, match="could not convert"):
        store.import_table("theirs", broken, PROVENANCE)
    assert store.campaigns() == []


def test_a_full_disk_asks_for_room_whatever_was_to_be_written(tmp_path: Path) -> None:
    with Store(f"sqlite:///{tmp_path}/x.sqlite") as store:
        Failures(store.database).disk_full()
        many = pd.concat([TABLE] * 200, ignore_index=True)
        with pytest.raises(
            StoreError, match=r"the disk is full: make room, then do it again; a campaign that was"
        ):
            store.import_table("theirs", many, PROVENANCE)


def test_an_unknown_campaign_is_named_with_those_there_are(store: Store) -> None:
    store.import_table("theirs", TABLE, PROVENANCE)
    with pytest.raises(StateError, match=r"no campaign 7 .* known: 1"):
        store.measurement_table(7)


def test_sqlite_writes_are_durable(tmp_path: Path) -> None:
    with Store(f"sqlite:///{tmp_path}/data/x.sqlite") as store, store.database.reading() as db:
        assert db.exec_driver_sql("PRAGMA journal_mode").scalar() == "wal"
        assert db.exec_driver_sql("PRAGMA synchronous").scalar() == 2  # FULL


def test_another_connection_sees_a_step_at_once(tmp_path: Path) -> None:
    with Store(f"sqlite:///{tmp_path}/x.sqlite") as store:
        campaign_id = store.create_campaign("c", PROVENANCE, [])
        store.move(campaign_id, State.PLANNED, State.CHECKING, time_s=1.0)
        other = sqlite3.connect(tmp_path / "x.sqlite")
        try:
            assert other.execute("SELECT state FROM campaigns").fetchall() == [("checking",)]
        finally:
            other.close()


def test_a_verdict_is_kept_as_given(store: Store) -> None:
    verdict = {"verdict": "named", "causes": [{"effect": "core_loss_inductor", "probability": 0.99}]}
    campaign_id = store.import_table("theirs", TABLE, PROVENANCE)
    store.add_diagnosis(verdict, campaign_id=campaign_id)
    assert [row["verdict"] for row in store.diagnoses(campaign_id)] == [verdict]


def test_the_url_comes_from_option_bench_environment_default(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("D2EA_DB", "sqlite:///env")
    assert database_url("sqlite:///option", "sqlite:///bench") == "sqlite:///option"
    assert database_url(None, "sqlite:///bench") == "sqlite:///bench"
    assert database_url() == "sqlite:///env"
    monkeypatch.delenv("D2EA_DB")
    assert database_url() == "sqlite:///d2ea-data/d2ea.sqlite"


@pytest.mark.parametrize("url", ["not a url", "nodialect:///x", "sqlite:////proc/nowhere/x.sqlite"])
def test_a_database_that_cannot_be_opened_is_an_input_error(url: str) -> None:
    with pytest.raises(InputError, match="database: URL"):
        Store(url)


@pytest.mark.parametrize(
    "left", [0.5, 0.0]
)  # of the file: cut in the middle, and overwritten from its first byte
def test_a_damaged_file_says_what_to_copy_and_how_to_read_what_is_left(left: float, tmp_path: Path) -> None:
    file = tmp_path / "lab.sqlite"
    with Store(f"sqlite:///{file}") as store:
        store.import_table("theirs", TABLE, PROVENANCE)
    whole = file.read_bytes()
    kept = whole[: int(left * len(whole))]
    file.write_bytes(kept + b"no database " * (0 if kept else 400))
    with pytest.raises((InputError, StoreError)) as caught, Store(f"sqlite:///{file}") as store:
        store.measurement_table(1)
    said = str(caught.value)
    assert f"copy {file}" in said
    assert (
        f"""sqlite3 "{file}" .dump | sed 's/^ROLLBACK/COMMIT/' | sqlite3 "{tmp_path}/rescued-lab.sqlite\""""
        in said
    )
    assert f"--db sqlite:///{tmp_path}/rescued-lab.sqlite" in said


def test_a_password_is_never_said() -> None:
    with pytest.raises(InputError) as caught:
        Store("postgresql+nodriver://lab:secret@host/db")
    assert "secret" not in str(caught.value)
