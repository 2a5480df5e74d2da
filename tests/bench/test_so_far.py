"""How much of a campaign's plan was measured, as a diagnosis says it."""

import pytest

from bench.so_far import measured_so_far, so_far_text

CAMPAIGN = {
    "id": 3, "name": "night", "planned": 50, "accepted": 26, "rejected": 0, "shown": "interrupted", "config": {},
}  # fmt: skip


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        (
            {},
            "26 of 50 planned rows were measured, and the campaign is interrupted: d2ea resume 3 measures the rest",
        ),
        ({"shown": "running"}, "26 of 50 planned rows were measured, and the campaign is running"),
        (
            {"shown": "done", "rejected": 24},
            "26 of 50 planned rows were measured, 24 were rejected: d2ea status 3",
        ),
        ({"shown": "done", "accepted": 50}, ""),
        ({"shown": "imported", "accepted": 50}, ""),
    ],
)
def test_what_is_not_there_is_said_with_what_to_do(changed: dict[str, object], said: str) -> None:
    text = so_far_text(measured_so_far(CAMPAIGN | changed))
    assert text.startswith(said)
    assert bool(text) == bool(said)


def test_the_answer_for_programs_holds_both_numbers_and_the_state() -> None:
    of = measured_so_far(CAMPAIGN)["campaign"]
    assert (of["accepted"], of["planned"], of["state"]) == (26, 50, "interrupted")


def test_a_diagnosis_of_a_file_says_nothing_of_a_plan() -> None:
    assert so_far_text({"verdict": "named"}) == ""
