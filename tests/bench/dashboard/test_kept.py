"""Models and tables as the pages show them; what cannot be read is said."""

from pathlib import Path

import numpy as np

from bench.dashboard.kept import chosen_optimum, decision_rows, model_rows
from bench.lut_file import LutOrigin, write_beside
from models.boosting import BoostSettings
from models.journal import Journal
from models.lut import Lut
from models.registry import Origin, Registry
from models.surrogate import train_experiment_only
from tests.models.conftest import measured_table

WHEN = "2024-05-01T12:00:00+00:00"


def registry_with_a_model(folder: Path) -> tuple[Registry, str]:
    model = train_experiment_only(
        measured_table(30, seed=1), BoostSettings(depth=2, trees=2, l2=1.0, rate=0.5)
    )
    registry = Registry(folder)
    origin = Origin(data="campaign 1", virtual=True)
    return registry, registry.save(model, data_sha256="0" * 64, created=WHEN, origin=origin).id


def test_the_model_in_use_and_its_table_are_shown(tmp_path: Path) -> None:
    registry, model = registry_with_a_model(tmp_path)
    Journal(tmp_path).use(model, when=WHEN, reason="I trust it")
    assert "has no table" in chosen_optimum(registry).said
    two = np.array([0.5, 0.6])
    lut = Lut(power_W=1000 * two, D1=two, D2=two, predicted=two, price=0 * two, soft_edges=4 + 0 * two)
    write_beside(tmp_path / model, lut, LutOrigin.of(registry.show(model)))
    shown = chosen_optimum(registry).table
    assert shown is not None
    assert [row["P_W"] for row in shown["rows"]] == [500.0, 600.0]
    assert (shown["lab"], shown["files"]) == ("virtual lab", ["lut.csv", "lut.json", "lut.h"])
    assert [row["used"] for row in model_rows(registry)] == [True]
    assert decision_rows(registry)[0]["reason"] == "I trust it"


def test_a_damaged_table_or_journal_is_said(tmp_path: Path) -> None:
    registry, model = registry_with_a_model(tmp_path)
    (tmp_path / model / "lut.json").write_text("{")
    assert "cannot be read" in chosen_optimum(registry).said
    (tmp_path / "journal.jsonl").write_text("half a line")
    assert "not a decision" in decision_rows(registry)[0]["reason"]


def test_nothing_yet_is_said(tmp_path: Path) -> None:
    assert "d2ea optimise" in chosen_optimum(Registry(tmp_path)).said
    assert model_rows(Registry(tmp_path)) == []
