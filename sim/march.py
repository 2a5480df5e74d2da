r"""The link current over half a period, in closed form, from given instants at which the bridges step.

Between two steps of a bridge the link obeys

.. math:: L \, \dot\imath = v_p - n v_s - \sigma V_0 - R \, (i + \tau \dot\imath) - \sigma' V_0' + R' i_m, \qquad
          \sigma = \operatorname{sign} i, \quad \sigma' = \operatorname{sign} (i - i_m)

with the drops of whatever conducts: V0 of the primary's active state with the current along or against the voltage, or
of its zero state, V0' of the secondary's; R is all resistance, R' what of it is the secondary's. A resistor L / tau
beside the inductance carries tau di/dt: the windings' eddy currents, whose resistance rises with frequency squared.
What leaves the bridges' terminals is i + tau di/dt. Each stretch is solved by its exponential, cut where i crosses zero
or, with a threshold in the secondary, the magnetizing current. A current that the remaining voltage cannot lift over
its threshold stays there (:mod:`sim.drops`). Everything is vectorised over operating points.

The magnetizing current is a triangle of its own, driven by n vs. With rho = R'/R the part y = i - rho i_m is an
exponential, and i that and a straight line.

Assumption: the transformer's windings carry the link current, and the secondary's drop is left out of what drives the
magnetizing current's triangle; its power is not (:meth:`sim.pieces.Pieces.bridge_energy`).
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sim.decay import decay_integral
from sim.drops import Dropped, Moment, Stretch
from sim.pieces import Pieces
from sim.waveform import Circuit, Steps

Array = NDArray[np.float64]

_NEVER = -0.999999  # of a decay's asymptote: what the line alone carries over is left to Newton's rule
_CROSSINGS = 2  # steps: the line is a hundredth of the slope
_MEETINGS = 4  # with the magnetizing current: its slope may be most of the difference


@dataclass(slots=True, kw_only=True)
class _Start:
    """Pieces from a current at known voltages: what drives it, how it decays, the sign that it has or takes.

    A piece ends at the latest when the current reaches ``until_A``, zero or the next bend of the flux, or the
    magnetizing current where the secondary has a threshold. In a stretch in which the sign turns while legs swing it is
    a mean, and its piece lasts. ``share`` is that of the magnetizing current, ``line_A`` and ``line_A_per_s`` the
    straight part that it makes.
    """

    current_A: Array
    drive_A_per_s: Array
    decay_per_s: Array
    drops: Dropped
    relative_L: Array
    until_A: Array
    share: Array
    moment: Moment
    line_A: Array
    line_A_per_s: Array

    @classmethod
    def of(cls, circuit: Circuit, moment: Moment, current_A: Array, stretch: Stretch) -> "_Start":
        """From a current."""
        drops = Dropped.of(circuit, moment, current_A, stretch)
        R, push_V = drops.resistance_Ohm, drops.push_V
        relative, until = np.ones_like(push_V), np.where(current_A == 0, np.nan, 0.0)
        if circuit.bends_A.size:
            relative, until = _band(circuit, current_A, drops.sign, push_V - R * current_A)
        until[drops.lasts] = np.nan
        inertia_H = relative * (circuit.inductance_H + R * circuit.eddy_s)
        share = np.where(drops.held, 0.0, drops.behind_Ohm / np.where(R > 0, R, np.inf))
        line_A_per_s = share * moment.magnetizing_A_per_s
        return cls(
            current_A=current_A, drive_A_per_s=push_V / inertia_H - line_A_per_s, decay_per_s=R / inertia_H,
            drops=drops, relative_L=relative, until_A=until, share=share, moment=moment,
            line_A=share * moment.magnetizing_A, line_A_per_s=line_A_per_s,
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

    def ends(self, end_A: Array, left_s: Array) -> "_Ends":
        """Points at which the current gets beyond a limit on the way to ``end_A``, and when."""
        rows = np.flatnonzero((self.until_A - self.current_A) * (self.until_A - end_A) < 0)
        time_s = self._time_s(rows, (self.until_A - self.current_A)[rows], 0.0)
        found = _Ends(
            rows=rows, time_s=time_s, current_A=self.until_A[rows], slope_A_per_s=np.zeros(rows.size)
        )
        crosses = self.drops.secondary_crosses
        if crosses is None:
            return found
        to_go, slope = self.moment.magnetizing_A - self.current_A, self.moment.magnetizing_A_per_s
        rows = np.flatnonzero(crosses & (to_go * (to_go + slope * left_s - (end_A - self.current_A)) < 0))
        time_s = self._time_s(rows, to_go[rows], slope[rows])
        at_A = self.moment.at(rows, time_s).magnetizing_A
        return found.or_earlier(_Ends(rows=rows, time_s=time_s, current_A=at_A, slope_A_per_s=slope[rows]))

    def _time_s(self, chosen: NDArray[np.intp], to_go: Array, away_A_per_s: Array | float) -> Array:
        """When it has gone so far, from a limit that goes away: as of one exponential, then by Newton's rule."""
        slope, line = self.slope[chosen] - away_A_per_s, self.line_A_per_s[chosen] - away_A_per_s
        decay, curved = self.decay_per_s[chosen], self.curved[chosen]
        straight, x = to_go / slope, -decay * to_go / slope
        x = np.maximum(x, _NEVER)
        t = np.asarray(straight * np.where(x == 0, 1.0, np.log1p(x) / np.where(x == 0, 1.0, x)))
        for _ in range(_CROSSINGS if self.drops.secondary_crosses is None else _MEETINGS):
            gone = t * (curved * decay_integral(decay * t) + line)
            t = np.maximum(t - (gone - to_go) / (curved * np.exp(-decay * t) + line), 0.0)
        return t


@dataclass(slots=True, kw_only=True)
class _Ends:
    """Points whose pieces end early: when, at what current, and how fast the limit moves that they meet; all (K,)."""

    rows: NDArray[np.intp]
    time_s: Array
    current_A: Array
    slope_A_per_s: Array

    def or_earlier(self, other: "_Ends") -> "_Ends":
        """Of both the earlier one."""
        if not other.rows.size or not self.rows.size:
            return self if self.rows.size else other
        rows = np.union1d(self.rows, other.rows)
        mine, own = np.full((3, rows.size), np.inf), np.full((3, rows.size), np.inf)
        for values, part in ((mine, self), (own, other)):
            values[:, np.searchsorted(rows, part.rows)] = part.time_s, part.current_A, part.slope_A_per_s
        time_s, current_A, slope = np.where(mine[0] <= own[0], mine, own)
        return _Ends(rows=rows, time_s=time_s, current_A=current_A, slope_A_per_s=slope)


def _band(circuit: Circuit, current_A: Array, sign: Array, push_V: Array) -> tuple[Array, Array]:
    """Relative inductance where a current goes, and the next bend (or zero) on its way."""
    size, outward = np.abs(current_A), push_V * sign >= 0
    below = np.sum(circuit.bends_A[:, None] < size, axis=0)
    band = np.where(outward, np.sum(circuit.bends_A[:, None] <= size, axis=0), below)
    bends = np.concatenate([[0.0], circuit.bends_A, [np.inf]])
    relative = np.take_along_axis(circuit.relative_L, band[None], axis=0)[0]
    return relative, sign * bends[band + outward]


@dataclass(frozen=True, slots=True)
class _Behind:
    """What of the pieces is of a secondary whose drop depends on its state, arrays (K, N)."""

    resistance_Ohm: Array
    threshold_V: Array
    sign: Array
    meets_A_per_s: Array

    def note(self, pieces: slice, rows: slice | NDArray[np.intp], drops: Dropped) -> None:
        """Keep the drops of pieces that begin now."""
        self.resistance_Ohm[pieces, rows], self.threshold_V[pieces, rows] = drops.behind_Ohm, drops.behind_V
        assert drops.secondary_sign is not None
        self.sign[pieces, rows] = drops.secondary_sign


def _pieces_a_stretch(circuit: Circuit) -> int:
    """One to each bend and back, and two more where i and the magnetizing current may cross, and rest."""
    return 2 * (circuit.bends_A.size + (1 if circuit.secondary is None else 2))


def march(circuit: Circuit, steps: Steps, start_A: Array) -> Pieces:
    """Follow the current through a half period; within a stretch a piece ends where the current bends or is zero."""
    each = _pieces_a_stretch(circuit)
    shape = (5 * each, *start_A.shape)
    length = np.zeros(shape)
    current, drive, decay, sign, relative, share, shunt = (np.empty(shape) for _ in range(7))
    behind = None if circuit.secondary is None else _Behind(*(np.zeros(shape) for _ in range(4)))
    magnetizing, rises = steps.magnetizing(circuit)
    i = start_A
    for k in range(5):
        left, part, now = steps.duration_s[k], circuit, i
        moment = Moment(
            vp_V=steps.vp_V[k], nvs_V=steps.nvs_V[k], magnetizing_A=magnetizing[k], magnetizing_A_per_s=rises[k]
        )  # fmt: skip
        moving = np.arange(i.size)
        rows: slice | NDArray[np.intp] = slice(None)  # all of them, without the cost of picking
        for m in range(each):
            stretch = Stretch(left_s=left, whole=steps.stretch(k) if m == 0 else None)
            piece = _Start.of(part, moment, now, stretch)
            end = piece.after(left)
            beyond = slice(each * k + m, each * (k + 1))
            length[each * k + m, rows] = left
            current[each * k + m, rows] = now
            drive[beyond, rows], decay[beyond, rows] = piece.drive_A_per_s, piece.decay_per_s
            sign[beyond, rows], relative[beyond, rows] = piece.drops.sign, piece.relative_L
            share[beyond, rows], shunt[beyond, rows] = piece.share, moment.magnetizing_A
            if behind is not None:
                behind.note(beyond, rows, piece.drops)
            if m == 0:
                i = end
            else:
                i[rows] = end
            current[each * k + m + 1 : each * (k + 1), rows] = end
            if m == each - 1:
                break
            ends = piece.ends(end, left)
            if not ends.rows.size:
                break
            moving = moving[ends.rows]
            length[each * k + m, moving] = ends.time_s
            if behind is not None:
                behind.meets_A_per_s[each * k + m + 1, moving] = ends.slope_A_per_s
            left, rows, part = left[ends.rows] - ends.time_s, moving, part.take(ends.rows)
            moment, now = moment.at(ends.rows, ends.time_s), ends.current_A
    begin = np.concatenate([np.zeros_like(length[:1]), np.cumsum(length, axis=0)[:-1]])
    return Pieces(
        start_s=begin, duration_s=length, current_A=current, drive_A_per_s=drive, decay_per_s=decay,
        sign=sign, vp_V=np.repeat(steps.vp_V, each, axis=0), nvs_V=np.repeat(steps.nvs_V, each, axis=0),
        eddy_s=circuit.eddy_s, relative_L=relative, share=share, magnetizing_A=shunt,
        magnetizing_A_per_s=np.repeat(rises, each, axis=0),
        behind_Ohm=circuit.behind_Ohm if behind is None else behind.resistance_Ohm,
        behind_V=0.0 if behind is None else behind.threshold_V,
        secondary_sign=None if behind is None else behind.sign,
        meets_A_per_s=0.0 if behind is None else behind.meets_A_per_s,
    )  # fmt: skip
