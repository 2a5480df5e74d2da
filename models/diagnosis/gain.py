"""What an extension is worth: error on blocks that were not fitted, next to its rivals.

Blocks are bands of power, so that nothing near a predicted point was fitted. In each fold the cause, the best
wrong cause and a leftover alone are fitted to the other bands; errors are of efficiency at the measured points.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from models.diagnosis.hypotheses import Fit
from models.diagnosis.observations import Observations
from models.diagnosis.whitener import Covariance, Whitener

Array = NDArray[np.float64]

_BANDS = 4
_RESAMPLES = 400
_LEAST = 12  # readings below which blocks mean nothing


@dataclass(frozen=True, slots=True, kw_only=True)
class Readings:
    """What a gain is judged on: residuals (M,), their covariance, and directions (q, M) of a leftover everywhere."""

    observations: Observations
    residual: Array
    covariance: Covariance
    leftover: Array


@dataclass(frozen=True, slots=True, kw_only=True)
class Gain:
    """Mean absolute errors of efficiency on held-out bands; ``ci95`` of before minus after, paired bootstrap.

    ``calibrated`` is that of the cause with all everyday spreads and the analyzer's errors fitted beside it.
    """

    before: float
    after: float
    ci95: tuple[float, float]
    wrong_cause: float | None
    leftover_only: float
    calibrated: float

    def as_plain(self) -> dict[str, object]:
        """For the JSON answer."""
        return {
            "blocks": "power band",
            "before": self.before,
            "after": self.after,
            "ci95": list(self.ci95),
            "wrong_cause": self.wrong_cause,
            "leftover_only": self.leftover_only,
            "calibrated": self.calibrated,
        }


def _refitted(fit: Fit, residual: Array, whitener: Whitener, rows: NDArray[np.bool_]) -> Array:
    """The fit's shift with its values fitted again on some readings (linear about the fit), at all readings."""
    if not fit.terms:
        return np.zeros_like(residual)
    slopes = np.stack([t.slope for t in fit.terms])
    prior = np.array([t.head.prior for t in fit.terms])
    pull = -np.array([t.distance for t in fit.terms]) / prior**2
    weighted = whitener.solve(slopes[:, rows].T)
    precision = slopes[:, rows] @ weighted + np.diag(prior**-2)
    step = np.linalg.solve(precision, weighted.T @ (residual - fit.shift)[rows] + pull)
    return np.asarray(fit.shift + step @ slopes)


def _leftover_on(readings: Readings, rows: NDArray[np.bool_]) -> Array:
    """A leftover in these directions fitted on some readings, at all readings."""
    leftover = readings.leftover
    whitener = Whitener.of(readings.covariance.take(np.flatnonzero(rows)).beside(leftover[:, rows]))
    return np.asarray(leftover.T @ (leftover[:, rows] @ whitener.solve(readings.residual[rows])))


def held_out_gain(readings: Readings, cause: Fit, rival: Fit | None, seed: int) -> Gain | None:
    """The gain of a cause over bands of power, or None with too few readings."""
    observations, covariance = readings.observations, readings.covariance
    residual = readings.residual
    power = np.asarray(observations.points.power_W)[observations.row]
    judged = observations.of("efficiency") & observations.loaded[observations.row]
    if judged.sum() < _LEAST:
        return None
    edges = np.quantile(power[judged], np.linspace(0, 1, _BANDS + 1)[1:-1])
    band = np.searchsorted(edges, power)
    error = {
        name: np.full(residual.size, np.nan)
        for name in ("before", "after", "wrong", "leftover", "calibrated")
    }
    for k in range(_BANDS):
        rows, out = band != k, (band == k) & judged
        whitener = Whitener.of(covariance.take(np.flatnonzero(rows)))
        error["before"][out] = residual[out]
        left = residual - _refitted(cause, residual, whitener, rows)
        error["after"][out] = left[out]
        # noise is on the diagonal: between bands, the covariance is that of spreads and smooth inaccuracy
        pulled = np.zeros_like(residual)
        pulled[rows] = whitener.solve(left[rows])
        error["calibrated"][out] = left[out] - covariance.times(pulled)[out]
        if rival is not None:
            error["wrong"][out] = (residual - _refitted(rival, residual, whitener, rows))[out]
        error["leftover"][out] = (residual - _leftover_on(readings, rows))[out]
    # d(efficiency) = - efficiency * d(input power) / input power
    scale = power[judged] / observations.value[judged] ** 2
    size = {name: np.abs(e[judged]) * scale for name, e in error.items()}
    rng = np.random.default_rng(seed)
    picks = rng.integers(0, judged.sum(), (_RESAMPLES, int(judged.sum())))
    better = np.mean((size["before"] - size["after"])[picks], axis=1)
    low, high = np.quantile(better, [0.025, 0.975])
    return Gain(
        before=float(np.mean(size["before"])),
        after=float(np.mean(size["after"])),
        ci95=(float(low), float(high)),
        wrong_cause=None if rival is None else float(np.mean(size["wrong"])),
        leftover_only=float(np.mean(size["leftover"])),
        calibrated=float(np.mean(size["calibrated"])),
    )
