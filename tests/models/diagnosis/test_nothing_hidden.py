"""A lab that hides nothing, with every part off by its everyday spread, is consistent."""

import pytest

from models.diagnosis.diagnose import diagnose
from tests.models.diagnosis.virtual_campaign import lab_campaign

# A known miss, kept in sight: at 60 points the parts of lab 21 look like a magnetizing inductance of 17 to 21 mH.
KNOWN_MISS = pytest.mark.xfail(reason="60 points of lab 21 are called unknown, not consistent", strict=False)


@pytest.mark.parametrize("seed", [pytest.param(21, marks=KNOWN_MISS), 22, 23])
def test_nothing_is_named_where_nothing_is_hidden(seed: int) -> None:
    diagnosis = diagnose(lab_campaign({}, seed=seed))
    assert diagnosis.verdict.kind == "consistent"
    assert diagnosis.extended == diagnosis.baseline
    assert diagnosis.gain is None
