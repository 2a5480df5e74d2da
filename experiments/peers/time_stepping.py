r"""The ac link stepped through time, as a peer of the exact waveform solver.

Between the legs' positions u (from -1/2 to 1/2 of their swing) and the link current i:

.. math:: L \dot\imath = V_1 (u_1 + u_2) - n V_2 (u_3 + u_4) - \sigma V_0 - R i

While a leg's switches are both off, in its dead time, the current that leaves it moves its charge, and its
position follows the charge along the curve of its capacitances; at the end of the dead time the rest is
switched hard. The magnetizing current follows n vs. Explicit steps of a fixed length take current, charges and
magnetizing current through half a period. They close by half-wave symmetry: every half period starts from the
mean of the last one's start and its negated end. The loop around D0 is closed by Chandrupatla's root finder
(SciPy's), for all points at once.

Shared with the solver are the parameters alone: voltages, drops, charges, curves, edges.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import elementwise

from sim.soft_switching import CURVE_POINTS
from sim.steady_state import Circuit

Array = NDArray[np.float64]

_CHARGE_SHARES = np.linspace(0.0, 1.0, CURVE_POINTS)
_SECONDARY = np.array([0.0, 0.0, 1.0, 1.0])[:, None]  # a phase moves the secondary's edges
_PHASES = (-0.05, 0.5)  # of the rising branch; soft edges carry a little power even below 0
_POWER_W, _PHASE = 0.5, 1e-5  # where the search for D0 stops: half a watt


@dataclass(frozen=True, slots=True, kw_only=True)
class Stepped:
    """The last half period of N points: rms current, power into the secondary bridge, how far from closing."""

    rms_A: Array
    output_W: Array
    open_A: Array


@dataclass(frozen=True, slots=True, kw_only=True)
class _State:
    """Link and magnetizing current (N,), and the charge of each leg (4, N), counted from its old rail."""

    link_A: Array
    magnetizing_A: Array
    charge_C: Array


def step_to_steady_state(circuit: Circuit, edges: Array, *, step_s: float, half_periods: int = 6) -> Stepped:
    """Step N points, with edges (4, N) in units of the half period, for so many half periods."""
    size = circuit.V1_V.size
    state = _State(link_A=np.zeros(size), magnetizing_A=np.zeros(size), charge_C=circuit.charge_C)
    steps = round(float(circuit.half_period_s[0]) / step_s)
    for _ in range(half_periods):
        end, square, power_W = _half_period(circuit, edges, state, steps)
        open_A = state.link_A + end.link_A
        state = replace(
            end,
            link_A=0.5 * (state.link_A - end.link_A),
            magnetizing_A=0.5 * (state.magnetizing_A - end.magnetizing_A),
        )
    return Stepped(rms_A=np.sqrt(square), output_W=power_W, open_A=np.abs(open_A))


def steady_phase(circuit: Circuit, edges: Array, output_W: Array, *, step_s: float) -> Array:
    """Phase (N,) in units of the half period at which a power arrives; NaN where it does not below 1/2.

    ``edges`` (4, N) are those at phase 0, ``output_W`` (N,) is the power into the secondary bridge.
    """

    def missing_W(phase: Array, point: NDArray[np.intp]) -> Array:
        k = point.ravel()
        moved = edges[:, k] + _SECONDARY * phase.ravel()
        stepped = step_to_steady_state(circuit.take(k), moved, step_s=step_s)
        return np.asarray((stepped.output_W - output_W[k]).reshape(phase.shape))

    low, high = (np.full(output_W.size, phase) for phase in _PHASES)
    found = elementwise.find_root(
        missing_W, (low, high), args=(np.arange(output_W.size),),
        tolerances={"fatol": _POWER_W, "xatol": _PHASE},
    )  # fmt: skip
    return np.where(found.success, found.x, np.nan)


def _half_period(circuit: Circuit, edges: Array, start: _State, steps: int) -> tuple[_State, Array, Array]:
    """The state after half a period; mean square current and mean power over it."""
    h = circuit.half_period_s / steps
    dead = circuit.dead_time_s / circuit.half_period_s
    half = 0.5 * np.stack([circuit.V1_V, circuit.V1_V, circuit.nV2_V, circuit.nV2_V])
    i, im, q = start.link_A, start.magnetizing_A, start.charge_C
    power, square = np.zeros_like(i), np.zeros_like(i)
    for k in range(steps):
        since = np.mod((k + 1) / steps - edges, 1.0)  # from each leg's edge to the end of this step
        opened = np.minimum(since * steps, 1.0)  # share of the step after the edge
        closed = np.clip(
            (since - dead) * steps, 0.0, 1.0
        )  # share after the dead time: all the way, hard or not
        q = np.where(since * steps < 1.0, 0.0, q)
        rising = np.where(np.mod((k + 1) / steps - edges, 2.0) < 1.0, 1.0, -1.0)
        position = _position(circuit, q) * (1.0 - closed) + closed
        level = rising * half * (2.0 * position - 1.0)
        vp, nvs = level[0] + level[1], level[2] + level[3]
        after = i + h * _slope(circuit, vp, nvs, i)
        mid = 0.5 * (i + after)
        power, square = power + nvs * mid, square + mid * mid
        secondary = circuit.turns_ratio * (mid - im)
        leaving = rising * np.stack([-mid, -mid, secondary, secondary])
        q = np.clip(q + h * leaving * opened, 0.0, circuit.charge_C)
        im = im + h * nvs / circuit.magnetizing_H
        i = after
    return _State(link_A=i, magnetizing_A=im, charge_C=q), square / steps, power / steps


def _position(circuit: Circuit, charge_C: Array) -> Array:
    """Share of the swing (4, N) at these charges; all points have one set of capacitances."""
    share = charge_C / circuit.charge_C
    return np.stack([np.interp(share[k], _CHARGE_SHARES, circuit.curves[k, 0]) for k in range(4)])


def _slope(circuit: Circuit, vp: Array, nvs: Array, i: Array) -> Array:
    """di/dt in A/s; a current that crosses zero has the wrong drop for one step, a fraction of a mA."""
    live = np.abs(vp) > 0.5 * circuit.V1_V
    V0, R = (
        np.where(live, np.where(vp * i > 0, circuit.forward[k], circuit.reverse[k]), circuit.zero[k])
        for k in (0, 1)
    )
    return np.asarray((vp - nvs - np.sign(i) * V0 - R * i) / circuit.inductance_H)
