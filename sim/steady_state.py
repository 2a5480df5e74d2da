r"""The exact periodic steady state of the ac link.

Between two steps of a bridge the link obeys

.. math:: L \, \dot\imath = v_p - n v_s - \sigma V_0 - R \, (i + \tau \dot\imath), \qquad \sigma = \operatorname{sign} i

with the drops V0 and R of whatever conducts: the active state with the current along or against the voltage,
or the zero state. A resistor L / tau beside the inductance carries tau di/dt: the windings' eddy currents, whose
resistance rises with frequency squared. What leaves the bridges' terminals is i + tau di/dt. Each stretch is solved by
its exponential, cut where the current crosses zero (a current that the remaining voltage cannot lift over V0 stays at
zero). Half-wave symmetry i(Th) = -i(0) closes the orbit; the delays of the four
edges follow from the currents at the edges (:mod:`sim.soft_switching`). Everything is vectorised over operating points.

Assumption: the secondary's resistances are referred to the primary and carry the link current, and the
magnetizing inductance lies across the ideal secondary bridge, so its current is a triangle of its own.
"""

from dataclasses import dataclass, fields, replace
from typing import Self

import numpy as np
from numpy.typing import NDArray

from sim.decay import decay_integral, decay_moment, decay_square
from sim.soft_switching import CURVE_POINTS, Commutation, commutate, read_curves

Array = NDArray[np.float64]

_SWEEPS = 120
_RESTART = 9  # every so many sweeps a plain step, in case the acceleration chases its tail
_CLOSED = 1e-10  # of the largest current: far below anything measured, above rounding
_SETTLED = 1e-9  # of a half period, 25 fs at 20 kHz


@dataclass(frozen=True, slots=True, kw_only=True)
class Circuit:
    """What the solver needs of a converter at N operating points; arrays have shape (N,) unless told.

    ``forward``, ``reverse``, ``zero`` are the loop's drops (threshold in V, resistance in Ohm, shape (2, N))
    in the active state with the current along vp, against it, and in the zero state; ``secondary`` (3, 2, N) are those
    that depend on the secondary's state instead (current out of it along its voltage, against it, zero state), and
    ``eddy_s`` is tau. ``charge_C`` (4, N) moves each leg through its swing along the ``curve``-th of its ``curves``
    (4, G, 65), shared by all points.
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

    def take(self, chosen: NDArray[np.intp]) -> Self:
        """The circuit at some of its points."""
        values = {f.name: getattr(self, f.name) for f in fields(self) if f.name != "curves"}
        of_points = {
            name: value[..., chosen] for name, value in values.items() if isinstance(value, np.ndarray)
        }
        return replace(self, **of_points)


@dataclass(frozen=True, slots=True, kw_only=True)
class Pieces:
    """The half period in ten exponential pieces (some empty), arrays of shape (10, N).

    In a piece that starts at ``start_s`` the current is ``i e^(-a t) + w (1 - e^(-a t)) / a`` with
    i = ``current_A``, w = ``drive_A_per_s``, a = ``decay_per_s``; ``sign`` is that of the current. Integrals are of
    what leaves the terminals, the current and ``eddy_s`` times its slope.
    """

    start_s: Array
    duration_s: Array
    current_A: Array
    drive_A_per_s: Array
    decay_per_s: Array
    sign: Array
    vp_V: Array
    nvs_V: Array
    eddy_s: Array | float = 0.0

    def current_at(self, time_s: Array) -> Array:
        """Link current in A at times of the half period [0, Th], shape (..., N)."""
        index = np.sum(time_s[None] >= self.start_s.reshape(10, *(1,) * (time_s.ndim - 1), -1), axis=0) - 1
        index = np.clip(index, 0, 9).reshape(-1, time_s.shape[-1])

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
        return np.asarray(passed + self.eddy_s * (self.end_A - self.current_A))

    def square(self) -> Array:
        """Integral of the squared terminal current over each piece, in A^2 s."""
        T, i, w = self.duration_s, self.current_A, self.drive_A_per_s
        x = self.decay_per_s * T
        plain = T * (
            i**2 * decay_integral(2 * x) + w * T * (i * decay_integral(x) ** 2 + w * T * decay_square(x))
        )
        eddy = self.eddy_s * (self.end_A**2 - i**2 + self.eddy_s * self.squared_slope())
        return np.asarray(plain + eddy)

    def squared_slope(self) -> Array:
        """Integral of (di/dt)^2 over each piece, in A^2/s."""
        first = self.drive_A_per_s - self.decay_per_s * self.current_A
        return np.asarray(first**2 * self.duration_s * decay_integral(2 * self.decay_per_s * self.duration_s))

    @property
    def end_A(self) -> Array:
        """Current at the end of each piece, in A."""
        first = self.duration_s * decay_integral(self.decay_per_s * self.duration_s)
        return np.asarray(self.current_A + first * (self.drive_A_per_s - self.decay_per_s * self.current_A))


@dataclass(frozen=True, slots=True, kw_only=True)
class Orbit:
    """A periodic steady state: start current (N,), delays of the edges in units of Th (4, N), and the rest.

    ``closed`` tells at which points current and delays came back to themselves.
    """

    start_A: Array
    delay: Array
    pieces: Pieces
    commutation: Commutation
    closed: NDArray[np.bool_]

    def start_of(self, chosen: NDArray[np.intp]) -> Self:
        """Start current and delays at some points, enough to start from again."""
        return replace(self, start_A=self.start_A[chosen], delay=self.delay[:, chosen])

    def output_power_W(self) -> Array:
        """Mean of n vs i over the half period: power into the ideal secondary bridge."""
        return self._mean_power_W(self.pieces.nvs_V)

    def input_power_W(self) -> Array:
        """Mean of vp i over the half period: power out of the ideal primary bridge."""
        return self._mean_power_W(self.pieces.vp_V)

    def _mean_power_W(self, voltage_V: Array) -> Array:
        """Mean of a voltage, (10, N) over the pieces, times the current."""
        return np.asarray(
            np.sum(voltage_V * self.pieces.charge(), axis=0) / np.sum(self.pieces.duration_s, axis=0)
        )


def _levels(circuit: Circuit, flips: Array) -> tuple[Array, Array, Array]:
    """Durations of the five stretches of a half period, and vp and n vs in each, all (5, N)."""
    turn = np.floor(flips)
    place = flips - turn
    after = 1.0 - 2.0 * np.mod(turn, 2.0)  # sign of each square wave after its flip
    half = np.stack([circuit.V1_V, circuit.V1_V, circuit.nV2_V, circuit.nV2_V]) / 2
    order = np.argsort(place, axis=0)
    zero = np.zeros_like(place[:1])
    times = np.concatenate([zero, np.take_along_axis(place, order, axis=0), zero + 1.0])
    jump = 2 * half * after

    def staircase(rows: slice) -> Array:
        mask = np.zeros((4, 1))
        mask[rows] = 1.0
        steps = np.take_along_axis(jump * mask, order, axis=0)
        first = -np.sum((half * after)[rows], axis=0, keepdims=True)
        return np.concatenate([first, first + np.cumsum(steps, axis=0)])

    return np.diff(times, axis=0) * circuit.half_period_s, staircase(slice(0, 2)), staircase(slice(2, 4))


def lossless_start_A(circuit: Circuit, flips: Array) -> Array:
    """Start current (N,) of the orbit without drops: minus half of what the voltages add in a half period."""
    duration, vp, nvs = _levels(circuit, flips)
    return np.asarray(-0.5 * np.sum(duration * (vp - nvs), axis=0) / circuit.inductance_H)


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


def _march(circuit: Circuit, flips: Array, start_A: Array) -> Pieces:
    """Follow the current through a half period from ``start_A``."""
    duration, vp, nvs = _levels(circuit, flips)
    shape = (10, *start_A.shape)
    length, current, drive, decay, signs = (np.zeros(shape) for _ in range(5))
    i = start_A
    for k in range(5):
        v, left = vp[k] - nvs[k], duration[k]
        sign = np.where(i != 0, np.sign(i), np.sign(v))
        for half in (2 * k, 2 * k + 1):
            V0, R = _drops(circuit, vp[k], nvs[k], sign)
            held = (i == 0) & (np.abs(v) <= V0)
            inertia_H = circuit.inductance_H + R * circuit.eddy_s
            a = R / inertia_H
            w = np.where(held, 0.0, (v - sign * V0) / inertia_H)
            slope = w - a * i
            end = i + slope * left * decay_integral(a * left)
            crosses = (end * sign < 0) & (i != 0)
            with np.errstate(divide="ignore", invalid="ignore"):
                # time to zero from i + slope (1 - e^(-a t)) / a = 0
                until = np.where(crosses, _log_ratio(a * i / slope) * -i / slope, left)
            length[half], current[half], drive[half], decay[half], signs[half] = until, i, w, a, sign
            i = np.where(crosses, 0.0, end)
            left = left - until
            sign = np.where(crosses, np.sign(v), sign)
    begin = np.concatenate([np.zeros_like(length[:1]), np.cumsum(length, axis=0)[:-1]])
    return Pieces(
        start_s=begin, duration_s=length, current_A=current, drive_A_per_s=drive, decay_per_s=decay,
        sign=signs, vp_V=np.repeat(vp, 2, axis=0), nvs_V=np.repeat(nvs, 2, axis=0), eddy_s=circuit.eddy_s,
    )  # fmt: skip


def _log_ratio(x: Array) -> Array:
    """log(1 + x) / x, 1 at 0."""
    return np.where(x == 0, 1.0, np.log1p(x) / np.where(x == 0, 1.0, x))


def magnetizing_current(circuit: Circuit, edges: Array, time: Array) -> Array:
    """Triangle driven by n vs, in A, at ``time`` (..., N) in units of Th; zero mean by half-wave symmetry."""
    slope = circuit.nV2_V * circuit.half_period_s / (2 * circuit.magnetizing_H)
    total: Array = np.zeros_like(time)
    for edge in edges[2:]:
        position = np.mod(time - edge, 2.0)
        total = total + np.where(position < 1.0, position - 0.5, 1.5 - position)
    return slope * total


def _commutations(circuit: Circuit, edges: Array, flips: Array, pieces: Pieces) -> Commutation:
    """The dead time of each of the four edges, seen in the frame in which it rises."""
    turn = np.floor(edges)
    parity = 1.0 - 2.0 * np.mod(turn, 2.0)
    n = circuit.turns_ratio
    link = parity * pieces.current_at((edges - turn) * circuit.half_period_s)
    current = np.concatenate([-link[:2], n * (link[2:] - magnetizing_current(circuit, edges, edges[2:]))])
    half = np.stack([circuit.V1_V, circuit.V1_V, circuit.nV2_V, circuit.nV2_V]) / 2
    ahead = np.mod(flips[:, None] - edges[None, :] + 1.0, 2.0) - 1.0  # next flip of leg l seen from edge e
    side = np.array([1.0, 1.0, -1.0, -1.0])[:, None] / circuit.inductance_H
    shunt = np.array([0.0, 0.0, -1.0, -1.0])[:, None] / circuit.magnetizing_H
    # d(driving current)/dt per volt of leg l (rows) at edge e (columns)
    gain = np.stack([-side, -side, n * (side + shunt), n * (side + shunt)], axis=1) * half[:, None]
    own = np.stack([gain[k, k] for k in range(4)])
    base = np.sum(np.where(ahead > 0, -gain, gain), axis=0) - np.where(np.diagonal(ahead).T > 0, -own, own)
    # the next flip of a leg, up where it is down and down where it is up
    wait = np.where(ahead > 0, ahead, ahead + 1.0)
    legs, targets, points = np.nonzero(
        (wait < circuit.dead_time_s / circuit.half_period_s) & ~np.eye(4, dtype=bool)[:, :, None]
    )
    chosen = legs, targets, points
    arrival = wait[chosen] * circuit.half_period_s[points]
    kick = np.where(ahead[chosen] > 0, 2.0, -2.0) * gain[chosen]

    def drive(start_s: Array, end_s: Array) -> Array:
        total: Array = base.copy() if arrival.size else base
        if arrival.size:
            begin, end = start_s[points], end_s[points]
            np.add.at(total, (targets, points), kick * np.clip((end - arrival) / (end - begin), 0.0, 1.0))
        return total

    flat = circuit.curves.ravel()
    first = (np.arange(4)[:, None] * circuit.curves.shape[1] + circuit.curve) * CURVE_POINTS

    def share_of(charge_share: Array) -> Array:
        return read_curves(flat, first + np.minimum(charge_share, 1.0 - 1e-12) * (CURVE_POINTS - 1))

    return commutate(current, drive, own, circuit.dead_time_s, circuit.charge_C, share_of)


def _sweep(circuit: Circuit, edges: Array, start_A: Array, delay: Array) -> tuple[Pieces, Commutation]:
    flips = edges + delay
    pieces = _march(circuit, flips, start_A)
    return pieces, _commutations(circuit, edges, flips, pieces)


def periodic(circuit: Circuit, edges: Array, start_A: Array, delay: Array) -> Orbit:
    """The orbit for given edges (4, N) in units of Th, from a first guess of start current and delays.

    The map "half period, then dead times" is iterated with Anderson acceleration of depth two (Walker and
    Ni, 2011) on the start current and the four delays; the closing error i(Th) + i(0) has a slope near 2, so
    half of it is the plain step. ``closed`` tells where both settled.
    """
    unit_A = circuit.V1_V * circuit.half_period_s / circuit.inductance_H  # as comparable as delays
    longest = circuit.dead_time_s / circuit.half_period_s
    state = np.concatenate([(start_A / unit_A)[None], delay])
    history = np.full((4, *state.shape), np.nan)  # last state and step, and those before
    closed = np.zeros(start_A.shape, dtype=bool)
    for sweep in range(_SWEEPS):
        busy = np.flatnonzero(~closed)
        if not busy.size:
            break
        part, now = circuit.take(busy), state[:, busy]
        i = now[0] * unit_A[busy]
        pieces, commutation = _sweep(part, edges[:, busy], i, now[1:])
        gap = pieces.end_A[-1] + i
        step = np.concatenate(
            [(-0.5 * gap / unit_A[busy])[None], commutation.delay_s / part.half_period_s - now[1:]]
        )
        done = (np.abs(gap) <= _CLOSED * (1.0 + np.abs(i))) & np.all(np.abs(step[1:]) <= _SETTLED, axis=0)
        closed[busy] = done
        ahead = now + (
            step if sweep % _RESTART == _RESTART - 1 else _accelerated(now, step, history[:, :, busy])
        )
        ahead[1:] = np.clip(ahead[1:], 0.0, longest[busy])
        history[2:, :, busy] = history[:2, :, busy]
        history[0, :, busy], history[1, :, busy] = now.T, step.T
        state[:, busy] = np.where(done, now, ahead)
    start_A, delay = state[0] * unit_A, state[1:]
    pieces, commutation = _sweep(circuit, edges, start_A, delay)
    return Orbit(start_A=start_A, delay=delay, pieces=pieces, commutation=commutation, closed=closed)


def _accelerated(now: Array, step: Array, history: Array) -> Array:
    """Anderson's step of depth two (or one, or none) from the last states and steps (4, 5, N)."""
    dx, df = now - history[0], step - history[1]
    dx2, df2 = history[0] - history[2], history[1] - history[3]
    deep = np.isfinite(df2[0])
    dx2, df2 = np.where(deep, dx2, 0.0), np.where(deep, df2, 0.0)
    dx, df = np.where(np.isfinite(df), dx, 0.0), np.where(np.isfinite(df), df, 0.0)
    aa, ab, bb = np.sum(df * df, axis=0), np.sum(df * df2, axis=0), np.sum(df2 * df2, axis=0)
    ra, rb = np.sum(df * step, axis=0), np.sum(df2 * step, axis=0)
    determinant = aa * bb - ab * ab
    two = determinant > 1e-8 * aa * bb
    safe = np.where(two, determinant, 1.0)
    first = np.where(two, (ra * bb - rb * ab) / safe, np.where(aa > 0, ra / np.where(aa > 0, aa, 1.0), 0.0))
    second = np.where(two, (rb * aa - ra * ab) / safe, 0.0)
    return np.asarray(step - first * (dx + df) - second * (dx2 + df2))
