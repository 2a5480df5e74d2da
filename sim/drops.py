r"""What the devices' drops take from the loop of the ac link: threshold and resistance of whatever conducts.

The primary's drop follows the link current i and its sign. The secondary's follows the link current less the
magnetizing one, i - i_m: where it has a threshold, that acts by the sign of i - i_m, and a current that the threshold
holds back runs with i_m, so that none is left for the secondary.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from sim.decay import Decay
from sim.waveform import Circuit

Array = NDArray[np.float64]
Index = NDArray[np.intp]
Law = tuple[Array, Array]  # threshold in V and resistance in Ohm
DropsOf = Callable[[Circuit, Index, float], Law]  # of some of the points, for a sign of their current

_INSTANT_S = 1e-30
_TINY_V = 1e-30
_NONE = 1e-13  # of what a link voltage of the primary moves the current by in Th: no current of the secondary


@dataclass(slots=True, kw_only=True)
class Moment:
    """Known voltages, and the magnetizing current with its slope, all (N,)."""

    vp_V: Array
    nvs_V: Array
    magnetizing_A: Array
    magnetizing_A_per_s: Array

    def at(self, chosen: Index, later_s: Array) -> "Moment":
        """Some of the points, after a time."""
        slope = self.magnetizing_A_per_s[chosen]
        return Moment(
            vp_V=self.vp_V[chosen], nvs_V=self.nvs_V[chosen],
            magnetizing_A=self.magnetizing_A[chosen] + slope * later_s, magnetizing_A_per_s=slope,
        )  # fmt: skip


@dataclass(slots=True, kw_only=True)
class Stretch:
    """How long is left of a stretch (N,); at its start also its whole length and the time since it began."""

    left_s: Array
    whole: tuple[Array, Array] | None = None

    def turning(
        self, circuit: Circuit, current_A: Array, driven_V: Array, law: "DropsOf"
    ) -> "_Turning | None":
        """Points whose current may change its sign in a stretch that begins now; None where all stretches are long."""
        if self.whole is None or not (self.whole[0] < circuit.dead_time_s).any():
            return None
        return _Turning.of(circuit, current_A, driven_V, law, self.whole)


def primary_law(circuit: Circuit, vp_V: Array, sign: Array) -> Law:
    """The primary's drop, and all in series that depends on no state, for a sign of i."""
    along, live = vp_V * sign, np.abs(vp_V) > 0.5 * circuit.V1_V
    V0, R = np.where(live, np.where(along > 0, circuit.forward, circuit.reverse), circuit.zero)
    return V0, R


def secondary_law(circuit: Circuit, nvs_V: Array, sign: Array) -> Law:
    """The secondary's drop for a sign of i - i_m; of a circuit whose secondary's depends on its state."""
    assert circuit.secondary is not None
    along, live = -nvs_V * sign, np.abs(nvs_V) > 0.5 * circuit.nV2_V
    forward, reverse, zero = circuit.secondary
    V0, R = np.where(live, np.where(along > 0, forward, reverse), zero)
    return V0, R


@dataclass(slots=True, kw_only=True)
class _Turning:
    r"""Points whose current may change its sign in a stretch shorter than a dead time, all (K,).

    Both ends of such a stretch are instants that stand for swings under way. Its voltage is a mean, and may be none at
    all, where that of the link runs through zero: the current does not rest there, as it would with drops that take
    the sign of i all at once. The mean sign is that of dry friction (:func:`sim.commutation.mean_sign`) with the
    current spread by what half a link voltage of the primary makes of it, less the nearer the stretch is to a dead
    time. Drops are those of both signs by their shares; V0 has the sign.

    Assumption: that spread. It mends the gap in power wherever it is above the threshold.
    """

    rows: Index
    sign: Array
    V0: Array
    R: Array

    @classmethod
    def of(
        cls,
        circuit: Circuit,
        current_A: Array,
        driven_V: Array,
        law: DropsOf,
        whole: tuple[Array, Array],
    ) -> Self:
        """From a current and the voltage that drives it, with the length of its stretch and the time since it began.

        ``law`` gives the drops at some of the points for a sign.
        """
        length_s, past_s = whole
        far = length_s / circuit.inductance_H * (np.abs(driven_V) + circuit.V1_V)
        (rows,) = np.nonzero((length_s < circuit.dead_time_s) & (np.abs(current_A) < far))
        part = circuit.take(rows)
        (up_V, up_R), (down_V, down_R) = (law(part, rows, sign) for sign in (1.0, -1.0))
        per_L, past = (
            length_s[rows] / part.inductance_H,
            past_s[rows] / np.maximum(length_s[rows], _INSTANT_S),
        )
        change, held = per_L * driven_V[rows], 0.5 * per_L * (up_V + down_V)
        spread = 0.5 * per_L * part.V1_V * (1.0 - length_s[rows] / part.dead_time_s)
        moved = 2.0 * (current_A[rows] - past * change) + change + np.clip(change, -held, held)
        total = np.maximum(np.abs(change), held) + held + spread - 2.0 * past * held
        turns = np.abs(moved) < total
        sign = moved / np.where(turns, total, np.inf)
        up, down = 0.5 + 0.5 * sign, 0.5 - 0.5 * sign
        all_ = (sign, up * up_V - down * down_V, up * up_R + down * down_R)
        mean, V0, R = (values[turns] for values in all_)
        return cls(rows=rows[turns], sign=mean, V0=V0, R=R)

    def put(self, drops: Law, sign: Array, rests: NDArray[np.bool_], lasts: NDArray[np.bool_]) -> None:
        """Write what these points drop, by what sign, that they do not rest and that it lasts, to arrays of all."""
        V0, R = drops
        V0[self.rows], R[self.rows], sign[self.rows] = self.V0, self.R, self.sign
        rests[self.rows], lasts[self.rows] = False, True


@dataclass(frozen=True, slots=True, kw_only=True)
class _Behind:
    """The secondary's drop at the start of a piece, (N,): the sign of i - i_m, threshold with that sign, resistance.

    ``rests`` tells where there is no i - i_m, ``lasts`` where the sign is a mean.
    """

    sign: Array
    V0: Array
    R: Array
    rests: NDArray[np.bool_]
    lasts: NDArray[np.bool_]

    @classmethod
    def of(cls, circuit: Circuit, moment: Moment, current_A: Array, stretch: Stretch) -> Self:
        """Where nothing rests."""
        x = current_A - moment.magnetizing_A
        unit_A = circuit.V1_V * circuit.half_period_s / circuit.inductance_H
        rests = np.abs(x) <= _NONE * unit_A
        sign = np.where(rests, 0.0, np.sign(x))
        V0, R = secondary_law(circuit, moment.nvs_V, sign)
        V0, lasts = sign * V0, np.zeros(x.shape, dtype=bool)

        def law(part: Circuit, rows: Index, way: float) -> Law:
            return secondary_law(part, moment.nvs_V[rows], np.full(rows.size, way))

        driven_V = moment.vp_V - moment.nvs_V - circuit.inductance_H * moment.magnetizing_A_per_s
        if (turning := stretch.turning(circuit, x, driven_V, law)) is not None:
            turning.put((V0, R), sign, rests, lasts)
        return cls(sign=sign, V0=V0, R=R, rests=rests, lasts=lasts)

    def hold(self, circuit: Circuit, moment: Moment, before: tuple[Law, Array], stretch: Stretch) -> None:
        """What rests: the mean sign at which i ends with i_m, at most 1; ``before`` is the primary's law, and i.

        With x = i - i_m: L dx/dt = v - V0 - R i_m - u - L di_m/dt less all resistances times x, and the secondary's
        drop u is such that x = 0 again at the end.
        """
        rows = np.flatnonzero(self.rests)
        if not rows.size:
            return
        part, (law, current_A) = circuit.take(rows), before
        V0, R = law[0][rows], law[1][rows]
        nvs, one = moment.nvs_V[rows], np.ones(rows.size)
        (up_V, up_R), (down_V, down_R) = (secondary_law(part, nvs, way * one) for way in (1.0, -1.0))
        mean_R, left_s, slope = 0.5 * (up_R + down_R), stretch.left_s[rows], moment.magnetizing_A_per_s[rows]
        small_H = relative_inductance(part, current_A[rows])
        inertia_H = small_H * (part.inductance_H + (R + mean_R) * part.eddy_s)
        decay = Decay.of((R + mean_R) * left_s / inertia_H)
        middle_A = moment.magnetizing_A[rows] + slope * left_s * decay.second / decay.first
        drop_V = moment.vp_V[rows] - nvs - V0 - R * middle_A - inertia_H * slope
        odd, even = 0.5 * (up_V - down_V), np.maximum(0.5 * (up_V + down_V), _TINY_V)
        sign = np.clip((drop_V - odd) / even, -1.0, 1.0)
        self.sign[rows], self.V0[rows] = sign, odd + sign * even
        self.R[rows] = np.where(np.abs(sign) < 1.0, mean_R, np.where(sign > 0, up_R, down_R))


@dataclass(slots=True, kw_only=True)
class Dropped:
    """The loop at the start of a piece, (N,): the voltage that is left, and all resistance.

    ``behind_Ohm`` and ``behind_V`` are what of both the secondary drops, by the ``secondary_sign`` of i - i_m; without
    a threshold there is no such sign. ``held`` is a link current that rests, ``lasts`` tells where its sign is a mean;
    ``secondary_crosses`` where i - i_m has a sign of its own, which may change.
    """

    push_V: Array
    resistance_Ohm: Array
    sign: Array
    held: NDArray[np.bool_]
    lasts: NDArray[np.bool_]
    behind_Ohm: Array | float
    behind_V: Array | float
    secondary_sign: Array | None
    secondary_crosses: NDArray[np.bool_] | None

    @classmethod
    def of(cls, circuit: Circuit, moment: Moment, current_A: Array, stretch: Stretch) -> Self:
        """At a current."""
        plain_V, resting = moment.vp_V - moment.nvs_V, current_A == 0
        if circuit.secondary is None:
            behind, v, behind_Ohm = None, plain_V, circuit.behind_Ohm
        else:
            behind = _Behind.of(circuit, moment, current_A, stretch)
            v, behind_Ohm = plain_V - behind.V0, behind.R
        at_rest_V = v + behind_Ohm * moment.magnetizing_A
        if behind is not None:  # where neither has a current i goes with i_m
            at_rest_V = np.where(behind.rests, moment.magnetizing_A_per_s, at_rest_V)
        sign = np.where(resting, np.sign(at_rest_V), np.sign(current_A))
        V0, R = primary_law(circuit, moment.vp_V, sign)
        held = resting & (np.abs(at_rest_V) <= V0)
        V0, lasts = sign * V0, np.zeros(sign.shape, dtype=bool)

        def law(part: Circuit, rows: Index, way: float) -> Law:
            return primary_law(part, moment.vp_V[rows], np.full(rows.size, way))

        if (turning := stretch.turning(circuit, current_A, plain_V, law)) is not None:
            turning.put((V0, R), sign, held, lasts)
        if behind is None:
            return cls(
                push_V=np.where(held, 0.0, v - V0), resistance_Ohm=R, sign=sign, held=held, lasts=lasts,
                behind_Ohm=circuit.behind_Ohm, behind_V=0.0, secondary_sign=None, secondary_crosses=None,
            )  # fmt: skip
        held &= ~behind.rests
        behind.hold(circuit, moment, ((V0, R), current_A), stretch)
        return cls(
            push_V=np.where(held, 0.0, plain_V - behind.V0 - V0), resistance_Ohm=R + behind.R, sign=sign, held=held,
            lasts=lasts, behind_Ohm=behind.R, behind_V=behind.V0, secondary_sign=behind.sign,
            secondary_crosses=~(behind.rests | behind.lasts),
        )  # fmt: skip


def relative_inductance(circuit: Circuit, current_A: Array) -> Array | float:
    """Inductance at a current, of that at a small one."""
    if not circuit.bends_A.size:
        return 1.0
    band = np.sum(circuit.bends_A[:, None] < np.abs(current_A), axis=0)
    return np.asarray(np.take_along_axis(circuit.relative_L, band[None], axis=0)[0])
