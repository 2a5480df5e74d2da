r"""The law by which legs commutate in their dead times, and its data: charge against current, alone or with others.

Both switches of a leg are off for its dead time. The current that leaves through the leg moves charge q into its
output capacitances; the node's voltage follows the charge along a nonlinear curve, the current follows the voltages
of all legs and the drops of what conducts:

.. math::
    \dot q_k = c_k (x_k + \tau \dot x_k), \quad 0 \le q_k \le Q_k, \qquad
    \dot x_k = A_k + \sum_l P_{kl} u_l(q_l) - D(i, i - i_m, u) - \frac{R}{L} i

x is the link current i where it leaves a leg of the primary, the link current less the magnetizing one where it
leaves a leg of the secondary; u is a leg's position from -1 to 1, and :math:`c_k x_k > 0` drives it to 1. At q = Q the
opposite diode conducts, at q = 0 with a current that runs back the diode on the old side does; a current that
reverses takes the charge back. Whatever of the swing is missing when the dead time ends is switched hard. A rule by
the sign of the current alone is discontinuous in D0 and has regulation gaps; this one has none.

The waveform solver needs of all this one number an edge: ``delay``, the time at which an instant step would carry the
same volt-seconds. :mod:`sim.swings` integrates the law.
"""

from dataclasses import dataclass, fields, replace
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from sim.soft_switching import CURVE_POINTS

Array = NDArray[np.float64]
Index = NDArray[np.intp]

FULL = CURVE_POINTS - 1.0  # a whole swing's charge, in intervals of its curve
_TINY_A = 1e-30
_LEAST = 1e-14  # square of a movement, in intervals, that is none


@dataclass(slots=True, kw_only=True)
class Commutation:
    """The dead times of all edges, arrays of one shape.

    ``delay_s`` is the volt-second equivalent delay of the step, ``missing`` the share of the swing that is
    switched hard, ``opposite_C`` and ``same_C`` the charges that the diodes on the new and the old side
    carry, ``delay_per_A`` how the delay moves with the link current where the first of the legs that meet opens (in
    s/A), ``turn_off_A`` the driving current at the edge (positive: the switch that opens carried it forward),
    ``turn_on_A`` the one that the switch that closes takes over against its will.
    """

    delay_s: Array
    delay_per_A: Array
    missing: Array
    opposite_C: Array
    same_C: Array
    turn_off_A: Array
    turn_on_A: Array

    @classmethod
    def empty(cls, *shape: int) -> Self:
        """Room for the dead times of so many edges."""
        return cls(**{f.name: np.zeros(shape) for f in fields(cls)})

    def edge(self, which: Any) -> Self:
        """One of the edges, or several."""
        return type(self)(**{name: getattr(self, name)[which] for name in self.__slots__})

    def put(self, places: Index, part: "Commutation") -> None:
        """Renew some of the edges, by their places in the arrays seen as one row."""
        for name in self.__slots__:
            getattr(self, name).reshape(-1)[places] = getattr(part, name)


@dataclass(frozen=True, slots=True, kw_only=True)
class Curves:
    """Positions over the charge of a swing, with slopes and integrals: curves of 65 points one after the other."""

    position: Array
    rise: Array
    integral: Array

    @classmethod
    def of(cls, share: Array) -> Self:
        """From voltage shares (..., 65) on an even grid of the charge share."""
        position = 2.0 * share - 1.0
        rise = np.diff(position, axis=-1, append=position[..., -1:])
        below = np.cumsum(position + 0.5 * rise, axis=-1) - (position + 0.5 * rise)
        return cls(position=position.ravel(), rise=rise.ravel(), integral=below.ravel())

    def at(self, first: Index, place: Array) -> tuple[Array, Array, Array]:
        """Positions, their slopes and their integrals at places from 0 to 64 on the curves that begin at ``first``."""
        step = place.astype(np.intp)
        index, part = first + step, place - step
        low, rise = self.position[index], self.rise[index]
        risen = rise * part
        return low + risen, rise, self.integral[index] + part * (low + 0.5 * risen)


@dataclass(slots=True, kw_only=True)
class Drops:
    r"""What a bridge's drops take from the slope of the link current, arrays (K,) in A/s unless told.

    ``level`` is the bridge's voltage over its link's without the legs that move, ``per_leg`` (m, K) what each of those
    adds at its new rail. Between the zero state (v = 0) and the active one (v = +-1) drops go straight, as they do on
    average where the step is instant:
    :math:`D = \operatorname{sign}(i) (V_z + |v| ((V_f + V_r)/2 - V_z)) + v (V_f - V_r) / 2`.
    """

    level: Array
    per_leg: Array
    zero: Array
    even: Array
    odd: Array

    @classmethod
    def of(cls, level: Array, per_leg: Array, forward: Array, reverse: Array, zero: Array) -> Self:
        """From the drops with the current along the voltage, against it, and in the zero state."""
        even, odd = 0.5 * (forward + reverse) - zero, 0.5 * (forward - reverse)
        return cls(level=level, per_leg=per_leg, zero=zero, even=even, odd=odd)

    def take(self, chosen: Index) -> Self:
        """Some of the groups."""
        return type(self)(**{name: getattr(self, name).take(chosen, axis=-1) for name in self.__slots__})

    def at(self, position: Array) -> tuple[Array, Array]:
        """What is taken times the sign of i, and whatever that is, (K,), at the legs' positions (m, K)."""
        level = self.level + np.einsum("lK,lK->K", self.per_leg, position)
        return self.zero + np.abs(level) * self.even, level * self.odd


@dataclass(slots=True, kw_only=True)
class Meeting:
    """K groups of m legs each whose dead times meet, the first to open first; arrays (m, K) unless told.

    ``current_A`` is x when the first opens, ``per_current`` is c, ``outside_A_per_s`` is A, ``coupling_A_per_s``
    (m, m, K) is P. The link current is the first leg's x and ``magnetizing_A`` (K,), what is left of it for the
    secondary is that less ``shunted_A`` (K,); ``damping_per_s`` (K,) is R/L. ``drops`` are of the primary, by the sign
    of the link current, and of a secondary with a threshold, by the sign of what is left for it.
    ``opens_s`` counts from the first leg's; ``curve`` is where the leg's curve begins. ``eddy_s`` and ``dead_time_s``
    are (K,).
    """

    current_A: Array
    per_current: Array
    outside_A_per_s: Array
    coupling_A_per_s: Array
    drops: tuple[Drops, ...]
    magnetizing_A: Array
    shunted_A: Array
    damping_per_s: Array
    eddy_s: Array
    charge_C: Array
    curve: Index
    opens_s: Array
    dead_time_s: Array

    def take(self, chosen: Index) -> Self:
        """Some of the groups."""
        own = {name: getattr(self, name).take(chosen, axis=-1) for name in self.__slots__ if name != "drops"}
        return type(self)(drops=tuple(drop.take(chosen) for drop in self.drops), **own)

    def nudged(self, *, current_A: Array, later_s: Array) -> Self:
        """The same groups with another current, or with legs that open later by times (m, K)."""
        return replace(self, current_A=self.current_A + current_A, opens_s=self.opens_s + later_s)

    def per_charge(self) -> Array:
        """Movement along the curve per charge of x: c in intervals of the curve."""
        return np.asarray(self.per_current * (FULL / self.charge_C))


def mean_sign(current_A: Array, change_A: Array, held_A: Array) -> Array:
    """Mean sign of a current through a step in which voltages change it by ``change_A``, drops by ``held_A`` at most.

    The drops' sign turns where the current does; a change that is less than they hold back ends at zero.
    """
    size = np.abs(change_A)
    moved = 2.0 * current_A + change_A + np.minimum(np.maximum(change_A, -held_A), held_A)
    return limited(moved / (np.maximum(size, held_A) + held_A + _TINY_A), -1.0, 1.0)


def limited(values: Array, low: float, high: float) -> Array:
    """As ``np.clip``, which costs three times as much for a hundred values."""
    return np.minimum(np.maximum(values, low), high)


def mean_position(u: Array, integral: Array, covered: Array, moved: Array) -> Array:
    """Mean position in a step that ends at ``u``: the curve's over the charge covered, and ``u`` once it is there."""
    return u + (integral - u * covered) * moved / (moved * moved + _LEAST)
