"""A campaign in which something changed on the way is diagnosed in two stretches, each with its own answer."""

import pandas as pd
import pytest

from experiments.onset_trials import happened
from models.dataset import Measurements, load_measurements
from models.diagnosis.diagnose import Diagnosis, diagnose
from models.diagnosis.stretches import stretches
from models.diagnosis.usable import TooFewPoints
from tests.models.diagnosis.virtual_campaign import lab_table

SEED = 171
OF_SIZE = 0.2  # the lab's laws are off by up to a tenth, and half of the rows tell the rest


@pytest.fixture(scope="module")
def table() -> pd.DataFrame:
    """A resistance that sets in, and a row before it that cannot be; not in the order of time."""
    frame, _ = happened(lab_table({}, seed=SEED), lab_table({"link_resistance": 0.08}, seed=SEED), 0.5)
    frame.loc[3, "P2_W"] = 5000.0
    return frame.iloc[::-1].reset_index(drop=True)


@pytest.fixture(scope="module")
def measured(table: pd.DataFrame) -> Measurements:
    return load_measurements(table)


@pytest.fixture(scope="module")
def found(measured: Measurements) -> Diagnosis:
    return diagnose(measured)


def test_before_there_is_nothing_and_after_there_is_the_cause(
    found: Diagnosis, measured: Measurements, table: pd.DataFrame
) -> None:
    told: list[str] = []
    before, after = stretches(found, measured, diagnose, told.append)
    assert (before.name, after.name) == ("before", "after")
    assert before.found is not None
    assert after.found is not None
    assert before.found.verdict.kind == "consistent"
    assert after.found.verdict.named == ("link_resistance",)
    assert after.found.leading.terms[0].value == pytest.approx(0.08, rel=OF_SIZE)
    rows = before.measurements.rows, after.measurements.rows
    assert sorted([*rows[0], *rows[1]]) == sorted(measured.rows)  # each row once, by its number in the table
    times_s = [table["time_s"].iloc[[row - 1 for row in each]] for each in rows]
    assert times_s[0].max() < times_s[1].min()
    assert [list(each.measurements.frame["time_s"]) for each in (before, after)] == list(map(list, times_s))
    assert told == [
        "diagnosing the rows before the change on their own",
        "diagnosing the rows after the change on their own",
    ]
    plain = after.as_plain()
    assert (plain["rows"], plain["refused"]) == (len(rows[1]), None)
    assert plain["answer"]["named"] == ["link_resistance"]


def test_a_stretch_that_is_too_short_says_so(found: Diagnosis, measured: Measurements) -> None:
    first = min(measured.frame["time_s"])

    def diagnosed(rows: Measurements) -> Diagnosis:
        if first in set(rows.frame["time_s"]):
            raise TooFewPoints("7 usable rows")
        return found

    before, after = stretches(found, measured, diagnosed)
    assert (before.found, after.found) == (None, found)
    assert before.as_plain() == {
        "name": "before", "rows": len(before.measurements.rows), "refused": "7 usable rows", "answer": None,
    }  # fmt: skip


def test_where_nothing_sets_in_there_are_none() -> None:
    measured = load_measurements(lab_table({"link_resistance": 0.08}, seed=SEED))
    assert stretches(diagnose(measured), measured, diagnose) == ()
