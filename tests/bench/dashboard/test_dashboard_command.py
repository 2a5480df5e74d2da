"""The verb dashboard: what it refuses before it serves anything."""

from pathlib import Path

import pytest
from sqlalchemy import create_engine, text

from bench import cli
from bench.processes import NICE
from bench.store import Store

pytestmark = pytest.mark.usefixtures("in_a_folder_of_its_own")


def refused(capsys: pytest.CaptureFixture[str], *arguments: str) -> str:
    with pytest.raises(SystemExit) as ended:
        cli.main(("dashboard", *arguments))
    assert ended.value.code == 2
    return capsys.readouterr().err


def test_another_address_needs_a_token(capsys: pytest.CaptureFixture[str]) -> None:
    assert "--host = '0.0.0.0': needs a token: set D2EA_TOKEN" in refused(capsys, "--host", "0.0.0.0")


@pytest.mark.parametrize(
    ("options", "named"), [(("--token-file", "my.txt"), "my.txt: token:"), ((), "environment: D2EA_TOKEN:")]
)
def test_a_short_token_is_no_token(
    options: tuple[str, ...], named: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    Path("my.txt").write_text("short\n")
    monkeypatch.setenv("D2EA_TOKEN", "short")
    said = " ".join(refused(capsys, "--host", "0.0.0.0", *options).split())
    assert f"{named} holds 5 characters; at least 16 are needed: python3 -c" in said
    assert "short" not in said


def test_a_token_file_that_is_not_there_is_named(capsys: pytest.CaptureFixture[str]) -> None:
    assert "cannot be read" in refused(capsys, "--token-file", "absent")


def test_a_database_of_another_version_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    url = "sqlite:///x.sqlite"
    Store(url).close()
    with create_engine(url).begin() as db:
        db.execute(text("UPDATE d2ea_schema SET version = 99"))
    assert "is of schema 99" in refused(capsys, "--db", url)


def test_an_address_that_is_not_ours_is_said(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, given_way: list[int]
) -> None:
    monkeypatch.setenv("D2EA_TOKEN", "sixteen letters or more")
    assert "cannot be listened on" in refused(capsys, "--host", "192.0.2.1")
    assert given_way == [NICE]  # by then it has let campaigns go first
