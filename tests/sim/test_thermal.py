"""Temperatures are what the losses keep up, and no more."""

import numpy as np
import pytest

from sim.prototype import prototype
from sim.station import AT_INPUT, AT_OUTPUT, IN_LINK
from sim.thermal import temperatures

PARTS = (*AT_INPUT, *IN_LINK, *AT_OUTPUT)


def losses(**watts: float) -> dict[str, np.ndarray]:
    return {part: np.array([watts.get(part, 0.0)]) for part in PARTS}


def test_without_losses_everything_is_at_ambient() -> None:
    t = temperatures(prototype(), losses(), np.array([31.0]))
    assert {float(np.ravel(value)[0]) for value in t.by_place().values()} == {31.0}


def test_semiconductors_share_one_heatsink() -> None:
    t = temperatures(
        prototype(), losses(primary_inner_conduction=6.0, secondary_switching=4.0), np.array([25.0])
    )
    assert t.heatsink_C[0] == pytest.approx(25.0 + 1.0 * 10.0)
    assert t.junction_C["primary_outer"][0] == t.heatsink_C[0]
    assert t.junction_C["primary_inner"][0] == pytest.approx(35.0 + 0.95 * 6.0 / 4)  # four switches share it


def test_windings_warm_by_copper_and_core() -> None:
    t = temperatures(prototype(), losses(inductor_copper=2.0, inductor_core=1.0), np.array([25.0]))
    assert t.inductor_C[0] == pytest.approx(25.0 + 7.0 * 3.0)
    assert t.heatsink_C[0] == t.transformer_C[0] == 25.0


def test_an_overload_stays_finite() -> None:
    t = temperatures(prototype(), losses(primary_inner_conduction=1e6), np.array([25.0]))
    assert t.junction_C["primary_inner"][0] == 250.0
