"""Which model is in use: put on top, taken back, and never forgotten."""

import pytest

from models.journal import Choice, Decision, Journal
from models.registry import RegistryError

WHEN = "2024-05-01T12:00:00+00:00"


def promoted(journal, model):
    journal.note(Decision(when=WHEN, decision=Choice.PROMOTED, model=model, reason="better"))


def test_the_last_model_put_into_use_is_in_use(tmp_path):
    journal = Journal(tmp_path)
    assert journal.in_use() is None
    promoted(journal, "a")
    journal.use("b", when=WHEN, reason="I trust it")
    journal.note(Decision(when=WHEN, decision=Choice.KEPT_OUT, model="c", reason="worse"))
    assert journal.in_use() == "b"
    assert [entry.model for entry in journal.decisions()] == ["a", "b", "c"]


def test_rolling_back_goes_one_model_back_each_time(tmp_path):
    journal = Journal(tmp_path)
    for model in ("a", "b", "c"):
        promoted(journal, model)
    assert journal.roll_back(when=WHEN, reason="odd").model == "b"
    assert journal.roll_back(when=WHEN, reason="odd").model == "a"
    assert journal.rolled_back() == {"b", "c"}
    with pytest.raises(RegistryError, match="none before it"):
        journal.roll_back(when=WHEN, reason="odd")
    promoted(journal, "d")
    assert journal.in_use() == "d"


def test_a_model_taken_back_that_was_never_in_use_is_said(tmp_path):
    journal = Journal(tmp_path)
    back = Decision(when=WHEN, decision=Choice.ROLLED_BACK, model="a", reason="odd", replaced="b")
    journal.note(back)
    with pytest.raises(RegistryError, match=r"journal.jsonl: b was taken back .* entries are missing"):
        journal.in_use()


def test_a_damaged_line_is_named(tmp_path):
    promoted(Journal(tmp_path), "a")
    with (tmp_path / "journal.jsonl").open("a") as file:
        file.write('{"when": "half a li\n')
    with pytest.raises(RegistryError, match=r"journal.jsonl:2: not a decision"):
        Journal(tmp_path).in_use()
