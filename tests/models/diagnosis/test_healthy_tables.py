"""Tables of another laboratory with nothing wrong in them: made by the simulator, with instruments of their own."""

import numpy as np
import pandas as pd

from models.dataset import load_measurements
from models.diagnosis.diagnose import diagnose
from sim.model import Model
from tests.models.diagnosis.virtual_campaign import simulated_campaign


def read(frame: pd.DataFrame, seed: int) -> pd.DataFrame:
    """What an analyzer with a noise of 0.012 % shows of both powers."""
    rng = np.random.default_rng(seed)
    noisy = {name: frame[name] * (1 + 1.2e-4 * rng.standard_normal(len(frame))) for name in ("P1_W", "P2_W")}
    return frame.assign(**noisy).drop(columns="efficiency")


def test_standby_that_scatters_is_not_something_over_time() -> None:
    loaded = read(simulated_campaign(Model.baseline(), seed=132, count=40), seed=132)
    standby = pd.DataFrame({"kind": ["standby"] * 6, "time_s": np.linspace(10.0, 9000.0, 6)})
    scatter_W = 0.12 * np.random.default_rng(133).standard_normal(6)  # of a range of 1500 W
    table = pd.concat([loaded, standby.assign(P1_W=scatter_W)], ignore_index=True)
    found = diagnose(load_measurements(table))
    assert found.verdict.kind == "consistent"
    assert not [row for row in found.rejected if row["row"] > len(loaded)]  # each counts
