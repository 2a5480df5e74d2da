"""A small smooth converter to learn from: no simulator needed, truth known everywhere."""

from collections.abc import Callable
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest

CEILING_W = 2224.6
EDGE_GAP = 0.016


def feasible(D1, D2, power_W):
    """Carries the power, and has no pulse or zero state shorter than the dead time."""
    D1, D2, power_W = np.broadcast_arrays(D1, D2, power_W)
    short = (
        ((D1 > 1 - EDGE_GAP) & (D1 < 1))
        | ((D2 > 0) & (D2 < EDGE_GAP))
        | (D1 < EDGE_GAP)
        | (1 - D2 < EDGE_GAP)
    )
    return ~short & (power_W <= CEILING_W * np.sin(np.pi / 2 * D1) * np.cos(np.pi / 2 * D2))


def simulated_efficiency(D1, D2, power_W):
    """A bowl whose bottom moves with load, and a fold; NaN where infeasible."""
    load = np.asarray(power_W) / 2000.0
    bowl = (D1 - 0.45 - 0.5 * load) ** 2 + 0.6 * (D2 - 0.5 + 0.45 * load) ** 2
    loss_W = 6.0 + 14.0 * load**2 + 60.0 * bowl + 5.0 * np.abs(np.sin(6.0 * (D1 - D2)))
    return np.where(feasible(D1, D2, power_W), power_W / (power_W + loss_W), np.nan)


def true_efficiency(D1, D2, power_W):
    """The simulation plus a resistance it does not know."""
    efficiency = simulated_efficiency(D1, D2, power_W)
    load = np.asarray(power_W) / 2000.0
    extra_W = 4.0 + 9.0 * load**2 * (1 + 2 * (1 - D1) ** 2 + D2**2)
    return power_W / (power_W / efficiency + extra_W)


def simulated_grid(shape: tuple[int, int, int]) -> pd.DataFrame:
    """Simulation table on a full grid, infeasible rows included."""
    axes = (np.linspace(0, 1, shape[0]), np.linspace(0, 1, shape[1]), np.linspace(200, 2000, shape[2]))
    D1, D2, power_W = (a.ravel() for a in np.meshgrid(*axes, indexing="ij"))
    efficiency = simulated_efficiency(D1, D2, power_W)
    power = {"P_set_W": power_W, "P2_W": power_W}
    return pd.DataFrame(
        {"D1": D1, "D2": D2, **power, "feasible": np.isfinite(efficiency), "efficiency": efficiency}
    )


def measured_table(count: int, seed: int, noise: float = 2e-4) -> pd.DataFrame:
    """Measurement table at random feasible points; ``noise`` is the standard deviation of efficiency."""
    rng = np.random.default_rng(seed)
    D1, D2, power_W = rng.random(20 * count), rng.random(20 * count), rng.uniform(200, 2000, 20 * count)
    efficiency = true_efficiency(D1, D2, power_W)
    keep = np.flatnonzero(np.isfinite(efficiency))[:count]
    efficiency = efficiency[keep] + noise * rng.standard_normal(count)
    return pd.DataFrame(
        {
            "D1": D1[keep],
            "D2": D2[keep],
            "P2_W": power_W[keep],
            "P1_W": power_W[keep] / efficiency,
            "efficiency": efficiency,
        }
    )


@pytest.fixture(scope="session")
def converter() -> SimpleNamespace:
    """The functions above, and what most tests need of them."""
    functions: dict[str, Callable[..., object]] = {
        "feasible": feasible,
        "simulated_efficiency": simulated_efficiency,
        "true_efficiency": true_efficiency,
        "simulated_grid": simulated_grid,
        "measured_table": measured_table,
    }
    return SimpleNamespace(edge_gap=EDGE_GAP, loads_W=np.arange(200.0, 2001.0, 100.0), **functions)
