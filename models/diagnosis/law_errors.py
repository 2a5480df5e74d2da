"""How a cause's own formula is known to err: relative errors of what it does, of a shape that the set points tell.

About which harmonic the windings' resistance flattens is roughly known, and each set point has its own share of what
lies beyond. A core's loss depends on the core's temperature; ferrites have a minimum somewhere from 25 to 120 degC and
lose half as much again 75 K away from it (makers' data sheets; Magnetics, *Designing with magnetic cores at high
temperatures*). The simulator leaves that out.
"""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from models.diagnosis.observations import Observations
from sim.checks import HOTTEST_C
from sim.effects.base import Effect
from sim.harmonics import eddy_share
from sim.operating_points import Points
from sim.parameters import Converter
from sim.simulate import Result

Array = NDArray[np.float64]
LawErrors = Callable[[Effect], list[Array]]  # of an effect: relative errors (M,), one sigma each

# Assumption: of a core's loss by one sigma, for so many K of the core, and again for their square
OF_WARMTH, WARMTH_K = 0.2, 60.0
_FLATTENS = 0.5  # Assumption: of what flattening takes away, what it may take more or less, one sigma
_HOT = 2.0  # times what the core is simulated to lose: heat that it has more where the cause is large


def no_errors(entry: Effect) -> list[Array]:
    """Of an effect whose formula errs in no known way."""
    return []


def law_errors(observations: Observations, near: Result, converter: Converter) -> LawErrors:
    """The errors at every reading; ``near`` is a simulation of the rows with readings."""
    rows, row = np.unique(observations.row, return_inverse=True)
    points = observations.points.take(rows)

    def errors(entry: Effect) -> list[Array]:
        found = []
        if entry.of_eddies:
            found.append(of_flattening(converter, points, np.asarray(near["D0"])))
        if entry.core_of:
            found += _of_warmth(_core_C(entry.core_of, near, converter))
        return [np.nan_to_num(error)[row] for error in found]

    return errors


def of_flattening(converter: Converter, points: Points, D0: Array) -> Array:
    """Relative error (N,), one sigma, of what eddy currents lose at points with voltages."""
    left = eddy_share(converter, points, D0)
    return np.asarray(_FLATTENS * (1.0 / left - 1.0))


def _core_C(part: str, near: Result, converter: Converter) -> Array:
    """The temperature of a part whose core loses far more than simulated, at every row, (N,)."""
    heat_W = _HOT * np.asarray(near[f"loss_{part}_core_W"])
    warmer = np.asarray(near[f"T_{part}_C"]) + getattr(converter, part).thermal_K_per_W * heat_W
    return np.asarray(np.minimum(warmer, HOTTEST_C))


def _of_warmth(core_C: Array) -> list[Array]:
    """A straight line and a parabola over the temperature, without a level: that is in the value."""
    warmth = (core_C - np.nanmean(core_C)) / WARMTH_K
    return [OF_WARMTH * warmth, OF_WARMTH * (warmth**2 - np.nanmean(warmth**2))]
