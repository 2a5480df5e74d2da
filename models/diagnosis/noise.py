"""Noise of each channel from replicates: rows at one set point, whatever else they are.

Replicates in time order are differenced before they are squared (von Neumann, 1941), so that a drift does not
pass for noise; nor does heat that lags behind (:mod:`models.diagnosis.heat_lag`). With few of them the estimate is
uncertain: what the best explanation leaves then corrects it, channel by channel, and readings that lie far off count
less. Rows without load have a noise of their own, which is a share of the instrument's range.
"""

from dataclasses import dataclass, replace
from typing import Self

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from models.diagnosis.observations import Observations
from models.diagnosis.rounding import rounding
from models.set_points import set_power, together

Array = NDArray[np.float64]

_PROPORTIONAL = {"efficiency", "P_link1_W", "P_link2_W", "I_L_rms_A"}
# Assumption: of eight updates' mean on an analyzer of 0.05 % class, relative to the power, or to the current
_WITHOUT_REPLICATES = {"efficiency": 1.5e-4, "P_link1_W": 5e-4, "P_link2_W": 5e-4, "I_L_rms_A": 5e-4}
_FAR_OFF = 3.0  # sigmas
_CLIPPED = 0.9950  # E[min(z^2, 9)] of a normal deviate z
# Assumption: of a channel's noise, as found from replicates or as assumed without; further off it is no noise
_SCALES = (0.4, 4.0)
_LEAST_A = 0.1  # of an rms current: below, noise is that of the range
HOLDS = 0.01  # of the rated power: as far as a load that was set once may wander
_LEAST = 0.1  # of the rated power: below, noise is that of the range
LEAST_DIFFERENCES = 4  # of replicates: fewer say nothing, and noise is assumed
_LEAST_SHARE, _TRIED = (
    1e-3,
    200,
)  # of their rms: least noise that is looked for beside what is slow, in so many steps


@dataclass(frozen=True, slots=True, kw_only=True)
class ChannelNoise:
    """Noise of one channel: relative to the reading's power where ``proportional``, else in its unit.

    ``idle`` is that of rows without load, in the channel's unit; 0 where none was read again. ``scatter`` is
    what the ``differences`` say without any margin; 0 where they are too few. ``excess_kurtosis`` and
    ``autocorrelation`` are those of a single reading's noise. ``log_likelihood`` is that of the differences.
    """

    channel: str
    sigma: float
    proportional: bool
    differences: int
    excess_kurtosis: float
    autocorrelation: float
    idle: float = 0.0
    scatter: float = 0.0
    log_likelihood: float = 0.0

    def as_plain(self) -> dict[str, object]:
        """For the JSON answer."""
        return {
            "sigma": self.sigma,
            "relative": self.proportional,
            "from_replicates": self.differences,
            "excess_kurtosis": self.excess_kurtosis,
            "autocorrelation": self.autocorrelation,
        }


@dataclass(frozen=True, slots=True, kw_only=True)
class Replicates:
    """Rows of the frame that share a set point, in time order, at least two each: those that carry power, and not."""

    carrying: list[NDArray[np.intp]]
    unloaded: list[NDArray[np.intp]]

    @classmethod
    def of(cls, observations: Observations) -> Self:
        """All that a campaign has."""
        groups = _groups(observations)
        return cls(
            carrying=[g for g in groups if observations.loaded[g].all()],
            unloaded=[g for g in groups if not observations.loaded[g].any()],
        )


def _groups(observations: Observations) -> list[NDArray[np.intp]]:
    """Rows of the frame that share a set point, in time order, at least two each."""
    frame = observations.frame
    keys = [frame["kind"].replace("reference", "load"), frame["D1"].round(6), frame["D2"].round(6)]
    keys.append(set_power(frame, _power_of(observations, keys)))
    order = frame["time_s"] if "time_s" in frame else frame.index.to_series()
    grouped = frame.assign(_order=order).groupby(keys, dropna=False)
    return [g.sort_values("_order").index.to_numpy() for _, g in grouped if len(g) > 1]


def _power_of(observations: Observations, keys: list[pd.Series]) -> pd.Series:
    """The power read of every row, one for those of the same ``keys`` that a load which was set once could have.

    A residual is taken at the power that was read: powers that are so near need not be the same.
    """
    return together(observations.frame["P2_W"].fillna(0.0), keys, HOLDS * observations.rated_W)


def _differences(
    observations: Observations, scaled: Array, name: str, groups: list[NDArray[np.intp]]
) -> list[Array]:
    """Differences (.., n) of successive replicates of ``scaled`` (.., M), one sigma of noise each; one a set point."""
    mask = observations.of(name)
    by_row = np.full((*scaled.shape[:-1], len(observations.frame)), np.nan)
    by_row[..., observations.row[mask]] = scaled[..., mask]
    steps = [np.diff(by_row[..., g]) / np.sqrt(2) for g in groups]
    return [step[..., np.all(np.isfinite(np.atleast_2d(step)), axis=0)] for step in steps]


def scale_of(observations: Observations, name: str) -> Array:
    """What the noise of a channel is proportional to, per reading (M,); 1 where it is not proportional.

    It falls no further below a tenth of the rated power.
    """
    if name not in _PROPORTIONAL:
        return np.ones(observations.value.size)
    if name == "I_L_rms_A":
        return np.asarray(np.maximum(np.abs(observations.value), _LEAST_A))
    least_W = _LEAST * observations.rated_W
    return np.asarray(np.maximum(np.asarray(observations.points.power_W)[observations.row], least_W))


def estimate_noise(
    observations: Observations, replicates: Replicates, residual: Array, slow: Array | None = None
) -> list[ChannelNoise]:
    """The noise of every channel present, from what the residuals (M,) of the baseline differ by between replicates.

    What ``slow`` directions (L, M), one sigma each, make of differences is no noise.
    """
    found = []
    both = residual[None] if slow is None else np.concatenate([residual[None], slow])
    for channel in observations.channels:
        scaled = both / scale_of(observations, channel.name)
        of_each = _differences(observations, scaled, channel.name, replicates.carrying)
        steps, *slower = np.concatenate(of_each, axis=1) if of_each else np.empty((len(both), 0))
        floor = 0.0 if channel.name in _PROPORTIONAL else channel.floor
        told = _Told.of(steps, np.array(slower))
        if told.differences >= LEAST_DIFFERENCES:
            sigma = max(told.scatter * _upper(told.differences), floor)
            power = max(float(np.mean(steps**2)), 1e-150)  # squared below: exact replicates have none
            kurtosis = 2.0 * (float(np.mean(steps**4)) / power**2 - 3.0)  # a difference has half of it
            memory = _autocorrelation([each[0] for each in of_each], power)
        else:
            sigma, kurtosis, memory = _WITHOUT_REPLICATES.get(channel.name, 2 * channel.floor), 0.0, 0.0
            told = replace(told, scatter=0.0)
        found.append(
            ChannelNoise(
                channel=channel.name,
                sigma=sigma,
                proportional=channel.name in _PROPORTIONAL,
                differences=told.differences,
                excess_kurtosis=kurtosis,
                autocorrelation=memory,
                idle=_idle(_differences(observations, residual, channel.name, replicates.unloaded)),
                scatter=told.scatter,
                log_likelihood=told.log_likelihood,
            )
        )
    return found


@dataclass(frozen=True, slots=True, kw_only=True)
class _Told:
    """The noise that differences tell, how many of them do, and their log likelihood."""

    scatter: float
    differences: int
    log_likelihood: float

    @classmethod
    def of(cls, steps: Array, slow: Array) -> Self:
        """The likeliest noise of steps (n,), beside ``slow`` directions (L, n) of one sigma each."""
        rms = float(np.sqrt(np.mean(steps**2))) if steps.size else 0.0
        if not np.any(slow) or not rms:
            likely = -0.5 * steps.size * (2.0 * np.log(rms) + 1.0) if rms else 0.0
            return cls(scatter=rms, differences=steps.size, log_likelihood=likely)
        spread, axes = np.linalg.eigh(slow.T @ slow)
        spread, squares = np.maximum(spread, 0.0), (axes.T @ steps) ** 2
        tried = rms**2 * np.geomspace(_LEAST_SHARE**2, 1.0, _TRIED)[:, None]
        likely = -0.5 * np.sum(np.log(spread + tried) + squares / (spread + tried), axis=1)
        best = int(np.argmax(likely))
        free = float(np.sum(tried[best] / (spread + tried[best])))
        return cls(
            scatter=float(np.sqrt(tried[best, 0])),
            differences=round(free),
            log_likelihood=float(likely[best]),
        )


def _upper(differences: int) -> float:
    """The upper side of a chi-squared estimate, over the estimate."""
    return float(1 + 0.7 / np.sqrt(differences))


def _idle(of_each: list[Array]) -> float:
    """Noise from any differences at all: whatever two readings of nothing differ by, neither is known better."""
    steps = np.concatenate(of_each or [np.empty(0)])
    return float(np.sqrt(np.mean(steps**2))) * _upper(steps.size) if steps.size else 0.0


def _autocorrelation(of_each: list[Array], power: float) -> float:
    """How far a reading's noise is like that before it at the set point, -1 to 1; 0 where too few were read thrice.

    Of noise that remembers its last value by r, successive differences correlate by -(1 - r)/2.
    """
    products = np.concatenate([d[1:] * d[:-1] for d in of_each] or [np.empty(0)])
    if products.size < LEAST_DIFFERENCES:
        return 0.0
    return float(np.clip(1 + 2 * np.mean(products) / power, -1.0, 1.0))


def sigma_of(observations: Observations, noise: list[ChannelNoise]) -> Array:
    """Standard deviation of every reading, (M,)."""
    sigma = np.zeros(observations.value.size)
    for entry, channel in zip(noise, observations.channels, strict=True):
        mask = observations.of(entry.channel)
        random = entry.sigma * scale_of(observations, entry.channel)[mask]
        idle = np.where(observations.loaded[observations.row[mask]], 0.0, entry.idle)
        least2 = np.maximum(random**2 + channel.floor**2, idle**2)
        sigma[mask] = np.sqrt(least2 + rounding(observations, entry.channel))
    return sigma


def usual_noise(channel: str) -> float | None:
    """What a channel's noise usually is, relative; None of one whose noise is not proportional."""
    return _WITHOUT_REPLICATES.get(channel)


def corrected(
    observations: Observations, noise: list[ChannelNoise], told: list[float], sigma: Array, left: Array
) -> Array:
    """Standard deviations (M,) after a look at what the best explanation leaves of each reading.

    ``left`` (M,) is in sigmas, corrected for what the explanation has absorbed. Each channel's noise is scaled to
    what is left there, the replicates counting with what they say, ``told`` of each channel by
    :func:`told_by_replicates`; single readings beyond three sigmas are widened.
    """
    scaled = sigma.copy()
    for entry, scatter2 in zip(noise, told, strict=True):
        mask = observations.of(entry.channel)
        z2 = left[mask] ** 2
        if not z2.size:
            continue
        typical = float(np.mean(np.minimum(z2, _FAR_OFF**2))) / _CLIPPED
        square = (entry.differences * scatter2 + z2.size * typical) / (entry.differences + z2.size)
        scale = float(np.clip(np.sqrt(square), *_SCALES))
        scaled[mask] *= scale * np.maximum(1.0, np.sqrt(z2) / (_FAR_OFF * scale))
    return scaled


def told_by_replicates(observations: Observations, noise: list[ChannelNoise], sigma: Array) -> list[float]:
    """Of each channel the mean square of its replicates' scatter over ``sigma`` (M,), their assumed noise; 1 at most.

    Floors, margins and drifts make ``sigma`` larger than the scatter; rounding is in both. 1 where replicates are few.
    """
    return [_told(observations, entry, sigma) for entry in noise]


def _told(observations: Observations, entry: ChannelNoise, sigma: Array) -> float:
    if entry.differences < LEAST_DIFFERENCES:
        return 1.0
    mask = observations.of(entry.channel)
    loaded = observations.loaded[observations.row[mask]]
    scatter = entry.scatter * scale_of(observations, entry.channel)[mask]
    variance = scatter**2 + rounding(observations, entry.channel)
    return min(float(np.mean((variance / sigma[mask] ** 2)[loaded])), 1.0)


def without_widening(observations: Observations, first: Array, sigma: Array) -> Array:
    """Standard deviations (M,) with no single reading widened, from those at ``first`` and those after it."""
    scale = sigma / first
    usual = np.array([np.median(scale[observations.channel == k]) for k in range(len(observations.channels))])
    return np.asarray(np.minimum(usual[observations.channel] * first, sigma))
