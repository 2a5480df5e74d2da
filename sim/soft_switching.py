r"""What happens in the dead time: a continuous law of commutation by charge.

Both switches of a leg are off for the dead time. The current that leaves through the leg moves charge q
into its output capacitances; the node's voltage follows the charge along a nonlinear curve, the current
follows the voltage through the link inductance:

.. math:: \dot q = j, \qquad \dot\jmath = s(t, u(q/Q)), \qquad 0 \le q \le Q

j > 0 drives the node towards the other rail. At q = Q the opposite diode conducts, at q = 0 with j < 0 the
diode on the old side does; a current that reverses takes the charge back. Whatever of the swing is missing
when the dead time ends is switched hard. A rule by the sign of the current alone is discontinuous in D0 and
has regulation gaps; this one has none at the dead times it is made for (at 2.4 % of a half period and more,
power over phase folds where two edges pass each other).

The waveform solver needs of all this one number an edge: ``delay``, the time at which an instant step would
carry the same volt-seconds.
"""

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Self

import numpy as np
from numpy.typing import NDArray

from sim.parameters import Capacitance, Quantity

Array = NDArray[np.float64]

# Graded steps: finer at the start, where a large current swings the node in nanoseconds.
_STEPS = 10
_GRID = (np.arange(_STEPS + 1) / _STEPS) ** 1.5
CURVE_POINTS = 65


Junctions = Sequence[Capacitance]


def swing_curve(charging: Junctions, discharging: Junctions, swing_V: float) -> Array:
    """Voltage share of a swing in one step on an even grid of its charge share, shape (65,), from 0 to 1."""
    return leg_curve([(charging, discharging)], swing_V)


def leg_curve(steps: Sequence[tuple[Junctions, Junctions]], step_V: float) -> Array:
    """Voltage share of a leg's swing on an even grid of its charge share, shape (65,), from 0 to 1.

    The swing is one step after the other, each of ``step_V``: some junctions charge from 0, the others discharge
    from ``step_V``; all of scalar values.
    """
    v = np.linspace(0.0, step_V, 513)
    shares, charges = [np.zeros(1)], [np.zeros(1)]
    for k, (charging, discharging) in enumerate(steps):
        charge = np.zeros_like(v)
        for junction in charging:
            charge = charge + junction.charge_C(v)
        for junction in discharging:
            charge = charge + junction.charge_C(step_V) - junction.charge_C(step_V - v)
        shares.append((k + v[1:] / step_V) / len(steps))
        charges.append(charges[-1][-1] + charge[1:])
    charge = np.concatenate(charges)
    return np.interp(np.linspace(0.0, float(charge[-1]), CURVE_POINTS), charge, np.concatenate(shares))


@dataclass(frozen=True, slots=True, kw_only=True)
class Curves:
    """Voltage share over charge share of whole swings, for arrays of edges of one shape.

    ``values`` holds curves of 65 points one after the other, ``first`` where each edge's begins.
    """

    values: Array
    first: NDArray[np.intp]

    def at(self, charge_share: Array) -> tuple[Array, Array]:
        """Voltage shares at charge shares in [0, 1], and their slopes."""
        place = charge_share * (CURVE_POINTS - 1)
        step = np.minimum(place.astype(np.intp), CURVE_POINTS - 2)
        index = self.first + step
        low: Array = self.values[index]
        rise = self.values[index + 1] - low
        return low + rise * (place - step), rise * (CURVE_POINTS - 1)


def residual_energy(
    charging: Sequence[Capacitance], discharging: Sequence[Capacitance], swing_V: Quantity, missing: Quantity
) -> Quantity:
    r"""Energy lost, in J, when a leg is switched hard over the last part ``missing`` of its swing.

    With v0 = (1 - missing) V already reached, the rail supplies Q(V) - Q(v0) at V to the charging junctions,
    and what the junctions do not store is lost:
    :math:`V [Q(V) - Q(v_0)] - [E(V) - E(v_0)]` for each that charges, :math:`E(V - v_0)` for each that
    discharges. For two constant capacitances C it is C dV^2.

    >>> constant = Capacitance(zero_bias_F=200e-12, junction_V=1e6, grading=0.5)
    >>> f"{residual_energy([constant], [constant], 140.0, 1.0) * 1e6:.2f} uJ"
    '3.92 uJ'
    """
    reached = (1.0 - missing) * swing_V
    lost: Quantity = 0.0 * reached
    for junction in charging:
        supplied = swing_V * (junction.charge_C(swing_V) - junction.charge_C(reached))
        lost = lost + supplied - (junction.energy_J(swing_V) - junction.energy_J(reached))
    for junction in discharging:
        lost = lost + junction.energy_J(swing_V - reached)
    return lost


@dataclass(frozen=True, slots=True, kw_only=True)
class Commutation:
    """The dead times of all edges, arrays of one shape.

    ``delay_s`` is the volt-second equivalent delay of the step, ``missing`` the share of the swing that is
    switched hard, ``opposite_C`` and ``same_C`` the charges that the diodes on the new and the old side
    carry, ``delay_per_A`` how the delay moves with the current at the edge (in s/A), ``turn_off_A`` that current
    (positive: the switch that opens carried it forward), ``turn_on_A`` the one that the switch that closes takes
    over against its will.
    """

    delay_s: Array
    delay_per_A: Array
    missing: Array
    opposite_C: Array
    same_C: Array
    turn_off_A: Array
    turn_on_A: Array

    def edge(self, which: int | slice) -> Self:
        """One of the edges, or several."""
        return type(self)(**{f.name: getattr(self, f.name)[which] for f in fields(self)})


@dataclass(frozen=True, slots=True, kw_only=True)
class Drive:
    """Slopes of the driving currents in A/s, arrays of one shape (edges, N) unless told.

    ``outside_A_per_s`` comes from the rest of the circuit, ``own_A_per_s`` is added by the leg's own voltage at the new
    rail and taken away at the old one. At the flat places ``kicked`` (K,) the former changes: ``kicks_A_per_s``
    (steps, K) are the mean changes in each step of the dead time.
    """

    outside_A_per_s: Array
    own_A_per_s: Array | float
    kicked: NDArray[np.intp] | None = None
    kicks_A_per_s: Array | None = None

    def in_step(self, step: int) -> Array:
        """Mean slope from outside in one step."""
        if self.kicked is None or self.kicks_A_per_s is None:
            return self.outside_A_per_s
        total = self.outside_A_per_s.copy()
        total.ravel()[self.kicked] += self.kicks_A_per_s[step]
        return total


def steps_of(dead_time_s: Array) -> Array:
    """Ends of the steps of a dead time in s, shape (steps + 1, ...)."""
    return _GRID.reshape(-1, *(1,) * np.ndim(dead_time_s)) * dead_time_s


def commutate(
    current_A: Array, drive: Drive, dead_time_s: Array, charge_C: Array, curves: Curves
) -> Commutation:
    """Integrate the dead time of each edge in graded steps.

    In a step the charge moves by the current and its slope at the start, the current by the mean of its slopes at both
    ends (Verlet's rule, of second order); where the charge arrives within the step, the voltage is there from then on.

    Parameters
    ----------
    current_A : array
        Driving current when the leg's switches open, positive towards the new rail.
    drive : Drive
        How that current moves.
    dead_time_s : array
        Dead time, shape (N,); ``current_A`` and ``charge_C`` have shape (edges, N).
    charge_C : array
        Charge of a whole swing.
    curves : Curves
        Voltage share over charge share.
    """
    own, per_C = drive.own_A_per_s, 1.0 / charge_C
    j, q = current_A, np.zeros_like(current_A)
    dj, dq = np.ones_like(q), np.zeros_like(q)  # derivatives to the current at the edge
    u, rise = curves.at(q)
    du = np.zeros_like(q)
    reached, opposite, over, reached_per_A = (np.zeros_like(q) for _ in range(4))
    for k, step in enumerate(np.diff(steps_of(dead_time_s), axis=0)):
        outside = drive.in_step(k) - own
        moved = q + (j + 0.5 * step * (outside + 2.0 * own * u)) * step
        dmoved = dq + (dj + step * own * du) * step
        after = np.clip(moved, 0.0, charge_C)
        beyond = moved - after
        free = beyond == 0.0
        while_moving = np.where(free, 1.0, (after - q) / np.where(free, 1.0, moved - q))
        share, rise = curves.at(after * per_C)
        dshare = np.where(free, rise * dmoved * per_C, 0.0)
        mean = share + 0.5 * while_moving * (u - share)
        dmean = 0.5 * (du + dshare)
        opposite += np.maximum(beyond, 0.0)
        over += beyond
        reached += mean * step
        reached_per_A += dmean * step
        j = j + step * (outside + 2.0 * own * mean)
        dj = dj + 2.0 * step * own * dmean
        q, dq, u, du = after, np.where(free, dmoved, 0.0), share, dshare
    missing = 1.0 - u
    return Commutation(
        delay_s=dead_time_s - reached,
        delay_per_A=-reached_per_A,
        missing=missing,
        opposite_C=opposite,
        same_C=opposite - over,
        turn_off_A=np.maximum(current_A, 0.0),
        turn_on_A=np.maximum(-j, 0.0) * missing,
    )
