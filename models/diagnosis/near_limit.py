"""Near the most that D1 and D2 carry: which rows have power to spare, and what a link inductance bends there.

Everything answers there at once and not linearly, and what moves that limit the most is the link inductance.
"""

from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from models.diagnosis.observations import Observations
from sim.model import Model
from sim.side_by_side import at_once
from sim.simulate import Result, can_run, lossless_most_W
from sim.spread import Spread

Array = NDArray[np.float64]

LINK_INDUCTANCE = "inductor.inductance_H"
LEAST_SPARE = 0.03  # of the power: an inductance three sigma off still carries it
_LOST = 0.05  # of the power: by so much more may what is lost at the most lower it, between models
_SPARE = 0.12  # of the power: an inductance eight per cent off and everything else still carry it


def margin(observations: Observations) -> float:
    """How much more than its power, relative, a row's D1 and D2 have to carry for a diagnosis.

    Closer to the most that they can carry, D0 answers to everything at once and not linearly. The input power does so
    far less: where it is all there is, what it bends by is known (:func:`curvature`).
    """
    return LEAST_SPARE if observations.efficiency_alone else _SPARE


def power_to_spare(observations: Observations, model: Model, least: float) -> NDArray[np.bool_]:
    """Readings (M,) of rows that a model could run with so much more power, relative, and of rows without any."""
    used, place = np.unique(observations.row, return_inverse=True)
    p = observations.points.take(used)
    return can_run(model, replace(p, power_W=p.power_W * (1 + least)))[place]


def still_to_spare(
    observations: Observations, baseline: Model, model: Model, known: float
) -> NDArray[np.bool_]:
    """Readings (M,) of rows that a model leaves :data:`LEAST_SPARE`, where the baseline is known to leave more.

    ``known`` is that, relative to the power. Rows whose lossless limit moves by less than lies between the two are not
    simulated.
    """
    p = observations.points
    # a pulse narrower than two dead times carries nothing
    with np.errstate(invalid="ignore", divide="ignore"):
        moved = lossless_most_W(model, p) / lossless_most_W(baseline, p)
    enough = moved * (1 + known) > (1 + LEAST_SPARE) * (1 + _LOST)
    asked = ~enough[observations.row]
    spare = np.ones(asked.size, dtype=bool)
    if np.any(asked):
        spare[asked] = power_to_spare(observations.take(asked), model, LEAST_SPARE)
    return spare


def first_looks(observations: Observations, baseline: Model) -> tuple[NDArray[np.bool_], Result]:
    """Readings (M,) of rows with a :func:`margin`, and a reference of all rows, which takes longer: it is made here."""
    reference_of = partial(observations.reference, baseline)
    spare_of = partial(power_to_spare, observations, baseline, margin(observations))
    if observations.processes < 2:
        return spare_of(), reference_of()
    of_all, spare = at_once(reference_of, spare_of)
    return spare, of_all


def curvature(base: Array, more: Array, less: Array) -> Array:
    """How far readings (..., M) bend over one sigma, from what they are there and one sigma to either side."""
    return np.asarray(0.5 * (more + less) - base)


def answers_about(observations: Observations, model: Model, spread: Spread, near: Result | None) -> Array:
    """How readings answer about a model to a spread of one sigma: by a slope, and by a :func:`curvature`; (2, M).

    NaN where the model does not run so.
    """
    each = [
        Model(converter=spread.shifted(model.converter, sigmas), effects=model.effects)
        for sigmas in (0.0, 1.0, -1.0)
    ]
    base, more, less = (here for here, _ in observations.solved(each, near))
    return np.stack([0.5 * (more - less), curvature(base, more, less)])
