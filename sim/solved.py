"""The circuit, edges and orbit behind a simulated point, for whoever wants more of it than the result's columns."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sim.circuit import Temperatures, build_circuit
from sim.fixed_point import operate
from sim.model import Model
from sim.modulation import centre_offset, hybrid_edges
from sim.operating_points import Points
from sim.parameters import Converter, ParameterError
from sim.simulate import Result, simulate
from sim.steady_state import Circuit, Orbit

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True)
class Solved:
    """N points in their steady state: ``edges`` (4, N) in units of Th, at the D0 that delivers the power."""

    converter: Converter
    points: Points
    temperatures: Temperatures
    circuit: Circuit
    edges: Array
    orbit: Orbit
    result: Result


def solve_points(model: Model, points: Points) -> Solved:
    """Solve points that all run.

    Raises
    ------
    ParameterError
        For the first point that cannot run, with the reason.
    """
    result = simulate(model, points)
    for k in np.flatnonzero(~result.feasible)[:1].tolist():
        at = f"D1 = {points.D1[k]:g}, D2 = {points.D2[k]:g}, {points.power_W[k]:g} W"  # type: ignore[index]
        raise ParameterError(f"{at} cannot run: {result.reason[k]}")
    converter, moved = model.altered_converter(), model.set_points(points)
    found = operate(converter, moved)
    state = found.state
    D1, D2 = np.asarray(moved.D1), np.asarray(moved.D2)
    late = np.array([0.0, 0.0, 1.0, 1.0])[:, None] * converter.secondary_delay_s / converter.half_period_s
    V1 = moved.V1_V - converter.input_cable_Ohm * state.balance.I1_A
    V2 = moved.V2_V + converter.output_cable_Ohm * moved.power_W / moved.V2_V
    return Solved(
        converter=converter,
        points=moved,
        temperatures=state.temperatures,
        circuit=build_circuit(found.station.converter, state.temperatures, np.asarray(V1), np.asarray(V2)),
        edges=hybrid_edges(state.regulated.phase - centre_offset(D1, D2), D1, D2) + late,
        orbit=state.regulated.orbit,
        result=result,
    )
