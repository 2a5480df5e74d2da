"""D1 and D2 over load as a table for a controller that draws straight lines between its rows.

The best modulation of each load by itself makes a bad table: D1 and D2 may jump from one hill of efficiency
to another, and what lies on the straight line between two rows may carry no power, lose its soft switching,
or be far less efficient than either. So rows are chosen together. The candidates of a load are the optima of
the loads around it; of all tables that can be put together from them, dynamic programming takes the one with
the largest

    sum over rows of predicted efficiency - STILL · movement of D1 and D2 - UNSOUND · unsound lines

A line is sound when, at points between its rows, the simulator carries the power, every edge that is soft at
both ends stays soft, and the model predicts no dip below the worse end by more than ``DIP``. Nor may it lead from a
modulation without a zero state to one with: on the way it asks for one as short as the dead time, and a bridge whose
dead time is a little longer than its datasheet's trips there. What carries a
power carries every smaller one, so keeping the modulation of the next larger load is always among the choices.

A table is a function of power alone, with powers that rise: the controller has no state, hence no hysteresis.
"""

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from models.boosting import Floats
from models.feasibility import LONGER, Bools, edge_gap_of
from models.optimise import OptimumTable
from models.surrogate import EfficiencyModel
from sim.model import Model
from sim.modulation import EDGES
from sim.operating_points import Points
from sim.simulate import simulate

WINDOW = 4  # loads on either side whose optima are candidates
TRIED = np.array([0.25, 0.5, 0.75])  # of a line, while rows are chosen
CHECKED = np.linspace(0.1, 0.9, 9)  # of a line, once they are
STILL = 5e-4  # efficiency that one half period of D1 or D2 must gain to be worth moving for
DIP = 1e-3  # of efficiency below the worse end of a line
UNSOUND = 1.0  # more than all that a better row can gain


@dataclass(frozen=True, slots=True, kw_only=True)
class Line:
    """What was found between two rows: whether every point carries its power, whether a zero state comes or goes,
    edges that stop being soft, and how far predicted efficiency falls below the worse end (a fraction, 0 where it
    does not)."""

    low_W: float
    high_W: float
    carries: bool
    zero_state_appears: bool
    lost_edges: tuple[str, ...]
    dip: float

    @property
    def sound(self) -> bool:
        """Nothing between the rows is worse than a controller may meet."""
        return self.carries and not self.zero_state_appears and not self.lost_edges and self.dip <= DIP

    def __str__(self) -> str:
        wrong = [] if self.carries else ["power is not carried"]
        wrong += ["a zero state as short as the dead time"] if self.zero_state_appears else []
        wrong += [f"{edge} loses zero-voltage switching" for edge in self.lost_edges]
        if self.dip > DIP:
            wrong.append(f"predicted efficiency dips by {100 * self.dip:.2f} points")
        return f"{self.low_W:g} to {self.high_W:g} W: {', '.join(wrong) or 'sound'}"


@dataclass(frozen=True, slots=True, kw_only=True)
class Lut:
    """Rows of rising ``power_W``, all (L,); D1, D2 in half periods, efficiencies as fractions.

    ``half_width`` is half the 95 % interval of ``predicted``, NaN where the model's hold-out was too small to
    tell. ``price`` is what the load's own optimum is predicted to be better. ``soft_edges`` counts the edges
    that switch at zero voltage. ``left_out_W`` are loads that nothing carries.
    """

    power_W: Floats
    D1: Floats
    D2: Floats
    predicted: Floats
    price: Floats
    soft_edges: Floats
    half_width: float = float("nan")
    lines: tuple[Line, ...] = ()
    left_out_W: tuple[float, ...] = ()

    @property
    def unsound(self) -> tuple[Line, ...]:
        """The lines that are not as good as their ends."""
        return tuple(line for line in self.lines if not line.sound)

    def frame(self) -> pd.DataFrame:
        """One row per load, columns as in the table's files."""
        return pd.DataFrame(
            {
                "P_W": self.power_W,
                "D1": self.D1,
                "D2": self.D2,
                "predicted": self.predicted,
                "predicted_low": self.predicted - self.half_width,
                "predicted_high": np.minimum(self.predicted + self.half_width, 1.0),
                "price": self.price,
                "soft_edges": self.soft_edges.astype(int),
            }
        )


def makeable(D1: Floats, D2: Floats, edge_gap: float) -> tuple[Floats, Floats]:
    """What a controller makes of D1, D2 on a line: nothing shorter than the dead time, as its protocol says.

    ``edge_gap`` is the dead time in half periods. A zero state or pulse that comes out shorter is made absent or
    as long as the dead time, whichever is nearer; a pulse is never absent.

    >>> D1, D2 = makeable(np.array([0.5, 0.99, 0.995]), np.array([0.1, 0.012, 0.005]), 0.016)
    >>> D1.tolist(), D2.tolist()
    ([0.5, 0.984, 1.0], [0.1, 0.016, 0.0])
    """

    def zero_state(width: Floats) -> Floats:
        short = np.where(2 * width >= edge_gap, edge_gap, 0.0)
        return np.where(width >= edge_gap, width, short)

    kept_D1 = 1.0 - zero_state(1.0 - np.maximum(D1, edge_gap))
    return kept_D1, zero_state(np.minimum(D2, 1.0 - edge_gap))


def without_zero_state(D1: Floats, D2: Floats) -> tuple[Bools, Bools]:
    """Whether the primary and the secondary have no zero state at all."""
    return D1 == 1.0, D2 == 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Surroundings:
    """What a table is checked against: the model that predicts and the simulator that says what can run."""

    model: EfficiencyModel
    simulator: Model

    def ask(self, D1: Floats, D2: Floats, power_W: Floats) -> tuple[Floats, Bools]:
        """Predicted efficiency (N,), NaN where the power is not carried, and soft edges (N, edges).

        A prediction of 1 and above is no efficiency: the model is asked where it knows nothing. A zero state that a
        slightly longer dead time would swallow does not count as carrying the power.
        """
        gap = edge_gap_of(self.simulator)
        D1, D2 = makeable(D1, D2, gap)
        tight = [(width > 0) & (width < LONGER * gap) for width in (1.0 - D1, D2)]
        predicted, soft = self._ask(D1, D2, power_W)
        return np.where(tight[0] | tight[1], np.nan, predicted), soft

    def _ask(self, D1: Floats, D2: Floats, power_W: Floats) -> tuple[Floats, Bools]:
        asked = np.stack([D1, D2, power_W], axis=1)
        (D1, D2, power_W), again = _each_once(asked)
        run = simulate(self.simulator, Points(D1=D1, D2=D2, power_W=power_W))
        predicted = np.asarray(self.model.predict(D1, D2, power_W), dtype=np.float64)
        soft = np.stack([run[f"zvs_{edge}"] for edge in EDGES], axis=1) > 0.5
        return np.where(run.feasible & (predicted < 1.0), predicted, np.nan)[again], soft[again]


def _each_once(points: Floats) -> tuple[Floats, NDArray[np.intp]]:
    """Distinct points as columns (3, M), and which of them each point (N, 3) is: optima share their modulation."""
    distinct, again = np.unique(points, axis=0, return_inverse=True)
    return distinct.T, again.ravel()


def make_lut(optimum: OptimumTable, around: Surroundings, *, half_width: float = float("nan")) -> Lut:
    """The table of the loads that can be carried.

    Raises ValueError when fewer than two loads can be: there is nothing to draw a line between.
    """
    order = np.argsort(optimum.power_W)
    candidates = _carried(optimum, order[np.isfinite(optimum.D1[order])], around)
    chosen = candidates.best_path(around)
    power_W, rows = candidates.power_W, np.arange(candidates.power_W.size)
    predicted = candidates.value[rows, chosen]
    table = Lut(
        power_W=power_W,
        D1=candidates.D1[rows, chosen],
        D2=candidates.D2[rows, chosen],
        predicted=predicted,
        price=np.max(candidates.value, axis=1) - predicted,
        soft_edges=candidates.soft[rows, chosen].sum(axis=1).astype(float),
        half_width=half_width,
        left_out_W=tuple(np.setdiff1d(optimum.power_W, power_W).tolist()),
    )
    return replace(table, lines=check_lines(table.frame(), around))


def _carried(optimum: OptimumTable, loads: NDArray[np.intp], around: Surroundings) -> "_Candidates":
    """The candidates of such of the loads, in their order, as have any that carries them."""
    while len(loads) >= 2:
        candidates = _Candidates.around(optimum.power_W[loads], optimum.D1[loads], optimum.D2[loads], around)
        carried = np.any(np.isfinite(candidates.value), axis=1)
        if np.all(carried):
            return candidates
        loads = loads[carried]
    raise ValueError(f"{len(loads)} of {len(optimum.power_W)} loads can be carried; a table needs two")


def check_lines(rows: pd.DataFrame, around: Surroundings) -> tuple[Line, ...]:
    """What lies between the rows (columns P_W, D1, D2) of any table, its own or one read from a file."""
    ends, soft = around.ask(*(rows[name].to_numpy(dtype=np.float64) for name in ("D1", "D2", "P_W")))
    without = without_zero_state(rows["D1"].to_numpy(dtype=np.float64), rows["D2"].to_numpy(dtype=np.float64))
    D1, D2, power_W = (_between(rows[name].to_numpy(dtype=np.float64)) for name in ("D1", "D2", "P_W"))
    inner, inner_soft = around.ask(D1.ravel(), D2.ravel(), power_W.ravel())
    inner, inner_soft = inner.reshape(D1.shape), inner_soft.reshape(*D1.shape, -1)
    lines = []
    for k, (low_W, high_W) in enumerate(pairwise(rows["P_W"].tolist())):
        worse_end = np.nanmin(ends[k : k + 2]) if np.isfinite(ends[k : k + 2]).any() else np.nan
        lost = soft[k] & soft[k + 1] & ~inner_soft[k].all(axis=0)
        dip = max(0.0, float(worse_end - np.nanmin(inner[k]))) if np.isfinite(inner[k]).any() else np.inf
        appears = any(edge[k] != edge[k + 1] for edge in without)
        lines.append(
            Line(
                low_W=low_W,
                high_W=high_W,
                carries=bool(np.isfinite(inner[k]).all() and np.isfinite(ends[k : k + 2]).all()),
                zero_state_appears=bool(appears),
                lost_edges=tuple(edge for edge, gone in zip(EDGES, lost, strict=True) if gone),
                dip=dip,
            )
        )
    return tuple(lines)


def _between(ends: Floats) -> Floats:
    """Values (L - 1, S) on the straight lines between rows (L,)."""
    return np.asarray(ends[:-1, None] + (ends[1:] - ends[:-1])[:, None] * CHECKED)


@dataclass(frozen=True, slots=True, kw_only=True)
class _Candidates:
    """Modulations to choose from: D1, D2 and value (L, C), -inf where not possible, and soft edges (L, C, E)."""

    power_W: Floats
    D1: Floats
    D2: Floats
    value: Floats
    soft: Bools

    @classmethod
    def around(cls, power_W: Floats, D1: Floats, D2: Floats, surroundings: Surroundings) -> "_Candidates":
        """The optima of each load's neighbours, taken to that load."""
        loads = len(power_W)
        place = np.arange(loads)[:, None] + np.arange(-WINDOW, WINDOW + 1)
        inside = (place >= 0) & (place < loads)
        place = np.clip(place, 0, loads - 1)
        power = np.repeat(power_W, place.shape[1])
        value, soft = surroundings.ask(D1[place].ravel(), D2[place].ravel(), power)
        value = value.reshape(place.shape)
        return cls(
            power_W=power_W,
            D1=D1[place],
            D2=D2[place],
            value=np.where(inside & np.isfinite(value), value, -np.inf),
            soft=soft.reshape(*place.shape, -1),
        )

    def best_path(self, around: Surroundings) -> NDArray[np.intp]:
        """Which candidate of each load, (L,): the best sum that the lines allow (Viterbi)."""
        total = self.value[0]
        came_from = np.zeros(self.value.shape, dtype=np.intp)
        penalty = UNSOUND * ~self._sound(around) + STILL * self._movement()
        for k in range(1, len(self.power_W)):
            reached = total[:, None] - penalty[k - 1]
            came_from[k] = np.argmax(reached, axis=0)
            total = reached.max(axis=0) + self.value[k]
        chosen = np.empty(len(self.power_W), dtype=np.intp)
        chosen[-1] = np.argmax(total)
        for k in range(len(chosen) - 1, 0, -1):
            chosen[k - 1] = came_from[k, chosen[k]]
        return chosen

    def _movement(self) -> Floats:
        """|ΔD1| + |ΔD2| from each candidate to each of the next load, (L - 1, C, C)."""
        moved = [np.abs(x[:-1, :, None] - x[1:, None, :]) for x in (self.D1, self.D2)]
        return np.asarray(moved[0] + moved[1])

    def _sound(self, around: Surroundings) -> Bools:
        """Whether the line from each candidate to each of the next load is sound, (L - 1, C, C)."""
        possible = np.isfinite(self.value)
        k, a, b = np.nonzero(possible[:-1, :, None] & possible[1:, None, :])

        def on_line(x: Floats) -> Floats:
            return np.asarray(x[k, a, None] + (x[k + 1, b] - x[k, a])[:, None] * TRIED)

        power_W = self.power_W[k, None] + np.diff(self.power_W)[k, None] * TRIED
        value, soft = around.ask(on_line(self.D1).ravel(), on_line(self.D2).ravel(), power_W.ravel())
        worst = value.reshape(power_W.shape).min(axis=1)  # NaN where a point is not carried
        kept = soft.reshape(*power_W.shape, -1).all(axis=1) | ~(self.soft[k, a] & self.soft[k + 1, b])
        above = worst >= np.minimum(self.value[k, a], self.value[k + 1, b]) - DIP
        sound = np.zeros((len(self.power_W) - 1, *2 * (possible.shape[1],)), dtype=bool)
        stays = np.ones(len(k), dtype=bool)
        for edge in without_zero_state(self.D1, self.D2):
            stays &= edge[k, a] == edge[k + 1, b]
        sound[k, a, b] = above & stays & kept.all(axis=1)
        return sound
