"""Variants of a converter in one, and out again."""

from dataclasses import replace

import numpy as np
import pytest

from sim.parameters import ParameterError
from sim.prototype import prototype
from sim.stacking import pick, stack


def test_values_that_differ_become_arrays_and_others_stay() -> None:
    base = prototype()
    stacked = stack([base, replace(base, dead_time_s=500e-9)], 3)
    np.testing.assert_array_equal(stacked.dead_time_s, np.repeat([400e-9, 500e-9], 3))
    assert stacked.inductor == base.inductor


def test_one_row_of_a_stack_is_its_variant() -> None:
    base = prototype()
    other = replace(base, inductor=replace(base.inductor, inductance_H=250e-6))
    row = pick(stack([base, other], 2), np.array([3]))
    assert row.inductor.inductance_H.tolist() == [250e-6]
    assert row.secondary == base.secondary


def test_variants_of_another_frequency_are_refused() -> None:
    base = prototype()
    with pytest.raises(ParameterError, match="frequency_Hz"):
        stack([base, replace(base, frequency_Hz=50e3)], 2)
