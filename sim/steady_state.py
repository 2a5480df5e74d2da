"""The exact periodic steady state of the ac link.

Half-wave symmetry i(Th) = -i(0) closes an orbit (:mod:`sim.march`); each of its four edges is delayed by what its
dead time makes of the current there (:mod:`sim.dead_times`). Newton's rule finds it (:mod:`sim.newton`); orbits that
still do not close are left to Anderson acceleration, points whose power is not met to the bracketed search in
:mod:`sim.regulation`.
"""

import numpy as np
from numpy.typing import NDArray

from sim.anderson import accelerated
from sim.dead_times import magnetizing_current
from sim.newton import Demand, Effort, settle, step_once
from sim.orbit import COARSE, FINE, NEAR, SHIFT, Accuracy, Orbit, Sweep
from sim.pieces import Pieces
from sim.waveform import Circuit, lossless_start_A

__all__ = [
    "COARSE",
    "FINE",
    "NEAR",
    "SHIFT",
    "Accuracy",
    "Circuit",
    "Demand",
    "Effort",
    "Orbit",
    "Pieces",
    "half_period",
    "lossless_start_A",
    "magnetizing_current",
    "periodic",
    "settle",
    "step_once",
]

Array = NDArray[np.float64]

_SWEEPS = 120
_RESTART = 9  # every so many sweeps a plain step, in case the acceleration chases its tail


def half_period(
    circuit: Circuit, edges: Array, state: Array, accuracy: Accuracy = FINE
) -> tuple[Orbit, Array]:
    """The half period from a state (6, N), and by how much it does not close: current in A, delays in Th, (5, N)."""
    sweep = Sweep.of(circuit, edges, state, sloped=False)
    return sweep.orbit(state, accuracy), np.concatenate([sweep.gap_A[None], sweep.late])


def periodic(
    circuit: Circuit, edges: Array, start_A: Array, delay: Array, accuracy: Accuracy = FINE
) -> Orbit:
    """The orbit for given edges (4, N) in units of Th, from a first guess of start current and delays."""
    guess = np.concatenate([start_A[None], delay, np.zeros((1, start_A.size))])
    state, orbit, _ = settle(circuit, edges, guess, None, accuracy=accuracy)
    open_ = np.flatnonzero(~orbit.closed)
    if not open_.size:
        return orbit
    state[:, open_] = _anderson(circuit.take(open_), edges.take(open_, axis=1), guess.take(open_, axis=1))
    return half_period(circuit, edges, state)[0]


def _anderson(circuit: Circuit, edges: Array, state: Array) -> Array:
    """Anderson acceleration of depth two (Walker and Ni, 2011) of the map "half period, then dead times".

    The closing error i(Th) + i(0) has a slope near 2, so half of it is the plain step.
    """
    unit = np.ones((6, 1)) + np.eye(6)[:, :1] * (
        circuit.V1_V * circuit.half_period_s / circuit.inductance_H - 1.0
    )
    longest = circuit.dead_share
    now, history = state / unit, np.full((4, *state.shape), np.nan)  # last state and step, and those before
    for turn in range(_SWEEPS):
        sweep = Sweep.of(circuit, edges, now * unit, sloped=False)
        done = sweep.closes(now[0] * unit[0], FINE)
        if np.all(done):
            break
        step = np.concatenate([(-0.5 * sweep.gap_A / unit[0])[None], sweep.late, np.zeros_like(now[:1])])
        ahead = now + (step if turn % _RESTART == _RESTART - 1 else accelerated(now, step, history))
        ahead[1:5] = np.clip(ahead[1:5], 0.0, longest)
        history[2:] = history[:2]
        history[0], history[1] = now, step
        now = np.where(done, now, ahead)
    return now * unit
