"""The house in order: what the documents say is what the code has, and the rules of the house hold."""

import ast
import os
import re
import tomllib
from collections.abc import Iterator
from dataclasses import is_dataclass
from functools import cache
from pathlib import Path
from typing import get_args, get_type_hints

import numpy as np
import pytest
from pydantic import BaseModel
from typer.main import get_command

from bench.cli import build
from bench.config import BenchConfig, CampaignConfig, check
from bench.lut_file import STATED
from bench.store import COLUMNS
from bench.verdict_wording import VERDICTS
from bench.wording import MODEL_NAMES, effect_name
from drivers.mocks.faults import FaultFile
from drivers.mocks.lab.foreign.families import FOREIGN
from drivers.mocks.lab.hidden import HIDDEN
from models.lut import Lut
from models.screening import KINDS, KNOWN_COLUMNS
from sim.effects.catalogue import CATALOGUE
from sim.model import Model
from sim.modulation import EDGES
from sim.parameters import Converter
from sim.simulate import PARTS, Points, simulate

ROOT = Path(__file__).resolve().parents[1]
PACKAGES = ("sim", "drivers", "models", "bench", "experiments")
DOCUMENTS = (ROOT / "README.md", ROOT / "NOMENCLATURE.md", *sorted((ROOT / "docs").rglob("*.md")))
MODULES = sorted(path for package in PACKAGES for path in (ROOT / package).rglob("*.py"))

Row = tuple[str, ...]


def section(document: str, heading: str) -> str:
    """The text under a heading of the second level."""
    text = (ROOT / document).read_text(encoding="utf-8")
    found = re.search(rf"^## {re.escape(heading)}\n(.*?)(?=^## |\Z)", text, re.MULTILINE | re.DOTALL)
    assert found, f"{document} has no heading {heading!r}"
    return found[1]


def table(document: str, heading: str, number: int = 0) -> list[Row]:
    """The rows of the first (or another) table under a heading, cells without code marks."""
    lines = section(document, heading).splitlines()
    starts = [k for k, line in enumerate(lines) if line.startswith("|---")]
    rows = []
    for line in lines[starts[number] + 1 :]:
        if not line.startswith("|"):
            break
        rows.append(tuple(cell.strip().replace("`", "") for cell in line.strip("|").split("|")))
    return rows


def first_cells(heading: str, number: int = 0) -> list[str]:
    return [row[0] for row in table("NOMENCLATURE.md", heading, number)]


# --- NOMENCLATURE.md ----------------------------------------------------------------------------------


def effect_rows() -> Iterator[Row]:
    for name, entry in CATALOGUE.items():
        head = entry.headline
        also = ", ".join(f"{p.name} ({p.unit})" for p in entry.parameters[1:]) or "–"
        yield name, effect_name(name), entry.stage, head.name, head.unit, f"{head.off:g}", also


def test_effects_are_those_of_the_catalogue() -> None:
    assert table("NOMENCLATURE.md", "Effects") == list(effect_rows())


def test_foreign_effects_are_those_of_the_lab() -> None:
    listed = table("NOMENCLATURE.md", "Foreign effects")
    assert listed == [(f.name, f.unit, f.where, f.says) for f in FOREIGN.values()]


def test_measurement_columns_are_those_that_are_read_and_stored() -> None:
    listed = first_cells("Measurement table")
    assert sorted(listed) == sorted(KNOWN_COLUMNS)
    assert sorted(listed) == sorted(COLUMNS)


def test_simulation_columns_are_those_of_a_result() -> None:
    listed = []
    for name in first_cells("Simulation table"):
        kind, _, each = name.partition("<")
        several = {"part>_W": [f"{kind}{part}_W" for part in PARTS], "edge>": [kind + edge for edge in EDGES]}
        listed += several.get(each, [name])
    result = simulate(Model.baseline(), Points(D1=0.9, D2=0.1, power_W=500.0))
    assert sorted(listed) == sorted(result.columns())


def test_loss_parts_are_those_of_the_simulator() -> None:
    assert first_cells("Loss parts") == list(PARTS)


def test_kinds_verdicts_and_models_are_those_of_the_code() -> None:
    assert set(first_cells("Kinds")) == set(KINDS)
    assert set(first_cells("Diagnosis")) == set(VERDICTS)
    assert first_cells("Efficiency models") == list(MODEL_NAMES)


def listed_units() -> set[str]:
    """Endings of names in the table of units, some of which share a row."""
    return {ending.strip().removeprefix("_") for cell in first_cells("Units") for ending in cell.split(",")}


_ONE = r"(?:[A-Z][A-Za-z]*\d?|[mu]?s|min|h|m\d|deg|rad)"
_ENDING = re.compile(rf"_((?:{_ONE}_)?per_{_ONE}(?:_{_ONE})*|{_ONE})$")
_NO_UNIT = {"paper_D0", "start_D1", "start_D2", "relative_L", "vl_min"}  # symbols, and a lower limit


def ending(name: str) -> str | None:
    """What a name ends in where that looks like a unit.

    >>> ending("slope_A_per_s"), ending("area_m2"), ending("start_D1"), ending("turns")
    ('A_per_s', 'm2', None, None)
    """
    found = None if name in _NO_UNIT else _ENDING.search(name)
    return found[1] if found else None


def public_names(path: Path) -> Iterator[str]:
    """Functions, their arguments, and fields of classes of a module that do not begin with an underscore."""
    for node in ast.walk(tree_of(path)):
        if isinstance(node, ast.FunctionDef) and not node.name.startswith("_"):
            yield node.name
            yield from (a.arg for a in (*node.args.posonlyargs, *node.args.args, *node.args.kwonlyargs))
        if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
            yield from (
                item.target.id
                for item in node.body
                if isinstance(item, ast.AnnAssign) and isinstance(item.target, ast.Name)
            )


def test_units_are_those_that_public_names_end_in() -> None:
    named = {name for path in MODULES for name in public_names(path)}
    named |= {p.name for entry in CATALOGUE.values() for p in entry.parameters}
    assert {unit for name in named if (unit := ending(name))} == listed_units()


def test_parameters_of_effects_end_in_a_listed_unit_or_have_none() -> None:
    parameters = [p for entry in CATALOGUE.values() for p in entry.parameters]
    assert [p.name for p in parameters if (ending(p.name) in listed_units()) is (p.unit == "1")] == []


# Numbers in files that need no unit; a new one is entered here, or ends in its unit.
DIMENSIONLESS = {
    "converter": {
        "current_exponent", "voltage_exponent", "grading", "saturation", "ac_extra", "flattens_at_harmonic", "alpha",
        "beta", "turns", "turns_ratio",
    },
    "bench.toml": {"input", "output", "link1", "link2", "unit", "speed", "start_D1", "start_D2"},
    "campaign.toml": {
        "seed", "points", "shape", "repeats", "reference_every", "heat_margin", "power_margin", "standby", "no_load",
        "D1", "D2", "start", "at_once", "candidates", "probability", "optimum", "lost", "spread", "samples",
        "power_tolerance", "voltage_tolerance",
    },
    "faults.toml": {"seed", "after", "every", "count", "chance", "value"},
}  # fmt: skip
# Keys that have a unit and do not end in it, as NOMENCLATURE.md says.
UNIT_NOT_TOLD = {
    "converter": {"k"},
    "bench.toml": {"baud", "ranges"},
    "campaign.toml": {"minutes", "every", "slope"},
    "faults.toml": {"seconds"},
}


def numbers_of(kind: type) -> Iterator[str]:
    """Names of the fields of an object, and of the objects in it, that hold a number or several."""
    for name, hint in get_type_hints(kind).items():
        inside = [each for each in _types_in(hint) if isinstance(each, type)]
        owners = [each for each in inside if is_dataclass(each) or issubclass(each, BaseModel)]
        for owner in owners:
            yield from numbers_of(owner)
        if not owners and {int, float} & set(inside) and name not in ("tolerances", "model_config"):
            yield name


def _types_in(hint: object) -> Iterator[object]:
    yield hint
    for argument in get_args(hint):
        yield from _types_in(argument)


@pytest.mark.parametrize(
    ("file", "kind"),
    [
        ("converter", Converter),
        ("bench.toml", BenchConfig),
        ("campaign.toml", CampaignConfig),
        ("faults.toml", FaultFile),
    ],
)
def test_numbers_in_files_end_in_a_listed_unit_or_need_none(file: str, kind: type) -> None:
    plain = {name for name in numbers_of(kind) if ending(name) not in listed_units()}
    assert plain == DIMENSIONLESS[file] | UNIT_NOT_TOLD[file]


def test_keys_whose_unit_is_not_in_their_name_are_told() -> None:
    told = section("NOMENCLATURE.md", "Units").partition("do not end in it")[2].partition("\n\n")[0]
    assert set(re.findall(r"`(\w+)`", told)) == set().union(*UNIT_NOT_TOLD.values())


def test_words_that_modules_of_the_diagnosis_are_named_after_are_told() -> None:
    told = set(first_cells("Words of the diagnosis"))
    named = {"common mode", "law", "leftover", "race", "refinery", "setting", "sight"}
    assert named | {"bend", "doubt", "everyday line", "rival", "tangent"} <= told
    modules = {path.stem.replace("_", " ") for path in (ROOT / "models" / "diagnosis").glob("*.py")}
    assert named <= modules, "a module that is gone needs no word"


# --- README.md ----------------------------------------------------------------------------------------


def test_the_readme_lists_every_command_and_no_other() -> None:
    commands = get_command(build()).commands  # type: ignore[attr-defined]  # it is a group
    assert sorted(row[0] for row in table("README.md", "Commands")) == sorted(f"d2ea {c}" for c in commands)


def test_the_readme_leads_to_every_folder_and_each_is_there() -> None:
    listed = [row[0].rstrip("/") for row in table("README.md", "Where things are")]
    assert set(PACKAGES) | {"tests", "docs"} <= set(listed)
    assert all((ROOT / folder).is_dir() for folder in listed)


def test_the_readmes_campaign_can_be_read() -> None:
    block = re.search(r"```toml\n(.*?)```", section("README.md", "Without hardware"), re.DOTALL)
    assert block
    check(tomllib.loads(block[1]), CampaignConfig, file="README.md")


def test_the_readmes_make_targets_exist() -> None:
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    asked = set(re.findall(r"\bmake (?:PYTHON=\S+ )?([a-z]+)\b", text))
    targets = set(re.findall(r"^([a-z]+):", (ROOT / "Makefile").read_text(encoding="utf-8"), re.MULTILINE))
    assert {"demo", "test"} <= asked <= targets


DECISIONS = sorted((ROOT / "docs" / "decisions").glob("[0-9]*.md"))


@pytest.mark.parametrize("document", DOCUMENTS, ids=lambda path: path.name)
def test_links_lead_somewhere(document: Path) -> None:
    text = document.read_text(encoding="utf-8")
    for target, anchor in re.findall(r"\]\((?!https?:)([^)#\s]*)(?:#([^)\s]*))?\)", text):
        path = document.parent / target if target else document
        assert path.exists(), f"{document.name} links to {target}"
        headings = re.findall(r"^#+ (.*)$", path.read_text(encoding="utf-8"), re.MULTILINE) if anchor else []
        assert not anchor or anchor in [h.lower().replace(" ", "-") for h in headings]


def test_the_index_of_decisions_has_every_page() -> None:
    index = (ROOT / "docs" / "decisions" / "README.md").read_text(encoding="utf-8")
    assert set(re.findall(r"\]\((\d+-[^)]*)\)", index)) == {path.name for path in DECISIONS}


def test_every_decision_has_context_decision_and_consequences() -> None:
    for path in DECISIONS:
        text = path.read_text(encoding="utf-8")
        assert re.findall(r"^## (.*)$", text, re.MULTILINE) == ["Context", "Decision", "Consequences"], (
            path.name
        )
        assert len(text.splitlines()) <= 45, f"{path.name} is longer than half a page"


# --- the rules ----------------------------------------------------------------------------------------


@cache
def tree_of(path: Path) -> ast.Module:
    return ast.parse(path.read_text(encoding="utf-8"))


def called(path: Path) -> set[str]:
    """Names of everything a module calls, without what stands before the last dot."""
    calls = [node.func for node in ast.walk(tree_of(path)) if isinstance(node, ast.Call)]
    return {call.attr if isinstance(call, ast.Attribute) else getattr(call, "id", "") for call in calls}


def where(names: set[str]) -> set[str]:
    """Modules outside the mocks that call one of these names."""
    modules = {path: path.relative_to(ROOT).as_posix() for path in MODULES}
    return {
        name
        for path, name in modules.items()
        if not name.startswith("drivers/mocks/") and called(path) & names
    }


def test_only_the_transport_opens_connections() -> None:
    assert where({"serial_for_url", "Serial", "create_connection"}) == {
        "drivers/tcp_port.py",
        "drivers/transport.py",
    }


def test_only_the_store_writes_to_the_database() -> None:
    assert where({"create_engine"}) == {"bench/store/database.py"}


def test_files_stay_short() -> None:
    long = {p.name: n for p in MODULES if (n := len(p.read_text(encoding="utf-8").splitlines())) > 400}
    assert not long, "one concept per file, 400 lines at most"


def test_functions_take_few_parameters() -> None:
    for path in MODULES:
        if path.parent.name == "commands" or path.name == "command.py":
            continue  # a verb's options are its parameters
        for node in ast.walk(tree_of(path)):
            if isinstance(node, ast.FunctionDef):
                a = node.args
                names = [
                    x.arg for x in (*a.posonlyargs, *a.args, *a.kwonlyargs) if x.arg not in ("self", "cls")
                ]
                assert len(names) <= 6, f"{path.name}: {node.name} takes {len(names)}; give them an object"


def test_the_contract_that_drivers_know_no_mocks_names_every_driver() -> None:
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    contracts = settings["tool"]["importlinter"]["contracts"]
    (held,) = (c["source_modules"] for c in contracts if c.get("forbidden_modules") == ["drivers.mocks"])
    assert set(held) == {f"drivers.{path.stem}" for path in (ROOT / "drivers").glob("[!_]*.py")}


def test_the_lab_can_hide_every_effect_of_the_catalogue() -> None:
    assert set(CATALOGUE) <= set(HIDDEN)


def test_the_check_of_a_change_can_be_run() -> None:
    script = ROOT / ".ci" / "run"
    assert os.access(script, os.X_OK)
    assert "make test" in script.read_text(encoding="utf-8")
    assert ".ci/run" in (ROOT / ".github" / "workflows" / "ci.yml").read_text(encoding="utf-8")


def test_columns_of_the_table_of_the_best_modulation_are_those_written() -> None:
    listed = first_cells("Table of the best modulation")
    rows = {name: np.zeros(2) for name in ("power_W", "D1", "D2", "predicted", "price", "soft_edges")}
    assert listed == [*Lut(**rows).frame().columns, *STATED]
