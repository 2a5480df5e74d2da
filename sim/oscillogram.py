"""Waveforms vp, vs and iL of operating points over a whole period, with the real slopes of the dead times."""

import numpy as np

from sim.model import Model
from sim.operating_points import Points
from sim.solved import Solved, solve_points
from sim.stepping import Stepper, Steps, Trace, settle


def oscillogram(model: Model, points: Points, steps: Steps | None = None) -> Trace:
    """A period of N points in their steady state from S1's rising edge on, arrays (S, N), as an oscilloscope shows it.

    D0 is the simulator's, the waveform that of :mod:`sim.stepping`.

    Raises
    ------
    ParameterError
        For the first point that cannot run, with the reason.

    >>> point = Points(D1=0.9, D2=0.1, power_W=600.0)
    >>> trace = oscillogram(Model.baseline(), point, Steps(in_dead_time=9, in_half_period=20))
    >>> trace.vp_V.max().round().item(), trace.vs_V.max().round().item()
    (300.0, 140.0)
    """
    return oscillogram_of(solve_points(model, points), steps)


def oscillogram_of(solved: Solved, steps: Steps | None = None) -> Trace:
    """The same of points that are solved already."""
    half = settle(Stepper(circuit=solved.circuit, steps=steps or Steps()), solved.edges).trace
    return Trace(
        time_s=np.concatenate([half.time_s, half.time_s + solved.circuit.half_period_s]),
        vp_V=np.concatenate([half.vp_V, -half.vp_V]),
        vs_V=np.concatenate([half.vs_V, -half.vs_V]),
        current_A=np.concatenate([half.current_A, -half.current_A]),
        magnetizing_A=np.concatenate([half.magnetizing_A, -half.magnetizing_A]),
        output_V=np.concatenate([half.output_V, half.output_V]),
    )
