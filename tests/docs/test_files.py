"""The page of files has every key that a file may have, with its default and what is allowed, and no other."""

import re
import tomllib
from collections.abc import Iterator
from dataclasses import fields
from pathlib import Path
from typing import Any, Literal, get_args, get_origin

import pytest
from pydantic import BaseModel
from pydantic.fields import FieldInfo

from bench.config import BenchConfig, CampaignConfig
from bench.model_file import KEYS
from bench.toml_file import to_toml
from drivers.mocks.fault_kinds import KINDS, WIRES
from drivers.mocks.faults import DATABASE, DATABASE_KINDS, FaultFile
from sim.converter_data import ConverterDataError, converter_from_plain
from sim.parameters import (
    Capacitance,
    Conduction,
    Converter,
    Core,
    Diode,
    Recovery,
    Switch,
    SwitchingEnergy,
    Winding,
)
from sim.prototype import prototype
from sim.spread import TOLERANCED, everyday_spread
from tests.docs.tables import Row, tables

PAGE = Path(__file__).resolve().parents[2] / "docs" / "files.md"
FILES: dict[str, type[BaseModel]] = {
    "bench.toml": BenchConfig,
    "campaign.toml": CampaignConfig,
    "faults.toml": FaultFile,
}
BOUNDS = ("ge", "gt", "le", "lt")


def section_in(annotation: object) -> type[BaseModel] | None:
    """The table of a file that a key opens, or one of several; None for a value."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return annotation
    return next((found for arg in get_args(annotation) if (found := section_in(arg))), None)


def sections(kind: type[BaseModel], path: str = "") -> Iterator[tuple[str, type[BaseModel]]]:
    """Every table of a file by its path, the file itself first."""
    yield path, kind
    for name, field in kind.model_fields.items():
        if found := section_in(field.annotation):
            yield from sections(found, f"{path}.{name}".lstrip("."))


def values(kind: type[BaseModel]) -> dict[str, FieldInfo]:
    """The keys of a table that are no tables themselves."""
    return {name: f for name, f in kind.model_fields.items() if not section_in(f.annotation)}


def default(field: FieldInfo) -> str:
    """A key's default as the page shows it."""
    if field.is_required():
        return "required"
    value = field.get_default(call_default_factory=True)
    if value is None:
        return "–"
    return "none" if value == {} else to_toml({"key": value}).strip().removeprefix("key = ")


def allowed(field: FieldInfo) -> set[str]:
    """Bounds and choices of a key, as they have to be read beside it."""

    def of(annotation: object, metadata: Any) -> Iterator[object]:
        for each in metadata:
            yield from of(None, each.metadata) if isinstance(each, FieldInfo) else ()
            yield from (getattr(each, name) for name in BOUNDS if hasattr(each, name))
        if get_origin(annotation) is Literal:
            yield from get_args(annotation)
        else:
            for arg in get_args(annotation):
                yield from of(arg, getattr(arg, "__metadata__", ()))

    return {f"{v:g}" if isinstance(v, int | float) else str(v) for v in of(field.annotation, field.metadata)}


def listed(file: str) -> dict[str, tuple[Row, ...]]:
    """The rows of each table that the page has of a file, by path; a heading may stand for several."""
    found: dict[str, tuple[Row, ...]] = {}
    for table in tables(PAGE):
        if table.part == file:
            found |= dict.fromkeys(re.findall(r"\[+([\w.]+)\]+", table.heading) or [""], table.rows)
    return found


@pytest.mark.parametrize("file", FILES)
def test_every_table_of_a_file_is_on_the_page_and_no_other(file: str) -> None:
    assert sorted(listed(file)) == sorted(path for path, _ in sections(FILES[file]))


@pytest.mark.parametrize("file", FILES)
def test_every_key_is_on_the_page_with_its_default_and_no_other(file: str) -> None:
    shown = {path: {key: stated for key, _, stated, _ in rows} for path, rows in listed(file).items() if rows}
    there = {
        path: {key: default(f) for key, f in values(kind).items()} for path, kind in sections(FILES[file])
    }
    assert shown == there


@pytest.mark.parametrize("file", FILES)
def test_bounds_and_choices_stand_beside_every_key(file: str) -> None:
    rows = {(path, row[0]): row for path, table in listed(file).items() for row in table}
    for path, kind in sections(FILES[file]):
        for key, field in values(kind).items():
            told = set(re.findall(r"\d+(?:\.\d+)?|[a-z_]+", rows[path, key][1]))
            assert allowed(field) <= told, f"{path}.{key}"
            assert rows[path, key][3], f"{path}.{key}"


def test_the_kinds_of_faults_are_on_the_page_with_what_each_can_happen_to() -> None:
    wires = {name: {at for at, of in WIRES.items() if of & kind.wires} for name, kind in KINDS.items()}
    there = wires | {name: {DATABASE} for name in DATABASE_KINDS}
    rows = next(table.rows for table in tables(PAGE) if table.part == "Kinds of faults")
    whole = {"all four instruments": set(WIRES)}
    assert {kind: whole.get(at, set(at.split(", "))) for kind, at, _ in rows} == there


def test_the_keys_of_a_model_file_are_on_the_page() -> None:
    of_file, of_converter = listed("model.toml")[""], listed("model.toml")["converter"]
    assert [row[0] for row in of_file] == list(KEYS)
    assert {row[0] for row in of_converter} == {f.name for f in fields(Converter)} - {
        "modulation",
        "tolerances",
    }


def test_what_a_model_file_may_leave_out_of_its_converter_is_told_with_its_default() -> None:
    stated = {row[0]: row[1] for row in listed("model.toml")["converter"]}
    with pytest.raises(ConverterDataError) as refused:
        converter_from_plain({})
    missing = {wrong.keys[0] for wrong in refused.value.wrong}
    assert missing == {key for key, shown in stated.items() if shown == "required"}
    whole = tomllib.loads((PAGE.parent / "examples" / "two_level_dab.toml").read_text(encoding="utf-8"))
    least = converter_from_plain({key: whole["converter"][key] for key in missing})
    assert {key: str(getattr(least, key)) for key in stated.keys() - missing} == {
        key: stated[key] for key in stated.keys() - missing
    }


def test_the_keys_of_a_converters_parts_are_on_the_page() -> None:
    told = {
        row[0]: row for table in tables(PAGE) if table.part == "Parts of a converter" for row in table.rows
    }
    kinds = {
        "on": Conduction, "reverse": Conduction, "turn_off, turn_on": SwitchingEnergy, "recovery": Recovery,
        "capacitance": Capacitance, "winding": Winding, "core": Core,
    }  # fmt: skip
    for table, kind in kinds.items():
        if table != "reverse":  # which is like on
            assert all(re.search(rf"\b{f.name}\b", told[table][2]) for f in fields(kind)), table
    of_devices = {f.name for f in (*fields(Switch), *fields(Diode))} - {"thermal_K_per_W", "tolerances"}
    tables_told = {name for key in told for name in key.split(", ")} | {"part", "synchronous"}
    assert of_devices | {"thermal", "winding", "core"} <= tables_told
    assert "part" in told["the device itself"][2]
    assert "synchronous" in told["the device itself"][2]


def test_every_usual_spread_is_on_the_page_with_its_size() -> None:
    rows = {
        row[0]: row[1] for table in tables(PAGE) if table.part == "Everyday spreads" for row in table.rows
    }
    units = {"%": (0.01, True), "ns": (1e-9, False), "mΩ": (1e-3, False), "mW": (1e-3, False)}
    told = {}
    for paths, size in rows.items():
        number, unit = size.replace(",", "").split()[:2]
        factor, relative = units[unit]
        told |= dict.fromkeys(paths.split(", "), (pytest.approx(float(number) * factor), relative))
    usual = {s.path: (s.sigma, s.relative) for s in everyday_spread(prototype()) if s.path in TOLERANCED}
    assert usual == told
