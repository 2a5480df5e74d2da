"""How far a table's readings were rounded, and what that leaves open of each.

A reading on a grid of step s is off by up to half of it, with a variance of s\\ :sup:`2`/12 (Widrow and Kollar, 2008,
*Quantization Noise*). Whatever was written down counts: an input power that follows from an efficiency of three digits
lies on no grid itself, and the simulation runs at the output power that was written.
"""

import numpy as np
from numpy.typing import NDArray

from models.diagnosis.observations import Observations

Array = NDArray[np.float64]

_ON_THE_GRID = 1e-6  # of a step
_STEPS = [m * 10.0**k for k in range(2, -6, -1) for m in (5.0, 2.5, 2.0, 1.0)]
_EXACTLY = 1e-12  # relative: what was worked out from other columns, to a double's rounding
_COARSEST = 1e-3  # of the rated power: output powers on a coarser grid are where they were set, not how they were read
_SEVERAL = 3  # different values: one alone is on any grid
_FOLLOW_P2 = ("efficiency", "P_link1_W", "P_link2_W")  # channels that move by a watt with the output's watt


def resolution(values: Array) -> float:
    """The step that all values (n,) are multiples of, 1, 2, 2.5 or 5 times a power of ten; 0 if there is none coarse.

    >>> resolution(np.array([0.12, 0.3, -0.05])), resolution(np.array([20.5, 31.0])), resolution(np.array([1 / 3]))
    (0.01, 0.5, 0.0)
    """
    first = float(values[0]) if values.size else 0.0  # alone it rules most steps out, and costs no array
    for step in _STEPS:
        if abs(first / step - round(first / step)) < _ON_THE_GRID:
            steps = values / step
            if np.all(np.abs(steps - np.round(steps)) < _ON_THE_GRID):
                return step
    return 0.0


def rounding(observations: Observations, name: str) -> Array:
    """Variances (n,) of a channel's readings by the rounding of what they were worked out from."""
    mask = observations.of(name)
    value, row = observations.value[mask], observations.row[mask]
    own = np.full(value.size, resolution(value) ** 2)
    if name not in _FOLLOW_P2 or not value.size:
        return own / 12
    P2 = np.where(observations.loaded[row], np.asarray(observations.points.power_W)[row], 0.0)
    if name == "efficiency" and not np.any(own) and (step := _step_of_efficiency(observations, row)):
        return np.asarray((value**2 / np.maximum(P2, 1e-9) * step) ** 2 / 12 * (P2 > 0.0))
    return np.asarray((own + np.where(P2 > 0.0, step_of_output(observations), 0.0) ** 2) / 12)


def step_of_output(observations: Observations) -> float:
    """The step in W that output powers were rounded to; 0 where they were not, or lie where they were set."""
    P2 = np.asarray(observations.points.power_W)[observations.loaded]
    step = resolution(P2[P2 > 0.0]) if np.any(P2 > 0.0) else 0.0
    return step if step <= _COARSEST * observations.rated_W else 0.0


def _step_of_efficiency(observations: Observations, row: NDArray[np.intp]) -> float:
    """The step of efficiencies that the input power of these rows was worked out from; 0 where it was read itself."""
    frame = observations.frame.iloc[row[observations.loaded[row]]]
    if "efficiency" not in frame:
        return 0.0
    efficiency, P1, P2 = (frame[c].to_numpy(dtype=float) for c in ("efficiency", "P1_W", "P2_W"))
    from_it = np.allclose(P2 / P1, efficiency, rtol=_EXACTLY, atol=0.0)
    return resolution(efficiency) if from_it and np.unique(efficiency).size >= _SEVERAL else 0.0
