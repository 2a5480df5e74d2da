r"""The link current over half a period, in closed form, from given instants at which the bridges step.

Between two steps of a bridge the link obeys

.. math:: L \, \dot\imath = v_p - n v_s - \sigma V_0 - R \, (i + \tau \dot\imath), \qquad \sigma = \operatorname{sign} i

with the drops V0 and R of whatever conducts: the active state with the current along or against the voltage, or the
zero state. A resistor L / tau beside the inductance carries tau di/dt: the windings' eddy currents, whose resistance
rises with frequency squared. What leaves the bridges' terminals is i + tau di/dt. Each stretch is solved by its
exponential, cut where the current crosses zero (a current that the remaining voltage, that of the magnetizing current
behind it included, cannot lift over V0 stays there). Everything is vectorised over operating points.

The magnetizing current is a triangle of its own, driven by n vs. Resistance behind it, R', carries the link current
less the magnetizing one: with rho = R'/R the part y = i - rho i_m is an exponential, and i that and a straight line.

Assumption: the secondary's thresholds and the transformer's windings carry the link current, and the drop of R' is left
out of what drives the magnetizing current's triangle; its power is not (:meth:`sim.pieces.Pieces.bridge_energy`).
"""

from dataclasses import dataclass, field
from typing import Self

import numpy as np
from numpy.typing import NDArray

from sim.decay import decay_integral
from sim.pieces import Pieces
from sim.stacking import own_rows

Array = NDArray[np.float64]

_SHARED = ("curves", "bends_A")
_NEVER = -0.999999  # of a decay's asymptote: what the line alone carries over is left to Newton's rule
_INSTANT_S = 1e-30
_CROSSINGS = 2  # steps: the line is a hundredth of the slope


@dataclass(frozen=True, slots=True, kw_only=True)
class Circuit:
    """What the solver needs of a converter at N operating points; arrays have shape (N,) unless told.

    ``forward``, ``reverse``, ``zero`` are the loop's drops (threshold in V, resistance in Ohm, shape (2, N))
    in the active state with the current along vp, against it, and in the zero state; ``secondary`` (3, 2, N) are those
    that depend on the secondary's state instead (current out of it along its voltage, against it, zero state), and
    ``eddy_s`` is tau. ``charge_C`` (4, N) moves each leg through its swing along the ``curve``-th of its ``curves``
    (4, G, 65), shared by all points. ``behind_Ohm`` is what of the resistances lies behind the magnetizing inductance,
    in every state. The inductance is ``relative_L`` (B, N) of that of a small current between the
    bends (B - 1,) of the flux, shared by all points; without bends it is that of a small current.
    """

    V1_V: Array
    nV2_V: Array
    turns_ratio: Array
    inductance_H: Array
    magnetizing_H: Array
    half_period_s: Array
    dead_time_s: Array
    forward: Array
    reverse: Array
    zero: Array
    charge_C: Array
    curves: Array
    curve: NDArray[np.intp]
    secondary: Array | None = None
    eddy_s: Array | float = 0.0
    behind_Ohm: Array | float = 0.0
    bends_A: Array = field(default_factory=lambda: np.zeros(0))
    relative_L: Array = field(default_factory=lambda: np.ones((1, 1)))

    def take(self, chosen: NDArray[np.intp]) -> Self:
        """The circuit at some of its points."""
        part = object.__new__(type(self))  # made of what was made: ten times as fast as replace()
        shared = _SHARED if self.bends_A.size else (*_SHARED, "relative_L")
        for name in self.__slots__:
            value = getattr(self, name)
            if isinstance(value, np.ndarray) and name not in shared:
                value = value.take(chosen, axis=-1)
            object.__setattr__(part, name, value)
        return part


@dataclass(frozen=True, slots=True, kw_only=True)
class Steps:
    """The bridges' steps in a half period, in units of Th: four flips cut it into five stretches.

    ``place`` (4, N) is where each leg flips, ``jump_V`` (4, N) by how much its bridge's voltage (times n), ``rank``
    (4, N) how many flip before it; ``duration_s``, ``vp_V`` and ``nvs_V`` (5, N) are of the stretches.
    """

    place: Array
    jump_V: Array
    rank: NDArray[np.intp]
    duration_s: Array
    vp_V: Array
    nvs_V: Array

    @classmethod
    def of(cls, circuit: Circuit, flips: Array) -> "Steps":
        """From the positions (4, N) at which the square waves rise."""
        place, after = half_wave(flips)
        half = 0.5 * np.stack([circuit.V1_V, circuit.V1_V, circuit.nV2_V, circuit.nV2_V])
        rank = _rank(place)
        order = np.empty_like(rank)
        np.put_along_axis(order, rank, np.broadcast_to(np.arange(4)[:, None], rank.shape), axis=0)
        level = half * after
        jump = 2.0 * level
        ordered, places = own_rows(order, jump, place)
        of_secondary = order >= 2
        zero = np.zeros_like(place[:1])
        times = np.concatenate([zero, places, zero + 1.0])

        def staircase(first: Array, steps: Array) -> Array:
            return np.concatenate([-first[None], np.cumsum(steps, axis=0) - first])

        return cls(
            place=place,
            jump_V=jump,
            rank=rank,
            duration_s=np.diff(times, axis=0) * circuit.half_period_s,
            vp_V=staircase(level[0] + level[1], np.where(of_secondary, 0.0, ordered)),
            nvs_V=staircase(level[2] + level[3], np.where(of_secondary, ordered, 0.0)),
        )

    def stretch(self, k: int) -> tuple[Array, Array]:
        """Length (N,) of a stretch, and of what of it lies before the half period: its last one goes on in the next."""
        if k not in (0, 4):
            return self.duration_s[k], np.zeros_like(self.duration_s[k])
        before = self.duration_s[4] if k == 0 else np.zeros_like(self.duration_s[4])
        return self.duration_s[0] + self.duration_s[4], before

    def magnetizing(self, circuit: Circuit) -> tuple[Array, Array]:
        """Magnetizing current at the start of each stretch, and its slope there, (5, N)."""
        slope = self.nvs_V / circuit.magnetizing_H
        risen = np.cumsum(slope * self.duration_s, axis=0)
        return np.concatenate([np.zeros_like(risen[:1]), risen[:-1]]) - 0.5 * risen[-1], slope


def half_wave(positions: Array) -> tuple[Array, Array]:
    """Place in the half period, in [0, 1), of waves that rise at ``positions``, and their sign after it."""
    turn = np.floor(positions)
    return positions - turn, 1.0 - 2.0 * (turn - 2.0 * np.floor(0.5 * turn))


def _rank(place: Array) -> NDArray[np.intp]:
    """How many of four places (4, N) come before each; of equal ones the first does."""
    rank = np.zeros(place.shape, dtype=np.intp)
    for one in range(4):
        for other in range(one + 1, 4):
            later = place[one] > place[other]
            rank[one] += later
            rank[other] += ~later
    return rank


def lossless_start_A(circuit: Circuit, flips: Array) -> Array:
    """Start current (N,) of the orbit without drops: minus half of what the voltages add in a half period.

    A square wave of +-V that rises at place u of the half period and stays adds V (1 - 2u) Th.
    """
    place, after = half_wave(flips)
    mean = after * (1.0 - 2.0 * place)
    half_V = 0.5 * (circuit.V1_V * (mean[0] + mean[1]) - circuit.nV2_V * (mean[2] + mean[3]))
    return np.asarray(-0.5 * half_V * circuit.half_period_s / circuit.inductance_H)


def _drops(circuit: Circuit, vp_V: Array, nvs_V: Array, sign: Array) -> tuple[Array, Array]:
    """Threshold and resistance (N,) of the conducting path."""
    along = vp_V * sign
    live = np.abs(vp_V) > 0.5 * circuit.V1_V
    V0, R = np.where(live, np.where(along > 0, circuit.forward, circuit.reverse), circuit.zero)
    if circuit.secondary is None:
        return V0, R
    along, live = -nvs_V * sign, np.abs(nvs_V) > 0.5 * circuit.nV2_V
    own = np.where(
        live, np.where(along > 0, circuit.secondary[0], circuit.secondary[1]), circuit.secondary[2]
    )
    return V0 + own[0], R + own[1]


@dataclass(frozen=True, slots=True, kw_only=True)
class _Moment:
    """Known voltages, and the magnetizing current with its slope, all (N,)."""

    vp_V: Array
    nvs_V: Array
    magnetizing_A: Array
    magnetizing_A_per_s: Array

    def at(self, chosen: NDArray[np.intp], later_s: Array) -> "_Moment":
        """Some of the points, after a time."""
        slope = self.magnetizing_A_per_s[chosen]
        return _Moment(
            vp_V=self.vp_V[chosen], nvs_V=self.nvs_V[chosen],
            magnetizing_A=self.magnetizing_A[chosen] + slope * later_s, magnetizing_A_per_s=slope,
        )  # fmt: skip


@dataclass(frozen=True, slots=True, kw_only=True)
class _Turning:
    r"""Points whose current may change its sign in a stretch shorter than a dead time, all (K,).

    Both ends of such a stretch are instants that stand for swings under way. Its voltage is a mean, and may be none at
    all, where that of the link runs through zero: the current does not rest there, as it would with drops that take
    the sign of i all at once. The mean sign is that of dry friction (:func:`sim.commutation.mean_sign`) with the
    current spread by what half a link voltage of the primary makes of it, less the nearer the stretch is to a dead
    time. Drops are those of both signs by their shares; V0 has the sign.

    Assumption: that spread. It mends the gap in power wherever it is above the threshold.
    """

    rows: NDArray[np.intp]
    sign: Array
    V0: Array
    R: Array

    @classmethod
    def of(cls, circuit: Circuit, moment: _Moment, current_A: Array, stretch: tuple[Array, Array]) -> Self:
        """From a current, with the length of its stretch and the time since it began."""
        length_s, past_s = stretch
        far = length_s / circuit.inductance_H * (np.abs(moment.vp_V - moment.nvs_V) + circuit.V1_V)
        rows = np.flatnonzero((length_s < circuit.dead_time_s) & (np.abs(current_A) < far))
        part, vp_V, nvs_V, one = circuit.take(rows), moment.vp_V[rows], moment.nvs_V[rows], np.ones(rows.size)
        (up_V, up_R), (down_V, down_R) = (_drops(part, vp_V, nvs_V, sign) for sign in (one, -one))
        per_L, past = (
            length_s[rows] / part.inductance_H,
            past_s[rows] / np.maximum(length_s[rows], _INSTANT_S),
        )
        change, held = per_L * (vp_V - nvs_V), 0.5 * per_L * (up_V + down_V)
        spread = 0.5 * per_L * part.V1_V * (1.0 - length_s[rows] / part.dead_time_s)
        moved = 2.0 * (current_A[rows] - past * change) + change + np.clip(change, -held, held)
        total = np.maximum(np.abs(change), held) + held + spread - 2.0 * past * held
        turns = np.abs(moved) < total
        sign = moved / np.where(turns, total, np.inf)
        up, down = 0.5 + 0.5 * sign, 0.5 - 0.5 * sign
        whole = (sign, up * up_V - down * down_V, up * up_R + down * down_R)
        mean, V0, R = (values[turns] for values in whole)
        return cls(rows=rows[turns], sign=mean, V0=V0, R=R)


@dataclass(frozen=True, slots=True, kw_only=True)
class _Start:
    """Pieces from a current at known voltages: what drives it, how it decays, the sign that it has or takes.

    A piece ends at the latest when the current reaches ``until_A``: zero, or the next bend of the flux. In a stretch in
    which the sign turns while legs swing it is a mean, and its piece lasts. ``share`` is
    that of the magnetizing current, ``line_A`` and ``line_A_per_s`` the straight part that it makes.
    """

    current_A: Array
    drive_A_per_s: Array
    decay_per_s: Array
    sign: Array
    relative_L: Array
    until_A: Array
    share: Array
    line_A: Array
    line_A_per_s: Array

    @classmethod
    def of(
        cls, circuit: Circuit, moment: _Moment, current_A: Array, stretch: tuple[Array, Array] | None
    ) -> "_Start":
        """From a current; first in a stretch with that one's length and the time since it began."""
        v = moment.vp_V - moment.nvs_V
        resting, at_rest_V = current_A == 0, v + circuit.behind_Ohm * moment.magnetizing_A
        sign = np.where(resting, np.sign(at_rest_V), np.sign(current_A))
        V0, R = _drops(circuit, moment.vp_V, moment.nvs_V, sign)
        held = resting & (np.abs(at_rest_V) <= V0)
        push_V = np.where(held, 0.0, v - sign * V0)
        turning = None
        if stretch is not None and np.any(stretch[0] < circuit.dead_time_s):
            turning = _Turning.of(circuit, moment, current_A, stretch)
            rows = turning.rows
            sign[rows], held[rows], R[rows], push_V[rows] = (
                turning.sign,
                False,
                turning.R,
                v[rows] - turning.V0,
            )
        relative, until = np.ones_like(v), np.where(resting, np.nan, 0.0)
        if circuit.bends_A.size:
            relative, until = _band(circuit, current_A, sign, push_V - R * current_A)
        if turning is not None:
            until[turning.rows] = np.nan
        inertia_H = relative * (circuit.inductance_H + R * circuit.eddy_s)
        share = np.where(held, 0.0, circuit.behind_Ohm / np.where(R > 0, R, np.inf))
        line_A_per_s = share * moment.magnetizing_A_per_s
        return cls(
            current_A=current_A, drive_A_per_s=push_V / inertia_H - line_A_per_s, decay_per_s=R / inertia_H,
            sign=sign, relative_L=relative, until_A=until, share=share, line_A=share * moment.magnetizing_A,
            line_A_per_s=line_A_per_s,
        )  # fmt: skip

    @property
    def curved(self) -> Array:
        """Slope at the start of the part that decays."""
        return self.drive_A_per_s - self.decay_per_s * (self.current_A - self.line_A)

    @property
    def slope(self) -> Array:
        """di/dt at the start."""
        return self.curved + self.line_A_per_s

    def after(self, time_s: Array) -> Array:
        """The current after a time."""
        return self.current_A + time_s * (
            self.curved * decay_integral(self.decay_per_s * time_s) + self.line_A_per_s
        )

    def reaches(self, end_A: Array) -> NDArray[np.intp]:
        """Points at which the current gets beyond its limit on the way to ``end_A``."""
        return np.flatnonzero((self.until_A - self.current_A) * (self.until_A - end_A) < 0)

    def time_s(self, chosen: NDArray[np.intp]) -> Array:
        """When it gets there: as of one exponential, and from there by Newton's rule."""
        slope, to_go = self.slope[chosen], (self.until_A - self.current_A)[chosen]
        decay, curved, line = self.decay_per_s[chosen], self.curved[chosen], self.line_A_per_s[chosen]
        straight, x = to_go / slope, -decay * to_go / slope
        x = np.maximum(x, _NEVER)
        t = np.asarray(straight * np.where(x == 0, 1.0, np.log1p(x) / np.where(x == 0, 1.0, x)))
        for _ in range(_CROSSINGS):
            gone = t * (curved * decay_integral(decay * t) + line)
            t = np.maximum(t - (gone - to_go) / (curved * np.exp(-decay * t) + line), 0.0)
        return t


def _band(circuit: Circuit, current_A: Array, sign: Array, push_V: Array) -> tuple[Array, Array]:
    """Relative inductance where a current goes, and the next bend (or zero) on its way."""
    size, outward = np.abs(current_A), push_V * sign >= 0
    below = np.sum(circuit.bends_A[:, None] < size, axis=0)
    band = np.where(outward, np.sum(circuit.bends_A[:, None] <= size, axis=0), below)
    bends = np.concatenate([[0.0], circuit.bends_A, [np.inf]])
    relative = np.take_along_axis(circuit.relative_L, band[None], axis=0)[0]
    return relative, sign * bends[band + outward]


def march(circuit: Circuit, steps: Steps, start_A: Array) -> Pieces:
    """Follow the current through a half period; within a stretch a piece ends where the current bends or is zero."""
    each = 2 * (circuit.bends_A.size + 1)
    shape = (5 * each, *start_A.shape)
    length = np.zeros(shape)
    current, drive, decay, sign, relative, share, shunt = (np.empty(shape) for _ in range(7))
    magnetizing, rises = steps.magnetizing(circuit)
    i = start_A
    for k in range(5):
        left, part, now = steps.duration_s[k], circuit, i
        moment = _Moment(
            vp_V=steps.vp_V[k], nvs_V=steps.nvs_V[k], magnetizing_A=magnetizing[k], magnetizing_A_per_s=rises[k]
        )  # fmt: skip
        moving = np.arange(i.size)
        rows: slice | NDArray[np.intp] = slice(None)  # all of them, without the cost of picking
        for m in range(each):
            piece = _Start.of(part, moment, now, steps.stretch(k) if m == 0 else None)
            end = piece.after(left)
            beyond = slice(each * k + m, each * (k + 1))
            length[each * k + m, rows] = left
            current[each * k + m, rows] = now
            drive[beyond, rows], decay[beyond, rows] = piece.drive_A_per_s, piece.decay_per_s
            sign[beyond, rows], relative[beyond, rows] = piece.sign, piece.relative_L
            share[beyond, rows], shunt[beyond, rows] = piece.share, moment.magnetizing_A
            reached = piece.reaches(end)
            if m == 0:
                i = end
            else:
                i[rows] = end
            current[each * k + m + 1 : each * (k + 1), rows] = end
            if not reached.size or m == each - 1:
                break
            passed, moving = piece.time_s(reached), moving[reached]
            length[each * k + m, moving] = passed
            left, rows, part = left[reached] - passed, moving, circuit.take(moving)
            moment, now = moment.at(reached, passed), piece.until_A[reached]
    begin = np.concatenate([np.zeros_like(length[:1]), np.cumsum(length, axis=0)[:-1]])
    return Pieces(
        start_s=begin, duration_s=length, current_A=current, drive_A_per_s=drive, decay_per_s=decay,
        sign=sign, vp_V=np.repeat(steps.vp_V, each, axis=0), nvs_V=np.repeat(steps.nvs_V, each, axis=0),
        eddy_s=circuit.eddy_s, relative_L=relative, share=share, magnetizing_A=shunt,
        magnetizing_A_per_s=np.repeat(rises, each, axis=0), behind_Ohm=circuit.behind_Ohm,
    )  # fmt: skip
