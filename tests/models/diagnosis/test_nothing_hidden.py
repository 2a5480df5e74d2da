"""A lab that hides nothing, with every part off by its everyday spread, is consistent."""

import pytest

from models.diagnosis.diagnose import diagnose
from tests.models.diagnosis.virtual_campaign import lab_campaign


@pytest.mark.parametrize("seed", [21, 22, 23])
def test_nothing_is_named_where_nothing_is_hidden(seed: int) -> None:
    diagnosis = diagnose(lab_campaign({}, seed=seed))
    assert diagnosis.verdict.kind == "consistent"
    assert diagnosis.extended == diagnosis.baseline
    assert diagnosis.gain is None
