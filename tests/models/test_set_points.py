"""Rows of one set point: by the power that was set, else by powers that lie near."""

import numpy as np
import pandas as pd

from models.set_points import set_power, together


def test_the_set_power_counts_where_it_was_noted() -> None:
    measured = pd.DataFrame({"P2_W": [499.7, 700.2, 901.0], "P_set_W": [500.0, np.nan, 900.0]})
    assert set_power(measured, measured["P2_W"]).tolist() == [500.0, 700.2, 900.0]
    assert set_power(measured[["P2_W"]], measured["P2_W"]).tolist() == [499.7, 700.2, 901.0]


def test_a_sweep_in_small_steps_is_no_single_power() -> None:
    power = pd.Series(np.arange(1300.0, 2001.0, 5.0))
    found = together(power, [pd.Series(np.ones(power.size))], span=20.0)
    assert found.nunique() == 29  # five of 5 W each: 141 / 5 and one that is left
    assert np.all((power - found).between(0.0, 20.0))


def test_powers_at_different_modulations_are_different_sets() -> None:
    power, D1 = pd.Series([500.0, 499.0, 501.0, 500.5]), pd.Series([0.8, 0.9, 0.8, 0.9])
    assert together(power, [D1], span=5.0).tolist() == [500.0, 499.0, 500.0, 499.0]
