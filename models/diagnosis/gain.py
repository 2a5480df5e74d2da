"""What an extension is worth: error on blocks that were not fitted, next to its rivals.

Blocks are bands of power, regions of D1 and D2, or parts of the campaign's time, so that nothing near a predicted point
was fitted. In each fold the cause, the best wrong cause and a leftover alone are fitted to the other blocks; errors are
of efficiency at the measured points.
"""

from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from models.diagnosis.held_out import HeldOut
from models.diagnosis.hypotheses import Fit
from models.diagnosis.observations import Observations
from models.diagnosis.whitener import Covariance, Whitener
from sim.side_by_side import shared_out, side_by_side

Array = NDArray[np.float64]

_PARTS = 4  # of power, and of time
_LEAST_DUTY = 0.02  # range of D1 or D2 below which it counts as one
_RESAMPLES = 400
_LEAST = 12  # readings below which blocks mean nothing


@dataclass(frozen=True, slots=True, kw_only=True)
class Readings:
    """What a gain is judged on: residuals (M,), their covariance, and directions (q, M) of a leftover everywhere.

    Of the readings those are judged that ``counts`` (M,) has: none that is an outlier to every explanation.
    """

    observations: Observations
    residual: Array
    counts: NDArray[np.bool_]
    covariance: Covariance
    leftover: Array


@dataclass(frozen=True, slots=True, kw_only=True)
class Gain:
    """Mean absolute errors of efficiency on held-out ``blocks``; ``ci95`` of before minus after, paired bootstrap.

    ``calibrated`` is that of the cause with all everyday spreads and the analyzer's errors fitted beside it, and
    ``calibrated_ci95`` of before minus that. ``intervals`` are 95 % of each error by itself, by its name here.
    """

    blocks: str
    before: float
    after: float
    ci95: tuple[float, float]
    wrong_cause: float | None
    leftover_only: float
    calibrated: float
    calibrated_ci95: tuple[float, float]
    intervals: dict[str, tuple[float, float]]

    def as_plain(self) -> dict[str, object]:
        """For the JSON answer."""
        return {
            "blocks": self.blocks,
            "before": self.before,
            "after": self.after,
            "ci95": list(self.ci95),
            "wrong_cause": self.wrong_cause,
            "leftover_only": self.leftover_only,
            "calibrated": self.calibrated,
            "calibrated_ci95": list(self.calibrated_ci95),
            "intervals": {name: list(bounds) for name, bounds in self.intervals.items()},
        }


@dataclass(frozen=True, slots=True, kw_only=True)
class Worth:
    """What gains are asked of: a cause on some readings, and the best wrong one."""

    readings: Readings
    cause: Fit
    rival: Fit | None
    seed: int

    def gains(self) -> tuple[Gain, ...]:
        """One for every kind of blocks, bands of power first."""
        return held_out_gains(self.readings, self.cause, self.rival, self.seed)


def _refitted(fit: Fit, residual: Array, held_out: HeldOut) -> Array:
    """The fit's shift with its values fitted again without what is held out (linear about the fit), at all readings."""
    if not fit.terms:
        return np.zeros_like(residual)
    slopes = np.stack([t.slope for t in fit.terms])
    prior = np.array([t.head.prior for t in fit.terms])
    pull = -np.array([t.distance for t in fit.terms]) / prior**2
    weighted = held_out.solve(slopes)
    precision = weighted @ slopes.T + np.diag(prior**-2)
    step = np.linalg.solve(precision, weighted @ (residual - fit.shift) + pull)
    return np.asarray(fit.shift + step @ slopes)


@dataclass(frozen=True, slots=True, kw_only=True)
class _Fitted:
    """Readings with their covariance factored, ``alone`` and with a leftover everywhere ``beside``."""

    readings: Readings
    alone: Whitener
    beside: Whitener

    @classmethod
    def of(cls, readings: Readings) -> Self:
        """Factored once for all blocks."""
        c = readings.covariance
        return cls(readings=readings, alone=Whitener.of(c), beside=Whitener.of(c.wider(readings.leftover)))


@dataclass(frozen=True, slots=True, kw_only=True)
class _Blocks:
    """One kind of blocks: in which of them every reading lies, (M,), and which readings are judged, (M,)."""

    name: str
    place: NDArray[np.intp]
    judged: NDArray[np.bool_]


def held_out_gains(readings: Readings, cause: Fit, rival: Fit | None, seed: int) -> tuple[Gain, ...]:
    """The gain of a cause over every kind of blocks there is, bands of power first; none with too few readings."""
    kinds = _kinds(readings)
    shares = [
        ([kinds[k] for k in share], readings, (cause, rival), seed)
        for share in shared_out(len(kinds), readings.observations.processes)
        if share.size
    ]
    found = {gain.blocks: gain for gains in side_by_side(_over_each, shares) for gain in gains}
    return tuple(found[blocks.name] for blocks in kinds)


def _kinds(readings: Readings) -> list[_Blocks]:
    observations = readings.observations
    p, row = observations.points, observations.row
    judged = observations.of("efficiency") & observations.loaded[row] & readings.counts
    if judged.sum() < _LEAST:
        return []

    def parts(values: Array, count: int) -> NDArray[np.intp]:
        edges = np.quantile(values[row][judged], np.linspace(0, 1, count + 1)[1:-1])
        return np.searchsorted(edges, values[row])

    found = {"power band": parts(np.asarray(p.power_W), _PARTS)}
    duties = [d for d in (np.asarray(p.D1), np.asarray(p.D2)) if np.ptp(d[row][judged]) > _LEAST_DUTY]
    if duties:
        found["region of D1 and D2"] = np.asarray(sum(parts(duty, 2) << k for k, duty in enumerate(duties)))
    time_s = np.asarray(p.time_s)
    if np.ptp(time_s[row][judged]) > 0:
        found["quarter of the time"] = parts(time_s, _PARTS)
    parted = {name: place for name, place in found.items() if np.ptp(place[judged]) > 0}
    return [_Blocks(name=name, place=place, judged=judged) for name, place in parted.items()]


def _over_each(share: tuple[list[_Blocks], Readings, tuple[Fit, Fit | None], int]) -> list[Gain]:
    """The gains over some kinds of blocks."""
    kinds, readings, rivals, seed = share
    fitted = _Fitted.of(readings)
    return [_over(blocks, fitted, rivals, seed) for blocks in kinds]


def _over(blocks: _Blocks, fitted: _Fitted, rivals: tuple[Fit, Fit | None], seed: int) -> Gain:
    """The gain over one kind of blocks."""
    observations, judged = fitted.readings.observations, blocks.judged
    error = _held_out_errors(blocks, fitted, *rivals) | {"before": fitted.readings.residual}
    # d(efficiency) = - efficiency * d(input power) / input power
    power = np.asarray(observations.points.power_W)[observations.row]
    scale = power[judged] / observations.value[judged] ** 2
    size = {name: np.abs(e[judged]) * scale for name, e in error.items()}
    rng = np.random.default_rng(seed)
    picks = rng.integers(0, judged.sum(), (_RESAMPLES, int(judged.sum())))
    drawn = {name: np.mean(e[picks], axis=1) for name, e in size.items()}
    return Gain(
        blocks=blocks.name,
        before=float(np.mean(size["before"])),
        after=float(np.mean(size["after"])),
        ci95=_inner(drawn["before"] - drawn["after"]),
        wrong_cause=float(np.mean(size["wrong_cause"])) if "wrong_cause" in size else None,
        leftover_only=float(np.mean(size["leftover_only"])),
        calibrated=float(np.mean(size["calibrated"])),
        calibrated_ci95=_inner(drawn["before"] - drawn["calibrated"]),
        intervals={name: _inner(means) for name, means in drawn.items()},
    )


def _inner(drawn: Array) -> tuple[float, float]:
    """What 95 % of the resampled values lie in."""
    low, high = np.quantile(drawn, [0.025, 0.975])
    return float(low), float(high)


def _held_out_errors(blocks: _Blocks, fitted: _Fitted, cause: Fit, rival: Fit | None) -> dict[str, Array]:
    """What each explanation, fitted to the other blocks, leaves of the judged readings, (M,) by name."""
    residual, leftover = fitted.readings.residual, fitted.readings.leftover
    names = ("after", "leftover_only", "calibrated", *(("wrong_cause",) if rival else ()))
    error = {name: np.full(residual.size, np.nan) for name in names}
    for block in np.unique(blocks.place[blocks.judged]):
        out = blocks.place == block
        judged, held_out = out & blocks.judged, HeldOut.of(fitted.alone, out)
        left = residual - _refitted(cause, residual, held_out)
        error["after"][judged] = left[judged]
        error["calibrated"][judged] = (left - held_out.predicted(left[None])[0])[judged]
        if rival is not None:
            error["wrong_cause"][judged] = (residual - _refitted(rival, residual, held_out))[judged]
        (pulled,) = HeldOut.of(fitted.beside, out).solve(residual[None])
        error["leftover_only"][judged] = (residual - leftover.T @ (leftover @ pulled))[judged]
    return error
