"""The commands of the how-to pages and the README, run as they stand on a rack of mock instruments."""

import re
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path

import pandas as pd
import pytest

from bench import cli
from bench.config import read_campaign
from bench.toml_file import to_toml
from drivers.clock import StepClock
from drivers.mocks.faults import Fault, FaultFile
from drivers.mocks.plant import Plant
from drivers.mocks.rack import LIMITS, Rack
from sim.model import Model
from tests.docs.console import Command, commands, files, mismatch
from tests.models.diagnosis.virtual_campaign import simulated_campaign

ROOT = Path(__file__).resolve().parents[2]
HOW_TO = ROOT / "docs" / "how-to"
CAMPAIGN = """\
name = "a campaign"

[plan]
kind = "latin_hypercube"
points = 16
"""
UNSAFE = 3
UNPLUGGED = FaultFile(fault=(Fault(instrument="load", kind="hang_up", after=60, seconds=600.0),))

Started = Callable[[FaultFile], AbstractContextManager[None]]


@pytest.fixture
def started(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Started:
    """A rack in this process whose clock does not wait; ``bench.toml`` tells where it listens.

    The pages' own bench.toml names the ports of another computer.
    """
    clock = StepClock()
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("D2EA_DB", raising=False)
    for module in ("bench", "lut"):
        monkeypatch.setattr(f"bench.commands.{module}.WallClock", lambda _speed: clock)

    @contextmanager
    def start(faults: FaultFile) -> Iterator[None]:
        with Rack(Plant.virtual(seed=1, hidden={}, clock=clock), faults=faults) as rack:
            config = rack.bench_config()
            impatient = {"again_s": 0.0, "recover_s": 0.0}  # what does not answer is not waited for
            Path("bench.toml").write_text(to_toml({**config, "limits": LIMITS | impatient}))
            Path("campaign.toml").write_text(CAMPAIGN)
            yield

    return start


def typed(page: Path, verb: str) -> Command:
    """The page's command of this verb."""
    return next(c for c in commands(page) if Path(c.words[0]).name == "d2ea" and c.words[1] == verb)


def run(command: Command) -> int:
    with pytest.raises(SystemExit) as ended:
        cli.main(command.words[1:])
    return int(ended.value.code or 0)


@pytest.mark.parametrize(
    "page", [HOW_TO / "connect-a-real-bench.md", ROOT / "docs" / "files.md"], ids=lambda page: page.stem
)
def test_a_pages_own_bench_takes_its_limits_and_voltages(
    page: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    written = files(page)
    Path("bench.toml").write_text(written["bench.toml"])
    few = CAMPAIGN.replace("points = 16", "points = 1\nstandby = 1\nno_load = 0")
    Path("campaign.toml").write_text(written.get("first-check.toml", few))
    with pytest.raises(SystemExit) as ended:
        cli.main(["run", "campaign.toml", "--bench", "bench.toml", "--rehearse"])
    assert not ended.value.code


def test_the_first_check_of_a_real_bench(started: Started) -> None:
    page = HOW_TO / "connect-a-real-bench.md"
    with started(FaultFile()):
        Path("first-check.toml").write_text(files(page)["first-check.toml"])
        assert run(typed(page, "check")) == 0
        assert run(typed(page, "run")) == 0
    assert Path("first-check.log").stat().st_size > 0


def test_the_readme_from_the_mock_bench_to_a_verdict(
    started: Started, capsys: pytest.CaptureFixture[str]
) -> None:
    page = ROOT / "README.md"
    with started(FaultFile()):
        assert [run(typed(page, verb)) for verb in ("check", "run", "diagnose")] == [0, 0, 0]
    assert "verdict:" in capsys.readouterr().out


def test_a_rehearsal_tells_which_faults_struck(started: Started, capsys: pytest.CaptureFixture[str]) -> None:
    page = HOW_TO / "when-something-goes-wrong.md"
    faults = re.search(r"^```\n(seed = .*?)^```", page.read_text(encoding="utf-8"), re.DOTALL | re.MULTILINE)
    assert faults
    with started(FaultFile()):
        Path("faults.toml").write_text(faults[1])
        assert run(typed(page, "run")) == 1  # the trip ends it
    assert "OVP" in capsys.readouterr().err


def test_an_unsafe_bench_is_told_cleared_and_resumed(
    started: Started, capsys: pytest.CaptureFixture[str]
) -> None:
    page = HOW_TO / "when-something-goes-wrong.md"
    with started(UNPLUGGED):
        assert run(typed(ROOT / "README.md", "run")) == UNSAFE
        assert run(typed(page, "status")) == 0
        assert "UNSAFE" in capsys.readouterr().out
        assert run(typed(page, "resume")) != 0
        assert run(typed(page, "clear")) == UNSAFE  # the load cannot be reached
        assert run(Command(("d2ea", "clear", "--seen-off"), "")) == 0
    with started(FaultFile()):
        assert run(Command(("d2ea", "resume", "--bench", "bench.toml"), "")) == 0
    capsys.readouterr()
    assert run(typed(page, "status")) == 0
    assert "done" in capsys.readouterr().out


def test_the_page_on_adaptive_campaigns_shows_a_campaign_file(tmp_path: Path) -> None:
    ((name, text),) = files(HOW_TO / "let-a-campaign-choose.md").items()
    (tmp_path / name).write_text(text)
    plan = read_campaign(tmp_path / name).plan
    assert plan.adaptive is not None
    assert (plan.points, plan.adaptive.start, plan.adaptive.minutes) == (40, 12, 180.0)


def test_a_table_with_german_headers_is_read_asked_and_simulated(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("D2EA_DB", raising=False)
    Path("messung.csv").write_text(german(simulated_campaign(Model.baseline(), seed=4, count=16)))
    for command, code in zip(commands(HOW_TO / "diagnose-your-own-table.md"), (2, 0, 0, 0), strict=True):
        assert run(command) == code
        printed = capsys.readouterr()
        assert not mismatch(command, printed.out or printed.err)


def german(table: pd.DataFrame) -> str:
    """The load rows as a spreadsheet of that country writes them."""
    rows = table[table["kind"] == "load"]
    times = pd.Timestamp("2026-11-20 22:14:05") + pd.to_timedelta(rows["time_s"], unit="s")
    columns = {
        "Zeitstempel": times.dt.strftime("%d.%m.%Y %H:%M:%S"),
        "Tastgrad D1": rows["D1"],
        "Phase D2": rows["D2"],
        "Pout [kW]": rows["P2_W"] / 1e3,
        "Pin [kW]": rows["P1_W"] / 1e3,
    }
    return pd.DataFrame(columns).to_csv(index=False, sep=";", decimal=",")
