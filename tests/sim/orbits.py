"""Periodic orbits of the prototype at chosen or random points, for tests that check them by other means."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from sim.circuit import Temperatures, build_circuit
from sim.modulation import centre_offset, hybrid_edges
from sim.parameters import Conduction, Converter
from sim.prototype import prototype
from sim.steady_state import Circuit, Orbit, periodic

Array = NDArray[np.float64]

JUNCTION_C = 60.0
PHASE_SHIFT = np.array([0.0, 0.0, 1.0, 1.0])[:, None]  # moves the secondary's edges


@dataclass(frozen=True, slots=True, kw_only=True)
class Case:
    """N solved points: the circuit, the edges (4, N) in units of Th, and the orbit."""

    circuit: Circuit
    edges: Array
    orbit: Orbit

    @property
    def rms_A(self) -> Array:
        """Rms link current from the solver's own pieces."""
        return np.sqrt(np.sum(self.orbit.pieces.square(), axis=0) / self.circuit.half_period_s)


def circuit(count: int, converter: Converter | None = None) -> Circuit:
    """The prototype's circuit (or another's) at its nominal voltages, warm."""
    converter = converter or prototype()
    return build_circuit(
        converter,
        Temperatures.everywhere(converter, np.full(count, JUNCTION_C)),
        np.full(count, converter.V1_V),
        np.full(count, converter.V2_V),
    )


def edges_at(D1: Array, D2: Array, phase: Array) -> Array:
    """Edges (4, N) whose pulses' centres are ``phase`` apart."""
    return hybrid_edges(phase - centre_offset(D1, D2), D1, D2)


def solve(D1: Array, D2: Array, phase: Array, converter: Converter | None = None) -> Case:
    """Orbits from a start at rest."""
    D1, D2, phase = np.broadcast_arrays(np.atleast_1d(D1), D2, phase)
    circuit_, edges = circuit(D1.size, converter), edges_at(D1, D2, phase)
    orbit = periodic(circuit_, edges, np.zeros(D1.size), np.zeros((4, D1.size)))
    return Case(circuit=circuit_, edges=edges, orbit=orbit)


def random_duties(count: int, seed: int) -> tuple[Array, Array]:
    """D1 and D2 over their range; every eighth point has no primary, every eighth no secondary zero state."""
    rng = np.random.default_rng(seed)
    D1, D2 = rng.uniform(0.05, 0.98, count), rng.uniform(0.02, 0.95, count)
    D1[::8], D2[::8] = 1.0, 0.0
    D1[1::8], D2[2::8] = 1.0, 0.0
    return D1, D2


def random_case(count: int, *, seed: int, converter: Converter | None = None) -> Case:
    """Orbits at random duty ratios and phases of the rising branch."""
    D1, D2 = random_duties(count, seed)
    return solve(D1, D2, np.random.default_rng([seed, 1]).uniform(0.0, 0.5, count), converter)


def without_losses(converter: Converter) -> Converter:
    """No drops, no resistance, no dead time."""
    nothing = Conduction(threshold_V=0.0, resistance_Ohm=0.0)
    primary, inductor, transformer = converter.primary, converter.inductor, converter.transformer
    return replace(
        converter,
        dead_time_s=0.0,
        link_resistance_Ohm=0.0,
        primary=replace(
            primary,
            outer=replace(primary.outer, on=nothing, reverse=nothing),
            inner=replace(primary.inner, on=nothing, reverse=nothing),
            clamp=replace(primary.clamp, on=nothing),
        ),
        secondary=replace(converter.secondary, switch=replace(converter.secondary.switch, on=nothing)),
        inductor=replace(inductor, winding=replace(inductor.winding, resistance_Ohm=0.0)),
        transformer=replace(transformer, winding=replace(transformer.winding, resistance_Ohm=0.0)),
    )
