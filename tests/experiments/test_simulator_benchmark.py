"""The benchmark's parts: they agree where the simulator is right, and say what is missing or wrong."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from bench.errors import InputError
from experiments.harness.settings import Settings
from experiments.simulator import circuit_simulator, reference
from experiments.simulator.agreement import dense_scan, lossless_single_phase_shift, time_stepping
from experiments.simulator.load_steps import best_table
from experiments.simulator.points import running_points
from experiments.simulator.speed import GridCost, sweep_ladder
from experiments.simulator_benchmark import PARTS, _parts, run
from sim.model import Model
from sim.simulate import grid, simulate


def test_the_closed_form_and_the_scan_are_met(tmp_path: Path) -> None:
    settings = Settings(out=tmp_path, scale=0.02)
    for findings in (lossless_single_phase_shift(), dense_scan(settings)):
        assert all(goal.met for goal in findings.goals)


def test_time_stepping_judges_current_and_power(tmp_path: Path) -> None:
    goals = time_stepping(Settings(out=tmp_path, scale=0.04)).goals
    assert [goal.unit for goal in goals] == ["%", "%"]
    assert all(0 < goal.value < 1.0 for goal in goals)  # the bar itself is the benchmark's to judge


def test_a_ladder_of_one_rung_has_no_ratio(tmp_path: Path) -> None:
    findings = sweep_ladder(Settings(out=tmp_path, scale=1e-6, processes=1))
    assert [goal.unit for goal in findings.goals] == ["GiB"]
    assert "10,000 points only" in findings.notes[0]
    assert not list(tmp_path.iterdir())


def test_without_ngspice_the_row_says_so_and_is_missed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(circuit_simulator, "installed", lambda: False)
    findings = circuit_simulator.ngspice_findings(1e-4, Settings(out=tmp_path))
    assert len(findings.goals) == 3
    assert not any(goal.met for goal in findings.goals)
    assert "not run" in findings.notes[0]


def test_a_point_costs_processor_time() -> None:
    assert GridCost(seconds=2.0, processor_s=1.0, feasible=5000, processes=1).per_point_s == pytest.approx(
        2e-4
    )


def test_drawn_points_run() -> None:
    points = running_points(20, np.random.default_rng(1))
    assert simulate(Model.baseline(), points).feasible.all()


def test_the_best_of_a_grid_is_a_rising_table() -> None:
    table = best_table(simulate(Model.baseline(), grid((6, 6, 4))))
    assert (np.diff(table.power_W) > 0).all()
    assert ((table.D1 > 0) & (table.D2 < 1)).all()


def reference_file(path: Path, **changes: object) -> Path:
    """Rows that this simulator made itself, logged at the middle of a step."""
    D2_theirs = np.array([0.8, 0.7, 0.9])
    table = pd.DataFrame({
        "Vin_V": 200.0, "Vref_V": 200.0, "P_W": [400.0, 300.0, 500.0], "D1": [0.8, 0.7, 0.9], "D2": D2_theirs,
        "D0": 0.05, "I_L_pp_A": 5.0, "I_L_rms_A": 2.0, "valid": 1,
    })  # fmt: skip
    for name, value in changes.items():
        table[name] = value
    table.to_csv(path, index=False)
    return path


def test_a_reference_of_our_own_waveforms_has_no_error(tmp_path: Path) -> None:
    path = reference_file(tmp_path / "own.csv")
    rows = reference._read(path)
    rms, pp = reference._current(rows, rows.D0_lead - np.asarray(rows.points.D2))
    own = reference_file(tmp_path / "own.csv", I_L_rms_A=rms, I_L_pp_A=pp)
    table = reference.reference_findings(own).tables[0]
    logged = next(row for row in table.rows if row[0] == "as logged")
    assert logged[1:5] == pytest.approx((0.0, 0.0, 0.0, 0.0), abs=1e-9)


def test_without_a_file_the_reference_is_not_run() -> None:
    findings = reference.reference_findings(None)
    assert not findings.goals
    assert "not run" in findings.notes[0]


def test_a_reference_that_lacks_a_column_or_a_number_is_named(tmp_path: Path) -> None:
    path = reference_file(tmp_path / "bad.csv", I_L_pp_A=["1", "x", "2"])
    with pytest.raises(InputError, match=r"bad.csv:3: row: numbers in every column"):
        reference.reference_findings(path)
    pd.read_csv(path).drop(columns="D0").to_csv(path, index=False)
    with pytest.raises(InputError, match="D0: column is missing"):
        reference.reference_findings(path)


def test_only_the_parts_asked_for_are_run(tmp_path: Path) -> None:
    result = run(Settings(out=tmp_path, only=("closed_form", "reference")))
    assert [goal.name.split(",")[0] for goal in result.goals] == ["SPS lossless", "SPS lossless"]
    assert result.notes == ("reference points: not run (--reference FILE)",)


def test_every_part_that_can_be_asked_for_is_one(tmp_path: Path) -> None:
    assert set(_parts(Settings(out=tmp_path))) == set(PARTS)
