"""Kept models: found again by the hash of their data and settings, and predicting the same."""

import numpy as np
import pytest

from models.boosting import BoostSettings
from models.registry import Origin, Registry, RegistryError, data_hash
from models.surrogate import train_d2ea, train_simulator_first

SMALL = BoostSettings(depth=3, trees=5, l2=1.0, rate=0.3)
WHEN = "2024-05-01T12:00:00+00:00"


@pytest.fixture(scope="module")
def tables(converter):
    return converter.simulated_grid((9, 9, 5)), converter.measured_table(60, seed=1)


@pytest.fixture(scope="module")
def model(tables):
    return train_d2ea(*tables, first=SMALL, second=SMALL)


def test_a_kept_model_predicts_the_same(tmp_path, model, tables):
    registry = Registry(tmp_path)
    record = registry.save(model, data_sha256=data_hash(*tables), created=WHEN, metrics={"mean_abs": 0.003})
    again = registry.load(record.id)
    x = (tables[1]["D1"], tables[1]["D2"], tables[1]["P2_W"])
    np.testing.assert_array_equal(again.predict(*x), model.predict(*x))
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


def test_the_rows_behind_a_model_are_kept(tmp_path, model):
    registry = Registry(tmp_path)
    origin = Origin(
        data="theirs.csv", virtual=True, fitted=("theirs.csv row 1",), held_out=("theirs.csv row 2",)
    )
    record = registry.save(model, data_sha256="0" * 64, created=WHEN, origin=origin)
    assert registry.origin(record.id) == origin
    assert (record.virtual, record.data) == (True, "theirs.csv")


def test_no_pickle_is_written(tmp_path, model):
    registry = Registry(tmp_path)
    registry.save(model, data_sha256="0" * 64, created=WHEN)
    assert {p.suffix for p in tmp_path.rglob("*") if p.is_file()} == {".json", ".ubj"}
