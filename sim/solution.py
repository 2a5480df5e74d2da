"""Solves one converter at N points: every column's true value, or the reason why there is none.

Points with a start, from a near variant of the converter at the same points, go from there (:class:`Seed`); the others
from nothing. What points have settled from nothing is a start for further variants.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from sim.columns import columns, columns_of, impossible
from sim.fixed_point import Outcome, operate
from sim.modulation import centre_offset, hybrid_edges, infeasible_pulse, outside_modulation
from sim.neighbours import Response, approach, started, unknowns_of
from sim.operating_points import Points, carried
from sim.parameters import Converter
from sim.piecewise import power_share
from sim.stacking import pick
from sim.station import WarmStart, station_of

Array = NDArray[np.float64]

_WIDER = 2.0  # dead times: no pulse is made so much wider
_SPARE = 0.12  # of the power: a variant that can carry so much less is refused nowhere by its start


@dataclass(frozen=True, slots=True, kw_only=True)
class Seed:
    """Warm starts of the points ``rows`` (K,) of a set of ``size``; ``spare`` (K,) tells which have power to spare.

    ``ahead`` (n, V size) is where V variants start with their response, NaN where at the start itself.
    """

    size: int
    rows: NDArray[np.intp]
    start: WarmStart
    spare: NDArray[np.bool_]
    response: Response | None = None
    ahead: Array | None = None

    @classmethod
    def of(cls, size: int, rows: NDArray[np.intp], outcome: Outcome, *, learn: bool) -> "Seed":
        """Of what was solved at ``rows`` of ``size`` points."""
        solved, response = outcome.station.ready(outcome.state), None
        if learn and rows.size:
            response, look = Response.of(solved)
            solved = response.nearer(solved, look)
        return cls(
            size=size, rows=rows, start=solved.start(), spare=outcome.comfortable(_SPARE), response=response
        )

    def answering(self, converter: Converter, points: Points, unknowns: Array) -> "Seed":
        """The same starts with the response of a variant where its unknowns (n, size) were found; else as it was."""
        if self.response is None or not self.rows.size:
            return self
        station = station_of(pick(converter, self.rows), points.take(self.rows), self.start)
        response, _ = Response.of(started(station, unknowns.take(self.rows, axis=1)))
        return replace(self, response=response)

    def take(self, chosen: NDArray[np.intp]) -> "Seed":
        """The starts for some of the points."""
        place = self.find(chosen)
        rows = np.flatnonzero(place >= 0)
        own = place[rows]
        return Seed(
            size=chosen.size, rows=rows, start=self.start.take(own), spare=self.spare[own],
            response=None if self.response is None else self.response.take(own),
        )  # fmt: skip

    def find(self, rows: NDArray[np.intp]) -> NDArray[np.intp]:
        """Which start each row of a repeated set has, -1 for none."""
        place = np.full(self.size, -1)
        place[self.rows] = np.arange(self.rows.size)
        return np.asarray(place[rows % self.size])


@dataclass(frozen=True, slots=True, kw_only=True)
class _Table:
    """What is found at N points, columns (C, N) and states of variants (n, N), written to as it is found."""

    reason: NDArray[np.str_]
    columns: Array
    states: Array

    def put(self, rows: NDArray[np.intp], columns: Array, why: NDArray[np.str_]) -> None:
        """Columns (C, K) of some points; of those that cannot be, the reason why."""
        sound = np.flatnonzero(why == "")
        self.columns[:, rows[sound]] = columns[:, sound]
        for k in np.flatnonzero(why != "").tolist():
            self.reason[rows[k]] = why[k]

    def visit(
        self,
        converter: Converter,
        points: Points,
        rows: NDArray[np.intp],
        seed: Seed,
        place: NDArray[np.intp],
    ) -> NDArray[np.intp]:
        """Solve variants from their neighbours in ``seed``; which of the rows that did not settle."""
        if seed.response is None or not rows.size:
            return np.arange(rows.size)
        at, open_ = points.take(rows), np.ones(rows.size, dtype=bool)
        station = station_of(pick(converter, rows), at, seed.start.take(place))
        if seed.ahead is not None:
            station = started(station, seed.ahead.take(rows, axis=1))
        for found in approach(station, seed.response, place):
            self.put(rows[found.rows], found.columns, found.why)
            self.states[:, rows[found.rows]] = found.unknowns
            open_[found.rows] = False
        return np.flatnonzero(open_)


@dataclass(frozen=True, slots=True, kw_only=True)
class Solution:
    """Reason of infeasibility ("" where feasible), every column's true value, a start for variants, and the state."""

    reason: NDArray[np.str_]
    values: dict[str, Array]
    seed: Seed | None
    state: Array

    def rows(self, chosen: slice) -> "Solution":
        """A stretch of the points."""
        values = {name: value[chosen] for name, value in self.values.items()}
        return Solution(reason=self.reason[chosen], values=values, seed=None, state=self.state[:, chosen])


def lossless_peak_W(points: Points, converter: Converter, dead_times: float = 0.0) -> Array:
    """The most in W, (N,), without losses and at full inductance, both pulses so many dead times wider."""
    scale_W = (
        points.V1_V * points.V2_V * converter.transformer.turns_ratio
        * converter.half_period_s / converter.inductor.inductance_H
    )  # fmt: skip
    wider = dead_times * converter.dead_share
    D1, D2 = np.clip(points.D1 + wider, 0.0, 1.0), np.clip(points.D2 - wider, 0.0, 1.0)
    share, _ = power_share(hybrid_edges(0.5 - centre_offset(D1, D2), D1, D2))
    return np.asarray(scale_W * share)


def _ceiling_W(points: Points, converter: Converter) -> Array:
    """More than a point can carry: pulses widened by two dead times, and the least inductance of all currents."""
    return np.asarray(lossless_peak_W(points, converter, _WIDER) / converter.inductor.bands()[1][-1])


def solve(converter: Converter, points: Points, seed: Seed | None, *, learn: bool = False) -> Solution:
    """Solve every point that can be; points with a start in ``seed`` go from there.

    Without one, variants may start from what is left; with ``learn`` they know its response as well.
    """
    size = len(points)
    reason = refused(converter, points)
    standby = ~np.asarray(points.pwm, dtype=bool)
    names = columns_of(converter)
    table = _Table(
        reason=reason,
        columns=np.full((len(names), size), np.nan),
        states=np.full((unknowns_of(converter), size), np.nan),
    )
    run = np.flatnonzero((reason == "") & ~standby)
    place = np.full(run.size, -1) if seed is None else seed.find(run)
    left: Seed | None = None
    if seed is not None:
        near = np.flatnonzero(place >= 0)
        open_ = table.visit(converter, points, run[near], seed, place[near])
        keep = np.sort(np.concatenate([np.flatnonzero(place < 0), near[open_]]))
        run, place = run[keep], place[keep]
        place[place >= 0] = np.where(seed.spare[place[place >= 0]], place[place >= 0], -1)
    for rows, start in ((run[place < 0], None), (run[place >= 0], seed)):
        if not rows.size:
            continue
        at = points.take(rows)
        warm = None if start is None else start.start.take(place[place >= 0])
        outcome = operate(pick(converter, rows), at, warm)
        for k in np.flatnonzero(~outcome.reached).tolist():
            reason[rows[k]] = _why_not(float(outcome.most_W[k]))
        there = np.flatnonzero(outcome.reached)
        found = columns(converter, outcome.state, at.take(there))
        table.put(rows[there], found, impossible(outcome.state, found))
        if seed is None:
            left = Seed.of(size, rows[there], outcome, learn=learn)
    values = dict(zip(names, table.columns, strict=True))
    for name in ("P1_W", "I1_A", "P2_W", "loss_added_W"):
        values[name][standby] = 0.0
    values["T_heatsink_C"][standby] = np.asarray(points.ambient_C)[standby]
    return Solution(reason=reason, values=values, seed=left, state=table.states)


def refused(converter: Converter, points: Points) -> NDArray[np.str_]:
    """Why a point need not be tried, "" where it must; standby is never refused."""
    dead = np.broadcast_to(converter.dead_share, (len(points),))
    D1, D2 = np.asarray(points.D1), np.asarray(points.D2)
    reason, open_ = np.full(len(points), "", dtype="U96"), np.asarray(points.pwm, dtype=bool).copy()
    for told in (infeasible_pulse(D1, D2, dead), outside_modulation(converter.modulation, D1, D2)):
        rows = np.flatnonzero(open_ & (told != ""))
        reason[rows], open_[rows] = told[rows], False
    most = _ceiling_W(points, converter)
    for k in np.flatnonzero(open_ & (np.abs(points.power_W) >= most)):
        reason[k] = carried(float(most[k]), "less than")
    return reason


def _why_not(most_W: float) -> str:
    if np.isfinite(most_W):
        return f"{carried(most_W)} into the secondary bridge"
    return "no steady state found"
