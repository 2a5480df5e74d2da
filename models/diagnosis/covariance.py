r"""What residuals do without any fault: noise, everyday spreads, the simulation's own accuracy.

.. math:: C = \operatorname{diag}(\sigma^2) + J \Lambda J^T + A

with J the spreads' directions and A a smooth inaccuracy of the simulation per channel over (D1, D2, power).
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve

from models.diagnosis.observations import Observations
from models.diagnosis.signatures import Signatures

Array = NDArray[np.float64]

_LEAST_DUTY, _LEAST_SHARE = (
    0.02,
    0.05,
)  # ranges of D1, D2 and power (of its largest) below which they count as one
_LENGTHS = np.array([0.3, 0.3, 0.4])  # of the ranges of D1, D2 and power: smooth over a third of the map


@dataclass(frozen=True, slots=True, kw_only=True)
class Whitener:
    """A factored covariance: solves and its log-determinant."""

    factor: tuple[Array, bool]
    log_determinant: float

    @classmethod
    def of(cls, covariance: Array) -> "Whitener":
        """Factor a covariance matrix (M, M)."""
        factor = cho_factor(covariance, lower=True, check_finite=False)
        return cls(factor=factor, log_determinant=2 * float(np.sum(np.log(np.diag(factor[0])))))

    def solve(self, right: Array) -> Array:
        """C^-1 right."""
        return np.asarray(cho_solve(self.factor, right, check_finite=False))


def length_scale(observations: Observations) -> Array:
    """Correlation lengths of D1, D2 and power in their own units, (3,)."""
    p = observations.points
    loaded = observations.loaded
    where = np.stack([p.D1, p.D2, p.power_W], axis=1)[loaded if np.any(loaded) else slice(None)]
    least = np.array([_LEAST_DUTY, _LEAST_DUTY, _LEAST_SHARE * float(np.max(where[:, 2], initial=1.0))])
    return np.asarray(np.maximum(np.ptp(where, axis=0), least) * _LENGTHS)


def locations(observations: Observations) -> Array:
    """Where each row of the frame lies on the map, in correlation lengths, (N, 3)."""
    p = observations.points
    return np.asarray(np.stack([p.D1, p.D2, p.power_W], axis=1) / length_scale(observations))


def kernel(a: Array, b: Array) -> Array:
    """Squared-exponential correlation of locations (N, 3) and (K, 3)."""
    distance2 = np.sum(a**2, axis=1)[:, None] + np.sum(b**2, axis=1) - 2 * a @ b.T
    return np.asarray(np.exp(-0.5 * np.maximum(distance2, 0.0)))


def same_channel(observations: Observations) -> NDArray[np.bool_]:
    """Pairs of readings of one channel, (M, M)."""
    return np.asarray(observations.channel[:, None] == observations.channel[None, :])


def accuracy_scale(observations: Observations, baseline: Array) -> Array:
    """The simulation's own accuracy for every reading, one sigma (M,)."""
    c = observations.channels
    fixed = np.array([k.accuracy for k in c])[observations.channel]
    share = np.array([k.accuracy_of_loss for k in c])[observations.channel]
    input_W = np.full(len(observations.frame), np.nan)
    mask = observations.of("efficiency")
    input_W[observations.row[mask]] = baseline[mask]
    loss = np.nan_to_num(input_W - np.asarray(observations.points.power_W), nan=0.0)[observations.row]
    return np.asarray(np.hypot(fixed, share * loss))


def covariance(observations: Observations, sigma: Array, known: Signatures) -> Array:
    """The covariance (M, M) of readings with noise ``sigma`` (M,), with no effect and no leftover."""
    place = locations(observations)[observations.row]
    smooth = kernel(place, place) * same_channel(observations)
    accuracy = accuracy_scale(observations, known.baseline)
    return np.asarray(
        np.diag(sigma**2 + known.input_sigma**2)
        + known.spreads.T @ known.spreads
        + accuracy[:, None] * accuracy[None, :] * smooth
    )
