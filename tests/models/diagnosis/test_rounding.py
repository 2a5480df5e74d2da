"""Rounding: what a table's last digits leave open, also of what was worked out from them."""

import numpy as np
import pandas as pd
import pytest

from models.dataset import load_measurements
from models.diagnosis.diagnose import diagnose
from models.diagnosis.observations import Observations, observe
from models.diagnosis.rounding import resolution, rounding
from sim.prototype import prototype
from tests.models.diagnosis.virtual_campaign import lab_campaign

RNG = np.random.default_rng(8)
P2_W, EFFICIENCY = RNG.uniform(200.0, 1800.0, 40), RNG.uniform(0.95, 0.98, 40)


def observed(P2_W: np.ndarray, P1_W: np.ndarray, efficiency: np.ndarray | None = None) -> Observations:
    frame = pd.DataFrame({"kind": "load", "D1": 0.9, "D2": 0.1, "P2_W": P2_W, "P1_W": P1_W})
    return observe(frame.assign(efficiency=P2_W / P1_W if efficiency is None else efficiency), prototype())


@pytest.mark.parametrize("step", [50.0, 0.5, 0.02, 0.025, 1e-5])
def test_a_step_comes_back(step: float) -> None:
    assert resolution(step * RNG.integers(1, 1000, 40)) == pytest.approx(
        step, rel=1e-12
    )  # of decimal fractions


def test_whole_watts_at_the_input_and_at_the_output_add_up() -> None:
    P1_W = P2_W / EFFICIENCY
    neither, both = observed(P2_W, P1_W), observed(np.round(P2_W), np.round(P1_W))
    assert np.all(rounding(neither, "efficiency") == 0.0)
    np.testing.assert_allclose(rounding(both, "efficiency"), (1.0 + 1.0) / 12)


def test_an_input_power_is_known_as_well_as_the_efficiency_that_it_was_worked_out_from() -> None:
    efficiency = np.round(EFFICIENCY, 3)
    found = rounding(observed(P2_W, P2_W / efficiency, efficiency), "efficiency")
    exact = np.var(P2_W[:, None] / (efficiency[:, None] + np.linspace(-5e-4, 5e-4, 2001)), axis=1)
    np.testing.assert_allclose(found, exact, rtol=2e-3)  # of a curve within a thousandth


def test_an_efficiency_that_was_rounded_beside_an_input_power_takes_nothing_from_it() -> None:
    beside = observed(P2_W, P2_W / EFFICIENCY, np.round(EFFICIENCY, 2))
    assert np.all(rounding(beside, "efficiency") == 0.0)


def test_output_powers_on_a_coarse_grid_are_where_they_were_set() -> None:
    set_W = 50.0 * np.round(P2_W / 50.0)
    assert np.all(rounding(observed(set_W, set_W / EFFICIENCY), "efficiency") == 0.0)


@pytest.mark.parametrize("seed", [1, 2])
@pytest.mark.parametrize("written", ["efficiency to a thousandth", "whole watts"])
def test_a_healthy_lab_whose_table_was_rounded_stays_consistent(written: str, seed: int) -> None:
    frame = lab_campaign({}, seed=seed, count=60).frame
    if written == "whole watts":
        frame = frame.assign(P1_W=frame["P1_W"].round(), P2_W=frame["P2_W"].round()).drop(
            columns="efficiency"
        )
    else:
        loaded = frame[frame["kind"].isin(["load", "reference"])]
        frame = loaded[["kind", "D1", "D2", "P2_W", "efficiency", "time_s"]].round({"efficiency": 3})
    assert diagnose(load_measurements(frame.reset_index(drop=True))).verdict.kind == "consistent"
