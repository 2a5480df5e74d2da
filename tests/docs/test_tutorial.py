"""The tutorial, run from top to bottom on a rack of mock instruments whose clock does not wait."""

from collections.abc import Iterator
from pathlib import Path

import pytest

from bench import cli
from bench.hidden import parse_hidden
from bench.toml_file import to_toml
from drivers.clock import StepClock
from drivers.mocks.plant import Plant
from drivers.mocks.rack import Rack
from tests.docs.console import Command, commands, files, mismatch

PAGE = Path(__file__).resolve().parents[2] / "docs" / "tutorial.md"


@pytest.fixture
def rack(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """What the page's ``d2ea mock`` starts, in this process: it hides the same, and its clock is stepped."""
    mock = next(command for command in commands(PAGE) if command.background)
    hidden = parse_hidden([mock.words[mock.words.index("--hide") + 1]])
    clock = StepClock()
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("D2EA_DB", raising=False)
    for module in ("bench", "lut"):
        monkeypatch.setattr(f"bench.commands.{module}.WallClock", lambda _speed: clock)
    with Rack(Plant.virtual(seed=1, hidden=hidden, clock=clock)) as started:
        Path("bench.toml").write_text(to_toml(started.bench_config()))
        yield


def run(command: Command, capsys: pytest.CaptureFixture[str]) -> str:
    with pytest.raises(SystemExit) as ended:
        cli.main(command.words[1:])
    told = capsys.readouterr()
    assert not ended.value.code, f"{' '.join(command.words)}: {told.err}"
    return told.out


def test_the_tutorial_does_what_it_says(rack: None, capsys: pytest.CaptureFixture[str]) -> None:
    for name, text in files(PAGE).items():
        Path(name).write_text(text)
    shown = [command for command in commands(PAGE) if not command.background]
    assert len(shown) > 10
    wrong = [said for command in shown if (said := mismatch(command, run(command, capsys)))]
    assert not wrong, "\n\n".join(wrong)
