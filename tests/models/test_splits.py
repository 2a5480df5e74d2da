"""Splits: every row once, replicates together."""

import numpy as np
import pandas as pd
import pytest

from models.splits import set_points, split, split_experiment, split_simulation


def test_shares_of_the_paper(converter):
    simulated = split_simulation(pd.DataFrame(index=range(12_500)), seed=0)
    assert [len(simulated.train), len(simulated.test), len(simulated.validation)] == [1250, 2500, 8750]
    measured = split_experiment(converter.measured_table(1000, seed=0), seed=0)
    assert [len(measured.train), len(measured.test), len(measured.validation)] == [400, 200, 400]


def test_every_row_once_and_seeded():
    one, two, other = (split(np.arange(100), (0.4, 0.2, 0.4), seed=s) for s in (1, 1, 2))
    assert sorted(np.concatenate([one.train, one.test, one.validation])) == list(range(100))
    np.testing.assert_array_equal(one.train, two.train)
    assert not np.array_equal(one.train, other.train)


def test_repeated_readings_stay_together(converter):
    points = converter.measured_table(60, seed=0)
    rng = np.random.default_rng(0)
    repeated = pd.concat([points] * 3, ignore_index=True)
    repeated["P2_W"] *= 1 + 0.002 * rng.standard_normal(180)  # scatter of a set power
    groups = set_points(repeated)
    assert len(np.unique(groups)) == 60
    parts = split_experiment(repeated, seed=3)
    assert not set(groups[parts.train]) & set(groups[parts.validation])


def test_a_sweep_over_power_has_many_set_points():
    sweep = pd.DataFrame({"D1": 0.9, "D2": 0.1, "P2_W": np.arange(1300.0, 2001.0, 25.0)})
    assert len(np.unique(set_points(sweep))) == 15  # two of 25 W each lie within 2 %, and the last one alone
    assert len(np.unique(set_points(sweep.assign(P_set_W=sweep["P2_W"])))) == len(sweep)
    assert len(np.unique(set_points(sweep.assign(P_set_W=np.nan)))) == 15  # nobody filled that column in


def test_shares_must_add_up():
    with pytest.raises(ValueError, match="add up to 1"):
        split(np.arange(10), (0.5, 0.2, 0.4), seed=0)
