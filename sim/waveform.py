r"""The link current over half a period, in closed form, from given instants at which the bridges step.

Between two steps of a bridge the link obeys

.. math:: L \, \dot\imath = v_p - n v_s - \sigma V_0 - R \, (i + \tau \dot\imath), \qquad \sigma = \operatorname{sign} i

with the drops V0 and R of whatever conducts: the active state with the current along or against the voltage, or the
zero state. A resistor L / tau beside the inductance carries tau di/dt: the windings' eddy currents, whose resistance
rises with frequency squared. What leaves the bridges' terminals is i + tau di/dt. Each stretch is solved by its
exponential, cut where the current crosses zero (a current that the remaining voltage cannot lift over V0 stays there).
Everything is vectorised over operating points.

Assumption: the secondary's resistances are referred to the primary and carry the link current, and the
magnetizing inductance lies across the ideal secondary bridge, so its current is a triangle of its own.
"""

from dataclasses import dataclass, field, fields, replace
from typing import Self

import numpy as np
from numpy.typing import NDArray

from sim.decay import decay_integral, decay_moment, decay_square

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True)
class Circuit:
    """What the solver needs of a converter at N operating points; arrays have shape (N,) unless told.

    ``forward``, ``reverse``, ``zero`` are the loop's drops (threshold in V, resistance in Ohm, shape (2, N))
    in the active state with the current along vp, against it, and in the zero state; ``secondary`` (3, 2, N) are those
    that depend on the secondary's state instead (current out of it along its voltage, against it, zero state), and
    ``eddy_s`` is tau. ``charge_C`` (4, N) moves each leg through its swing along the ``curve``-th of its ``curves``
    (4, G, 65), shared by all points. The inductance is ``relative_L`` (B, N) of that of a small current between the
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
    bends_A: Array = field(default_factory=lambda: np.zeros(0))
    relative_L: Array = field(default_factory=lambda: np.ones((1, 1)))

    def take(self, chosen: NDArray[np.intp]) -> Self:
        """The circuit at some of its points."""
        shared = {"curves", "bends_A"} | ({"relative_L"} if self.bends_A.size == 0 else set())
        values = {f.name: getattr(self, f.name) for f in fields(self) if f.name not in shared}
        of_points = {
            name: value[..., chosen] for name, value in values.items() if isinstance(value, np.ndarray)
        }
        return replace(self, **of_points)


@dataclass(frozen=True, slots=True, kw_only=True)
class Pieces:
    """The half period in exponential pieces (some empty), arrays (K, N), as many in each of five stretches.

    In a piece that starts at ``start_s`` the current is ``i e^(-a t) + w (1 - e^(-a t)) / a`` with
    i = ``current_A``, w = ``drive_A_per_s``, a = ``decay_per_s``; ``sign`` is that of the current. Integrals are of
    what leaves the terminals, the current and ``eddy_s`` times its slope; ``relative_L`` scales both inductance and
    ``eddy_s``.
    """

    start_s: Array
    duration_s: Array
    current_A: Array
    drive_A_per_s: Array
    decay_per_s: Array
    sign: Array
    vp_V: Array
    nvs_V: Array
    eddy_s: Array | float
    relative_L: Array

    def current_at(self, time_s: Array) -> Array:
        """Link current in A at times of the half period [0, Th], shape (..., N)."""
        count = self.start_s.shape[0]
        index = np.sum(time_s[None] >= self.start_s.reshape(count, *(1,) * (time_s.ndim - 1), -1), axis=0) - 1
        index = np.clip(index, 0, count - 1).reshape(-1, time_s.shape[-1])

        def pick(values: Array) -> Array:
            return np.take_along_axis(values, index, axis=0).reshape(time_s.shape)

        t = time_s - pick(self.start_s)
        first = t * decay_integral(pick(self.decay_per_s) * t)
        return pick(self.current_A) + first * (
            pick(self.drive_A_per_s) - pick(self.decay_per_s) * pick(self.current_A)
        )

    def charge(self) -> Array:
        """Integral of the terminal current over each piece, in A s."""
        x, T = self.decay_per_s * self.duration_s, self.duration_s
        passed = T * (self.current_A * decay_integral(x) + self.drive_A_per_s * T * decay_moment(x))
        return np.asarray(passed + self.eddy_s * self.relative_L * (self.end_A - self.current_A))

    def square(self) -> Array:
        """Integral of the squared terminal current over each piece, in A^2 s."""
        T, i, w = self.duration_s, self.current_A, self.drive_A_per_s
        x = self.decay_per_s * T
        plain = T * (
            i**2 * decay_integral(2 * x) + w * T * (i * decay_integral(x) ** 2 + w * T * decay_square(x))
        )
        eddy_s = self.eddy_s * self.relative_L
        eddy = eddy_s * (self.end_A**2 - i**2 + eddy_s * self.squared_slope())
        return np.asarray(plain + eddy)

    def squared_slope(self) -> Array:
        """Integral of (di/dt)^2 over each piece, in A^2/s."""
        first = self.drive_A_per_s - self.decay_per_s * self.current_A
        return np.asarray(first**2 * self.duration_s * decay_integral(2 * self.decay_per_s * self.duration_s))

    def squared_induced(self) -> Array:
        """The same of the voltage across the inductance, over that of a small current squared."""
        return np.asarray(self.relative_L**2 * self.squared_slope())

    @property
    def end_A(self) -> Array:
        """Current at the end of each piece, in A."""
        first = self.duration_s * decay_integral(self.decay_per_s * self.duration_s)
        return np.asarray(self.current_A + first * (self.drive_A_per_s - self.decay_per_s * self.current_A))


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
        ordered = np.take_along_axis(jump, order, axis=0)
        of_secondary = order >= 2
        zero = np.zeros_like(place[:1])
        times = np.concatenate([zero, np.take_along_axis(place, order, axis=0), zero + 1.0])

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
class _Start:
    """Pieces from a current at known voltages: what drives it, how it decays, the sign that it has or takes.

    A piece ends at the latest when the current reaches ``until_A``: zero, or the next bend of the flux.
    """

    current_A: Array
    drive_A_per_s: Array
    decay_per_s: Array
    sign: Array
    relative_L: Array
    until_A: Array

    @classmethod
    def of(cls, circuit: Circuit, vp_V: Array, nvs_V: Array, current_A: Array) -> "_Start":
        v = vp_V - nvs_V
        resting = current_A == 0
        sign = np.where(resting, np.sign(v), np.sign(current_A))
        V0, R = _drops(circuit, vp_V, nvs_V, sign)
        held = resting & (np.abs(v) <= V0)
        push_V = np.where(held, 0.0, v - sign * V0)
        relative, until = np.ones_like(v), np.where(resting, np.nan, 0.0)
        if circuit.bends_A.size:
            relative, until = _band(circuit, current_A, sign, push_V - R * current_A)
        inertia_H = relative * (circuit.inductance_H + R * circuit.eddy_s)
        return cls(
            current_A=current_A, drive_A_per_s=push_V / inertia_H, decay_per_s=R / inertia_H, sign=sign,
            relative_L=relative, until_A=until,
        )  # fmt: skip

    @property
    def slope(self) -> Array:
        """di/dt at the start."""
        return self.drive_A_per_s - self.decay_per_s * self.current_A

    def after(self, time_s: Array) -> Array:
        """The current after a time."""
        return self.current_A + self.slope * time_s * decay_integral(self.decay_per_s * time_s)

    def reaches(self, end_A: Array) -> NDArray[np.intp]:
        """Points at which the current gets beyond its limit on the way to ``end_A``."""
        return np.flatnonzero((self.until_A - self.current_A) * (self.until_A - end_A) < 0)

    def time_s(self, chosen: NDArray[np.intp]) -> Array:
        """When it gets there: i + slope (1 - e^(-a t)) / a = limit."""
        slope, to_go = self.slope[chosen], (self.until_A - self.current_A)[chosen]
        straight, x = to_go / slope, -self.decay_per_s[chosen] * to_go / slope
        return np.asarray(straight * np.where(x == 0, 1.0, np.log1p(x) / np.where(x == 0, 1.0, x)))


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
    current, drive, decay, sign, relative = (np.empty(shape) for _ in range(5))
    i = start_A
    for k in range(5):
        left, part = steps.duration_s[k], circuit
        vp, nvs, now = steps.vp_V[k], steps.nvs_V[k], i
        moving = np.arange(i.size)
        rows: slice | NDArray[np.intp] = slice(None)  # all of them, without the cost of picking
        for m in range(each):
            piece = _Start.of(part, vp, nvs, now)
            end = piece.after(left)
            beyond = slice(each * k + m, each * (k + 1))
            length[each * k + m, rows] = left
            current[each * k + m, rows] = now
            drive[beyond, rows], decay[beyond, rows] = piece.drive_A_per_s, piece.decay_per_s
            sign[beyond, rows], relative[beyond, rows] = piece.sign, piece.relative_L
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
            vp, nvs, now = vp[reached], nvs[reached], piece.until_A[reached]
    begin = np.concatenate([np.zeros_like(length[:1]), np.cumsum(length, axis=0)[:-1]])
    return Pieces(
        start_s=begin, duration_s=length, current_A=current, drive_A_per_s=drive, decay_per_s=decay,
        sign=sign, vp_V=np.repeat(steps.vp_V, each, axis=0), nvs_V=np.repeat(steps.nvs_V, each, axis=0),
        eddy_s=circuit.eddy_s, relative_L=relative,
    )  # fmt: skip
