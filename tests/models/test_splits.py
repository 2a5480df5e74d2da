"""Splits: every row once, replicates together, blocks whole."""

import numpy as np
import pandas as pd
import pytest

from models.splits import periods, power_bands, regions, set_points, split, split_experiment, split_simulation


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


def test_shares_must_add_up():
    with pytest.raises(ValueError, match="add up to 1"):
        split(np.arange(10), (0.5, 0.2, 0.4), seed=0)


def test_power_bands_hold_out_whole_bands(converter):
    table = converter.measured_table(200, seed=0)
    blocks = power_bands(table, 4)
    assert sorted(np.concatenate([b.held_out for b in blocks])) == list(range(200))
    for block in blocks:
        inside, outside = table["P2_W"].iloc[block.held_out], table["P2_W"].iloc[block.fitted]
        assert not outside.between(inside.min(), inside.max()).any()


def test_regions_and_periods_cover_every_row_once(converter):
    table = converter.measured_table(90, seed=0).assign(time_s=np.arange(90.0)[::-1])
    for blocks in (regions(table), periods(table, 3)):
        assert sorted(np.concatenate([b.held_out for b in blocks])) == list(range(90))
    first = periods(table, 3)[0]
    assert table["time_s"].iloc[first.held_out].max() == 29


def test_a_block_that_would_leave_nothing_to_fit_is_left_out(converter):
    table = converter.measured_table(20, seed=0).assign(P2_W=500.0)
    assert power_bands(table, 3) == []
