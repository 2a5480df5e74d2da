"""The verb diagnose on files: what it writes, and what it says of files that it cannot use."""

import json
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from bench.cli import main
from bench.commands.diagnose import MOST_ROWS, tell
from bench.model_file import read_model
from drivers.mocks.lab.laboratory import Laboratory
from drivers.mocks.lab.survey import schedule, survey
from experiments.onset_trials import happened
from sim.model import Model
from sim.simulate import Points, simulate
from tests.models.diagnosis.virtual_campaign import lab_table


def _campaign() -> pd.DataFrame:
    rng = np.random.default_rng(8)
    drawn = Points(D1=rng.uniform(0.5, 1, 80), D2=rng.uniform(0, 0.4, 80), power_W=rng.uniform(200, 1200, 80))
    chosen = drawn.take(np.flatnonzero(simulate(Model.baseline(), drawn).feasible)[:40])
    plan = schedule(np.asarray(chosen.D1), np.asarray(chosen.D2), np.asarray(chosen.power_W))
    return survey(Laboratory.draw(seed=8, hidden={"core_loss_transformer": 0.9}), plan, seed=8)


@pytest.fixture(scope="module")
def table(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("data") / "measured.csv"
    _campaign().to_csv(path, index=False)
    return path


def _run(*arguments: object) -> int:
    with pytest.raises(SystemExit) as stopped:
        main([str(a) for a in arguments])
    return int(stopped.value.code or 0)


def test_writes_answer_model_and_residuals(
    table: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert _run("diagnose", table, "--out", tmp_path / "d", "--json", tmp_path / "answer.json") == 0
    answer = json.loads((tmp_path / "answer.json").read_text())
    assert answer == json.loads((tmp_path / "d" / "diagnosis.json").read_text())
    assert answer["causes"][0]["effect"] == "core_loss_transformer"
    assert "core_loss_transformer" in (tmp_path / "d" / "model.toml").read_text()
    assert "residual_P1_W" in pd.read_csv(tmp_path / "d" / "residuals.csv")
    said = capsys.readouterr().out
    assert "Cause named: transformer core loss" in said
    assert "on held-out blocks (power band): " in said


def test_the_gain_of_rows_at_one_power_is_said_with_the_blocks_that_were_held_out(
    capsys: pytest.CaptureFixture[str],
) -> None:
    gain = {"before": 0.002, "after": 0.001, "ci95": (0.0005, 0.0015), "blocks": "region of D1 and D2"}
    gap = {"mean_abs_efficiency": 0.002, "mean_loss_W": 2.0}
    nothing = dict.fromkeys(("channels", "next", "rejected_rows", "rejected_columns"), ())
    tell({"points": 40, "gap": gap, "gain": gain, "verdict": "unknown", **nothing})
    assert "on held-out blocks (region of D1 and D2): " in capsys.readouterr().out


def test_how_the_table_was_read_and_what_the_model_holds_is_said(
    table: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    frame = pd.read_csv(table)
    frame.assign(I1_A=1.03 * frame["P1_W"] / frame["V1_V"]).to_csv(tmp_path / "off.csv", index=False)
    assert _run("diagnose", tmp_path / "off.csv", "--out", tmp_path / "d") == 0
    assert "read: I1_A: V1_V * I1_A is 1.03 times P1_W" in " ".join(capsys.readouterr().out.split())
    (cause,) = json.loads((tmp_path / "d" / "diagnosis.json").read_text())["causes"]
    kept = cause["parameters"][0]["in_model"]
    assert kept == read_model(tmp_path / "d" / "model.toml").effects[cause["effect"]]["relative_error"]
    low, high = cause["parameters"][0]["ci95"]
    assert low <= kept <= high


def test_where_something_changed_on_the_way_both_stretches_are_answered(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    changed, _ = happened(lab_table({}, seed=171), lab_table({"link_resistance": 0.08}, seed=171), 0.5)
    changed.to_csv(tmp_path / "changed.csv", index=False)
    out = tmp_path / "d"
    assert _run("diagnose", tmp_path / "changed.csv", "--out", out) == 0
    said = " ".join(capsys.readouterr().out.split())
    assert "verdict: Ac-link resistance sets in between rows" in said
    assert re.search(r"before the change, \d+ rows: Simulation and measurement agree", said)
    assert re.search(
        r"after the change, \d+ rows: Cause named: ac-link resistance, resistance \d+ mΩ \(95 %", said
    )
    page = (out / "diagnosis.html").read_text(encoding="utf-8")
    whole = json.loads((out / "diagnosis.json").read_text())
    for stretch in whole["unknown"]["onset"]["stretches"]:
        folder = out / stretch["name"]
        answer = json.loads((folder / "diagnosis.json").read_text())
        assert {key: answer[key] for key in stretch["answer"]} == stretch["answer"]
        assert f'<a href="{stretch["name"]}/diagnosis.html">' in page
        assert f"{stretch['name']} the change" in (folder / "diagnosis.html").read_text(encoding="utf-8")
        assert len(pd.read_csv(folder / "residuals.csv")) == stretch["rows"]
    assert read_model(out / "after" / "model.toml").effects["link_resistance"]["resistance_Ohm"] > 0.05
    assert not read_model(out / "before" / "model.toml").effects


def test_a_missing_column_is_wrong_use(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "short.csv"
    path.write_text("D1,D2,P1_W\n0.9,0.1,1000\n")
    assert _run("diagnose", path, "--out", tmp_path / "d") == 2
    said = capsys.readouterr().err
    assert "short.csv" in said
    assert "P2_W" in said


def test_too_few_rows_says_how_many_are_needed(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "two.csv"
    path.write_text("D1,D2,P2_W,P1_W\n0.9,0.1,1000,1020\n0.9,0.05,600,612\n")
    assert _run("diagnose", path, "--out", tmp_path / "d") == 2
    said = " ".join(capsys.readouterr().err.split())
    assert "two.csv: rows: 2 usable rows" in said
    assert "at least 12; measure more set points" in said


def test_an_unknown_effect_names_the_nearest(
    table: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert _run("diagnose", table, "--out", tmp_path / "d", "--without", "deadtime") == 2
    said = capsys.readouterr().err
    assert "command line: --without" in said
    assert "did you mean 'dead_time'" in said


@pytest.fixture(scope="module")
def answer(tmp_path_factory: pytest.TempPathFactory, table: Path) -> tuple[pd.DataFrame, Path]:
    """A table whose first row cannot be, with an outlier further down, and where its diagnosis is."""
    folder = tmp_path_factory.mktemp("shifted")
    frame = pd.read_csv(table).drop(columns="efficiency", errors="ignore")
    loaded = frame[frame["kind"] == "load"]
    frame.loc[loaded.index[7], "P1_W"] += 80.0  # W: ten times the loss that nobody entered
    shifted = pd.concat([loaded.head(1).assign(D1=7.0), frame], ignore_index=True).assign(lab="virtual")
    shifted.to_csv(folder / "shifted.csv", index=False)
    assert _run("diagnose", folder / "shifted.csv", "--out", folder / "d") == 0
    return shifted, folder / "d"


def test_every_row_is_named_as_the_file_counts_it(answer: tuple[pd.DataFrame, Path]) -> None:
    table, folder = answer
    rejected = json.loads((folder / "diagnosis.json").read_text())["rejected_rows"]
    assert len({row["row"] for row in rejected}) > 1
    for row in rejected:
        assert float(row["value"]) == pytest.approx(table[row["column"]][row["row"] - 1])
    residuals = pd.read_csv(folder / "residuals.csv")
    assert residuals["D1"].equals(table["D1"][residuals["row"] - 1].reset_index(drop=True))


def test_a_table_from_a_virtual_lab_says_so(answer: tuple[pd.DataFrame, Path]) -> None:
    assert "VIRTUAL LAB" in (answer[1] / "diagnosis.html").read_text()


@pytest.mark.parametrize(
    ("changed", "said"),
    [({"V1_V": 140.0}, "columns: V1_V: median 140"), ({"T_ambient_C": 298.15}, "Is it in kelvin?")],
)
def test_a_table_of_another_converter_is_wrong_use(
    changed: dict[str, float], said: str, table: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    pd.read_csv(table).assign(**changed).to_csv(tmp_path / "other.csv", index=False)
    assert _run("diagnose", tmp_path / "other.csv", "--out", tmp_path / "d") == 2
    assert said in " ".join(capsys.readouterr().err.split())


@pytest.mark.parametrize("imported", [False, True])
def test_rows_at_another_switching_frequency_are_refused_with_both(
    imported: bool,
    table: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(tmp_path)
    frame = pd.read_csv(table)
    frame.assign(fs_kHz=[20.0] * 3 + [30.0] * (len(frame) - 3)).to_csv("fast.csv", index=False)
    if imported:
        assert _run("import", "fast.csv") == 0
    assert _run("diagnose", "1" if imported else "fast.csv") == 2
    said = " ".join(capsys.readouterr().err.split())
    assert "row 4, column fs_kHz = '30': measured at 30 kHz" in said
    assert "switches at 20 kHz" in said
    assert "frequency_Hz = 30000" in said


def test_more_rows_than_there_is_memory_for_are_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rows = "".join(f"0.9,0.1,1000,{1020 + k * 1e-4}\n" for k in range(MOST_ROWS + 1))
    (tmp_path / "long.csv").write_text(f"D1,D2,P2_W,P1_W\n{rows}")
    assert _run("diagnose", tmp_path / "long.csv", "--out", tmp_path / "d") == 2
    assert "keep one row of 2" in " ".join(capsys.readouterr().err.split())


def test_a_diagnosis_of_a_file_loads_no_database() -> None:
    said = "import sys, bench.commands.diagnose; print('sqlalchemy' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", said], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "False"
