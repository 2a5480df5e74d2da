"""Calibrated physics: the simulator at the most probable state of its parts, and what is left over, smoothed.

The named effects and every everyday spread are fitted to all channels at once; the simulator then runs with
them. What it still misses in efficiency is carried by a Gaussian process over (D1, D2, power), in watts, which
falls back to nothing away from the measured points.
"""

from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from models.diagnosis.covariance import kernel, length_scale
from models.diagnosis.hypotheses import Fit
from models.diagnosis.refinery import Refinery
from models.diagnosis.whitener import Whitener
from sim.model import Model
from sim.operating_points import Points
from sim.simulate import simulate

Array = NDArray[np.float64]

CALIBRATED = "calibrated"


@dataclass(frozen=True, slots=True, kw_only=True)
class Leftover:
    """A correction of the input power in W from residuals at measured points: smooth, and an analyzer's errors.

    A Gaussian process with covariance ``smooth_W^2 k(x, x') + offset_W^2 + gain^2 P P'``; ``place`` (N, 3) holds
    the measured (D1, D2, power) and ``weight`` (N,) its fit.
    """

    place: Array
    weight: Array
    length: Array
    smooth_W: float = 0.25
    offset_W: float = 0.6
    gain: float = 4e-4

    def covariance(self, a: Array, b: Array) -> Array:
        """Prior covariance of the correction at (N, 3) and (K, 3), in W^2."""
        smooth = self.smooth_W**2 * kernel(a / self.length, b / self.length)
        return np.asarray(smooth + self.offset_W**2 + self.gain**2 * a[:, 2:] * b[:, 2])

    def fitted(self, residual_W: Array, sigma_W: Array) -> Self:
        """The process given residuals and their noise, (N,)."""
        prior = self.covariance(self.place, self.place)
        return replace(self, weight=Whitener.of(prior + np.diag(sigma_W**2)).solve(residual_W))

    def watts(self, place: Array) -> Array:
        """Correction at points (K, 3)."""
        return np.asarray(self.covariance(place, self.place) @ self.weight)


@dataclass(frozen=True, slots=True, kw_only=True)
class CalibratedPhysics:
    """An efficiency model: a calibrated simulator and the leftover that it could not take up."""

    model: Model
    leftover: Leftover
    V1_V: float
    V2_V: float
    ambient_C: float

    def predict(self, D1: ArrayLike, D2: ArrayLike, power_W: ArrayLike) -> Array:
        """Efficiency as a fraction, of the inputs' broadcast shape; NaN where the model cannot run."""
        a, b, c = np.broadcast_arrays(*(np.asarray(x, dtype=float) for x in (D1, D2, power_W)))
        points = Points(
            D1=a.ravel(), D2=b.ravel(), power_W=c.ravel(),
            V1_V=self.V1_V, V2_V=self.V2_V, ambient_C=self.ambient_C,
        )  # fmt: skip
        P1 = simulate(self.model, points)["P1_W"]
        extra = self.leftover.watts(np.stack([a.ravel(), b.ravel(), c.ravel()], axis=1))
        return np.asarray((c.ravel() / (P1 + extra)).reshape(a.shape))


def calibrate(refinery: Refinery, fit: Fit, sigma: Array) -> CalibratedPhysics:
    """The calibrated physics of one fit: its effects, the spreads under it, and the leftover.

    ``sigma`` (M,) is the noise of the readings.

    The analyzer's gain and offset inside their specification go to the leftover: the surrogate predicts what
    the bench shows. Voltages and ambient are those of the campaign, its medians.
    """
    observations = refinery.observations
    model = refinery.model(fit, refinery.spreads(fit))
    loads = observations.of("efficiency") & observations.loaded[observations.row]
    residual = observations.value - observations.simulate([model], refinery.near)[0]
    usable = loads & np.isfinite(residual)
    p = observations.points
    where = np.stack([p.D1, p.D2, p.power_W], axis=1)
    empty = Leftover(
        place=where[observations.row[usable]],
        weight=np.zeros(int(usable.sum())),
        length=length_scale(observations),
    )
    return CalibratedPhysics(
        model=model,
        leftover=empty.fitted(residual[usable], sigma[usable]),
        V1_V=float(np.median(np.asarray(p.V1_V))),
        V2_V=float(np.median(np.asarray(p.V2_V)[observations.loaded])),
        ambient_C=float(np.median(np.asarray(p.ambient_C))),
    )
