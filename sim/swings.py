"""Legs on their way through the dead time: the law of :mod:`sim.commutation` in graded steps.

In a step the charge moves by the current and its slope at the start, the current by the mean of its slopes (Verlet's
rule, of second order). The mean position is that of the curve over the charge covered: a node that a large current
swings within one step costs no accuracy. Legs that are alone, most of them, take their steps all at once; those of a
group take a dozen of their own, in :mod:`sim.meeting_legs`.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sim.commutation import FULL, Commutation, Curves, Meeting, limited, mean_position, mean_sign

Array = NDArray[np.float64]
Index = NDArray[np.intp]

_STEPS = 8  # of a leg; legs that meet take those of each other as well
_GRADE = 1.15  # finer at the start, where large currents swing nodes in nanoseconds
_GRID = (np.arange(_STEPS + 1) / _STEPS) ** _GRADE  # ends of steps, over the dead time
_ENDS = _GRID.tolist()
_LOOKS = (0, 3, 5)  # steps before which legs whose node will not move any more are done with


def commutate(meeting: Meeting, curves: Curves, *, sloped: bool = True) -> Commutation:
    """The dead times (m, K) of groups of legs; ``delay_per_A`` only of legs that are alone, where it is asked for."""
    if len(meeting.current_A) == 1:
        return _alone(_Alone.of(meeting, sloped=sloped), curves)
    return _together(meeting, curves)


def _alone(legs: "_Alone", curves: Curves) -> Commutation:
    """Take legs that meet no other through their dead times, all at once."""
    whole, rows = Commutation.empty(1, legs.x.size), np.arange(legs.x.size)
    for k in range(_STEPS):
        if k in _LOOKS:
            stays = legs.finish(k)
            if stays.any():
                (done,), (going,) = stays.nonzero(), (~stays).nonzero()
                whole.put(rows[done], legs.outcome(done))
                if not going.size:
                    return whole
                legs, rows = legs.take(going), rows[going]
        legs.step(curves, k)
    whole.put(rows, legs.outcome(slice(None)))
    return whole


def _together(meeting: Meeting, curves: Curves) -> Commutation:
    """Take groups of legs through their dead times, one after the other."""
    # here: compiled code takes a while to load
    from sim.meeting_legs import BRIDGES, COUPLING, PER_LEG, integrate

    m, K = meeting.current_A.shape
    given, bridges = np.zeros((COUPLING + m, m, K)), np.zeros((4, BRIDGES, K))
    given[:PER_LEG] = (
        meeting.current_A, meeting.per_current, meeting.outside_A_per_s, meeting.charge_C, meeting.curve,
        meeting.opens_s,
    )  # fmt: skip
    given[COUPLING:] = np.swapaxes(meeting.coupling_A_per_s, 0, 1)
    for bridge, drop in enumerate(meeting.drops):
        given[PER_LEG + bridge] = drop.per_leg
        bridges[:, bridge] = drop.level, drop.zero, drop.even, drop.odd
    of_all = (
        meeting.magnetizing_A, meeting.shunted_A, meeting.damping_per_s, meeting.eddy_s, meeting.dead_time_s,
        np.full(K, FULL),
    )  # fmt: skip
    link = np.concatenate([bridges.reshape(-1, K), of_all])
    rows = np.stack([curves.position, curves.rise, curves.integral])
    ends = integrate(given, link, rows, _GRID)
    return Commutation(**dict(zip(Commutation.__slots__, ends, strict=True)))


@dataclass(kw_only=True)
class _Alone:
    """K legs that meet no other, half way through their dead times, arrays (K,).

    ``q`` is the charge in intervals of the curve, ``u`` the position from -1 to 1; ``d`` are derivatives to the current
    at the edge. The slope of x is ``base + own u - way (signed + bent u) - damping i``; a secondary with a
    threshold takes the same with ``behind`` (2, K). What follows ``per_charge`` is of the :class:`Meeting`.
    """

    x: Array
    dx: Array
    q: Array
    dq: Array
    u: Array
    du: Array
    reached: Array
    reached_per_A: Array
    opposite: Array
    over: Array
    integral: Array
    base: Array
    own: Array
    signed: Array
    bent: Array
    per_charge: Array
    current_A: Array
    per_current: Array
    magnetizing_A: Array
    damping_per_s: Array
    eddy_s: Array
    charge_C: Array
    curve: Index
    dead_time_s: Array
    shunted_A: Array
    behind: Array | None
    sloped: bool

    @classmethod
    def of(cls, meeting: Meeting, *, sloped: bool) -> "_Alone":
        x = meeting.current_A[0]
        rails = [[drop.at(np.full((1, x.size), rail)) for drop in meeting.drops] for rail in (-1.0, 1.0)]
        plain = [np.asarray(sum(each[1] for each in rail)) for rail in rails]
        own, *behind = (
            (0.5 * (new[0] + old[0]), 0.5 * (new[0] - old[0])) for old, new in zip(*rails, strict=True)
        )
        zero = np.zeros_like(x)
        return cls(
            x=x, dx=zero + 1.0, q=zero, dq=zero, u=zero - 1.0, du=zero, reached=zero, reached_per_A=zero,
            opposite=zero, over=zero, integral=zero,
            base=meeting.outside_A_per_s[0] - 0.5 * (plain[1] + plain[0]),
            own=meeting.coupling_A_per_s[0, 0] - 0.5 * (plain[1] - plain[0]),
            signed=own[0], bent=own[1], behind=np.stack(behind[0]) if behind else None, shunted_A=meeting.shunted_A,
            per_charge=meeting.per_charge()[0], current_A=x, per_current=meeting.per_current[0],
            magnetizing_A=meeting.magnetizing_A, damping_per_s=meeting.damping_per_s, eddy_s=meeting.eddy_s,
            charge_C=meeting.charge_C[0], curve=meeting.curve[0], dead_time_s=meeting.dead_time_s, sloped=sloped,
        )  # fmt: skip

    def take(self, chosen: Index) -> "_Alone":
        """Some of the legs."""
        own = {name: v.take(chosen) for name, v in vars(self).items() if name not in ("sloped", "behind")}
        behind = None if self.behind is None else self.behind.take(chosen, axis=1)
        return _Alone(sloped=self.sloped, behind=behind, **own)

    def slope(self, h: Array) -> tuple[Array, Array]:
        """dx/dt now, and what drops take of it on average through a time."""
        i, slope = self.x + self.magnetizing_A, self.base + self.own * self.u
        signed = self.signed + self.bent * self.u
        taken = signed * mean_sign(i, h * slope, h * signed) + self.damping_per_s * i
        if self.behind is not None:
            held = self.behind[0] + self.behind[1] * self.u
            taken = taken + held * mean_sign(i - self.shunted_A, h * slope, h * held)
        return slope - taken, taken

    def finish(self, k: int) -> NDArray[np.bool_]:
        """Carry on, to the end of the dead time, legs at a rail that their current holds them to; tells which."""
        left_s = (1.0 - _ENDS[k]) * self.dead_time_s
        slope, _ = self.slope(left_s)
        now, then = self.per_charge * self.x, self.per_charge * (self.x + left_s * slope)
        at_end = self.q >= FULL
        stays = (at_end & (now > 0) & (then > 0)) | ((self.q <= 0.0) & (now < 0) & (then < 0))
        passed = left_s * (0.5 * (now + then) + self.per_charge * self.eddy_s * slope)
        carried = np.where(stays, passed, 0.0)
        self.opposite = self.opposite + np.maximum(carried, 0.0)
        self.over = self.over + carried
        self.reached = self.reached + np.where(stays & at_end, left_s, 0.0)
        self.x = np.where(stays, self.x + left_s * slope, self.x)
        return np.asarray(stays)

    def step(self, curves: Curves, k: int) -> None:
        """One step."""
        h = (_ENDS[k + 1] - _ENDS[k]) * self.dead_time_s
        slope, taken = self.slope(h)
        lead, rate = 0.5 * h + self.eddy_s, self.per_charge * h
        moved = self.q + rate * (self.x + lead * slope)
        after = limited(moved, 0.0, FULL)
        beyond = moved - after
        u, rise, integral = curves.at(self.curve, after)
        mean = mean_position(u, integral - self.integral, after - self.q, moved - self.q)
        if self.sloped:
            self._step_tangent(h, lead, rate, rise, beyond == 0.0)
        self.integral = integral
        self.x = self.x + h * (self.base + self.own * mean - taken)
        self.opposite = self.opposite + np.maximum(beyond, 0.0)
        self.over = self.over + beyond
        self.reached = self.reached + (0.5 + 0.5 * mean) * h
        self.q, self.u = after, u

    def _step_tangent(self, h: Array, lead: Array, rate: Array, rise: Array, free: NDArray[np.bool_]) -> None:
        """The same step of the derivatives; ``free`` tells where no rail ends it."""
        self.dq = np.where(free, self.dq + rate * (self.dx + lead * (self.own * self.du)), 0.0)
        du = rise * self.dq
        change = 0.5 * h * (self.du + du)
        self.dx, self.du = self.dx + self.own * change, du
        self.reached_per_A = self.reached_per_A + 0.5 * change

    def outcome(self, chosen: Index | slice) -> Commutation:
        """The dead times (1, K) of some of the legs, once they are over."""
        charge_C, c, u = self.charge_C[chosen] / FULL, self.per_current[chosen], self.u[chosen]
        missing = 0.5 - 0.5 * u
        opposite, over = self.opposite[chosen] * charge_C, self.over[chosen] * charge_C
        result = Commutation(
            delay_s=self.dead_time_s[chosen] - self.reached[chosen],
            delay_per_A=-self.reached_per_A[chosen],
            missing=missing,
            opposite_C=opposite,
            same_C=opposite - over,
            turn_off_A=np.maximum(c * self.current_A[chosen], 0.0),
            turn_on_A=np.maximum(-c * self.x[chosen], 0.0) * missing,
        )
        return result.edge(np.newaxis)
