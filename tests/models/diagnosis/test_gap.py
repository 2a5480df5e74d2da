"""What a cause carries of the gap, on made-up rows."""

import numpy as np
import pytest

from models.diagnosis.gap import Added, gap
from tests.models.diagnosis.fabricated import loads

LOADS = loads(np.array([500.0, 1000.0, 1500.0, 2000.0]))
GAP = np.array([1.0, 2.0, 3.0, 4.0])
ALL = np.ones(4, dtype=bool)


def test_the_whole_gap_is_carried_by_what_explains_it() -> None:
    whole = Added.by(LOADS, GAP, GAP, ALL)
    assert (whole.mean_W, whole.lowest_W, whole.highest_W) == (2.5, 1.0, 4.0)
    assert whole.share == pytest.approx(1.0)


def test_a_share_is_of_the_mean_absolute_gap() -> None:
    assert Added.by(LOADS, GAP, np.ones(4), ALL).share == pytest.approx(0.4)  # 2.5 W becomes 1.5 W


def test_what_works_against_the_others_has_watts_but_no_share() -> None:
    against = Added.by(LOADS, GAP, -GAP, ALL)
    assert (against.mean_W, against.share) == (-2.5, 0.0)
    assert against.as_plain() == {
        "share_of_gap": 0.0,
        "added_W": {"mean": -2.5, "lowest": -4.0, "highest": -1.0},
    }


def test_no_gap_has_no_shares() -> None:
    assert Added.by(LOADS, np.zeros(4), np.ones(4), ALL).share == 0.0


def test_what_counts_for_nothing_is_no_part_of_the_gap() -> None:
    outlier = np.array([1.0, 2.0, 300.0, 4.0])
    found = gap(LOADS, outlier, np.array([True, True, False, True]))
    assert found["mean_loss_W"] == pytest.approx(7.0 / 3)
    assert found["worst"]["P2_W"] == 500.0  # a watt of 500
