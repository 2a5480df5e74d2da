"""model.toml: a simulation model (baseline and effects with their values) as an operator's file."""

from pathlib import Path

from bench.errors import InputError, Problem
from bench.toml_file import line_of, read_toml, to_toml, write_atomically
from sim.model import Model
from sim.parameters import ParameterError
from sim.prototype import prototype

KEYS = ("converter", "effects")


def read_model(path: Path) -> Model:
    """The model in a file; InputError names each unknown effect, parameter or value with its line."""
    data = read_toml(path)
    text = path.read_text(encoding="utf-8")
    converter = prototype()
    problems = [
        Problem(
            file=str(path),
            field=key,
            value=None,
            allowed=f"unknown key; known here: {', '.join(KEYS)}",
            line=line_of(text, [key]),
        )
        for key in data
        if key not in KEYS
    ]
    if data.get("converter", converter.name) != converter.name:
        problems.append(
            Problem(
                file=str(path),
                field="converter",
                value=data["converter"],
                allowed=f"known: {converter.name!r}",
                line=line_of(text, ["converter"]),
            )
        )
    effects = data.get("effects", {})
    good: dict[str, dict[str, float]] = {}
    for name, values in effects.items() if isinstance(effects, dict) else [("effects", effects)]:
        try:
            Model(converter=converter, effects={name: _numbers(values)})
            good[name] = _numbers(values)
        except (ParameterError, TypeError, ValueError) as error:
            line = line_of(text, ["effects", name])
            problems.append(
                Problem(file=str(path), field=f"effects.{name}", value=None, allowed=str(error), line=line)
            )
    if problems:
        raise InputError(problems)
    return Model(converter=converter, effects=good)


def write_model(path: Path, model: Model) -> None:
    """Write a model; :func:`read_model` gives it back."""
    write_atomically(path, to_toml(model.as_plain()))


def _numbers(values: object) -> dict[str, float]:
    if not isinstance(values, dict) or not all(type(value) in (int, float) for value in values.values()):
        raise TypeError(f"is {values!r}; allowed is a table of parameters with numbers")
    return {name: float(value) for name, value in values.items()}
