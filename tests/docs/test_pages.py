"""What the pages say can be typed, and what they have their reader write can be read."""

import re
import shutil
from pathlib import Path

import click
import pytest
from typer.main import get_command

from bench import cli
from bench.cli import build
from bench.config import read_bench, read_campaign
from bench.model_file import read_model
from drivers.modbus_map import Flag, IdentityRegisters, ModbusMap, Modes, Register, Watchdog, load_map
from tests.docs.console import Command, commands, files
from tests.docs.tables import tables

ROOT = Path(__file__).resolve().parents[2]
PAGES = (ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md")))
TYPED = [
    pytest.param(command, id=f"{page.stem}: {command}")
    for page in PAGES
    for command in commands(page)
    if Path(command.words[0]).name == "d2ea"
]


@pytest.mark.parametrize("command", TYPED)
def test_a_documented_command_is_understood(command: Command) -> None:
    words = [word for word in command.words[1:] if word != "&"]
    group: click.Command = get_command(build())
    context = group.make_context("d2ea", words, resilient_parsing=True)
    while isinstance(group, click.Group):
        name, group, words = group.resolve_command(context, words)
        assert group is not None
        if not isinstance(group, click.Group):
            context = group.make_context(name, list(words), parent=context)  # raises a UsageError
        else:
            context = group.make_context(name, list(words), parent=context, resilient_parsing=True)


def written() -> list[object]:
    return [
        pytest.param(name, text, id=f"{page.stem}: {name}")
        for page in PAGES
        for name, text in files(page).items()
    ]


@pytest.mark.parametrize(("name", "text"), written())
def test_a_documented_file_can_be_read(name: str, text: str, tmp_path: Path) -> None:
    path = tmp_path / name
    path.write_text(text)
    if name == "bench.toml":
        assert read_bench(path).name
    elif name == "model.toml":
        assert read_model(path).effects
    elif name.endswith("_supply.toml"):
        assert load_map(path).kind == "supply"
    else:
        assert read_campaign(path).name


def test_every_key_of_a_register_map_is_explained() -> None:
    page = ROOT / "docs" / "how-to" / "add-an-instrument-map.md"
    told = {word for table in tables(page) for row in table.rows for word in re.findall(r"\w+", row[0])}
    top_and_register = {*ModbusMap.model_fields, *Register.model_fields} - {"registers", "name"}
    assert top_and_register <= told
    text = page.read_text(encoding="utf-8")
    inside = {name for kind in (Flag, IdentityRegisters, Modes, Watchdog) for name in kind.model_fields}
    assert inside <= set(re.findall(r"\w+", text))


def test_documented_simulations_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    shutil.copy(ROOT / "docs" / "examples" / "two_level_dab.toml", tmp_path)
    for page in ("add-an-effect.md", "add-a-converter.md"):
        found = ROOT / "docs" / "how-to" / page
        for name, text in files(found).items():
            Path(name).write_text(text)
        for command in commands(found):
            if command.words[1] == "simulate":
                with pytest.raises(SystemExit) as ended:
                    cli.main(command.words[1:])
                assert not ended.value.code
                assert Path("grid.csv").stat().st_size > 0
                Path("grid.csv").unlink()


def test_the_example_of_an_effect_is_one() -> None:
    from sim.effects import scalings
    from sim.effects.base import Effect

    page = (ROOT / "docs" / "how-to" / "add-an-effect.md").read_text(encoding="utf-8")
    block = re.search(r"```python\n(.*?)```", page, re.DOTALL)
    assert block
    made = eval(block[1], vars(scalings))
    assert isinstance(made, Effect)
    assert made.headline.lower <= made.headline.off <= made.headline.upper
