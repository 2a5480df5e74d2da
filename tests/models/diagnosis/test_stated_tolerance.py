"""A choke that is off by less than its file says it may be is an ordinary one; a choke that was measured is not."""

from dataclasses import replace

import numpy as np
import pytest

from models.dataset import load_measurements
from models.diagnosis.diagnose import diagnose
from sim.effects.catalogue import effect
from sim.model import Model
from sim.prototype import prototype
from tests.models.diagnosis.virtual_campaign import simulated_campaign


@pytest.mark.parametrize(
    ("tolerances", "verdict"), [({}, "named"), ({"inductor.inductance_H": 0.05}, "consistent")]
)
def test_a_choke_is_taken_for_as_good_as_its_file_says(tolerances: dict[str, float], verdict: str) -> None:
    lower = Model.baseline().with_effect("leakage_inductance", relative_error=-0.07)
    frame = simulated_campaign(lower, seed=4, count=40)
    noise = 1 + 1.5e-4 * np.random.default_rng(4).standard_normal(len(frame))
    frame = frame.assign(P1_W=frame["P1_W"] * noise, efficiency=frame["efficiency"] / noise)
    stated = Model(converter=replace(prototype(), tolerances=tolerances))
    found = diagnose(load_measurements(frame), stated)
    assert found.verdict.kind == verdict
    assert found.verdict.named == (("leakage_inductance",) if verdict == "named" else ())


def test_a_stated_tolerance_leaves_what_a_cause_is_searched_over() -> None:
    stated = replace(prototype(), tolerances={"inductor.inductance_H": 0.05})
    assert effect("leakage_inductance").at(stated) == effect("leakage_inductance").at(prototype())
