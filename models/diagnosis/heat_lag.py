r"""Heat that lags behind: windings and heatsinks take minutes to half an hour to settle, rows often less.

A part with the time constant :math:`\tau` whose rows would settle at :math:`T_k`, measured one after the other, is at

.. math:: \vartheta_k = T_k + (\vartheta_{k-1} - T_k)\, e^{-(t_k - t_{k-1}) / \tau}

and its readings are off by their slope over the part's temperature times :math:`\vartheta_k - T_k`. No bench tells its
time constants, so a few of them together are one everyday spread each, and so is a part that was cold, or hot, at the
start. What a temperature does to losses is known to a third, and in a core to no more than its sign
(:mod:`models.diagnosis.law_errors`). On a bench whose parts settle within their rows all this says nothing: replicates
tell how much of it there is.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from itertools import pairwise
from typing import Self

import numpy as np
from numpy.typing import NDArray

from models.diagnosis.law_errors import OF_WARMTH, WARMTH_K
from models.diagnosis.observations import Observations
from sim.simulate import Result

Array = NDArray[np.float64]

PARTS = {
    "heatsink_K_per_W": "T_heatsink_C",
    "inductor.thermal_K_per_W": "T_inductor_C",
    "transformer.thermal_K_per_W": "T_transformer_C",
}  # the channel of the temperature that a spread at this path sets
TIME_CONSTANTS_S = (150.0, 300.0, 600.0, 1200.0, 2400.0)
_SHARE = 0.5  # of a part's heat that lags so on a slow bench, one sigma
_LAW = 0.3  # of what a part's temperature does to losses, one sigma
_GAP = 1.5  # times what rows usually take: nobody knows what the bench did so long
_MOST_GAPS, _AFTER_A_GAP_S = 6, 600.0  # the longest ones, and the time constant that is taken behind them
_LEAST_K = 0.3  # of a spread: a row that it moves by less tells no slope


def lag_K(settled_C: Array, time_s: Array, time_constant_s: float) -> Array:
    """How far a part is above where each row would settle, (N,); the first row in time has settled.

    >>> lag_K(np.array([80.0, 40.0, 40.0]), np.array([0.0, 60.0, 120.0]), 60.0).round(1).tolist()
    [0.0, 14.7, 5.4]
    """
    above, order = np.zeros(settled_C.size), np.argsort(time_s, kind="stable")
    order = order[np.isfinite(settled_C[order])]
    for before, row in pairwise(order.tolist()):
        kept = np.exp(-(time_s[row] - time_s[before]) / time_constant_s)
        above[row] = (settled_C[before] + above[before] - settled_C[row]) * kept
    return above


@dataclass(frozen=True, slots=True, kw_only=True)
class History:
    """The ``rows`` (N,) of a table by which parts were heated, also those near the limit that nothing else goes by.

    ``time_s`` is when each was measured, ``settled_C`` where each part's temperature would settle, (N,) by its channel,
    and ``rise_K`` how far, on average, that is above the room.
    """

    rows: NDArray[np.intp]
    time_s: Array
    settled_C: Mapping[str, Array]
    rise_K: Mapping[str, float]

    @classmethod
    def of(cls, observations: Observations, near: Result) -> Self:
        """Of all rows with readings, by their simulation ``near``."""
        rows = np.unique(observations.row)
        points = observations.points.take(rows)
        settled_C = {column: np.asarray(near[column]) for column in PARTS.values()}
        rise_K = {k: float(np.nan_to_num(np.nanmean(t - points.ambient_C))) for k, t in settled_C.items()}
        return cls(rows=rows, time_s=np.asarray(points.time_s), settled_C=settled_C, rise_K=rise_K)

    def courses_K(self, column: str) -> dict[str, Array]:
        """How far a part may be above where rows would settle, (N,) by what for: rows before, the start, gaps in time.

        After a start or a gap a part is as far from where it would be as rows are from the room, one sigma.
        """
        if np.ptp(self.time_s) <= 0.0:
            return {}
        found, rise_K = dict[str, Array](), self.rise_K[column]
        for time_constant_s in TIME_CONSTANTS_S:
            name = f"{column} {time_constant_s:.0f} s behind"
            found[name] = lag_K(self.settled_C[column], self.time_s, time_constant_s)
            found[f"{name} from the start"] = rise_K * _since(
                self.time_s, np.min(self.time_s), time_constant_s
            )
        for begun_s in self._after_gaps_s():
            found[f"{column} after {begun_s:.0f} s"] = rise_K * _since(self.time_s, begun_s, _AFTER_A_GAP_S)
        return found

    def _after_gaps_s(self) -> list[float]:
        """When rows begin again after the longest gaps, (G,)."""
        times_s = np.sort(self.time_s)
        steps_s = np.diff(times_s)
        longest = np.argsort(-steps_s, kind="stable")[:_MOST_GAPS]
        usual_s = float(np.median(steps_s))
        return [float(times_s[k + 1]) for k in longest.tolist() if steps_s[k] > _GAP * usual_s]


def _since(time_s: Array, begun_s: float, time_constant_s: float) -> Array:
    """What is left at each time (N,) of what was there at one; nothing before it."""
    return np.where(time_s >= begun_s, np.exp(-np.maximum(time_s - begun_s, 0.0) / time_constant_s), 0.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class Heated:
    """A part whose temperature a spread moves: its channel, by how many K at each reading (M,), and the reading (M,).

    ``core`` (M,) is what readings move by where its core loses twice what it is simulated to; 0 where it has none.
    """

    column: str
    step_K: Array
    moved: Array
    core: Array | float = 0.0

    def per_K(self, observations: Observations) -> Array:
        """What each reading (M,) moves by for one kelvin of the part."""
        step_K = np.nan_to_num(self.step_K)
        slope = np.nan_to_num(self.moved) * step_K / (step_K**2 + _LEAST_K**2)
        return np.where(observations.of(self.column), 1.0, slope)


def heat_lags(observations: Observations, history: History, parts: Iterable[Heated]) -> dict[str, Array]:
    """One-sigma directions (M,) by name: of each part by all of its time constants, and of what its heat does."""
    place = np.searchsorted(history.rows, observations.row)
    sensed = np.any([observations.of(column) for column in PARTS.values()], axis=0)
    found = dict[str, Array]()
    for part in parts:
        per_K = _SHARE * part.per_K(observations)
        losses, core = _LAW * np.where(sensed, 0.0, per_K), OF_WARMTH / WARMTH_K * np.nan_to_num(part.core)
        for name, above_K in history.courses_K(part.column).items():
            found[name] = per_K * above_K[place]
            if name.endswith("behind"):
                found |= {f"{name}, losses": losses * above_K[place], f"{name}, core": core * above_K[place]}
    return {name: direction for name, direction in found.items() if np.any(direction)}


def own_lags(slope: Array, observations: Observations) -> Array:
    """By how much the heat that a cause of this slope (M,) adds itself lags behind in temperatures, (r, M).

    By the rows with readings, one sigma each: of every temperature and every time constant.
    """
    used, row = np.unique(observations.row, return_inverse=True)
    time_s, found = np.asarray(observations.points.time_s)[used], [np.empty((0, slope.size))]
    for column in PARTS.values():
        own = observations.of(column)
        if not np.any(slope[own]):
            continue
        more_K = np.full(used.size, np.nan)
        more_K[row[own]] = slope[own]
        for time_constant_s in TIME_CONSTANTS_S:
            found.append(np.where(own, _SHARE * lag_K(more_K, time_s, time_constant_s)[row], 0.0)[None])
    return np.concatenate(found)
