"""The law of :mod:`sim.march`, followed point by point in compiled code.

What a point is lies in rows that are named here: ``at`` (S,) what stays for a half period, ``now`` (25,) a piece from
where it starts, ``kept`` (KEPT, K, N) what is told of all of them.
"""

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]

_NEVER = -0.999999  # of a decay's asymptote: what the line alone carries over is left to Newton's rule
_CROSSINGS = 2  # steps: the line is a hundredth of the slope
_MEETINGS = 4  # with the magnetizing current: its slope may be most of the difference
_INSTANT_S = 1e-30
_TINY_V = 1e-30
_TINY = 1e-300  # stands for a decay of 0
_SMALL, _TERMS = 0.1, 8  # a decay for which integrals are made of their series, and of so many terms
_NONE = 1e-13  # of what a link voltage of the primary moves the current by in Th: no current of the secondary

# What stays: of a bridge, threshold and resistance with the current along its voltage, against it, in the zero state
V1, NV2, INDUCTANCE, HALF_PERIOD, DEAD_TIME, EDDY, BEHIND, PRIMARY = range(8)
SECONDARY = PRIMARY + 6  # of one whose drops depend on its own state
RELATIVE_L = SECONDARY + 6  # from here on, by bands of the flux
# What is given of each stretch
DURATION, VP, NVS, MAGNETIZING, RISE = range(5)
# What is kept of each piece, the last four where the secondary's drops depend on its own state
LENGTH, CURRENT, DRIVE, DECAY, SIGN, RELATIVE, SHARE, SHUNT = range(8)
BEHIND_OHM, BEHIND_V, BEHIND_SIGN, MEETS = range(8, 12)
OF_ALL, KEPT = 8, 12
# A piece where it starts: the current, the magnetizing one and its slope, voltages, how long is left; of the primary
# its threshold with its sign, all resistance that depends on no state of the secondary, the sign, whether that is a
# mean, and whether the current rests; the same of the secondary; then the terms of the current's law, where the
# piece ends at the latest, how fast the limit moves that it began at; and of the stretch its length, how much of that
# lies before the half period, and whether signs may turn in it
_I, _IM, _IM_SLOPE, _VP, _NVS, _LEFT, _V0, _R, _SIGN, _MEAN, _RESTS = range(11)
_V2, _R2, _SIGN2, _MEAN2, _RESTS2, _DRIVE, _DECAY, _SHARE, _RELATIVE, _UNTIL, _MET = range(11, 22)
_LENGTH, _PAST, _TURNS = range(22, 25)
_NOW = 25

_compiled = njit(cache=True, error_model="numpy")
_inlined = njit(inline="always", error_model="numpy")  # a call would cost more than what is done in it


@_compiled
def follow(given: Array, stretches: Array, start_A: Array, bends_A: Array, own: bool) -> Array:
    """The pieces (KEPT, K, N) of N half periods, as many in each of five stretches.

    ``given`` (S, N) and ``stretches`` (5, 5, N) have the rows named above. With ``own`` the secondary's drops depend on
    its state. A stretch has a piece to each bend and back, and two more where i and i_m may cross, and rest.
    """
    each, N = 2 * (bends_A.size + (2 if own else 1)), start_A.size
    kept = np.empty((KEPT if own else OF_ALL, 5 * each, N))
    at, now = np.empty(len(given)), np.empty(_NOW)
    for n in range(N):
        at[:] = given[:, n]
        now[_I] = start_A[n]
        _half_period(now, at, stretches[:, :, n], bends_A, kept[:, :, n], own)
    return kept


@_inlined
def _half_period(now: Array, at: Array, stretches: Array, bends_A: Array, kept: Array, own: bool) -> None:
    """The pieces (rows, K) of one point, stretch after stretch (5, 5)."""
    each = kept.shape[1] // 5
    for k in range(5):
        now[_LEFT], now[_VP], now[_NVS] = stretches[DURATION, k], stretches[VP, k], stretches[NVS, k]
        now[_IM], now[_IM_SLOPE] = stretches[MAGNETIZING, k], stretches[RISE, k]
        now[_MET], now[_LENGTH], now[_PAST] = 0.0, now[_LEFT], 0.0
        if k == 0:  # the half period's last stretch goes on in the next
            now[_PAST] = stretches[DURATION, 4]
            now[_LENGTH] += now[_PAST]
        elif k == 4:
            now[_LENGTH] += stretches[DURATION, 0]
        now[_TURNS] = 1.0 if now[_LENGTH] < at[DEAD_TIME] else 0.0
        last, ended = each * (k + 1), False
        for piece in range(each * k, last):
            if not ended:
                _drop(now, at, bends_A, own)
                _drive(now, at, bends_A, own)
                ended = _through(now, kept, piece, last, own)
                now[_TURNS] = 0.0  # that was of the whole stretch
            else:
                kept[LENGTH, piece], kept[CURRENT, piece] = 0.0, now[_I]


@_inlined
def _through(now: Array, kept: Array, piece: int, last: int, own: bool) -> bool:
    """Keep a piece and go to where it ends; tells whether the stretch does there."""
    line = now[_SHARE] * now[_IM_SLOPE]
    curved = now[_DRIVE] - now[_DECAY] * (now[_I] - now[_SHARE] * now[_IM])
    end_A = now[_I] + now[_LEFT] * (curved * _decay_integral(now[_DECAY] * now[_LEFT]) + line)
    kept[CURRENT, piece] = now[_I]
    for later in range(piece, last):  # pieces of no length at the end are as this one
        kept[DRIVE, later], kept[DECAY, later], kept[SIGN, later] = now[_DRIVE], now[_DECAY], now[_SIGN]
        kept[RELATIVE, later], kept[SHARE, later], kept[SHUNT, later] = (
            now[_RELATIVE], now[_SHARE], now[_IM],
        )  # fmt: skip
        if own:
            kept[BEHIND_OHM, later], kept[BEHIND_V, later] = now[_R2], now[_V2]
            kept[BEHIND_SIGN, later], kept[MEETS, later] = now[_SIGN2], now[_MET] if later == piece else 0.0
    time_s, met_A, limit_slope = np.inf, end_A, 0.0
    if piece + 1 < last:
        if (now[_UNTIL] - now[_I]) * (now[_UNTIL] - end_A) < 0.0:
            time_s = _time_s(
                now[_UNTIL] - now[_I], curved, line, now[_DECAY], _MEETINGS if own else _CROSSINGS
            )
            met_A = now[_UNTIL]
        if own and now[_RESTS2] == 0.0 and now[_MEAN2] == 0.0:
            to_go = now[_IM] - now[_I]
            if to_go * (to_go + now[_IM_SLOPE] * now[_LEFT] - (end_A - now[_I])) < 0.0:
                earlier_s = _time_s(to_go, curved, line - now[_IM_SLOPE], now[_DECAY], _MEETINGS)
                if earlier_s < time_s:
                    time_s, limit_slope = earlier_s, now[_IM_SLOPE]
                    met_A = now[_IM] + limit_slope * time_s
    ends = time_s == np.inf
    kept[LENGTH, piece] = now[_LEFT] if ends else time_s
    now[_I] = met_A
    if not ends:
        now[_MET] = limit_slope
        now[_LEFT] -= time_s
        now[_IM] += now[_IM_SLOPE] * time_s
    return ends


@_compiled
def _time_s(to_go: float, curved: float, line: float, decay: float, steps: int) -> float:
    """When it has gone so far, from a limit that goes away: as of one exponential, then by Newton's rule."""
    straight = to_go / (curved + line)
    x = max(-decay * straight, _NEVER)
    t = straight * (1.0 if x == 0.0 else np.log1p(x) / x)
    for _ in range(steps):
        gone = t * (curved * _decay_integral(decay * t) + line)
        t = max(t - (gone - to_go) / (curved * np.exp(-decay * t) + line), 0.0)
    return t


@_inlined
def _drive(now: Array, at: Array, bends_A: Array, own: bool) -> None:
    """What drives the current, lets it decay and goes straight, by what is dropped; and where that ends."""
    held = now[_RESTS] != 0.0
    R = now[_R] + (now[_R2] if own else 0.0)
    push_V = 0.0 if held else now[_VP] - now[_NVS] - (now[_V2] if own else 0.0) - now[_V0]
    now[_RELATIVE], now[_UNTIL] = 1.0, np.nan if now[_I] == 0.0 else 0.0
    if bends_A.size:
        size, outward = abs(now[_I]), (push_V - R * now[_I]) * now[_SIGN] >= 0.0
        band = 0
        for bend_A in bends_A:
            if bend_A < size or (outward and bend_A == size):
                band += 1
        now[_RELATIVE] = at[RELATIVE_L + band]
        reach = band + (1 if outward else 0)  # zero, the bends, and none beyond
        bound = 0.0 if reach == 0 else (np.inf if reach > bends_A.size else bends_A[reach - 1])
        now[_UNTIL] = np.nan if now[_SIGN] == 0.0 and bound == np.inf else now[_SIGN] * bound
    if now[_MEAN] != 0.0:
        now[_UNTIL] = np.nan
    inertia_H = now[_RELATIVE] * (at[INDUCTANCE] + R * at[EDDY])
    behind = now[_R2] if own else at[BEHIND]
    now[_SHARE] = behind / R if R > 0.0 and not held else 0.0
    now[_DRIVE] = push_V / inertia_H - now[_SHARE] * now[_IM_SLOPE]
    now[_DECAY] = R / inertia_H


@_inlined
def _drop(now: Array, at: Array, bends_A: Array, own: bool) -> None:
    """What both bridges drop where a piece starts.

    A current that the remaining voltage cannot lift over its threshold rests; one that the secondary's holds back runs
    with i_m, so that none is left for the secondary.
    """
    plain_V, behind_V, behind_Ohm = now[_VP] - now[_NVS], 0.0, at[BEHIND]
    now[_RESTS2] = 0.0
    if own:
        x = now[_I] - now[_IM]
        rests2 = abs(x) <= _NONE * at[V1] * at[HALF_PERIOD] / at[INDUCTANCE]
        now[_SIGN2], now[_RESTS2] = 0.0 if rests2 else np.sign(x), 1.0 if rests2 else 0.0
        now[_V2], now[_R2] = _law(at, SECONDARY, -now[_NVS], at[NV2], now[_SIGN2])
        now[_V2] *= now[_SIGN2]
        driven_V = plain_V - at[INDUCTANCE] * now[_IM_SLOPE]
        now[_MEAN2] = _turning(now, at, SECONDARY, x, driven_V)
        behind_V, behind_Ohm = now[_V2], now[_R2]
    at_rest_V = plain_V - behind_V + behind_Ohm * now[_IM]
    if now[_RESTS2] != 0.0:  # where neither has a current i goes with i_m
        at_rest_V = now[_IM_SLOPE]
    resting = now[_I] == 0.0
    now[_SIGN] = np.sign(at_rest_V) if resting else np.sign(now[_I])
    threshold_V, now[_R] = _law(at, PRIMARY, now[_VP], at[V1], now[_SIGN])
    now[_V0], now[_RESTS] = (
        now[_SIGN] * threshold_V,
        1.0 if resting and abs(at_rest_V) <= threshold_V else 0.0,
    )
    now[_MEAN] = _turning(now, at, PRIMARY, now[_I], plain_V)
    if now[_RESTS2] != 0.0:
        now[_RESTS] = 0.0
        _hold(now, at, bends_A)


@_inlined
def _law(at: Array, bridge: int, along_V: float, link_V: float, sign: float) -> tuple[float, float]:
    """Threshold and resistance of a bridge at a voltage, of the secondary reversed, for a sign of its current."""
    state = bridge + 4
    if abs(along_V) > 0.5 * link_V:
        state = bridge if along_V * sign > 0.0 else bridge + 2
    return at[state], at[state + 1]


@_compiled
def _turning(now: Array, at: Array, bridge: int, current_A: float, driven_V: float) -> float:
    r"""Drops of a bridge whose current may turn in a stretch shorter than a dead time, by a mean sign; 1 if it may.

    Both ends of such a stretch are instants that stand for swings under way. Its voltage is a mean, and may be none at
    all, where that of the link runs through zero: the current does not rest there, as it would with drops that take
    the sign of i all at once. The mean sign is that of dry friction (:func:`sim.commutation.mean_sign`) with the
    current spread by what half a link voltage of the primary makes of it, less the nearer the stretch is to a dead
    time. Drops are those of both signs by their shares; V0 has the sign.

    Assumption: that spread. It mends the gap in power wherever it is above the threshold.
    """
    length_s, per_L = now[_LENGTH], now[_LENGTH] / at[INDUCTANCE]
    if now[_TURNS] == 0.0 or abs(current_A) >= per_L * (abs(driven_V) + at[V1]):
        return 0.0
    along_V, link_V = (now[_VP], at[V1]) if bridge == PRIMARY else (-now[_NVS], at[NV2])
    up_V, up_Ohm = _law(at, bridge, along_V, link_V, 1.0)
    down_V, down_Ohm = _law(at, bridge, along_V, link_V, -1.0)
    past = now[_PAST] / max(length_s, _INSTANT_S)
    change, held = per_L * driven_V, 0.5 * per_L * (up_V + down_V)
    spread = 0.5 * per_L * at[V1] * (1.0 - length_s / at[DEAD_TIME])
    moved = 2.0 * (current_A - past * change) + change + min(max(change, -held), held)
    total = max(abs(change), held) + held + spread - 2.0 * past * held
    if not abs(moved) < total:
        return 0.0
    sign = moved / total
    up, down = 0.5 + 0.5 * sign, 0.5 - 0.5 * sign
    V0, R = up * up_V - down * down_V, up * up_Ohm + down * down_Ohm
    if bridge == PRIMARY:
        now[_V0], now[_R], now[_SIGN], now[_RESTS] = V0, R, sign, 0.0
    else:
        now[_V2], now[_R2], now[_SIGN2], now[_RESTS2] = V0, R, sign, 0.0
    return 1.0


@_compiled
def _hold(now: Array, at: Array, bends_A: Array) -> None:
    """A secondary without a current: its drop is such that i ends with i_m, at most its threshold.

    With x = i - i_m: L dx/dt = v - V0 - R i_m - u - L di_m/dt less all resistances times x, and the secondary's drop u
    is such that x = 0 again at the end.
    """
    up_V, up_Ohm = _law(at, SECONDARY, -now[_NVS], at[NV2], 1.0)
    down_V, down_Ohm = _law(at, SECONDARY, -now[_NVS], at[NV2], -1.0)
    mean_Ohm, slope, small = 0.5 * (up_Ohm + down_Ohm), now[_IM_SLOPE], 1.0
    if bends_A.size:
        band = 0
        for bend_A in bends_A:
            band += 1 if bend_A < abs(now[_I]) else 0
        small = at[RELATIVE_L + band]
    R = now[_R] + mean_Ohm
    inertia_H = small * (at[INDUCTANCE] + R * at[EDDY])
    middle_A = now[_IM] + slope * now[_LEFT] * _centre(R * now[_LEFT] / inertia_H)
    drop_V = now[_VP] - now[_NVS] - now[_V0] - now[_R] * middle_A - inertia_H * slope
    odd, even = 0.5 * (up_V - down_V), max(0.5 * (up_V + down_V), _TINY_V)
    sign = min(max((drop_V - odd) / even, -1.0), 1.0)
    now[_SIGN2], now[_V2] = sign, odd + sign * even
    now[_R2] = mean_Ohm if abs(sign) < 1.0 else (up_Ohm if sign > 0.0 else down_Ohm)


@_inlined
def _decay_integral(x: float) -> float:
    """As :func:`sim.decay.decay_integral`."""
    x = max(x, _TINY)
    return float(-np.expm1(-x) / x)


@_inlined
def _centre(x: float) -> float:
    """Where the centre of a decay lies: the second of the functions of :mod:`sim.decay` over the first."""
    if x >= _SMALL:
        first = _decay_integral(x)
        return (1.0 - first) / (x * first)
    third, term = 0.0, 1.0 / 6.0
    for k in range(_TERMS):
        third += term
        term *= -x / (k + 4)
    second = 0.5 - x * third
    return second / (1.0 - x * second)
