"""Converters that nobody designed: what is stated as feasible stands still and carries what was asked."""

import numpy as np
import pytest

from experiments.peers.random_converters import random_converter, random_points
from sim.fixed_point import operate
from sim.model import Model
from sim.simulate import simulate

STILL_K = 0.05  # the last solution's own accuracy: at an edge between hard and soft a loss can move that much
SEEDS = (*range(8), 60, 73)  # the last two swing far, step by step, before they settle


@pytest.mark.parametrize("seed", SEEDS)
def test_temperatures_and_powers_of_stated_points_stand_still(seed: int) -> None:
    rng = np.random.default_rng((3, seed))
    converter = random_converter(rng)
    points = random_points(converter, 12, rng)
    running = points.take(np.flatnonzero(simulate(Model(converter=converter), points).feasible))
    assert len(running) > 0
    outcome = operate(converter, running)
    assert outcome.reached.all()
    asked, now = outcome.station.ahead(outcome.state), outcome.station.slow
    for place, used_C in now.temperatures.by_place().items():
        np.testing.assert_allclose(asked.temperatures.by_place()[place], used_C, atol=STILL_K)
    balance = outcome.state.balance
    np.testing.assert_allclose(balance.P2_W, running.power_W, rtol=1e-5)  # stated to 1e-6, twice


def test_one_point_alone_is_what_it_is_among_others() -> None:
    rng = np.random.default_rng((3, 60))
    converter = random_converter(rng)
    points, model = random_points(converter, 12, rng), Model(converter=converter)
    together = simulate(model, points)
    for k in range(len(points)):
        alone = simulate(model, points.take(np.array([k])))
        assert alone.feasible[0] == together.feasible[k]
        if alone.feasible[0]:
            assert alone["P1_W"][0] == pytest.approx(together["P1_W"][k], rel=1e-5)  # stated to 1e-6, twice
