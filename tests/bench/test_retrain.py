"""Retraining: judged on blocks that nobody saw, promoted or kept out with the reason, back to the rows."""

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from bench.errors import BenchError, InputError
from bench.lut_file import model_of, read_lut
from bench.model_file import simulator_for
from bench.retrain import Retrainer, Retraining, newest_data, note_in_store, watch
from bench.store import Provenance, Store
from bench.trace import trace_entry
from bench.training import Trainer
from bench.training_data import Places, TrainingData
from models.calibrated import CalibratedPhysics
from models.dataset import Measurements
from models.held_blocks import held_out
from models.journal import Choice
from models.registry import ModelRecord, Registry
from models.surrogate import StagedModel
from sim.model import Model
from sim.prototype import prototype
from tests.bench.readings import imported, measured

WHEN = "2024-05-01T12:00:00+00:00"
LOADS_W = (400.0, 600.0, 800.0)
TREES = ("d2ea", "simulator_first_stage")  # a diagnosis takes longer, and most tests are not about it
OTHER = Model(converter=replace(prototype(), V1_V=330.0))
SETTINGS = {"simulator": Model.baseline(), "shape": (13, 13, 7), "loads_W": LOADS_W}


def file_data(table: pd.DataFrame, name: str = "theirs.csv") -> TrainingData:
    rows = tuple(int(row) + 1 for row in table.index)
    return TrainingData.of_file(Path(name), Measurements(frame=table, rows=rows, rejected=(), notes=()))


@cache
def shared(name: str) -> object:
    """What every retrainer here would ask the simulator for: the same loads and grid each time."""
    return getattr(Retrainer(registry=Registry(Path()), now=lambda: WHEN, **SETTINGS), name)


def retrainer(folder: Path, *kinds: str) -> Retrainer:
    made = Retrainer(registry=Registry(folder), now=lambda: WHEN, kinds=kinds or TREES, **SETTINGS)
    made.__dict__.update({name: shared(name) for name in ("search", "simulated")})
    return made


def promoted(result: Retraining) -> bool:
    return result.decision is not None and result.decision.decision is Choice.PROMOTED


@pytest.fixture(scope="module")
def first(tmp_path_factory: pytest.TempPathFactory) -> tuple[Retrainer, Retraining]:
    """A retrainer whose first candidate has been promoted."""
    made = retrainer(tmp_path_factory.mktemp("models"))
    return made, made.retrain(file_data(measured(150)))


def test_the_first_model_is_promoted_when_it_beats_the_simulation(
    first: tuple[Retrainer, Retraining],
) -> None:
    made, result = first
    assert promoted(result)
    assert result.decision is not None
    assert made.journal.in_use() == result.decision.model
    assert result.decision.errors[result.decision.model] <= result.decision.errors["simulation"]


def test_its_table_is_written_beside_it_and_leads_back_to_it(first: tuple[Retrainer, Retraining]) -> None:
    _, result = first
    assert result.decision is not None
    for file in result.files:
        assert model_of(file) == result.decision.model
        assert read_lut(file)["P_W"].tolist() == list(LOADS_W)


def test_a_model_knows_its_converter_and_is_refused_beside_another(
    first: tuple[Retrainer, Retraining],
) -> None:
    made, result = first
    assert result.decision is not None
    record = made.registry.show(result.decision.model)
    assert simulator_for(record, None) == Model.baseline()
    resistive = Model.baseline().with_effect("link_resistance", resistance_Ohm=0.1)
    assert simulator_for(record, resistive) == resistive  # the same converter, an effect besides
    with pytest.raises(BenchError, match=r"they differ in V1_V\. Name the model's own"):
        simulator_for(record, OTHER)
    with pytest.raises(BenchError, match="--models"):
        replace(made, simulator=OTHER).retrain(file_data(measured(160)))


def test_a_model_from_before_its_converter_was_kept_is_taken_as_it_was() -> None:
    record = ModelRecord(id="0" * 12, kind="d2ea", created=WHEN, data_sha256="", settings={}, metrics={})
    assert simulator_for(record, OTHER) == OTHER
    assert simulator_for(record, None) == Model.baseline()


def test_what_was_judged_was_not_fitted(first: tuple[Retrainer, Retraining]) -> None:
    made, result = first
    assert result.decision is not None
    origin = made.registry.origin(result.decision.model)
    assert not set(origin.fitted) & set(origin.held_out)
    assert len(origin.fitted) + len(origin.held_out) == len(measured(150))


def test_what_was_judged_taught_nothing(tmp_path: Path) -> None:
    odd = measured(150)
    odd.loc[held_out(odd, 2000.0), "efficiency"] -= 0.05
    result = retrainer(tmp_path).retrain(file_data(odd))
    assert result.decision is not None
    # five points off in every row that judges, and none of them was learnt
    assert result.decision.errors[result.decision.model] > 0.04


def test_the_same_data_are_not_learnt_twice(first: tuple[Retrainer, Retraining]) -> None:
    made, _ = first
    again = made.retrain(file_data(measured(150)))
    assert again.decision is None
    assert "nothing new" in again.said


def test_a_model_in_use_that_cannot_be_read_is_no_rival(tmp_path: Path) -> None:
    before = retrainer(tmp_path, "simulator_first_stage").retrain(file_data(measured(150)))
    assert before.decision is not None
    old = before.decision.model
    (tmp_path / old / "stage_2.ubj").write_bytes(b"of another version")
    heard: list[str] = []
    made = replace(retrainer(tmp_path, "d2ea"), say=heard.append)
    # the same rows: what was decided is worth nothing any more
    again = made.retrain(file_data(measured(150)))
    assert promoted(again)
    assert again.decision is not None
    assert (again.decision.replaced, set(again.decision.errors)) == (
        old,
        {again.decision.model, "simulation"},
    )
    assert again.decision.reason.endswith(
        f"model {old}, in use until now, is not compared: this version cannot read it"
    )
    assert any("stage_2.ubj: the trees of this model cannot be read" in said for said in heard)
    assert "nothing new" in made.retrain(file_data(measured(150))).said


def test_beside_what_cannot_be_read_a_candidate_still_has_to_beat_the_simulation(tmp_path: Path) -> None:
    before = retrainer(tmp_path, "simulator_first_stage").retrain(file_data(measured(150)))
    assert before.decision is not None
    (tmp_path / before.decision.model / "stage_2.ubj").write_bytes(b"of another version")
    odd = measured(150)
    odd.loc[~held_out(odd, 2000.0), "efficiency"] -= (
        0.05  # what is learnt is wrong by five points where it is judged
    )
    made = retrainer(tmp_path, "d2ea")
    assert not promoted(made.retrain(file_data(odd, "odd.csv")))
    assert made.journal.in_use() == before.decision.model


def test_a_worse_candidate_is_kept_out_with_the_reason(first: tuple[Retrainer, Retraining]) -> None:
    made, before = first
    broken = measured(150)
    broken.loc[~held_out(broken, 2000.0), "efficiency"] -= (
        0.05  # what it learns from is not what it is judged on
    )
    result = made.retrain(file_data(broken))
    assert result.decision is not None
    assert result.decision.decision is Choice.KEPT_OUT
    assert "points on" in result.decision.reason
    assert before.decision is not None
    assert made.journal.in_use() == before.decision.model


def record(id: str) -> ModelRecord:
    return ModelRecord(id=id, kind="d2ea", created=WHEN, data_sha256="0", settings={}, metrics={})


def test_a_model_that_was_taken_back_does_not_return_by_itself(tmp_path: Path) -> None:
    made = retrainer(tmp_path)
    for model in ("0123456789ab", "ba9876543210"):
        made.journal.use(model, when=WHEN, reason="chosen")
    made.journal.roll_back(when=WHEN, reason="odd")
    errors = {"candidate": 0.001, "simulation": 0.1, "0123456789ab": 0.01}
    decided = made._decide(record("ba9876543210"), errors, 30)
    assert decided.decision is Choice.KEPT_OUT
    assert "took this very model back" in decided.reason
    assert made._decide(record("aaaaaaaaaaaa"), errors, 30).decision is Choice.PROMOTED


def test_too_few_rows_wait(tmp_path: Path) -> None:
    result = retrainer(tmp_path).retrain(file_data(measured(12)))
    assert result.decision is None
    assert "waiting" in result.said


# --- who predicts nothing ---------------------------------------------------------------------------


class Blind:
    """A model that predicts nothing anywhere."""

    def predict(self, D1, D2, power_W):
        return np.full(np.shape(power_W), np.nan)


def blinded(monkeypatch: pytest.MonkeyPatch, *kinds: str) -> None:
    """Let candidates of these kinds predict nothing."""
    fit = Trainer.fit

    def fitted(self: Trainer, kind: str, data: TrainingData, chosen: Places) -> StagedModel:
        return StagedModel(kind=kind, stages=(Blind(),)) if kind in kinds else fit(self, kind, data, chosen)

    monkeypatch.setattr(Trainer, "fit", fitted)


def test_a_candidate_that_predicts_none_of_the_unseen_rows_is_left_out(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    blinded(monkeypatch, "simulator_first_stage")
    rows = measured(150)
    result = retrainer(tmp_path).retrain(file_data(rows))
    assert result.decision is not None
    assert result.decision.reason.startswith("d2ea, ")
    unseen = int(held_out(rows, 2000.0).sum())
    told = f"simulator_first_stage predicts none of the {unseen} unseen rows to judge on"
    assert result.decision.reason.endswith(told)


def test_where_no_candidate_predicts_more_rows_are_waited_for(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    blinded(monkeypatch, *TREES)
    result = retrainer(tmp_path).retrain(file_data(measured(150)))
    assert result.decision is None
    assert result.said.startswith("waiting: d2ea predicts none of the ")


def test_where_the_simulation_predicts_nothing_more_rows_are_waited_for(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("bench.retrain.SimulatorStage", lambda efficiency: Blind())
    result = retrainer(tmp_path, "d2ea").retrain(file_data(measured(150)))
    assert result.decision is None
    assert result.said.endswith("unseen rows is predicted by the simulation")


# --- calibrated physics ---------------------------------------------------------------------------------


def test_calibrated_physics_is_retrained_beside_the_trees_and_wins(tmp_path: Path) -> None:
    said: list[str] = []
    made = replace(retrainer(tmp_path, "d2ea", "calibrated"), say=said.append)
    made.__dict__.update({name: shared(name) for name in ("search", "simulated")})
    result = made.retrain(file_data(measured(60)))
    assert promoted(result)
    assert result.decision is not None
    assert result.decision.reason.startswith("calibrated, ")
    assert "; d2ea " in result.decision.reason  # what the other one came to
    # efficiency alone and a fifth held out, yet the cause is in the catalogue: a tenth of the simulation's error
    error, simulation = result.decision.errors[result.decision.model], result.decision.errors["simulation"]
    assert error < 0.1 * simulation
    assert any("weighing the causes" in line for line in said)
    (kept,) = made.registry.load(result.decision.model).stages
    assert isinstance(kept, CalibratedPhysics)
    assert read_lut(result.files[0])["P_W"].tolist() == list(LOADS_W)


def test_too_few_rows_for_a_diagnosis_leave_the_trees(tmp_path: Path) -> None:
    at_the_limit = measured(150)
    rows = file_data(at_the_limit.assign(D1=0.75, D2=0.2, P2_W=1290.0 + np.arange(len(at_the_limit)) % 3))
    alone = retrainer(tmp_path / "alone", "calibrated").retrain(rows)
    assert alone.decision is None
    assert "waiting: no calibrated model: " in alone.said


def test_standby_goes_to_the_diagnosis_and_nowhere_else() -> None:
    idle = pd.DataFrame({"kind": ["standby", "no_load"], "P1_W": [1.0, 9.0]})
    data = file_data(pd.concat([idle, measured(20)], ignore_index=True))
    assert len(data) == len(data.rows) == len(measured(20))
    some = data.beside_idle(np.array([0, 2]))
    assert some["kind"].tolist() == ["standby", "no_load", "load", "load"]
    assert some["D1"].tolist()[2:] == measured(20)["D1"].iloc[[0, 2]].tolist()


# --- from the database ----------------------------------------------------------------------------------


def test_an_entry_leads_back_to_its_measurements_or_says_that_they_are_gone(
    store: Store, tmp_path: Path
) -> None:
    campaign = imported(store, measured(150))
    data = newest_data(store)
    assert data is not None
    made = retrainer(tmp_path / "models")
    result = made.retrain(data)
    note_in_store(store, data, result)
    assert store.models(campaign)[0]["detail"]["decision"] == "promoted"
    file, lut = result.files[0], read_lut(result.files[0])
    told = trace_entry(file, lut, 610.0, registry=made.registry, db=store.url)
    assert told.virtual
    assert "600 W" in told.lines[0]
    nearest = [line for line in told.lines if line.startswith("near it: campaign")]
    names = set(made.registry.origin(model_of(file)).fitted)
    assert len(nearest) == 3
    assert all(line.removeprefix("near it: ").split(":")[0] in names for line in nearest)
    gone = trace_entry(file, lut, 600.0, registry=made.registry, db=f"sqlite:///{tmp_path}/other.sqlite")
    assert "cannot be looked at: there is no campaign 1" in gone.lines[-1]


def test_the_time_of_a_campaign_goes_on_from_the_one_before(store: Store) -> None:
    table = measured(20).assign(time_s=lambda t: 10.0 * np.arange(len(t)))
    ids = [imported(store, table), imported(store, table)]
    time_s = TrainingData.of_campaigns(store, ids).rows["time_s"].to_numpy()
    assert time_s[len(table)] == time_s[len(table) - 1] == table["time_s"].max()
    assert time_s[-1] == 2 * table["time_s"].max()


def test_watching_retrains_once_per_batch_of_rows(store: Store, tmp_path: Path) -> None:
    looks = iter([True, True, True, False])
    told: list[int] = []

    def wait() -> bool:
        if len(told) == 1:
            imported(store, measured(60, seed=2))
        return next(looks)

    imported(store, measured(20))
    for data, _ in watch(store, retrainer(tmp_path / "models"), every=10, wait=wait):
        told.append(len(data))
        if len(told) == 2:
            break
    assert told == [len(measured(20)), len(measured(60, seed=2))]


def test_a_virtual_lab_and_hardware_are_never_mixed(store: Store) -> None:
    first_id = imported(store, measured(20))
    second = store.import_table("real", measured(20), Provenance(config={}, config_hash="0", virtual=False))
    with pytest.raises(InputError, match="never learnt from together"):
        TrainingData.of_campaigns(store, [first_id, second])
