"""The demo on a small plan: one run, looked at from all sides; and the same seed measures the same numbers."""

import json
from pathlib import Path

import pandas as pd
import pytest
from typer.testing import CliRunner

from bench.campaign import Job, measurement_table, run_campaign
from bench.cli import build
from bench.config import BenchConfig, CampaignConfig, check
from bench.demo import fresh_database, was_found
from bench.demo_beside import unseen_points
from bench.model_file import read_model
from bench.store import Store
from drivers.clock import StepClock
from drivers.mocks.plant import Plant
from drivers.mocks.rack import Rack
from sim.model import Model
from sim.simulate import simulate
from tests.bench.command_line import d2ea

RESISTANCE_OHM = 0.12


@pytest.fixture(scope="module")
def demo(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("demo")
    arguments = ["demo", "--out", str(out), "--points", "30", "--seed", "3"]
    result = CliRunner().invoke(build(), [*arguments, "--hide", f"link_resistance={RESISTANCE_OHM}"])
    assert result.exit_code == 0, result.output
    return out


@pytest.fixture(scope="module")
def summary(demo: Path) -> dict:
    return json.loads((demo / "summary.json").read_text())


def test_summary_has_the_promised_keys(summary: dict) -> None:
    assert set(summary) >= {"points", "sim_points", "sim_feasible", "seconds", "error", "optimum",
                            "diagnosis", "hidden", "found"}  # fmt: skip
    assert set(summary["seconds"]) >= {
        "setup",
        "simulate",
        "campaign",
        "train",
        "optimise",
        "diagnose",
        "total",
    }
    assert set(summary["error"]) == {
        "simulation_only",
        "experiment_only",
        "d2ea",
        "simulator_first_stage",
        "calibrated",
    }


def test_simulates_the_papers_grid(summary: dict) -> None:
    assert summary["sim_points"] == 12_500
    # lossless, 41 % of the grid carry their power; losses and dead time take a little of it
    assert 0.38 < summary["sim_feasible"] / summary["sim_points"] < 0.41


def test_finds_what_was_hidden(summary: dict) -> None:
    cause = summary["diagnosis"]["causes"][0]
    assert summary["found"]
    assert cause["effect"] == "link_resistance"
    low, high = cause["parameters"][0]["ci95"]
    assert low - 0.01 < RESISTANCE_OHM < high + 0.01  # the parts' own resistances are off by some milliohms


def test_calibrated_physics_beats_every_other_model(summary: dict) -> None:
    error = summary["error"]
    assert error["calibrated"] < 0.1 * min(error["simulation_only"], error["experiment_only"], error["d2ea"])


def test_the_optimum_was_measured_and_is_as_predicted(summary: dict) -> None:
    measured = [row for row in summary["optimum"] if row["measured"] is not None]
    assert len(measured) >= 17  # of 19 loads; the lab's converter may not carry the last
    worst = max(abs(row["predicted"] - row["measured"]) for row in measured)
    assert worst < 1e-3  # a tenth of a point: the calibrated model's own error is some hundredths


def test_the_verdict_was_stored_without_what_was_hidden(demo: Path) -> None:
    with Store(f"sqlite:///{demo / 'demo.sqlite'}") as store:
        verdicts = store.diagnoses(1)
    assert verdicts[0]["verdict"]["verdict"] == "named"
    assert "hidden" not in json.dumps(verdicts[0]["verdict"])


def test_the_bench_was_seen_off(demo: Path, summary: dict) -> None:
    assert summary["power_off"] == "PWM off; load off; supply off; discharge to 60 V or less"
    with Store(f"sqlite:///{demo / 'demo.sqlite'}") as store:
        assert [row["state"] for row in store.campaigns()] == ["done", "done"]
        assert all(row["virtual"] for row in store.campaigns())


def test_the_extended_model_can_be_read_back(demo: Path) -> None:
    assert list(read_model(demo / "model.toml").effects) == ["link_resistance"]


def test_the_report_needs_nothing_else_and_says_virtual_lab(demo: Path) -> None:
    page = (demo / "report.html").read_text()
    assert "VIRTUAL LAB" in page
    assert "<script src" not in page
    assert '<link rel="stylesheet"' not in page
    assert (demo / "overview.png").stat().st_size > 50_000


def test_an_operators_database_is_refused_and_left_as_it_is(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    database = tmp_path / "d2ea.sqlite"
    database.write_bytes(b"measurements")
    assert d2ea("demo", "--out", str(tmp_path), "--points", "20") == 2
    assert "holds measurements in d2ea.sqlite" in " ".join(capsys.readouterr().err.split())
    assert [path.read_bytes() for path in tmp_path.iterdir()] == [b"measurements"]


def test_a_demo_replaces_the_database_of_an_earlier_one_and_nothing_else(tmp_path: Path) -> None:
    for name in ("demo.sqlite", "demo.sqlite-wal", "demo.sqlite-shm", "demo.sqlite.kept"):
        (tmp_path / name).touch()
    assert fresh_database(tmp_path) == tmp_path / "demo.sqlite"
    assert [path.name for path in tmp_path.iterdir()] == ["demo.sqlite.kept"]


def test_models_are_judged_on_as_many_points_as_was_meant(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("bench.demo_beside._FEASIBLE_SHARE", 1.0)  # more than are
    points = unseen_points(1)
    assert len(points) == 300
    assert simulate(Model.baseline(), points).feasible.all()


def test_found_needs_the_hidden_effect_to_be_named_or_in_the_group() -> None:
    named = {"verdict": "named", "named": ["a", "c"], "groups": []}
    group = {"verdict": "group", "named": [], "groups": [["a", "b"]]}
    assert was_found(named, {"a": 1.0})
    assert was_found(named, {"a": 1.0, "c": 1.0})
    assert not was_found(named, {"a": 1.0, "b": 1.0})
    assert not was_found(named, {"b": 1.0})
    assert was_found(group, {"b": 1.0})
    assert not was_found(named, {})
    assert was_found({"verdict": "consistent", "named": [], "groups": []}, {})


def _measured(folder: Path) -> pd.DataFrame:
    clock = StepClock()
    campaign = {
        "name": "same",
        "seed": 5,
        "plan": {"kind": "latin_hypercube", "points": 4, "standby": 1, "no_load": 1},
    }
    plant = Plant.virtual(seed=5, hidden={"dead_time": None}, clock=clock)
    with Rack(plant) as rack, Store(f"sqlite:///{folder / 'd2ea.sqlite'}") as store:
        bench = check(rack.bench_config(), BenchConfig, file="rack")
        job = Job.prepare(CampaignConfig.model_validate(campaign), bench)
        return measurement_table(store, run_campaign(job, store, clock))


def test_the_same_seed_measures_the_same_numbers(tmp_path: Path) -> None:
    (tmp_path / "a").mkdir()
    (tmp_path / "b").mkdir()
    pd.testing.assert_frame_equal(_measured(tmp_path / "a"), _measured(tmp_path / "b"), check_exact=True)
