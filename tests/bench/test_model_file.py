"""model.toml: converters, modulations and effects there and back, and every fault with its line."""

import tomllib
from pathlib import Path

import pandas as pd
import pytest

from bench.errors import InputError
from bench.model_file import read_model, rests_on, write_model
from models.registry import data_hash
from sim.model import Model

EXAMPLE = Path(__file__).resolve().parents[2] / "docs" / "examples" / "two_level_dab.toml"


def problems(tmp_path: Path, text: str) -> list[str]:
    path = tmp_path / "model.toml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(InputError) as caught:
        read_model(path)
    return [str(p).removeprefix(str(path)) for p in caught.value.problems]


@pytest.mark.parametrize("model", [Model.baseline("sps"), read_model(EXAMPLE)], ids=["prototype", "example"])
def test_a_model_comes_back_as_it_was(tmp_path: Path, model: Model) -> None:
    write_model(tmp_path / "model.toml", model.with_effect("link_resistance", resistance_Ohm=0.05))
    assert read_model(tmp_path / "model.toml") == model.with_effect("link_resistance", resistance_Ohm=0.05)


def test_an_extended_model_says_what_it_rests_on_and_comes_back_without_it(tmp_path: Path) -> None:
    cause = {
        "effect": "link_resistance", "probability": 0.99, "tied_with": [],
        "parameters": [{"name": "resistance_Ohm", "ci95": [0.04, 0.06]}, {"name": "other", "ci95": None}],
    }  # fmt: skip
    answer = {"verdict": "named", "points": 2, "unknown": {"probability": 0.0}, "causes": [cause]}
    table = pd.DataFrame({"D1": [0.9, 0.8], "P1_W": [500.0, 600.0]})
    model = Model.baseline().with_effect("link_resistance", resistance_Ohm=0.05)
    path = tmp_path / "model.toml"
    write_model(path, model, rests_on(answer, table, "mine.csv"))
    assert read_model(path) == model
    said = tomllib.loads(path.read_text(encoding="utf-8"))["diagnosis"]
    assert said["causes"]["link_resistance"]["resistance_Ohm_ci95"] == [0.04, 0.06]
    assert said["data_sha256"] == data_hash(table) != data_hash(table.assign(D1=0.7))


def test_a_file_may_name_another_one_for_its_converter(tmp_path: Path) -> None:
    (tmp_path / "dab.toml").write_text(EXAMPLE.read_text(encoding="utf-8"), encoding="utf-8")
    (tmp_path / "model.toml").write_text('converter = "dab.toml"\nmodulation = "dps"\n', encoding="utf-8")
    model = read_model(tmp_path / "model.toml")
    assert model.converter == read_model(EXAMPLE).driven_by("dps").converter


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ('modulation = "spwm"\n', ":1: modulation = 'spwm': Converter.modulation is 'spwm'; a NpcBridge"),
        ("modulation = 3\n", ":1: modulation = 3: the name of a modulation"),
        ('converter = "buck"\n', ":1: converter = 'buck': 'NPC-DAB prototype, 2 kW', a table"),
        ("", "file: holds nothing; name a converter, a modulation or effects"),
        ("efects = 1\n", ":1: efects: unknown key; known here: converter, modulation, effects, diagnosis"),
        ("[effects.link_resistance]\nresistance_Ohm = -1.0\n", "link_resistance.resistance_Ohm is -1 Ohm; allowed"),
    ],
)  # fmt: skip
def test_a_fault_is_told_with_its_line(tmp_path: Path, text: str, says: str) -> None:
    assert says in problems(tmp_path, text)[0]


def test_a_fault_in_a_converter_is_told_where_it_stands(tmp_path: Path) -> None:
    text = EXAMPLE.read_text(encoding="utf-8").replace("turns_ratio     = 8.0", 'turns_ratio     = "8:1"')
    line = text.splitlines().index('turns_ratio     = "8:1"') + 1
    assert problems(tmp_path, text) == [f":{line}: converter.transformer.turns_ratio = '8:1': a number"]


def test_an_effect_that_a_converter_cannot_have_is_refused(tmp_path: Path) -> None:
    (tmp_path / "dab.toml").write_text(EXAMPLE.read_text(encoding="utf-8"), encoding="utf-8")
    text = 'converter = "dab.toml"\n[effects.clamp_diode_drop]\nrelative_error = 0.2\n'
    assert "does not apply: 'two-level DAB, 400 V to 48 V, 1.5 kW' has no" in problems(tmp_path, text)[0]
