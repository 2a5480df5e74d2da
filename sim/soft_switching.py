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

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields
from itertools import pairwise
from typing import Self

import numpy as np
from numpy.typing import NDArray

from sim.parameters import Capacitance, Quantity

Array = NDArray[np.float64]

# Quadratically graded steps: fine at the start, where a large current swings the node in nanoseconds.
_STEPS = 16
_GRID = (np.arange(_STEPS + 1) / _STEPS) ** 2
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


def read_curves(curves: Array, charge_share: Array) -> Array:
    """Voltage share (4, N) at charge shares (4, N) in [0, 1], from curves (4, G, 65) chosen by offsets.

    ``curves`` is flattened and ``charge_share`` counted from each curve's start by the caller.
    """
    index = np.minimum(charge_share.astype(np.intp), curves.size - 2)
    low: Array = curves[index]
    return np.asarray(low + (curves[index + 1] - low) * (charge_share - index))


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
    carry, ``turn_off_A`` the current at the edge (positive: the switch that opens carried it forward),
    ``turn_on_A`` the current that the switch that closes takes over against its will.
    """

    delay_s: Array
    missing: Array
    opposite_C: Array
    same_C: Array
    turn_off_A: Array
    turn_on_A: Array

    def edge(self, which: int | slice) -> Self:
        """One of the edges, or several."""
        return type(self)(**{f.name: getattr(self, f.name)[which] for f in fields(self)})


def commutate(
    current_A: Array,
    drive: Callable[[Array, Array], Array],
    own_A_per_s: Array | float,
    dead_time_s: Array,
    charge_C: Array,
    voltage_share: Callable[[Array], Array],
) -> Commutation:
    """Integrate the dead time of each edge in graded steps.

    In a step the charge moves by the current and its slope at the start, the current by the mean of its slopes at both
    ends (Verlet's rule, of second order).

    Parameters
    ----------
    current_A : array
        Driving current when the leg's switches open, positive towards the new rail.
    drive : callable
        ``drive(start_s, end_s)``: mean slope in A/s that the rest of the circuit gives the current in a step, time
        counted from the edge.
    own_A_per_s : array or float
        Slope that the leg's own voltage adds to that at the new rail, and takes away at the old one.
    dead_time_s : array
        Dead time, shape (N,); ``current_A`` and ``charge_C`` have shape (edges, N).
    charge_C : array
        Charge of a whole swing.
    voltage_share : callable
        Voltage share over charge share.
    """
    j, q = current_A, np.zeros_like(current_A)
    share = np.zeros_like(q)
    delay, opposite, same = np.zeros_like(q), np.zeros_like(q), np.zeros_like(q)
    for start, end in pairwise(_GRID):
        step = (end - start) * dead_time_s
        pull = drive(start * dead_time_s, end * dead_time_s)
        moved = q + (j + 0.5 * step * (pull + own_A_per_s * (2.0 * share - 1.0))) * step
        q = np.clip(moved, 0.0, charge_C)
        opposite += np.maximum(moved - charge_C, 0.0)
        same += np.maximum(-moved, 0.0)
        before, share = share, voltage_share(q / charge_C)
        j = j + step * (pull + own_A_per_s * (before + share - 1.0))
        delay += (1.0 - 0.5 * (before + share)) * step
    missing = 1.0 - share
    return Commutation(
        delay_s=delay,
        missing=missing,
        opposite_C=opposite,
        same_C=same,
        turn_off_A=np.maximum(current_A, 0.0),
        turn_on_A=np.maximum(-j, 0.0) * missing,
    )
