"""Readings of a converter with more resistance than its simulation has, as a table and in a store."""

import numpy as np
import pandas as pd

from bench.store import Provenance, Store
from sim.model import Model
from sim.operating_points import Points
from sim.simulate import simulate


def measured(count: int, *, seed: int = 1, resistance_Ohm: float = 0.15, noise: float = 2e-5) -> pd.DataFrame:
    """Readings of a converter with a resistance that its simulation does not know."""
    rng = np.random.default_rng(seed)
    D1, D2, P_W = rng.uniform(0.7, 1.0, count), rng.uniform(0.0, 0.3, count), rng.uniform(300, 1200, count)
    converter = Model.baseline().with_effect("link_resistance", resistance_Ohm=resistance_Ohm)
    run = simulate(converter, Points(D1=D1, D2=D2, power_W=P_W))
    table = pd.DataFrame({"D1": D1, "D2": D2, "P2_W": P_W, "P_set_W": P_W, "kind": "load"})
    table["efficiency"] = run["efficiency"] + noise * rng.standard_normal(count)
    table["P1_W"] = P_W / table["efficiency"]
    return table[run.feasible].reset_index(drop=True)


def imported(store: Store, table: pd.DataFrame) -> int:
    return store.import_table("theirs", table, Provenance(config={}, config_hash="0", virtual=True))
