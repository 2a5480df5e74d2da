"""Which database a command takes, how another one finds it, and that no password is said."""

import pytest

from bench.job import CampaignOutcome
from bench.safety import PowerOffReport
from tests.bench.command_line import bench_file, campaign_file, d2ea

pytestmark = pytest.mark.usefixtures("in_a_folder_of_its_own")


@pytest.mark.parametrize(
    ("options", "key", "said"),
    [
        ((), {}, "; d2ea queue run runs it"),
        (("--db", "sqlite:///a b.sqlite"), {}, "; d2ea queue run --db 'sqlite:///a b.sqlite' runs it"),
        ((), {"database": "sqlite:///lab.sqlite"}, "; d2ea queue run --db sqlite:///lab.sqlite runs it"),
    ],
)
def test_an_entry_says_the_whole_command_that_runs_it(
    options: tuple[str, ...], key: dict[str, object], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert d2ea("queue", "add", campaign_file(), "--bench", bench_file(**key), *options) == 0
    assert said in " ".join(capsys.readouterr().out.split())


@pytest.mark.parametrize(
    ("key", "variable", "hint"),
    [
        ({"database": "sqlite:///lab.sqlite"}, "", "; d2ea status --db sqlite:///lab.sqlite looks into it"),
        ({"database": "sqlite:///lab.sqlite"}, "sqlite:///lab.sqlite", ""),
        ({}, "sqlite:///lab.sqlite", ""),
    ],
)
def test_where_the_benchs_own_key_chose_the_database_a_run_says_how_to_look_there(
    key: dict[str, object],
    variable: str,
    hint: str,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setenv("D2EA_DB", variable)
    done = CampaignOutcome(
        campaign_id=1,
        accepted=1,
        rejected=0,
        settled=1,
        power_off=PowerOffReport(steps=()),
        bench_seconds=1.0,
    )
    monkeypatch.setattr("bench.commands.bench.run_campaign", lambda *_, **__: done)
    assert d2ea("run", campaign_file(), "--bench", bench_file(**key)) == 0
    lines = [" ".join(line.split()) for line in capsys.readouterr().out.splitlines()]
    assert f"database: sqlite:///lab.sqlite{hint}" in lines


def test_a_password_is_refused_as_an_argument(capsys: pytest.CaptureFixture[str]) -> None:
    assert d2ea("runs", "--db", "postgresql://lab:secret@host/db") == 2
    said = capsys.readouterr().err
    assert "D2EA_DB" in said
    assert "secret" not in said
