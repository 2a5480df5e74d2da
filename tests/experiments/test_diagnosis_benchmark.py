"""The diagnosis benchmark: what it times, and which labs it asks."""

from pathlib import Path

import pandas as pd
import pytest

from experiments import diagnosis_benchmark
from experiments.blind.seeds import SCORING, TUNING
from experiments.diagnosis_benchmark import BARS_S, FIRST_SEED, HIDDEN, Cost, cost, run
from experiments.harness.settings import Settings


def test_a_cost_is_of_whole_diagnoses(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    ticks = iter((10.0, 13.5, 14.0, 14.5, 20.0, 22.5, 23.0, 23.4, 30.0, 31.0, 32.0, 33.0))
    trained, simulated = list[tuple[int, int]](), pd.DataFrame({"D1": [0.9] * 7})
    settings = Settings(out=tmp_path, now=lambda: next(ticks))
    monkeypatch.setattr(diagnosis_benchmark, "RUNS", 3)
    monkeypatch.setattr(
        diagnosis_benchmark, "train_d2ea", lambda *tables: trained.append(tuple(map(len, tables)))
    )
    found = cost(diagnosis_benchmark._trial(1, 24), simulated, settings)
    assert (found.points, found.hidden, found.seconds) == (24, "link_resistance", 2.5)
    assert found.runs_s == (3.5, 2.5, 1.0)
    assert (found.trees_s, found.trainings) == (0.5, 5.0)
    ((few, rows),) = set(trained)
    assert few == 7 < 24 <= rows  # the table's rows that carry load, references among them
    assert found.verdict in ("named", "group", "consistent", "unknown")
    assert found.processor_s > 0


def test_the_slowest_lab_is_held_against_the_bar(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    seconds = iter((1.0, 2.0, 3.0, 4.0))

    def timed(trial: object, simulated: pd.DataFrame, settings: Settings) -> Cost:
        points, median_s = getattr(trial, "points", 0), next(seconds)
        runs_s = (0.5 * median_s, median_s, 9.0)
        return Cost(points=points, hidden="x", verdict="named", runs_s=runs_s, processor_s=0.1, trees_s=2.0)

    monkeypatch.setattr(diagnosis_benchmark, "cost", timed)
    monkeypatch.setattr(diagnosis_benchmark, "_simulated", pd.DataFrame)
    monkeypatch.setattr(diagnosis_benchmark, "process_s", lambda *_: (1.0, 1.0))
    monkeypatch.setattr(diagnosis_benchmark, "diagnose", lambda _: None)
    result = run(Settings(out=tmp_path, scale=0.4))
    assert [(goal.value, goal.bar) for goal in result.goals] == [(2.0, 1.5), (4.0, 10.0)]
    assert [goal.verdict for goal in result.goals] == ["missed", "met"]


def test_its_labs_are_no_trials() -> None:
    assert len(BARS_S) == 2
    assert FIRST_SEED + len(HIDDEN) < min(TUNING.first, SCORING.first)
