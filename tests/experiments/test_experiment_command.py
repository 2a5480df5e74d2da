"""The verb: found by the command line, prints tables, writes files, refuses wrong use."""

import json
from pathlib import Path

import pytest

from experiments import command
from tests.bench.command_line import d2ea
from tests.experiments.fabricated import ENTRY


@pytest.fixture
def made_up(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(command, "names", lambda: ["made_up"])
    monkeypatch.setattr(command, "entry", lambda name: ENTRY)


def test_the_list_names_every_experiment(capsys: pytest.CaptureFixture[str]) -> None:
    assert d2ea("experiment", "list") == 0
    printed = capsys.readouterr().out
    for name in command.names():
        assert name in printed


@pytest.mark.usefixtures("made_up")
def test_a_run_prints_its_tables_and_writes_its_files(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert d2ea("experiment", "made_up", "--quick", "--out", str(tmp_path)) == 0
    printed = capsys.readouterr().out
    assert "[swarm]" in printed
    assert "≤ 0.01 points  missed" in printed
    assert "VIRTUAL LAB" in printed
    assert json.loads((tmp_path / "made_up.json").read_text())["scale"] == 0.1
    assert (tmp_path / "made_up.html").exists()


@pytest.mark.usefixtures("made_up")
def test_all_writes_one_page_with_every_row_and_keeps_what_is_done(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    command_line = ("experiment", "all", "--quick", "--out", str(tmp_path))
    assert d2ea(*command_line) == 0
    first = (tmp_path / "made_up.json").read_bytes()
    assert "2 met, 1 missed" in capsys.readouterr().out
    summary = json.loads((tmp_path / "all.json").read_text())
    assert [row["verdict"] for row in summary["rows"]] == ["met", "shown", "met", "missed"]
    assert "data:image/png;base64,iVBORw" in (tmp_path / "all.html").read_text()
    assert d2ea(*command_line) == 0
    assert "kept from before" in capsys.readouterr().err
    assert (tmp_path / "made_up.json").read_bytes() == first


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("blind_trail",), "did you mean 'blind_trials'"),
        (("blind_trials", "--scale", "0"), "--scale = 0.0"),
        (("blind_trials", "--quick", "--scale", "0.5"), "give one of the two"),
        (("blind_trials", "--only", "pears"), "--only = 'pears': one of single, pairs"),
        (("search_benchmark", "--only", "pairs"), "search_benchmark has no parts"),
        (("all", "--only", "pairs"), "--only: is for one experiment that has parts"),
        (("blind_trials", "--again"), "--again: is for all"),
        (("blind_trials", "--reference", "theirs.csv"), "--reference: is for an experiment that compares"),
        (
            ("search_benchmark", "--dask", "local"),
            "--dask: is for trials that a cluster may run: blind_trials",
        ),
        (("all", "--dask", "local"), "--dask: is for trials that a cluster may run"),
    ],
)
def test_wrong_use_is_told(arguments: tuple[str, ...], said: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert d2ea("experiment", *arguments) == 2
    assert said in capsys.readouterr().err
