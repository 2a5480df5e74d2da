r"""Calibrated physics: the simulator at the most probable state of its parts, and what is left over, smoothed.

The named effects and every everyday spread are fitted to all channels at once; the simulator then runs with
them (:mod:`models.calibration`). What it still misses in efficiency is carried by a Gaussian process over (D1, D2,
power), in watts, which falls back to nothing away from the measured points.

How sure it is: what the measurements leave open of spreads and effects has the covariance

.. math:: \Sigma = I - D C'^{-1} D^T

with D their directions in the readings, one prior sigma each, and C' the readings' covariance under the fit. The model
is kept again at one standard deviation along each of Sigma's axes: the squares of what these variants say differently,
and the process's own variance, add up.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from models.diagnosis.covariance import AT_EDGES, kernel
from models.diagnosis.whitener import Whitener
from models.feasibility import LONGER
from models.law_doubts import law_covariance, law_doubts
from models.most_carried import NOTHING, Most, carries, most_sigma
from models.surrogate import EfficiencyModel, StagedModel
from sim.model import Model
from sim.modulation import infeasible_pulse
from sim.operating_points import Points
from sim.parameters import Converter
from sim.simulate import Result, simulate, simulate_many
from sim.size import size

Array = NDArray[np.float64]

PLAIN = 5  # columns of a place without its laws' doubts
_EDGES = 2e-3  # Assumption: of the half period, how well a calibrated model knows where an edge just switches softly
_STRETCH = 128  # places whose covariances fit a core's cache: all at once take four times as long


@dataclass(frozen=True, slots=True, kw_only=True)
class Leftover:
    """A correction of the input power in W from residuals at measured points: smooth, and an analyzer's errors.

    A Gaussian process with covariance ``(smooth^2 k(x, x') + rough^2 k(3 x, 3 x') + drift^2 k(t, t')) L L' +
    offset_W^2 + gain^2 P P'`` and that of the model's own laws (:mod:`models.law_doubts`), of which ``doubt`` is a
    share; ``place`` (N, 5 + COLUMNS) holds the measured D1, D2, power P, time t, the loss L that the model has there
    and its laws' doubts; without them, (N, 5), laws are exact. ``length`` (4,) is how far the first four are smooth
    over, ``noise_W`` (N,) the readings' noise, and ``weight`` (N,) the fit. What is rough changes over a third of the
    way.
    """

    place: Array
    weight: Array
    noise_W: Array
    length: Array
    smooth: float = 5e-3
    rough: float = 1.5e-3
    offset_W: float = 0.6
    gain: float = 4e-4
    drift: float = 0.0
    doubt: float = 1.0

    def of(self, converter: Converter) -> Self:
        """The same at a converter of another size: its offset in W is that of the prototype."""
        return replace(self, offset_W=size("power", converter) * self.offset_W)

    def covariance(self, a: Array, b: Array) -> Array:
        """Prior covariance of the correction at such places (N, ...) and (K, ...), in W^2."""
        a_, b_ = a[:, :4] / self.length, b[:, :4] / self.length
        alike = kernel(a_[:, :3], b_[:, :3]), kernel(AT_EDGES * a_[:, :3], AT_EDGES * b_[:, :3])
        of_loss = self.smooth**2 * alike[0] + self.rough**2 * alike[1]
        of_loss = of_loss + self.drift**2 * kernel(a_[:, 3:], b_[:, 3:])
        known = of_loss * a[:, 4:5] * b[:, 4] + self.offset_W**2 + self.gain**2 * a[:, 2:3] * b[:, 2]
        if self.place.shape[1] > PLAIN:
            known = known + law_covariance(a[:, PLAIN:], b[:, PLAIN:], alike, self.doubt)
        return np.asarray(known)

    def fitted(self, residual_W: Array, sigma_W: Array) -> Self:
        """The process given residuals and their noise, (N,)."""
        fitted = replace(self, noise_W=sigma_W)
        return replace(fitted, weight=fitted._readings().solve(residual_W))

    def left_open(self, place: Array) -> Array:
        """Covariance of the correction at places (K, ...) after the fit, (K, K), in W^2."""
        across = self.covariance(place, self.place)
        return np.asarray(self.covariance(place, place) - across @ self._readings().solve(across.T))

    def solver(self) -> Callable[[Array], Array]:
        """The inverse covariance of its readings, to be applied to (N,) or (N, k)."""
        return self._readings().solve

    def _readings(self) -> Whitener:
        return Whitener.of(self.covariance(self.place, self.place) + np.diag(self.noise_W**2))

    def watts(self, place: Array) -> Array:
        """Correction at places (K, ...)."""
        if not len(place):
            return np.empty(0)
        parts = [place[k : k + _STRETCH] for k in range(0, len(place), _STRETCH)]
        return np.concatenate([self.covariance(part, self.place) @ self.weight for part in parts])


@dataclass(frozen=True, kw_only=True)
class CalibratedPhysics:
    """An efficiency model: a calibrated simulator, its variants, and the leftover that it could not take up.

    It speaks of the bench as it was at ``time_s``, when the last row was measured. ``shown`` is by how much more power
    than the model carries some row ran, relative: below zero where the model carries them all.
    """

    model: Model
    variants: tuple[Model, ...]
    leftover: Leftover
    V1_V: float
    V2_V: float
    ambient_C: float
    time_s: float
    shown: float = NOTHING

    def predict(self, D1: ArrayLike, D2: ArrayLike, power_W: ArrayLike) -> Array:
        """Efficiency as a fraction, of the inputs' broadcast shape; NaN where the model cannot run."""
        a, b, c = np.broadcast_arrays(*(np.asarray(x, dtype=float) for x in (D1, D2, power_W)))
        place = np.stack([a.ravel(), b.ravel(), c.ravel()], axis=1)
        found = simulate(self.model, self._points(place))
        P1 = found["P1_W"] + self.leftover.watts(self._now(place, found))
        return np.asarray((c.ravel() / P1).reshape(a.shape))

    def left_open(self, place: Array) -> Array:
        """Covariance of the predicted efficiency at points (K, 3) of D1, D2 and power, (K, K).

        What a variant cannot run says nothing there.
        """
        points = self._points(place)
        found, *others = simulate_many([self.model, *self.variants], points)
        P1 = found["P1_W"]
        moved = np.nan_to_num(np.stack([other["P1_W"] for other in others]) - P1)
        per_watt = place[:, 2] / P1**2
        watts = moved.T @ moved + self.leftover.left_open(self._now(place, found))
        return np.asarray(per_watt[:, None] * watts * per_watt)

    def vouched(self) -> "Vouched":
        """The same model, without the points of which it is not sure that they can be made and carry their power."""
        return Vouched(of=self, spare=1 / (1 + self.most.least) - 1)

    @cached_property
    def most(self) -> Most:
        """What is known of the most that can be carried, over what this model carries."""
        return Most(sigma=most_sigma([self.model, *self.variants], self._widest), shown=self.shown)

    def worth_a_try(self, loads_W: Array) -> Array:
        """Of loads (L,) those that may be carried and are vouched for nowhere: the points of the widest pulses, (K, 3).

        Only who measures there knows.
        """
        most = self.most
        surely, perhaps = (
            carries(self.model, self._widest(loads_W / (1 + end))) for end in (most.least, most.greatest)
        )
        return _at_the_widest(loads_W[perhaps & ~surely])

    def _widest(self, power_W: Array) -> Points:
        """Powers (K,) with the widest pulses."""
        return self._points(_at_the_widest(power_W))

    def _now(self, place: Array, found: Result) -> Array:
        """Points (K, 3) with the time, the loss, and what the laws there may be wrong by."""
        time_s, loss_W = np.full(len(place), self.time_s), found["P1_W"] - place[:, 2]
        return np.column_stack([place, time_s, loss_W, law_doubts(found, self.model)])

    def _points(self, place: Array) -> Points:
        D1, D2, power_W = place.T
        return Points(
            D1=D1, D2=D2, power_W=power_W, V1_V=self.V1_V, V2_V=self.V2_V, ambient_C=self.ambient_C, time_s=self.time_s
        )  # fmt: skip


def _at_the_widest(power_W: Array) -> Array:
    """Powers (K,) with the widest pulses, (K, 3)."""
    return np.stack([np.ones_like(power_W), np.zeros_like(power_W), power_W], axis=1)


@dataclass(frozen=True, slots=True, kw_only=True)
class Vouched:
    """A calibrated model that predicts only where it could carry a ``spare`` share of the power more.

    Nor does it where a slightly longer dead time would swallow a pulse or a zero state.
    """

    of: CalibratedPhysics
    spare: float
    edges_known_to: float = _EDGES

    def predict(self, D1: ArrayLike, D2: ArrayLike, power_W: ArrayLike) -> Array:
        """As that of the calibrated model; NaN too where there is not that much to spare, of power or of time."""
        given = np.broadcast_arrays(*(np.asarray(x, dtype=float) for x in (D1, D2, power_W)))
        place = np.stack([x.ravel() for x in given], axis=1)
        converter = self.of.model.altered_converter()
        dead = LONGER * converter.dead_share
        sure = np.flatnonzero(infeasible_pulse(place[:, 0], place[:, 1], dead) == "")
        more = place[sure] * (1.0, 1.0, 1 + self.spare)
        sure = sure[carries(self.of.model, self.of._points(more))]
        efficiency = np.full(len(place), np.nan)
        if sure.size:
            efficiency[sure] = self.of.predict(*place[sure].T)
        return efficiency.reshape(given[0].shape)


def vouched(model: EfficiencyModel) -> EfficiencyModel:
    """A calibrated model within what it vouches for; any other as it is."""
    if isinstance(model, StagedModel) and len(model.stages) == 1:
        (model,) = model.stages
    return model.vouched() if isinstance(model, CalibratedPhysics) else model
