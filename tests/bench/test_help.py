"""What the command line says of itself: help of every verb, and what a shell completes."""

import pytest

from tests.bench.command_line import d2ea

VERBS = (
    "mock", "check", "run", "status", "runs", "pause", "resume", "abort", "export", "import",
    "simulate", "train", "optimise", "models", "clear", "queue",
)  # fmt: skip


@pytest.mark.parametrize("verb", VERBS)
def test_every_verb_has_help(verb: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert d2ea(verb, "--help") == 0
    assert "Usage" in capsys.readouterr().out


def test_help_keeps_what_a_verb_says_of_itself(capsys: pytest.CaptureFixture[str]) -> None:
    assert d2ea("queue", "add", "--help") == 0
    assert "wait for its schedule (start_at, every)" in " ".join(capsys.readouterr().out.split())


@pytest.mark.parametrize(
    ("verb", "said"),
    [("status", "else the newest, running or not"), ("pause", "else the newest that is running")],
)
def test_help_says_which_campaign_is_meant_where_none_is_named(
    verb: str, said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert d2ea(verb, "--help") == 0
    words = [word for word in capsys.readouterr().out.split() if word not in "│"]  # the frame of the table
    assert said in " ".join(words)


def test_the_shell_completes_commands_and_options(
    capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("_D2EA_COMPLETE", "complete_bash")
    for words, place, completed in (("d2ea retr", "1", "retrain"), ("d2ea models roll", "2", "rollback")):
        monkeypatch.setenv("COMP_WORDS", words)
        monkeypatch.setenv("COMP_CWORD", place)
        d2ea()
        assert capfd.readouterr().out.split() == [completed]
