"""Pictures of blind trials, from answers made up by hand."""

from pathlib import Path

import numpy as np
import pytest

from experiments import blind_trials
from experiments.blind.calibration import reliability, statements
from experiments.blind.scoring import Scored
from experiments.harness.settings import Settings
from experiments.study.trial_pictures import _deviations, _first, _shares, credibility
from tests.experiments.fabricated import answer, scored

PNG = b"\x89PNG"
RIGHT = scored("dead_time", answer("named", "dead_time"))
TAKEN_FOR = scored("skin_effect", answer("named", "dead_time"))
EXCLUDED = scored("fan_step", None)


class _Told:
    """A run whose trials are known."""

    def scored(self, *_: object) -> list[Scored]:
        return [RIGHT, TAKEN_FOR, EXCLUDED]


@pytest.mark.parametrize(
    ("parts", "names"),
    [
        ({"single", "coverage", "pairs"}, ["confusion", "isolability", "credibility"]),
        ({"efficiency_only"}, ["isolability"]),
        ({"pairs", "nothing"}, []),
    ],
)
def test_parts_that_were_run_are_drawn(parts: set[str], names: list[str]) -> None:
    table, _ = reliability(statements([RIGHT, TAKEN_FOR]))
    found = blind_trials._pictures(_Told(), parts, [table])  # type: ignore[arg-type]  # as much of a run as it needs
    assert [picture.name for picture in found] == names
    assert all(picture.png.startswith(PNG) and picture.caption for picture in found)


def test_every_trial_is_in_its_row() -> None:
    """Also one that was taken for what nobody hid."""
    nothing = scored("skin_effect", answer("consistent"))
    hidden, said, shares = _shares(
        [RIGHT, TAKEN_FOR, nothing, scored("dead_time", answer("named", "fan_step"))]
    )
    assert hidden == ["skin_effect", "dead_time"]
    of = {
        h: {k: share for k, share in zip(said, row, strict=True) if share}
        for h, row in zip(hidden, shares.tolist(), strict=True)
    }
    assert of == {
        "skin_effect": {"dead_time": 50.0, "consistent": 50.0},
        "dead_time": {"dead_time": 50.0, "fan_step": 50.0},
    }


def test_pictures_are_part_of_the_result(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(blind_trials.Run, "scored", lambda *_: [RIGHT, TAKEN_FOR])
    result = blind_trials.run(Settings(only=("single",), out=tmp_path))
    assert [picture.name for picture in result.pictures] == ["confusion", "isolability"]
    assert "2 labs" in result.pictures[0].caption


def test_a_value_is_as_far_off_as_the_side_of_its_interval_says() -> None:
    # 0.1 is hidden; the value stands in the middle of its interval, whose half is 1.96 standard deviations
    off = _deviations([scored("dead_time", answer("named", "dead_time", ci95=(0.1, 0.3))), RIGHT, EXCLUDED])
    np.testing.assert_allclose(off, [1.96, 0.0], atol=1e-3)
    unlikely = answer("named", "dead_time", probability=0.4)
    assert _deviations([scored("dead_time", unlikely), TAKEN_FOR]).size == 0


def test_how_many_values_are_outside_is_said() -> None:
    table, _ = reliability(statements([RIGHT]))
    outside = scored("dead_time", answer("named", "dead_time", ci95=(0.11, 0.3)))
    assert "50.0 % lie outside" in credibility([RIGHT, outside], table).caption


@pytest.mark.parametrize(
    ("verdict", "said"),
    [("named", "fan_step"), ("group", "fan_step"), ("consistent", "consistent"), ("unknown", "unknown")],
)
def test_what_is_not_stated_is_not_said(verdict: str, said: str) -> None:
    assert _first(scored("dead_time", answer(verdict, "fan_step"))) == said
