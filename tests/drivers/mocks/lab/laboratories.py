"""Laboratories for tests: one of nominal parts and perfect instruments, and points that run."""

import numpy as np
from numpy.typing import NDArray

from drivers.mocks.lab.instruments import perfect_instruments
from drivers.mocks.lab.laboratory import Electrical, Laboratory
from drivers.mocks.lab.waveforms import Heat

Array = NDArray[np.float64]
PERFECT = perfect_instruments()


def nominal() -> Laboratory:
    """Every part as its datasheet says, nothing hidden, nothing misread."""
    return Laboratory.nominal()


def set_points(count: int, seed: int = 1) -> tuple[Array, Array, Array]:
    """D1, D2 and power of points that any of these labs can run."""
    rng = np.random.default_rng(seed)
    return rng.uniform(0.6, 0.96, count), rng.uniform(0.03, 0.3, count), rng.uniform(250, 1000, count)


def settled(lab: Laboratory, count: int = 40, time_s: float = 0.0) -> tuple[Electrical, Heat, Array]:
    """Steady states at random points, and the power at the input terminals."""
    D1, D2, power_W = set_points(count)
    now, heat = lab.settled(D1, D2, power_W, np.full(count, 300.0), np.full(count, time_s))
    return now, heat, lab.input_terminals(now, heat.heatsink_C, time_s)[1]
