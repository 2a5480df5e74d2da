r"""What residuals do without any fault: noise, everyday spreads, the simulation's own accuracy.

.. math:: C = \operatorname{diag}(\sigma^2) + J \Lambda J^T + A

with J the directions of spreads, and of what is not straight in them, and A the simulation's inaccuracy
(:mod:`models.diagnosis.inaccuracy`), smooth per channel over (D1, D2, power).
"""

import numpy as np
from numpy.typing import NDArray

from models.diagnosis.observations import Observations
from models.diagnosis.signatures import Signatures
from models.diagnosis.whitener import Covariance

Array = NDArray[np.float64]

_LEAST_DUTY, _LEAST_SHARE = 0.02, 0.05  # ranges of D1, D2 and power (of its largest) that count as one value
_LENGTHS = np.array([0.3, 0.3, 0.4])  # of the ranges of D1, D2 and power: smooth over a third of the map
AT_EDGES = 3.0  # laws of edges are smooth over a third of the lengths
_NEARER = (1.0, AT_EDGES, AT_EDGES)
_OVER_THE_MAP = 1.0 / 3.0  # what each further component is alike over: the whole map


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


def smooth_covariance(one: tuple[Array, Array], other: tuple[Array, Array]) -> Array:
    """Covariance (N, K) of the simulation's inaccuracy between two sets of readings of one channel.

    Each is told by its places on the map (N, 3) and its :func:`~models.diagnosis.inaccuracy.inaccuracy` (3, N), and
    by what single laws may be off by over the whole map, beneath it, where anything is.
    """
    (place, sigma), (place_, sigma_) = one, other
    both = zip(sigma, sigma_, _NEARER, strict=False)
    found = sum(np.outer(s, s_) * kernel(place * nearer, place_ * nearer) for s, s_, nearer in both)
    if len(of_laws := sigma[len(_NEARER) :]):
        alike = kernel(place * _OVER_THE_MAP, place_ * _OVER_THE_MAP)
        found = found + (of_laws.T @ sigma_[len(_NEARER) :]) * alike
    return np.asarray(found)


def noiseless_covariance(observations: Observations, known: Signatures) -> Covariance:
    """The covariance (M, M) of readings without noise, with no effect and no leftover."""
    place = locations(observations)
    of_channels = tuple(np.flatnonzero(observations.channel == k) for k in range(len(observations.channels)))
    own = []
    for readings in of_channels:
        here = place[observations.row[readings]], known.inaccuracy[:, readings]
        own.append(smooth_covariance(here, here))
    return Covariance(rows=of_channels, own=tuple(own), common=np.concatenate([known.spreads, known.bends]))
