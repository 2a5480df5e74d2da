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


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("simulate",), "where the simulated table goes"),
        (("optimise",), "trained model, as listed by d2ea models list; else the one in use"),
        (("netlist",), "simulation model; else the baseline"),
        (("diagnose",), "leave an effect out of the catalogue; may be repeated"),
        (("train",), "a measurement table (.csv, .txt, .tsv, .dat or .parquet), or a campaign"),
        (
            ("runs",),
            "else the key database of the bench's file, where one is given; else the variable D2EA_DB",
        ),
        (("lut",), "load it into the controller, verify it, trace it"),
        (("queue", "run"), "only campaigns of the bench of this name"),
    ],
)
def test_help_says_what_is_asked_for_and_what_is_taken_without_it(
    words: tuple[str, ...], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert d2ea(*words, "--help") == 0
    assert said in " ".join(word for word in capsys.readouterr().out.split() if word not in "│")


def test_the_shell_completes_commands_and_options(
    capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("_D2EA_COMPLETE", "complete_bash")
    for words, place, completed in (("d2ea retr", "1", "retrain"), ("d2ea models roll", "2", "rollback")):
        monkeypatch.setenv("COMP_WORDS", words)
        monkeypatch.setenv("COMP_CWORD", place)
        d2ea()
        assert capfd.readouterr().out.split() == [completed]
