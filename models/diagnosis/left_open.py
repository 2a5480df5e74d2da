r"""What the measurements leave open of readings that were not taken yet.

With C the covariance of the readings taken (noise, everyday spreads J, the simulation's own accuracy A), and stars for
those that could be taken, nothing being wrong leaves

.. math:: V = J_*^T J_* + A_{**} - C_*^T C^{-1} C_*, \quad C_* = J^T J_* + A_*,

and an explanation whose effects have the slopes T, in units of their priors, leaves

.. math:: V + R^T (1 + T C^{-1} T^T)^{-1} R, \quad R = T_* - T C^{-1} C_*

(Rasmussen and Williams, 2006, section 2.7: a Gaussian process with explicit basis functions). A reading tells two
explanations apart only as far as it differs by more than this. What an explanation expects there is what its model
says, whose parts have their most probable spreads, and what the instruments' errors and the simulation's inaccuracy
were found to be beside it, :math:`(C_* - J_p^T J_{p*})^T C^{-1} r` with :math:`J_p` the spreads of the parts.

Assumption: what a link inductance off bends of efficiency alone is part of C and not of the readings ahead, which keep
power to spare: there it is less than their noise.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from models.diagnosis.covariance import length_scale, locations, smooth_covariance
from models.diagnosis.hypotheses import Fit
from models.diagnosis.observations import Channel, Observations, observe
from models.diagnosis.predictions import Repeated
from models.diagnosis.refinery import Refinery
from models.diagnosis.signatures import Signatures, signatures
from sim.operating_points import SEEN, Points
from sim.simulate import Result

Array = NDArray[np.float64]

_IDLE_W = 1e-9


@dataclass(frozen=True, slots=True, kw_only=True)
class Ahead:
    """K points that could be measured, each by some channels; reading (k, c) is number ``K_channels * k + c``.

    ``near`` is a simulation of these points to start from; ``rows`` (K,) are those of the frame that they repeat.
    """

    points: Points
    channels: tuple[Channel, ...]
    near: Result | None = None
    rows: NDArray[np.intp] | None = None

    def observed(self, refinery: Refinery) -> tuple[Observations, NDArray[np.intp]]:
        """Them as observations without values, and the number of each of their readings."""
        p, size = self.points, len(self.points)
        power = np.broadcast_to(p.power_W, size)
        kind = np.where(np.asarray(p.pwm), np.where(power > _IDLE_W, "load", "no_load"), "standby")
        columns = {"D1": p.D1, "D2": p.D2, "P2_W": power, "V1_V": p.V1_V, "V2_V": p.V2_V,
                   "T_ambient_C": p.ambient_C, "time_s": p.time_s}  # fmt: skip
        frame = pd.DataFrame({name: np.broadcast_to(value, size) for name, value in columns.items()})
        frame = frame.assign(kind=kind, **{c.column: 1.0 for c in self.channels})
        seen = observe(frame, refinery.baseline.converter, refinery.observations.processes)
        kept = {name: getattr(p, name) for name in (*SEEN, "held")}
        seen = replace(seen, points=replace(seen.points, **kept))
        place = np.array([self.channels.index(c) for c in seen.channels])
        return seen, len(self.channels) * seen.row + place[seen.channel]


@dataclass(frozen=True, slots=True, kw_only=True)
class LeftOpen:
    """Of each fit: what its model's readings ahead are off by (R, N), and their covariance (R, N, N).

    N is K times the number of channels. NaN where a part off by its spread, or an effect, could not run.
    """

    beside: Array
    covariance: Array


def left_open(refinery: Refinery, ahead: Ahead, fits: Sequence[Fit]) -> LeftOpen:
    """What the measurements say and leave open of the readings ahead."""
    seen, number = ahead.observed(refinery)
    effects, known = {name for fit in fits for name in fit.effects}, refinery.known
    used = np.unique(seen.row)
    near = None if ahead.near is None else ahead.near.take(used)
    repeated = None if ahead.rows is None else Repeated(known=known.told, rows=ahead.rows[used])
    there = signatures(seen, refinery.baseline, among=effects, near=near, repeated=repeated)
    there = there.doubted(seen, known.doubt, known.others_doubt)
    accuracy = _Accuracy(refinery.observations, seen)
    same = known.spreads[: len(there.spreads)]  # rows ahead are taken when all has settled
    across = same.T @ there.spreads + accuracy.across(known.inaccuracy, there.inaccuracy)
    solved = refinery.geometry.whitener.solve(np.nan_to_num(across))
    common = there.spreads.T @ there.spreads + accuracy.ahead(there.inaccuracy) - across.T @ solved
    parts = slice(len(known.modes))
    other = across - known.spreads[parts].T @ there.spreads[parts]
    size = len(ahead.points) * len(ahead.channels)
    beside, covariance = np.zeros((len(fits), size)), np.zeros((len(fits), size, size))
    for k, fit in enumerate(fits):
        beside[k, number] = refinery.solved(fit) @ other
        covariance[k][np.ix_(number, number)] = common + _of_effects(refinery, fit, there, solved)
    return LeftOpen(beside=beside, covariance=covariance)


def _of_effects(refinery: Refinery, fit: Fit, there: Signatures, solved: Array) -> Array | float:
    """What the values of a fit's effects leave open, (M, M)."""
    if not fit.terms:
        return 0.0
    slopes = {s.key: s.slope for s in there.effects}
    prior = np.array([[t.head.prior] for t in fit.terms])
    here = prior * np.stack([t.slope for t in fit.terms])
    nothing = np.zeros(solved.shape[1])
    beyond = prior * np.stack([slopes.get(t.signature.key, nothing) for t in fit.terms]) - here @ solved
    inner = np.eye(len(here)) + here @ refinery.geometry.whitener.solve(here.T)
    return np.asarray(beyond.T @ np.linalg.solve(inner, beyond))


@dataclass(frozen=True, slots=True)
class _Accuracy:
    """The simulation's own accuracy, smooth over the map of what was measured."""

    taken: Observations
    ahead_of: Observations

    def _place(self, of: Observations) -> Array:
        own = locations(of) * length_scale(of) / length_scale(self.taken)
        return np.asarray(own[of.row])

    def _covariance(self, one: Observations, sigma: Array, other: Observations, sigma_: Array) -> Array:
        names = [np.array([c.name for c in of.channels])[of.channel] for of in (one, other)]
        same = names[0][:, None] == names[1][None, :]
        return np.asarray(same * smooth_covariance((self._place(one), sigma), (self._place(other), sigma_)))

    def across(self, inaccuracy: Array, there: Array) -> Array:
        """Between what was measured and what could be."""
        return self._covariance(self.taken, inaccuracy, self.ahead_of, there)

    def ahead(self, there: Array) -> Array:
        """Among what could be measured."""
        return self._covariance(self.ahead_of, there, self.ahead_of, there)
