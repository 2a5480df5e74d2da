"""The law of :mod:`sim.commutation` for legs that meet, integrated group by group in compiled code.

A group takes a dozen steps or more, each of some dozens of numbers: as arrays over a few groups they would cost a
microsecond a call. What a group is made of lies in two arrays, whose rows are named here: ``legs`` (COUPLING + m, m) of
what each leg has, ``link`` (S,) of what they share. ``way`` (13, m) is where the legs are.
"""

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]

_TINY_A = 1e-30
_LEAST = 1e-14  # square of a movement, in intervals, that is none
_NONE = 1e-9  # of the dead time: a step so short is none
_LOOKS, _OF = (3, 5), 8  # eighths of the steps after which it is asked whether any node will move any more
BRIDGES = 2  # that have drops of their own

# What is given of each leg, as in a Meeting; PER_LEG is of each bridge, COUPLING to each leg
CURRENT, PER_CURRENT, OUTSIDE, CHARGE, CURVE, OPENS, PER_LEG = range(7)
COUPLING = PER_LEG + BRIDGES
# What is given of the link: drops of each bridge, and what is one for all; FULL is a whole swing's charge, in intervals
# of its curve. What compiled code takes from another file it would keep when that one changes, so it is given too
LEVEL, ZERO, EVEN, ODD = range(0, 4 * BRIDGES, BRIDGES)
MAGNETIZING, SHUNTED, DAMPING, EDDY, DEAD, FULL = range(4 * BRIDGES, 4 * BRIDGES + 6)
# What is found, as in a Commutation
DELAY, DELAY_PER_A, MISSING, OPPOSITE_C, SAME_C, TURN_OFF, TURN_ON = range(7)
ENDS = 7
# Where a leg is: current, charge in intervals, position, the curve's integral, time spent at the new rail, charge past
# it, and past both; x where it opens and where it closes, its position there; how far the charge moves per charge of x;
# in a step dx/dt and the mean position
_X, _Q, _U, _INTEGRAL, _REACHED, _OPPOSITE, _OVER, _OPENED, _CLOSED, _LAST, _MOVES, _SLOPE, _MEAN = range(13)
_WAY = 13

_compiled = njit(cache=True, error_model="numpy")
_inlined = njit(inline="always", error_model="numpy")  # a call would cost more than what is done in it


@_compiled
def integrate(given: Array, link: Array, curves: Array, grid: Array) -> Array:
    """Take K groups of m legs, (COUPLING + m, m, K) and (S, K), through their dead times: (ENDS, m, K).

    ``curves`` (3, 65 n) are position, rise and integral of n curves, ``grid`` (S + 1,) the ends of graded steps over a
    dead time, from 0 to 1. How a delay moves with the current is not asked.
    """
    _, m, K = given.shape
    way, ends, nodes = np.empty((_WAY, m)), np.zeros((ENDS, m, K)), np.empty(m * grid.size)
    legs, shared = np.empty((given.shape[0], m)), np.empty(link.shape[0])
    for k in range(K):
        legs[:] = given[:, :, k]
        shared[:] = link[:, k]
        _begin(way, legs, shared[FULL])
        count = _steps(nodes, legs, shared[DEAD], grid)
        _go(way, legs, shared, curves, nodes[:count])
        for j in range(m):
            charge_C, missing = legs[CHARGE, j] / shared[FULL], 0.5 - 0.5 * way[_LAST, j]
            ends[DELAY, j, k] = shared[DEAD] - way[_REACHED, j]
            ends[MISSING, j, k] = missing
            ends[OPPOSITE_C, j, k] = charge_C * way[_OPPOSITE, j]
            ends[SAME_C, j, k] = charge_C * (way[_OPPOSITE, j] - way[_OVER, j])
            ends[TURN_OFF, j, k] = max(legs[PER_CURRENT, j] * way[_OPENED, j], 0.0)
            ends[TURN_ON, j, k] = max(-legs[PER_CURRENT, j] * way[_CLOSED, j], 0.0) * missing
    return ends


@_inlined
def _begin(way: Array, legs: Array, full: float) -> None:
    """Before the first leg of a group opens."""
    way[:] = 0.0
    for j in range(way.shape[1]):
        way[_X, j] = way[_OPENED, j] = way[_CLOSED, j] = legs[CURRENT, j]
        way[_U, j] = way[_LAST, j] = -1.0
        way[_MOVES, j] = legs[PER_CURRENT, j] * (full / legs[CHARGE, j])


@_compiled
def _steps(nodes: Array, legs: Array, dead_s: float, grid: Array) -> int:
    """Write where the graded steps of all legs of a group begin and end, in order; tells how many such nodes."""
    count = 0
    for j in range(legs.shape[1]):
        for share in grid:  # later than most that are there
            node, place = legs[OPENS, j] + share * dead_s, count
            while place > 0 and nodes[place - 1] > node:
                nodes[place] = nodes[place - 1]
                place -= 1
            nodes[place] = node
            count += 1
    kept = 1
    for i in range(1, count):
        if nodes[i] - nodes[kept - 1] > _NONE * dead_s:
            nodes[kept] = nodes[i]
            kept += 1
    return kept


@_inlined
def _go(way: Array, legs: Array, link: Array, curves: Array, nodes: Array) -> None:
    """From the first leg that opens to the last one that closes."""
    steps = nodes.size - 1
    for n in range(steps):
        looks = False
        for eighths in _LOOKS:
            looks = looks or n == steps * eighths // _OF
        if looks and _rest(way, legs, link, nodes[n]):
            break
        h = nodes[n + 1] - nodes[n]
        _step(way, legs, link, curves, nodes[n] + 0.5 * h, h)


@_inlined
def _step(way: Array, legs: Array, link: Array, curves: Array, middle_s: float, h: float) -> None:
    """One step, in which no leg opens or closes.

    In it the charge moves by the current and its slope at the start, the current by the mean of its slopes.
    """
    for j in range(way.shape[1]):
        if middle_s > legs[OPENS, j] + link[DEAD]:  # what has closed is at the new rail
            way[_Q, j], way[_U, j] = link[FULL], 1.0
    taken = _taken(way, legs, link, h)
    for j in range(way.shape[1]):
        way[_SLOPE, j] = _driven(legs, way[_U], j) - taken
    for j in range(way.shape[1]):
        moving = legs[OPENS, j] < middle_s <= legs[OPENS, j] + link[DEAD]
        own_h = h if moving else 0.0
        moved = way[_MOVES, j] * own_h * (way[_X, j] + (0.5 * h + link[EDDY]) * way[_SLOPE, j])
        ahead = way[_Q, j] + moved
        after = min(max(ahead, 0.0), link[FULL])
        place = min(max(int(after), 0), int(link[FULL]))  # a current that is no number has no place
        part, at = after - place, int(legs[CURVE, j]) + place
        low, risen = curves[0, at], curves[1, at] * part
        u, integral = low + risen, curves[2, at] + part * (low + 0.5 * risen)
        covered, beyond = after - way[_Q, j], ahead - after
        mean = u + (integral - way[_INTEGRAL, j] - u * covered) * moved / (moved * moved + _LEAST)
        way[_Q, j], way[_U, j], way[_INTEGRAL, j], way[_MEAN, j] = after, u, integral, mean
        way[_OVER, j] += beyond
        way[_OPPOSITE, j] += max(beyond, 0.0)
        way[_REACHED, j] += own_h * (0.5 + 0.5 * mean)
        if moving:
            way[_LAST, j] = u
    for j in range(way.shape[1]):
        way[_X, j] += h * (_driven(legs, way[_MEAN], j) - taken)
        if middle_s <= legs[OPENS, j]:
            way[_OPENED, j] = way[_X, j]
        elif middle_s <= legs[OPENS, j] + link[DEAD]:
            way[_CLOSED, j] = way[_X, j]


@_compiled
def _rest(way: Array, legs: Array, link: Array, now_s: float) -> bool:
    """Carry a group on to the end whose legs are all at the new rail and held there, if it is one."""
    rests, left_s = True, 0.0
    for j in range(way.shape[1]):
        own_s = max(legs[OPENS, j] + link[DEAD] - now_s, 0.0)
        left_s = max(left_s, own_s)
        if own_s == 0.0:
            way[_U, j] = 1.0
        elif way[_MOVES, j] != 0.0:
            rests = rests and now_s >= legs[OPENS, j] and way[_Q, j] >= link[FULL]
    if rests:
        taken = _taken(way, legs, link, left_s)
        for j in range(way.shape[1]):
            own_s = max(legs[OPENS, j] + link[DEAD] - now_s, 0.0)
            way[_SLOPE, j] = _driven(legs, way[_U], j) - taken
            now = way[_MOVES, j] * way[_X, j]
            then = way[_MOVES, j] * (way[_X, j] + own_s * way[_SLOPE, j])
            held = own_s == 0.0 or way[_MOVES, j] == 0.0 or (now > 0.0 and then > 0.0)
            rests = rests and held
    if rests:
        for j in range(way.shape[1]):
            own_s = max(legs[OPENS, j] + link[DEAD] - now_s, 0.0)
            middle_A = way[_X, j] + (0.5 * own_s + link[EDDY]) * way[_SLOPE, j]
            way[_OPPOSITE, j] += own_s * way[_MOVES, j] * middle_A
            way[_OVER, j] += own_s * way[_MOVES, j] * middle_A
            way[_REACHED, j] += own_s
    return rests


@_inlined
def _driven(legs: Array, position: Array, j: int) -> float:
    """dx/dt of a leg with all at positions from -1 to 1, without drops."""
    slope = legs[OUTSIDE, j]
    for n in range(position.size):
        slope += legs[COUPLING + n, j] * position[n]
    return float(slope)


@_inlined
def _taken(way: Array, legs: Array, link: Array, h: float) -> float:
    """What drops and resistance take of dx/dt, on average through a time."""
    i, change, taken = way[_X, 0] + link[MAGNETIZING], _driven(legs, way[_U], 0), 0.0
    for bridge in range(BRIDGES):
        plain = _level(legs, link, way[_U], bridge) * link[ODD + bridge]
        change, taken = change - plain, taken + plain
    taken += link[DAMPING] * i
    for bridge in range(BRIDGES):
        held = link[ZERO + bridge] + abs(_level(legs, link, way[_U], bridge)) * link[EVEN + bridge]
        taken += held * _mean_sign(i - bridge * link[SHUNTED], h * change, h * held)
    return float(taken)


@_inlined
def _level(legs: Array, link: Array, position: Array, bridge: int) -> float:
    """A bridge's voltage over its link's."""
    level = link[LEVEL + bridge]
    for n in range(position.size):
        level += legs[PER_LEG + bridge, n] * position[n]
    return float(level)


@_inlined
def _mean_sign(current_A: float, change_A: float, held_A: float) -> float:
    """As :func:`sim.commutation.mean_sign`."""
    moved = 2.0 * current_A + change_A + min(max(change_A, -held_A), held_A)
    return float(min(max(moved / (max(abs(change_A), held_A) + held_A + _TINY_A), -1.0), 1.0))
