"""What a diagnosis is carried out in: noise that fits the data, the covariance, and all that is weighed there."""

from dataclasses import dataclass, replace

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from models.diagnosis.covariance import Whitener, covariance
from models.diagnosis.evidence import on_tangents, weighed_with_leftovers
from models.diagnosis.geometry import Geometry
from models.diagnosis.law import Laws
from models.diagnosis.leftover import leftovers
from models.diagnosis.noise import ChannelNoise, corrected, sigma_of
from models.diagnosis.observations import Observations
from models.diagnosis.refinery import Refinery
from models.diagnosis.signatures import Signatures
from sim.model import Model
from sim.simulate import Result

Array = NDArray[np.float64]

_LOOKS = 6  # a reading far off pulls the explanation towards it: it takes a few looks to see it alone
_SETTLED = 0.1  # relative change of a standard deviation
_LEADING = 4  # effects that are weighed beside leftovers for it
_PROBES = 24  # random signs that estimate a trace to three per cent
_ROUGH = 0.02  # of what the best explanation moves a reading by: no law is good to less, from one reading to the next
_SEED = 0  # of the probes


@dataclass(frozen=True, slots=True, kw_only=True)
class Setting:
    """Noise (M,) and covariance (M, M) of the readings, and the refinery that works with them.

    ``far_off`` (M,) is how many of its channel's sigmas a reading lies from what explains the others.
    """

    sigma: Array
    far_off: Array
    covariance: Array
    refinery: Refinery

    def leftover_everywhere(self) -> Array:
        """Covariance (M, M) of the largest leftover that is thought possible in all channels."""
        known = self.refinery.geometry.leftovers
        widest = max(known.configurations, key=lambda c: (c.columns.size, c.amplitude_W))
        columns = widest.amplitude_W * known.basis[widest.columns]
        return np.asarray(columns.T @ columns)


def set_up(
    observations: Observations, baseline: Model, known: Signatures, noise: list[ChannelNoise]
) -> Setting:
    """The setting with the noise of replicates, corrected by what the best tangent leaves."""
    rivals = leftovers(observations, known.per_watt)
    first = before = sigma = left = sigma_of(observations, noise)
    doubt = np.zeros_like(sigma)

    def setting() -> Setting:
        matrix = covariance(observations, np.hypot(sigma, doubt), known)
        geometry = Geometry.of(Whitener.of(matrix), known.spreads, rivals)
        refinery = Refinery(known=known, observations=observations, baseline=baseline, geometry=geometry)
        return Setting(sigma=sigma, far_off=np.zeros_like(sigma), covariance=matrix, refinery=refinery)

    for _ in range(_LOOKS):
        left, explained = _look(setting())
        before, sigma = sigma, corrected(observations, noise, first, left * sigma / first)
        changed, doubt = np.hypot(before, doubt), _ROUGH * np.abs(explained)
        if np.all(np.abs(np.log(np.hypot(sigma, doubt) / changed)) < _SETTLED):
            break
    found = setting()
    near = observations.reference(baseline)
    laws = Laws.of(known.effects, observations, _state(observations, near), found.refinery.geometry)
    usual = np.array([np.median(sigma[observations.channel == k]) for k in range(len(observations.channels))])
    return replace(
        found,
        far_off=np.abs(left) * before / usual[observations.channel],
        refinery=replace(found.refinery, near=near, laws=laws),
    )


def _state(observations: Observations, near: Result) -> dict[str, Array]:
    """What a threshold may be of, (N,) by row of the frame: measured where it was, else as the baseline has it."""
    used, state = np.unique(observations.row), {}
    for name in ("T_heatsink_C", "I1_A"):
        known = np.full(len(observations.frame), np.nan)
        known[used] = near[name]
        if name in observations.frame:
            known = observations.frame[name].astype(float).fillna(pd.Series(known)).to_numpy()
        state[name] = known
    return state


def _look(setting: Setting) -> tuple[Array, Array]:
    """What the best explanation on tangents leaves of every reading, in sigmas as if it had not been fitted, (M,).

    And that explanation itself, (M,): the cause with the leftover beside it.
    """
    refinery, geometry = setting.refinery, setting.refinery.geometry
    nothing, *tangents = on_tangents(refinery)
    leading = sorted(tangents, key=lambda fit: -fit.log_evidence)[:_LEADING]
    best = weighed_with_leftovers(refinery, [nothing, *leading])[0]
    own = best.fit.own(refinery.known)
    signs = np.random.default_rng(_SEED).choice([-1.0, 1.0], (_PROBES, setting.sigma.size))
    vectors = np.concatenate([(refinery.residual - best.fit.shift)[None], signs * setting.sigma])
    pulled = geometry.solve(vectors, own, best.leftover)
    explained = best.fit.shift
    if best.leftover is not None:
        explained = explained + geometry.leftovers.of(best.leftover, pulled[0])
    solved = setting.sigma * pulled
    free = np.mean(signs * solved[1:], axis=0)  # of each reading: the share that was not absorbed, roughly
    channel = refinery.observations.channel
    share = np.array([np.mean(free[channel == k]) for k in range(int(channel.max()) + 1)])[channel]
    return solved[0] / np.sqrt(np.maximum(share, 0.05)), explained
