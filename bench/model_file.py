"""model.toml: a simulation model (a converter, its modulation, effects with their values) as an operator's file.

One that a diagnosis has extended says beside it, in a table ``diagnosis``, what the effects rest on. Nothing that
simulates goes by that.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pandas as pd

from bench.errors import BenchError, InputError, Problem
from bench.toml_file import line_of, read_toml, to_toml
from bench.whole_file import write_whole
from models.registry import ModelRecord, data_hash
from sim.converter_data import ConverterDataError, converter_from_plain, converter_to_plain
from sim.model import Model
from sim.parameters import Converter, ParameterError
from sim.prototype import prototype

KEYS = ("converter", "modulation", "effects", "diagnosis")
_NAMED = 3  # values in which two converters differ


def read_model(path: Path) -> Model:
    """The model in a file; InputError names each unknown key, wrong value or effect with its line."""
    data, text = read_toml(path), path.read_text(encoding="utf-8")
    problems = [
        _problem(path, text, (key,), None, f"unknown key; known here: {', '.join(KEYS)}")
        for key in data
        if key not in KEYS
    ]
    if not data:
        problems.append(
            _problem(path, text, ("file",), None, "holds nothing; name a converter, a modulation or effects")
        )
    converter = _converter(path, text, data, problems)
    effects = data.get("effects", {})
    good: dict[str, dict[str, float]] = {}
    for name, values in effects.items() if isinstance(effects, dict) else [("effects", effects)]:
        try:
            good[name] = _numbers(values)
            Model(converter=converter or prototype(), effects={name: good[name]})
        except (ParameterError, TypeError, ValueError) as error:
            problems.append(_problem(path, text, ("effects", name), None, str(error)))
    if problems or converter is None:
        raise InputError(problems)
    return Model(converter=converter, effects=good)


def model_from(path: Path | None) -> Model:
    """The simulation model in a file, or the baseline."""
    return Model.baseline() if path is None else read_model(path)


def simulator_for(record: ModelRecord, asked: Model | None) -> Model:
    """The simulation model to search a kept model beside: what is asked for, else what it was trained beside.

    Raises BenchError where what is asked for is another converter than the one that the model is of.
    """
    own = record.made_beside()
    if own is None or asked is None:
        return asked or own or Model.baseline()
    if asked.converter != own.converter:
        a, b = (_flat(converter_to_plain(m.converter) | _modulation(m)) for m in (own, asked))
        others = [name for name in a | b if a.get(name) != b.get(name)]
        more = f" and {len(others) - _NAMED} more" if len(others) > _NAMED else ""
        raise BenchError(
            f"model {record.id} is of the converter {own.converter.name!r}, the simulation model asked for of "
            f"{asked.converter.name!r}; they differ in {', '.join(others[:_NAMED])}{more}. Name the model's own with "
            "--sim-model, or keep the models of each converter in a folder of their own with --models"
        )
    return asked


def _modulation(model: Model) -> dict[str, object]:
    return {"modulation": model.converter.modulation}


def _flat(plain: Mapping[str, object], before: str = "") -> dict[str, object]:
    """Nested plain data by dotted path."""
    found: dict[str, object] = {}
    for name, value in plain.items():
        found |= _flat(value, f"{before}{name}.") if isinstance(value, Mapping) else {before + name: value}
    return found


def write_model(path: Path, model: Model, diagnosis: Mapping[str, Any] | None = None) -> None:
    """Write a model, and what it rests on where a ``diagnosis`` extended it; :func:`read_model` reads the model."""
    beside = {} if diagnosis is None else {"diagnosis": diagnosis}
    write_whole(path, to_toml(model.as_plain() | beside))


def rests_on(diagnosis: Mapping[str, Any], measured: pd.DataFrame, source: str) -> dict[str, Any]:
    """What the effects of an extended model rest on: the table that was ``measured``, the verdict, and the evidence.

    ``diagnosis`` is the JSON answer. The value of an effect is the model's own, inside the interval given here.
    """
    causes = {
        cause["effect"]: {
            "probability": cause["probability"],
            "tied_with": cause["tied_with"],
            **{f"{p['name']}_ci95": p["ci95"] for p in cause["parameters"] if p["ci95"]},
        }
        for cause in diagnosis["causes"]
    }
    return {
        "source": source,
        "data_sha256": data_hash(measured),
        "points": diagnosis["points"],
        "verdict": diagnosis["verdict"],
        "unknown_probability": diagnosis["unknown"]["probability"],
        "causes": causes,
    }


def _converter(
    path: Path, text: str, data: Mapping[str, object], problems: list[Problem]
) -> Converter | None:
    """The converter that a file describes, or names: the prototype, or another model file beside it."""
    described, modulation = data.get("converter", prototype().name), data.get("modulation")
    if not isinstance(modulation, str | None):
        problems.append(_problem(path, text, ("modulation",), modulation, "the name of a modulation"))
        return None
    try:
        if isinstance(described, Mapping):
            return converter_from_plain(described, modulation)
        if isinstance(described, str) and described.endswith(".toml"):
            model = _described_in(path, described)
        elif described == prototype().name:
            model = Model.baseline()
        else:
            allowed = f"{prototype().name!r}, a table with the converter's values, or another file.toml"
            problems.append(_problem(path, text, ("converter",), described, allowed))
            return None
        return (model if modulation is None else model.driven_by(modulation)).converter
    except ConverterDataError as error:
        found = (_problem(path, text, ("converter", *w.keys), w.value, w.allowed) for w in error.wrong)
        problems.extend(found)
    except ParameterError as error:
        problems.append(_problem(path, text, ("modulation",), modulation, str(error)))
    return None


def _described_in(path: Path, name: str) -> Model:
    """The model of another file; one that describes its converter itself."""
    other = path.parent / name
    if not isinstance(read_toml(other).get("converter"), Mapping):
        raise InputError.of(
            other, "converter", None, f"{path} refers to this file for a table with the converter's values"
        )
    return read_model(other)


def _problem(path: Path, text: str, keys: tuple[str, ...], value: object, allowed: str) -> Problem:
    return Problem(
        file=str(path), field=".".join(keys), value=value, allowed=allowed, line=line_of(text, keys)
    )


def _numbers(values: object) -> dict[str, float]:
    if not isinstance(values, dict) or not all(type(value) in (int, float) for value in values.values()):
        raise TypeError(f"is {values!r}; allowed is a table of parameters with numbers")
    return {name: float(value) for name, value in values.items()}
