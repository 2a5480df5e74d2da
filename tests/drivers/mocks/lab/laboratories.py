"""Laboratories for tests: one of nominal parts and perfect instruments, and points that run."""

import numpy as np
from numpy.typing import NDArray

from drivers.mocks.lab.hidden import Quirks
from drivers.mocks.lab.instruments import InstrumentErrors
from drivers.mocks.lab.laboratory import Electrical, Laboratory
from drivers.mocks.lab.waveforms import Heat
from sim.prototype import prototype

Array = NDArray[np.float64]
_NONE = dict.fromkeys((1, 2, 3, 4), 0.0)
PERFECT = InstrumentErrors(
    voltage_gain=_NONE,
    current_gain=_NONE,
    offset_A=_NONE,
    offset_W=_NONE,
    temperature_K=dict.fromkeys(("heatsink", "inductor", "transformer"), 0.0),
    output_sense=0.0,
    supply_V=0.0,
)


def nominal() -> Laboratory:
    """Every part as its datasheet says, nothing hidden, nothing misread."""
    return Laboratory(converter=prototype(), quirks=Quirks(), errors=PERFECT, hidden={})


def set_points(count: int, seed: int = 1) -> tuple[Array, Array, Array]:
    """D1, D2 and power of points that any of these labs can run."""
    rng = np.random.default_rng(seed)
    return rng.uniform(0.6, 0.96, count), rng.uniform(0.03, 0.3, count), rng.uniform(250, 1000, count)


def settled(lab: Laboratory, count: int = 40, time_s: float = 0.0) -> tuple[Electrical, Heat, Array]:
    """Steady states at random points, and the power at the input terminals."""
    D1, D2, power_W = set_points(count)
    now, heat = lab.settled(D1, D2, power_W, np.full(count, 300.0), np.full(count, time_s))
    return now, heat, lab.input_terminals(now, heat.heatsink_C, time_s)[1]
