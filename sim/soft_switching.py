"""What output capacitances make of a leg's swing: how voltage follows charge, what a hard step over the rest costs."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from sim.parameters import Capacitance, Quantity

Array = NDArray[np.float64]

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
