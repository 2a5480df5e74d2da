"""Whether readings that were widened as outliers are noise: two elements of the analyzer that miss the same are not.

Noise strikes one reading, and another one of the same row by chance only. A loss in the ac link shows in P1 and P_link1
and not in P_link2; a wrong reading of P2, at which the model runs, shows in all three. So where P1 and P_link1 miss the
same watts, against P2 as it was read and against P_link2, each beyond its own noise, it was the converter.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from models.diagnosis.evidence import Hypothesis
from models.diagnosis.observations import Observations
from models.diagnosis.setting import Setting

Array = NDArray[np.float64]

_AHEAD, _BEHIND = ("efficiency", "P_link1_W"), "P_link2_W"


@dataclass(frozen=True, slots=True, kw_only=True)
class Confirmed:
    """A row of the frame whose input power misses ``watts``, and the power before the link alike, both by ``sigma``."""

    row: int
    watts: float
    sigma: float


def confirmed(setting: Setting, best: Hypothesis) -> list[Confirmed]:
    """Rows with widened readings of which two elements miss the same beside the ``best`` explanation, clearest first.

    A reading is predicted from all other rows, and has the noise of its channel, however far it was widened. A row that
    carries no watt more, as the simulator has it, does not tell an output read wrongly from a loss.
    """
    refinery = setting.refinery
    rows = _widened(refinery.observations, setting.sigma > setting.usual)
    rows = rows[np.all(refinery.known.per_watt[rows] != 0.0, axis=1)]
    if not rows.size:
        return []
    each = np.zeros((rows.size, setting.sigma.size))
    each[np.arange(rows.size), rows.ravel()] = 1.0
    inverse = refinery.solve(best.fit, each, best.leftover)
    pulled = refinery.solved(best.fit, best.leftover)
    found = [
        _in_common(np.linalg.inv(own[:, row]), pulled[row], setting, row)
        for row, own in zip(rows, inverse.reshape(*rows.shape, -1), strict=True)
    ]
    return sorted((c for c in found if c.sigma > 0.0), key=lambda c: -c.sigma)


def _widened(observations: Observations, widened: NDArray[np.bool_]) -> NDArray[np.intp]:
    """The readings (n, 3) ahead of the link and behind it of every row with one ahead that was widened."""
    place = np.full((3, len(observations.frame)), -1)
    for k, name in enumerate((*_AHEAD, _BEHIND)):
        readings = np.flatnonzero(observations.of(name))
        place[k, observations.row[readings]] = readings
    rows = place[:, np.all(place >= 0, axis=0) & observations.loaded].T
    return rows[np.any(widened[rows[:, :2]], axis=1)]


def _in_common(covariance: Array, pulled: Array, setting: Setting, row: NDArray[np.intp]) -> Confirmed:
    """What one row's three readings miss: their ``covariance`` given all others, and C'^-1 of what is left there."""
    missed = covariance @ pulled
    noise = covariance + np.diag(setting.usual[row] ** 2 - setting.sigma[row] ** 2)
    per_watt = setting.refinery.known.per_watt[row]
    # against what is behind the link, once any error of the output's power is let in
    against = np.eye(3)[:2] - np.outer(per_watt[:2] / per_watt[2], np.eye(3)[2])
    beyond = np.concatenate([
        missed[:2] / np.sqrt(np.diag(noise)[:2]),
        against @ missed / np.sqrt(np.diag(against @ noise @ against.T)),
    ])  # fmt: skip
    same = np.ptp(np.sign(beyond)) == 0.0
    return Confirmed(
        row=int(setting.refinery.observations.row[row[0]]),
        watts=float(missed[0]),
        sigma=float(np.min(np.abs(beyond))) if same else 0.0,
    )
