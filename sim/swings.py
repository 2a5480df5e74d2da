"""Legs on their way through the dead time: the law of :mod:`sim.commutation` in graded steps.

In a step the charge moves by the current and its slope at the start, the current by the mean of its slopes (Verlet's
rule, of second order). The mean position is that of the curve over the charge covered: a node that a large current
swings within one step costs no accuracy.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sim.commutation import FULL, Commutation, Curves, Meeting, limited, mean_position, mean_sign

Array = NDArray[np.float64]
Index = NDArray[np.intp]

_STEPS = 8  # of a leg; legs that meet take those of each other as well
_GRADE = 1.15  # finer at the start, where large currents swing nodes in nanoseconds
_LOOKS = (0, 3, 5)  # steps before which legs whose node will not move any more are done with
_FEW = 300  # groups that are not worth being told apart
_NONE = 1e-9  # of the dead time: a step so short is none


def commutate(meeting: Meeting, curves: Curves, *, sloped: bool = True) -> Commutation:
    """The dead times (m, K) of groups of legs; ``delay_per_A`` only of legs that are alone, where it is asked for."""
    whole, rows = Commutation.empty(*meeting.current_A.shape), np.arange(meeting.current_A.shape[1])
    if len(meeting.current_A) == 1:
        _integrate(_Alone.of(meeting, sloped=sloped), curves, whole, rows)
        return whole
    at_once = np.all(meeting.opens_s == 0.0, axis=0)  # their steps are the same: half as many
    if rows.size < _FEW or not np.any(at_once) or np.all(at_once):
        _integrate(_Together.of(meeting), curves, whole, rows)
        return whole
    for part in (rows[at_once], rows[~at_once]):
        _integrate(_Together.of(meeting.take(part)), curves, whole, part)
    return whole


def _integrate(legs: "_Alone | _Together", curves: Curves, whole: Commutation, rows: Index) -> None:
    """Take legs through their dead times into rows of the whole."""
    columns = whole.delay_s.shape[1] * np.arange(len(whole.delay_s))[:, None]
    for k in range(legs.steps):
        if k in legs.looks:
            stays = legs.finish(k)
            if stays.any():
                (done,), (going,) = stays.nonzero(), (~stays).nonzero()
                whole.put(columns + rows[done], legs.outcome(done))
                if not going.size:
                    return
                legs, rows = legs.take(going), rows[going]
        legs.step(curves, k)
    whole.put(columns + rows, legs.outcome(slice(None)))


def _grid(steps: int) -> Array:
    """Ends of graded steps, over the dead time."""
    return np.asarray((np.arange(steps + 1) / steps) ** _GRADE)


_ENDS = _grid(_STEPS).tolist()


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

    looks = _LOOKS

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

    @property
    def steps(self) -> int:
        """How many steps a dead time has."""
        return _STEPS

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


def _steps_of_all(meeting: Meeting) -> tuple[Array, Array]:
    """Starts and lengths (S, K) of the graded steps of all legs of a group, in order, those of no length at the end."""
    graded = _grid(_STEPS)[:, None, None] * meeting.dead_time_s + meeting.opens_s
    nodes = np.sort(graded.reshape(-1, graded.shape[-1]), axis=0)
    starts, steps = nodes[:-1], np.diff(nodes, axis=0)
    used = steps > _NONE * meeting.dead_time_s
    most = int(np.max(np.sum(used, axis=0)))
    if most < len(steps):
        order = np.argsort(~used, axis=0, kind="stable")[:most]
        used = np.take_along_axis(used, order, axis=0)
        starts = np.where(used, np.take_along_axis(starts, order, axis=0), nodes[-1])
        steps = np.where(used, np.take_along_axis(steps, order, axis=0), 0.0)
    return starts, steps


@dataclass(kw_only=True)
class _Together:
    """K groups of m legs that meet, half way through their dead times, arrays (m, K).

    ``starts_s`` and ``steps_s`` (S, K) are the graded steps of every leg, in order, ``begun`` and ``moving`` (S, m, K)
    tell in which a leg has opened, and not closed yet, ``all_begun`` and ``all_moving`` where each leg has;
    ``integral`` is that of the curve so far; ``opened_A`` and ``closed_A`` are x where the dead time begins and ends,
    ``last`` the position there.
    """

    x: Array
    q: Array
    u: Array
    integral: Array
    reached: Array
    opposite: Array
    over: Array
    opened_A: Array
    closed_A: Array
    last: Array
    starts_s: Array
    steps_s: Array
    begun: NDArray[np.bool_]
    moving: NDArray[np.bool_]
    all_begun: list[bool]
    all_moving: list[bool]
    closes_s: Array
    per_charge: Array
    meeting: Meeting

    @classmethod
    def of(cls, meeting: Meeting) -> "_Together":
        """Before the first of them opens."""
        x, zero = meeting.current_A, np.zeros_like(meeting.current_A)
        starts_s, steps_s = _steps_of_all(meeting)
        closes_s, middle = meeting.opens_s + meeting.dead_time_s, (starts_s + 0.5 * steps_s)[:, None]
        begun = middle > meeting.opens_s
        moving = begun & (middle <= closes_s)
        return cls(
            x=x, q=zero, u=zero - 1.0, integral=zero, reached=zero, opposite=zero, over=zero,
            opened_A=x, closed_A=x, last=x, starts_s=starts_s, steps_s=steps_s,
            begun=begun, moving=moving, all_begun=np.all(begun, axis=(1, 2)).tolist(),
            all_moving=np.all(moving, axis=(1, 2)).tolist(), closes_s=closes_s,
            per_charge=meeting.per_charge(), meeting=meeting,
        )  # fmt: skip

    def take(self, chosen: Index) -> "_Together":
        """Some of the groups."""
        own = {n: v.take(chosen, axis=-1) for n, v in vars(self).items() if isinstance(v, np.ndarray)}
        return _Together(
            meeting=self.meeting.take(chosen), all_begun=self.all_begun, all_moving=self.all_moving, **own
        )

    @property
    def steps(self) -> int:
        """How many steps there are from the first leg that opens to the last one that closes."""
        return len(self.steps_s)

    @property
    def looks(self) -> tuple[int, ...]:
        """Steps before which groups are looked at whether they will move any more."""
        return tuple(self.steps * k // _STEPS for k in _LOOKS[1:])

    def finish(self, k: int) -> NDArray[np.bool_]:
        """Carry on to the end groups whose legs are all at the new rail and held there; tells which."""
        meeting, now_s = self.meeting, self.starts_s[k]
        left_s = np.maximum(self.closes_s - now_s, 0.0)
        u = np.where(left_s == 0.0, 1.0, self.u)
        driven = meeting.driven(u)
        slope = driven - self._taken(np.max(left_s, axis=0), driven[0], u)
        now, then = self.per_charge * self.x, self.per_charge * (self.x + left_s * slope)
        held = (left_s == 0.0) | ((self.q >= FULL) & (now > 0) & (then > 0))
        stays = np.all((held & (now_s >= meeting.opens_s)) | (self.per_charge == 0.0), axis=0)
        passed = left_s * (0.5 * (now + then) + self.per_charge * meeting.eddy_s * slope)
        carried = np.where(stays, passed, 0.0)
        self.opposite, self.over = self.opposite + carried, self.over + carried
        self.reached = self.reached + np.where(stays, left_s, 0.0)
        return np.asarray(stays)

    def _taken(self, h: Array, driven: Array, position: Array) -> Array:
        """What drops take, on average through a time, of the slope to which voltages drive the link current."""
        meeting, i = self.meeting, self.x[0] + self.meeting.magnetizing_A
        signed, plain = meeting.dropped(position)
        change = h * (driven - plain)
        taken = plain + meeting.damping_per_s * i + signed[0] * mean_sign(i, change, h * signed[0])
        for held in signed[1:]:
            taken = taken + held * mean_sign(i - meeting.shunted_A, change, h * held)
        return np.asarray(taken)

    def step(self, curves: Curves, k: int) -> None:
        """One step; in it no leg opens or closes."""
        meeting, h, begun, moving = self.meeting, self.steps_s[k], self.begun[k], self.moving[k]
        q, u, all_moving = self.q, self.u, self.all_moving[k]
        if not all_moving:  # what has closed is at the new rail
            done = begun & ~moving
            q, u = np.where(done, FULL, q), np.where(done, 1.0, u)
        driven, own_h = meeting.driven(u), h if all_moving else moving * h
        taken = self._taken(h, driven[0], u)
        driven -= taken
        moved = self.per_charge * own_h * (self.x + (0.5 * h + meeting.eddy_s) * driven)
        ahead = q + moved
        after = limited(ahead, 0.0, FULL)
        u, _, integral = curves.at(meeting.curve, after)
        mean = mean_position(u, integral - self.integral, after - q, moved)
        beyond = ahead - after
        self.q, self.u, self.integral, self.over = after, u, integral, self.over + beyond
        self.opposite = self.opposite + np.maximum(beyond, 0.0)
        self.reached = self.reached + own_h * (0.5 + 0.5 * mean)
        self.x = self.x + h * (meeting.driven(mean) - taken)
        if not self.all_begun[k]:
            self.opened_A = np.where(begun, self.opened_A, self.x)
        self.closed_A = self.x if all_moving else np.where(moving, self.x, self.closed_A)
        self.last = u if all_moving else np.where(moving, u, self.last)

    def outcome(self, chosen: Index | slice) -> Commutation:
        """The dead times (m, K) of some of the groups, once they are over."""
        meeting, which = self.meeting, (slice(None), chosen)
        c, charge_C, missing = (
            meeting.per_current[which],
            meeting.charge_C[which] / FULL,
            0.5 - 0.5 * self.last[which],
        )
        opposite = self.opposite[which]
        return Commutation(
            delay_s=meeting.dead_time_s[chosen] - self.reached[which],
            delay_per_A=np.zeros_like(c),
            missing=missing,
            opposite_C=charge_C * opposite,
            same_C=charge_C * (opposite - self.over[which]),
            turn_off_A=np.maximum(c * self.opened_A[which], 0.0),
            turn_on_A=np.maximum(-c * self.closed_A[which], 0.0) * missing,
        )
