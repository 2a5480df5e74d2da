"""Kept models: found again by the hash of their data and settings, and predicting the same."""

import errno

import numpy as np
import pytest

from bench.wording import MODEL_NAMES
from models.boosting import BoostSettings
from models.calibrated import CalibratedPhysics, Leftover, vouched
from models.registry import Origin, Registry, RegistryError, data_hash
from models.surrogate import (
    CALIBRATED,
    StagedModel,
    train_d2ea,
    train_experiment_only,
    train_simulation_only,
    train_simulator_first,
)
from sim.model import Model
from sim.spread import everyday_spread

SMALL = BoostSettings(depth=3, trees=5, l2=1.0, rate=0.3)
WHEN = "2024-05-01T12:00:00+00:00"


@pytest.fixture(scope="module")
def tables(converter):
    return converter.simulated_grid((9, 9, 5)), converter.measured_table(60, seed=1)


@pytest.fixture(scope="module")
def model(tables):
    return train_d2ea(*tables, first=SMALL, second=SMALL)


@pytest.fixture(scope="module")
def calibrated():
    """A converter whose parts are all off, with an effect and a leftover."""
    rng = np.random.default_rng(3)
    baseline = Model.baseline().with_effect("link_resistance", resistance_Ohm=0.07)
    spread = everyday_spread(baseline.converter)

    def shifted():
        converter = baseline.converter
        for entry in spread:
            converter = entry.shifted(converter, rng.normal())
        return Model(converter=converter, effects=baseline.effects)

    place = rng.uniform([0.4, 0.0, 200.0, 0.0, 5.0], [1.0, 0.5, 1800.0, 900.0, 50.0], (12, 5))
    empty = Leftover(
        place=place, weight=np.zeros(12), noise_W=np.zeros(12), length=np.array([0.2, 0.2, 400.0, 100.0])
    )
    physics = CalibratedPhysics(
        model=shifted(),
        variants=tuple(shifted() for _ in range(2)),
        leftover=empty.fitted(0.3 * rng.standard_normal(12), np.full(12, 0.1)),
        V1_V=299.7, V2_V=140.1, ambient_C=24.3, time_s=900.0, shown=-0.001,
    )  # fmt: skip
    return StagedModel(kind=CALIBRATED, stages=(physics,))


@pytest.fixture(scope="module")
def kinds(converter, tables, model, calibrated):
    """A model of every kind that is kept."""
    return {
        "simulation_only": train_simulation_only(tables[0], SMALL),
        "experiment_only": train_experiment_only(tables[1], SMALL),
        "d2ea": model,
        "simulator_first_stage": train_simulator_first(converter.simulated_efficiency, tables[1], SMALL),
        "calibrated": calibrated,
    }


@pytest.mark.parametrize("kind", MODEL_NAMES)
def test_a_kept_model_predicts_the_same(tmp_path, kind, kinds, converter, tables):
    registry, model = Registry(tmp_path), kinds[kind]
    record = registry.save(model, data_sha256=data_hash(*tables), created=WHEN, metrics={"mean_abs": 0.003})
    again = registry.load(record.id, converter.simulated_efficiency)
    x = (tables[1]["D1"], tables[1]["D2"], tables[1]["P2_W"])
    np.testing.assert_array_equal(again.predict(*x), model.predict(*x))
    assert again.kind == model.kind == record.kind == kind
    assert registry.show(record.id) == record
    assert record.metrics["mean_abs"] == 0.003


def test_the_id_follows_data_and_settings(tmp_path, model, tables):
    registry = Registry(tmp_path)
    one = registry.save(model, data_sha256=data_hash(*tables), created=WHEN)
    same = registry.save(model, data_sha256=data_hash(*tables), created="2025-01-01T00:00:00+00:00")
    changed = tables[1].assign(D1=tables[1]["D1"] + 1e-9)
    other = registry.save(model, data_sha256=data_hash(tables[0], changed), created=WHEN)
    deeper = train_d2ea(*tables, first=SMALL, second=BoostSettings(depth=4, trees=5, l2=1.0, rate=0.3))
    third = registry.save(deeper, data_sha256=data_hash(*tables), created=WHEN)
    assert same == one
    assert len({one.id, other.id, third.id}) == 3
    assert {record.id for record in registry.list()} == {one.id, other.id, third.id}


def test_a_simulator_stage_is_handed_in_again(tmp_path, converter, tables):
    model = train_simulator_first(converter.simulated_efficiency, tables[1], SMALL)
    registry = Registry(tmp_path)
    record = registry.save(model, data_sha256="0" * 64, created=WHEN)
    with pytest.raises(RegistryError, match="hand it in"):
        registry.load(record.id)
    again = registry.load(record.id, converter.simulated_efficiency)
    assert again.predict(0.8, 0.2, 700.0) == model.predict(0.8, 0.2, 700.0)


@pytest.mark.parametrize("id", ["0123456789ab", "../../etc", ""])
def test_a_model_that_is_not_there_is_named(tmp_path, id):
    with pytest.raises(RegistryError, match=r"no model '0123456789ab'|not the id of a model"):
        Registry(tmp_path).show(id)


def test_nothing_half_written_is_listed(tmp_path, model):
    (tmp_path / ".new-left").mkdir()
    (tmp_path / "0123456789ab").mkdir()
    assert Registry(tmp_path).list() == ()
    assert Registry(tmp_path / "absent").list() == ()


def test_others_are_listed_beside_one_that_cannot_be_read(tmp_path, model):
    registry = Registry(tmp_path)
    record = registry.save(model, data_sha256="0" * 64, created=WHEN)
    other = registry.save(model, data_sha256="1" * 64, created=WHEN)
    (tmp_path / other.id / "metadata.json").write_text('{"schema": 99}')
    assert [each.id for each in registry.list()] == [record.id]
    (said,) = registry.unreadable()
    assert other.id in said
    assert "reads schema 2 only" in said


def test_a_full_disk_is_said_and_leaves_nothing(tmp_path, model, monkeypatch):
    def full(*_):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr("models.boosting.Path.write_bytes", full)
    with pytest.raises(RegistryError, match=r"cannot be written \(No space left on device\); make room"):
        Registry(tmp_path).save(model, data_sha256="0" * 64, created=WHEN)
    assert not list(tmp_path.iterdir())


def test_a_folder_in_the_way_is_said_and_left(tmp_path, model):
    id = Registry(tmp_path / "elsewhere").save(model, data_sha256="0" * 64, created=WHEN).id
    (tmp_path / id).mkdir()
    (tmp_path / id / "notes.txt").write_text("mine")
    with pytest.raises(RegistryError, match=f"{id}: cannot be written .*move it away"):
        Registry(tmp_path).save(model, data_sha256="0" * 64, created=WHEN)
    assert (tmp_path / id / "notes.txt").read_text() == "mine"
    assert not list(tmp_path.glob(".new-*"))


def test_a_kept_model_may_be_read_by_whoever_may_read_other_files(tmp_path, model):
    record = Registry(tmp_path).save(model, data_sha256="0" * 64, created=WHEN)
    (tmp_path / "plain").mkdir()
    assert (tmp_path / record.id).stat().st_mode == (tmp_path / "plain").stat().st_mode


def test_damaged_metadata_is_said(tmp_path, model):
    registry = Registry(tmp_path)
    record = registry.save(model, data_sha256="0" * 64, created=WHEN)
    (tmp_path / record.id / "metadata.json").write_text('{"schema": 2}')
    with pytest.raises(RegistryError, match="not the metadata"):
        registry.show(record.id)


def test_a_model_of_another_version_is_said(tmp_path, model):
    registry = Registry(tmp_path)
    record = registry.save(model, data_sha256="0" * 64, created=WHEN)
    (tmp_path / record.id / "metadata.json").write_text('{"schema": 99}')
    with pytest.raises(RegistryError, match="reads schema 2 only"):
        registry.show(record.id)


def test_damaged_trees_are_said(tmp_path, model):
    registry = Registry(tmp_path)
    record = registry.save(model, data_sha256="0" * 64, created=WHEN)
    (tmp_path / record.id / "stage_2.ubj").write_bytes(b"not trees")
    with pytest.raises(RegistryError, match=r"stage_2.ubj: the trees of this model cannot be read"):
        registry.load(record.id)


def test_kept_calibrated_physics_is_as_sure_as_before(tmp_path, calibrated):
    registry = Registry(tmp_path)
    again = registry.load(registry.save(calibrated, data_sha256="0" * 64, created=WHEN).id)
    place = np.array([[0.8, 0.1, 700.0], [0.9, 0.3, 400.0]])
    (before,), (after,) = calibrated.stages, again.stages
    np.testing.assert_array_equal(after.left_open(place), before.left_open(place))
    assert vouched(again).spare == before.vouched().spare > 0


@pytest.mark.parametrize(
    ("before", "after", "said"),
    [
        ('"schema": 5', '"schema": 9', "reads schema 5 only; make it again with d2ea train"),
        ('"resistance_Ohm": 0.07}', '"resistance_Ohm": 0.08}', "was changed after it was written"),
        ('"resistance_Ohm": 0.07}', '"resistance": 0.07}', "link_resistance"),
        ('"V1_V": 299.7', '"V1": 299.7', "'V1_V' is missing"),
        ('"length": [0.2, ', '"length": [', r"leftover.length has shape \(3,\)"),
        ('"hybrid"', '"hybird"', "hybird"),
        ('"bench"', "", "double quotes"),
    ],
)
def test_damaged_calibrated_physics_is_said(tmp_path, calibrated, before, after, said):
    registry = Registry(tmp_path)
    record = registry.save(calibrated, data_sha256="0" * 64, created=WHEN)
    file = tmp_path / record.id / "stage_1.json"
    assert before in file.read_text()
    file.write_text(file.read_text().replace(before, after))
    with pytest.raises(RegistryError, match=f"stage_1.json: .*{said}"):
        registry.load(record.id)


def test_a_file_that_is_gone_is_said(tmp_path, calibrated):
    registry = Registry(tmp_path)
    record = registry.save(calibrated, data_sha256="0" * 64, created=WHEN)
    (tmp_path / record.id / "stage_1.json").unlink()
    with pytest.raises(RegistryError, match=r"stage_1.json: .*cannot be read"):
        registry.load(record.id)


def test_a_stage_of_another_kind_is_refused(tmp_path):
    with pytest.raises(RegistryError, match="type object cannot be kept"):
        Registry(tmp_path).save(
            StagedModel(kind="odd", stages=(object(),)), data_sha256="0" * 64, created=WHEN
        )


def test_the_rows_behind_a_model_are_kept(tmp_path, model):
    registry = Registry(tmp_path)
    origin = Origin(
        data="theirs.csv", virtual=True, fitted=("theirs.csv row 1",), held_out=("theirs.csv row 2",)
    )
    record = registry.save(model, data_sha256="0" * 64, created=WHEN, origin=origin)
    assert registry.origin(record.id) == origin
    assert (record.virtual, record.data) == (True, "theirs.csv")


def test_no_pickle_is_written(tmp_path, kinds):
    registry = Registry(tmp_path)
    for model in kinds.values():
        registry.save(model, data_sha256="0" * 64, created=WHEN)
    assert {p.suffix for p in tmp_path.rglob("*") if p.is_file()} == {".json", ".ubj"}
