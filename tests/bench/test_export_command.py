"""Tables that go in and come out: what an import leaves out is kept, and an export of nothing says why."""

from pathlib import Path

import pandas as pd
import pytest

from bench.campaign import run_campaign
from bench.imported import left_out_by_import
from bench.job import Job
from bench.store import Store, database_url
from tests.bench.command_line import d2ea, measured_table
from tests.bench.fake_bench import FakeInstruments, bench_config, campaign_config, predict

pytestmark = pytest.mark.usefixtures("in_a_folder_of_its_own")


def test_imported_measurements_come_out_of_export(capsys: pytest.CaptureFixture[str]) -> None:
    assert d2ea("import", measured_table(), "--name", "theirs") == 0
    assert d2ea("export", "1", "--out", "out.parquet") == 0
    ours, theirs = pd.read_parquet("out.parquet"), pd.read_csv("theirs.csv")
    pd.testing.assert_frame_equal(ours[theirs.columns], theirs)
    assert d2ea("runs") == 0
    assert "imported" in capsys.readouterr().out


def test_a_file_that_was_imported_before_is_imported_with_a_word(capsys: pytest.CaptureFixture[str]) -> None:
    table = measured_table()
    assert d2ea("import", table) == 0
    assert "too:" not in capsys.readouterr().out
    assert d2ea("import", table, "--name", "again") == 0
    assert "the very same file is campaign 1 too" in capsys.readouterr().out


def test_a_table_without_a_required_column_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    Path("bad.csv").write_text("D1,P2_W,P1_W\n0.9,500,510\n")
    assert d2ea("import", "bad.csv") == 2
    assert "bad.csv: measurement table: required column D2 is missing" in capsys.readouterr().err


def test_many_rows_left_out_do_not_flood_the_screen(capsys: pytest.CaptureFixture[str]) -> None:
    table = pd.read_csv(measured_table())
    pd.concat([table, table]).to_csv("twice.csv", index=False)
    assert d2ea("import", "twice.csv") == 0
    said = capsys.readouterr().err
    assert said.count("repeats an earlier row") == 1
    assert "59 rows more for that reason" in said


def test_what_an_import_left_out_stays_with_its_campaign(capsys: pytest.CaptureFixture[str]) -> None:
    table = pd.read_csv(measured_table())
    table.loc[3, "D1"] = 90.0
    table.to_csv("per_cent.csv", index=False)
    assert d2ea("import", "per_cent.csv") == 0
    with Store(database_url(None)) as store:
        kept = left_out_by_import(store.campaign(1)["config"])["left_out_by_import"]
    (row,) = kept["rows"]
    assert (row["row"], row["line"], row["column"], row["value"]) == (4, 5, "D1", "90.0")
    assert d2ea("status") == 0
    assert "1 row of per_cent.csv left out by its import" in capsys.readouterr().out


def test_export_of_an_unknown_campaign_or_ending_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    assert d2ea("export", "7", "--out", "x.csv") == 1
    assert "there is no campaign 7" in capsys.readouterr().err
    d2ea("import", measured_table())
    assert d2ea("export", "1", "--out", "x.xls") == 2


def test_a_campaign_without_accepted_rows_is_neither_exported_nor_diagnosed_but_says_what_there_is(
    capsys: pytest.CaptureFixture[str],
) -> None:
    fake = FakeInstruments()
    one = {
        "kind": "points",
        "set_points": [{"D1": 0.9, "D2": 0.1, "power_W": 500.0}],
        "standby": 0,
        "no_load": 0,
    }
    config = campaign_config(measure={"samples": 4, "voltage_tolerance": 1e-9}, plan=one)
    with Store(database_url(None)) as store:
        run_campaign(
            Job.prepare(config, bench_config(), predict=predict), store, fake.clock, around=fake.around()
        )
    assert d2ea("export", "1", "--out", "x.csv") == 1
    said = " ".join(capsys.readouterr().err.split())
    assert (
        "campaign 1 has no accepted rows, so nothing is written: it is done, and of its 1 rows 0 are" in said
    )
    assert "d2ea export 1 --rejected --out FILE.csv writes those, with the reason of each" in said
    assert not Path("x.csv").exists()
    assert d2ea("diagnose", "1") == 2
    said = " ".join(capsys.readouterr().err.split())
    assert (
        "campaign 1: rows: none is accepted, so there is nothing to diagnose: it is done, and of its" in said
    )
    assert "d2ea export 1 --rejected --out FILE.csv writes those" in said
    assert d2ea("export", "1", "--rejected", "--out", "x.csv") == 0
    assert "is not held at 140 V" in pd.read_csv("x.csv")["reason"][0]


def test_where_nothing_was_rejected_there_is_no_such_export(capsys: pytest.CaptureFixture[str]) -> None:
    d2ea("import", measured_table())
    assert d2ea("export", "1", "--rejected", "--out", "x.csv") == 1
    said = " ".join(capsys.readouterr().err.split())
    assert "no rejected rows, so nothing is written" in said
    assert "60 are accepted and 0 rejected" in said
    assert "--rejected --out" not in said
