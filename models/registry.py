"""Trained models on disk: one folder per model, named by the hash of its data and settings.

::

    <root>/<id>/metadata.json     kind, data hash, settings, metrics, when, from whose data, beside which simulator
    <root>/<id>/rows.json         the measured rows that it was fitted to, and those it was judged on
    <root>/<id>/stage_1.ubj       XGBoost's own format, one file per ensemble of trees
    <root>/<id>/stage_1.json      its settings; of calibrated physics all that there is (models/calibrated_file.py)

The same data and settings give the same id, so training twice keeps one folder. A stage that is the
simulator is not stored, only of which converter with which effects: whoever loads the model hands the simulator
in. Calibrated physics is the simulator with numbers of its own, and is stored with them and their hash. Which model
is in use, and why, is in :mod:`models.journal`.
"""

import hashlib
import json
import re
import shutil
import uuid
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import pandas as pd

from models.boosting import BoostedTrees
from models.surrogate import CALIBRATED, EfficiencyModel, Simulator, SimulatorStage, StagedModel

if TYPE_CHECKING:
    from sim.model import Model

SCHEMA = 2
_SIMULATOR = "simulator"


class RegistryError(ValueError):
    """A model that is not there, or cannot be kept or read; says what there is."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ModelRecord:
    """What is known of a stored model without loading it."""

    id: str
    kind: str
    created: str  # ISO 8601
    data_sha256: str
    settings: Mapping[str, object]  # of each stage, by its name
    metrics: Mapping[str, float]
    virtual: bool | None = None  # whether its measurements come from a virtual lab; None: nobody said
    data: str = ""  # where they are: a database and its campaigns, or a file
    # as plain data: converter, modulation, effects; None: not recorded
    simulator: Mapping[str, object] | None = None

    def made_beside(self) -> "Model | None":
        """The simulation model that it was trained beside; RegistryError where its description cannot be read."""
        from sim.model import Model  # here: the simulator loads slowly

        if self.simulator is None:
            return None
        try:
            return Model.from_plain(self.simulator)
        except (KeyError, TypeError, ValueError) as error:  # ParameterError is a ValueError
            raise RegistryError(f"model {self.id}: its simulation model cannot be read ({error})") from error


@dataclass(frozen=True, slots=True, kw_only=True)
class Origin:
    """Where a model's measurements come from: the way back from what it says to what was measured.

    ``fitted`` and ``held_out`` name rows, such as ``campaign 3 point 17 repeat 0`` or ``theirs.csv row 5``.
    ``simulator`` is the simulation model of the converter that was measured, as plain data.
    """

    data: str = ""
    virtual: bool | None = None
    fitted: tuple[str, ...] = ()
    held_out: tuple[str, ...] = ()
    simulator: Mapping[str, object] | None = None


def data_hash(*tables: pd.DataFrame) -> str:
    """SHA-256 over column names and values of training tables, in the order of their rows."""
    digest = hashlib.sha256()
    for table in tables:
        digest.update(json.dumps([str(column) for column in table.columns]).encode())
        digest.update(pd.util.hash_pandas_object(table, index=False).to_numpy().tobytes())
    return digest.hexdigest()


class Registry:
    """The models below one folder."""

    def __init__(self, root: Path) -> None:
        self.root = root

    def save(
        self,
        model: StagedModel,
        *,
        data_sha256: str,
        created: str,
        metrics: Mapping[str, float] | None = None,
        origin: Origin | None = None,
    ) -> ModelRecord:
        """Keep a model; a model of the same data and settings that is already there stays as it is."""
        settings = {f"stage_{number}": _settings(stage) for number, stage in enumerate(model.stages, start=1)}
        origin = origin or Origin()
        identity = json.dumps([SCHEMA, model.kind, data_sha256, settings], sort_keys=True)
        record = ModelRecord(
            id=_hash(identity)[:12],
            kind=model.kind,
            created=created,
            data_sha256=data_sha256,
            settings=settings,
            metrics=dict(metrics or {}),
            virtual=origin.virtual,
            data=origin.data,
            simulator=origin.simulator,
        )
        if (self.root / record.id / "metadata.json").is_file():
            return self.show(record.id)
        self._write(record, model, origin)
        return record

    def list(self) -> tuple[ModelRecord, ...]:
        """All models that can be read, the oldest first."""
        records = (each for each in self._each() if isinstance(each, ModelRecord))
        return tuple(sorted(records, key=lambda record: (record.created, record.id)))

    def unreadable(self) -> tuple[str, ...]:
        """Why other models cannot be read, a sentence each: of another version, or damaged."""
        return tuple(str(each) for each in self._each() if isinstance(each, RegistryError))

    def _each(self) -> Iterator[ModelRecord | RegistryError]:
        """What every folder holds, or why that cannot be read."""
        for id in sorted(path.parent.name for path in self.root.glob("*/metadata.json")):
            try:
                yield self.show(id)
            except RegistryError as error:
                yield error

    def show(self, id: str) -> ModelRecord:
        """What is known of one model; raises RegistryError when it is not there or not readable."""
        path = self._folder(id) / "metadata.json"
        try:
            metadata = json.loads(path.read_text())
            if metadata.pop("schema") != SCHEMA:
                raise RegistryError(f"{path}: this version reads schema {SCHEMA} only")
            return ModelRecord(**metadata)
        except FileNotFoundError:
            there = ", ".join(sorted(p.parent.name for p in self.root.glob("*/metadata.json"))) or "none"
            raise RegistryError(f"no model {id!r} in {self.root}; there are: {there}") from None
        except (KeyError, TypeError, json.JSONDecodeError) as error:
            raise RegistryError(f"{path}: not the metadata of a model ({error})") from error

    def origin(self, id: str) -> Origin:
        """The rows behind a model; raises RegistryError when they are not there or not readable."""
        record = self.show(id)
        path = self._folder(id) / "rows.json"
        try:
            rows = json.loads(path.read_text())
            return Origin(
                data=record.data,
                virtual=record.virtual,
                simulator=record.simulator,
                fitted=tuple(rows["fitted"]),
                held_out=tuple(rows["held_out"]),
            )
        except (OSError, KeyError, TypeError, json.JSONDecodeError) as error:
            raise RegistryError(f"{path}: not the rows of a model ({error})") from error

    def load(self, id: str, simulator: Simulator | None = None) -> StagedModel:
        """The model itself; one with the simulator as a stage needs ``simulator``."""
        record = self.show(id)
        stages: list[EfficiencyModel] = []
        for name, settings in record.settings.items():
            if isinstance(settings, Mapping) and CALIBRATED in settings:
                stages.append(_calibrated(self._folder(id) / f"{name}.json", settings[CALIBRATED]))
            elif settings != _SIMULATOR:
                stages.append(_trees(self._folder(id) / f"{name}.ubj"))
            elif simulator is not None:
                stages.append(SimulatorStage(simulator))
            else:
                raise RegistryError(f"model {id} has the simulator as {name}; hand it in to load the model")
        return StagedModel(kind=record.kind, stages=tuple(stages))

    def _folder(self, id: str) -> Path:
        if not re.fullmatch(r"[0-9a-f]{12}", id):
            raise RegistryError(f"{id!r} is not the id of a model: 12 hexadecimal digits")
        return self.root / id

    def _write(self, record: ModelRecord, model: StagedModel, origin: Origin) -> None:
        """Write beside the final folder and move it there whole: a reader never meets half a model."""
        folder, final = self.root / f".new-{uuid.uuid4().hex}", self.root / record.id
        try:
            folder.mkdir(parents=True)
            for name, stage in zip(record.settings, model.stages, strict=True):
                if isinstance(stage, BoostedTrees):
                    stage.save(folder / f"{name}.ubj")
                elif not isinstance(stage, SimulatorStage):
                    (folder / f"{name}.json").write_text(_text(stage))
            metadata = {"schema": SCHEMA, **asdict(record)}
            (folder / "metadata.json").write_text(json.dumps(metadata, indent=2) + "\n")
            rows = {"fitted": origin.fitted, "held_out": origin.held_out}
            (folder / "rows.json").write_text(json.dumps(rows) + "\n")
            try:
                folder.replace(final)
            except OSError as error:
                if (final / "metadata.json").is_file():
                    return  # another process has just kept the same model
                raise RegistryError(
                    f"{final}: cannot be written ({error.strerror}); if it is no model, move it away and try again"
                ) from error
        except OSError as error:
            said = (
                f"{final}: cannot be written ({error.strerror}); make room, or keep models in another folder"
            )
            raise RegistryError(said) from error
        finally:
            shutil.rmtree(folder, ignore_errors=True)


def _settings(stage: EfficiencyModel) -> object:
    if isinstance(stage, BoostedTrees):
        return asdict(stage.settings)
    if isinstance(stage, SimulatorStage):
        return _SIMULATOR
    return {CALIBRATED: _hash(_text(stage))}


def _text(stage: EfficiencyModel) -> str:
    """Calibrated physics as the text of its file; RegistryError for a stage of another kind."""
    from models.calibrated import CalibratedPhysics  # here: the simulator loads slowly
    from models.calibrated_file import calibrated_text

    if not isinstance(stage, CalibratedPhysics):
        kept = "trees, the simulator and calibrated physics can"
        raise RegistryError(f"a stage of type {type(stage).__name__} cannot be kept; {kept}")
    return calibrated_text(stage)


def _calibrated(path: Path, sha256: object) -> EfficiencyModel:
    # here: the simulator loads slowly
    from models.calibrated_file import CalibratedFileError, read_calibrated

    try:
        text = path.read_text(encoding="utf-8")
        physics = read_calibrated(text)
    except (OSError, UnicodeDecodeError, CalibratedFileError) as error:
        raise RegistryError(
            f"{path}: the calibrated physics of this model cannot be read ({error})"
        ) from error
    if _hash(text) != sha256:
        raise RegistryError(f"{path}: was changed after it was written: its hash is not {sha256}")
    return physics


def _trees(path: Path) -> BoostedTrees:
    try:
        return BoostedTrees.load(path)
    except (OSError, TypeError, ValueError) as error:  # XGBoost's own is a ValueError
        said = str(error).splitlines()[0]
        raise RegistryError(f"{path}: the trees of this model cannot be read ({said})") from error


def _hash(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()
