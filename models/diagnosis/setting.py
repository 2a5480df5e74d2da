"""What a diagnosis is carried out in: noise that fits the data, the covariance, and all that is weighed there."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from models.diagnosis.covariance import covariance
from models.diagnosis.evidence import on_tangents, weighed_with_leftovers
from models.diagnosis.geometry import Geometry
from models.diagnosis.leftover import Leftovers, leftovers
from models.diagnosis.noise import ChannelNoise, corrected, sigma_of
from models.diagnosis.observations import Observations
from models.diagnosis.refinery import Refinery
from models.diagnosis.signatures import Signatures
from models.diagnosis.whitener import Covariance, Whitener
from sim.model import Model

Array = NDArray[np.float64]

_LOOKS = 6  # a reading far off pulls the explanation towards it: it takes a few looks to see it alone
_SETTLED = 0.1  # relative change of a standard deviation
_LEADING = 4  # effects that are weighed beside leftovers for it
_PROBES = 24  # random signs that estimate a trace to three per cent
_SEED = 0  # of the probes


@dataclass(frozen=True, slots=True, kw_only=True)
class Setting:
    """Noise (M,) and covariance of the readings, and the refinery that works with them.

    ``far_off`` (M,) is how many of its channel's sigmas a reading lies from what explains the others.
    """

    sigma: Array
    far_off: Array
    covariance: Covariance
    refinery: Refinery

    def leftover_everywhere(self) -> Array:
        """Directions (q, M) of the largest leftover that is thought possible in all channels."""
        known = self.refinery.geometry.leftovers
        widest = max(known.configurations, key=lambda c: (c.columns.size, c.amplitude_W))
        return np.asarray(widest.amplitude_W * known.basis[widest.columns])


def set_up(
    observations: Observations, baseline: Model, known: Signatures, noise: list[ChannelNoise]
) -> Setting:
    """The setting with the noise of replicates, corrected by what the best tangent leaves."""
    rivals = leftovers(observations, known.per_watt)
    first = before = sigma = left = sigma_of(observations, noise)
    for _ in range(_LOOKS):
        left = _left_out(_setting(observations, baseline, known, sigma, rivals))
        before, sigma = sigma, corrected(observations, noise, first, left * sigma / first)
        if np.all(np.abs(np.log(sigma / before)) < _SETTLED):
            break
    near = observations.reference(baseline)
    setting = _setting(observations, baseline, known, sigma, rivals)
    usual = np.array([np.median(sigma[observations.channel == k]) for k in range(len(observations.channels))])
    return replace(
        setting,
        far_off=np.abs(left) * before / usual[observations.channel],
        refinery=replace(setting.refinery, near=near),
    )


def _setting(
    observations: Observations, baseline: Model, known: Signatures, sigma: Array, rivals: Leftovers
) -> Setting:
    parts = covariance(observations, sigma, known)
    geometry = Geometry.of(Whitener.of(parts), known.spreads, rivals)
    refinery = Refinery(known=known, observations=observations, baseline=baseline, geometry=geometry)
    return Setting(sigma=sigma, far_off=np.zeros_like(sigma), covariance=parts, refinery=refinery)


def _left_out(setting: Setting) -> Array:
    """What the best explanation on tangents leaves of every reading, in sigmas, as if it had not been fitted, (M,)."""
    refinery = setting.refinery
    nothing, *tangents = on_tangents(refinery)
    leading = sorted(tangents, key=lambda fit: -fit.log_evidence)[:_LEADING]
    best = weighed_with_leftovers(refinery, [nothing, *leading])[0]
    own = best.fit.own(refinery.known)
    signs = np.random.default_rng(_SEED).choice([-1.0, 1.0], (_PROBES, setting.sigma.size))
    vectors = np.concatenate([(refinery.residual - best.fit.shift)[None], signs * setting.sigma])
    solved = setting.sigma * refinery.geometry.solve(vectors, own, best.leftover)
    free = np.mean(signs * solved[1:], axis=0)  # of each reading: the share that was not absorbed, roughly
    channel = refinery.observations.channel
    share = np.array([np.mean(free[channel == k]) for k in range(int(channel.max()) + 1)])[channel]
    return np.asarray(solved[0] / np.sqrt(np.maximum(share, 0.05)))
