"""A cause that is there for a part of the time: which, how large, and between which rows; what is always there is none.

A campaign in which something happens is put together from two of the virtual lab's, of the same seed and schedule.
"""

import numpy as np
import pandas as pd
import pytest

from experiments.blind.trial import BlindTrial
from experiments.onset_trials import happened, said
from models.diagnosis.onset import Onset, is_onset
from tests.models.diagnosis.virtual_campaign import lab_table, onset_of, seen

SEED = 171
OF_SIZE = 0.2  # the lab's laws are off by up to a tenth, and half of the rows tell the rest


def lab(**hidden: float) -> pd.DataFrame:
    return lab_table(hidden, seed=SEED)


@pytest.mark.parametrize(
    ("effect", "size", "share"),
    [
        ("link_resistance", 0.08, 0.6),
        ("leakage_inductance", 0.1, 0.5),
        ("duty_offset", 0.006, 0.5),
    ],
)
def test_what_sets_in_is_told_with_its_size_and_its_moment(effect: str, size: float, share: float) -> None:
    frame, at_s = happened(lab(), lab(**{effect: size}), share)
    found = seen(frame)
    assert (found.verdict.kind, found.verdict.stated) == ("unknown", ())
    onset = onset_of(found)
    assert (onset.effect, onset.sets_in, onset.after_s) == (effect, True, at_s)
    assert onset.value - onset.aside == pytest.approx(size, rel=OF_SIZE)
    told = found.as_plain(ahead=False)["unknown"]["onset"]
    before, row = told["between_rows"]
    after_s = (frame["time_s"] - frame["time_s"].min()).to_numpy()
    assert after_s[row - 1] == at_s > after_s[before - 1]  # data rows count from one


def test_what_goes_away_is_told_as_such() -> None:
    frame, at_s = happened(lab(link_resistance=0.08), lab(), 0.5)
    onset = onset_of(seen(frame))
    assert (onset.effect, onset.sets_in, onset.after_s) == ("link_resistance", False, at_s)
    assert onset.value - onset.aside == pytest.approx(0.08, rel=OF_SIZE)


def test_what_is_lower_than_designed_sets_in_too() -> None:
    lower = BlindTrial(row="onset", seed=560_004, hidden=(("magnetizing_inductance", 0.0027),))
    answer = said(lower)
    assert answer.is_found
    assert answer.is_dated
    assert answer.always is None


@pytest.mark.parametrize("hidden", [{}, {"link_resistance": 0.08}, {"leakage_inductance": 0.1}])
def test_what_is_always_there_does_not_set_in(hidden: dict[str, float]) -> None:
    found = seen(lab(**hidden))
    assert found.unexplained is None or found.unexplained.onset is None
    assert found.verdict.named == tuple(hidden)


def misread(frame: pd.DataFrame, rows: list[int]) -> pd.DataFrame:
    """The same with an input power that was entered 300 W too high in some of the rows that carry power."""
    wrong = frame.drop(columns="efficiency", errors="ignore")
    wrong.loc[wrong.index[wrong["kind"] == "load"][rows], "P1_W"] += 300.0
    return wrong


@pytest.mark.parametrize("rows", [[5], [48], [44, 46]])
def test_a_reading_that_nothing_explains_does_not_set_in(rows: list[int]) -> None:
    """That of row 48 is next to a moment that would take it up."""
    found = seen(misread(lab(), rows))
    assert found.unexplained is None or found.unexplained.onset is None
    assert len({row["row"] for row in found.as_plain(ahead=False)["rejected_rows"]}) >= len(rows)


def test_beside_such_a_reading_what_sets_in_is_told_as_without() -> None:
    frame, at_s = happened(lab(), lab(link_resistance=0.08), 0.5)
    onset = onset_of(seen(misread(frame, [5, 28])))
    assert (onset.effect, onset.sets_in, onset.after_s) == ("link_resistance", True, at_s)
    assert onset.value - onset.aside == pytest.approx(0.08, rel=OF_SIZE)


def test_without_time_nothing_sets_in() -> None:
    frame, _ = happened(lab(), lab(link_resistance=0.08), 0.5)
    found = seen(frame.drop(columns="time_s"))
    assert found.unexplained is None or not is_onset(found.unexplained.location)


def test_in_efficiency_alone_nothing_sets_in() -> None:
    frame, _ = happened(lab(), lab(link_resistance=0.08), 0.5)
    columns = ["D1", "D2", "P1_W", "P2_W", "V1_V", "V2_V", "T_ambient_C", "kind", "time_s"]
    found = seen(frame[columns])
    assert found.unexplained is None or not is_onset(found.unexplained.location)


def test_what_is_read_back_is_the_value_that_moves_readings_so() -> None:
    direction = np.array([0.0, 0.0, 2.0, 4.0])
    onset = Onset(
        effect="link_resistance", parameter="resistance_Ohm", unit="Ohm", value=0.06, aside=0.02, after_s=60.0,
        before=1, row=2, sets_in=True, direction=direction,
    )  # fmt: skip
    assert onset.read(0.5 * direction).value == pytest.approx(0.04, rel=1e-12)  # rounding
