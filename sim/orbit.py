"""A half period of the ac link from a state (start current, delays of the edges, phase), and the orbit it may be."""

from dataclasses import dataclass, fields, is_dataclass, replace
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from sim.commutation import Commutation
from sim.dead_times import EdgeView, commutations
from sim.march import march
from sim.pieces import Pieces
from sim.stacking import put
from sim.waveform import Circuit, Steps

Array = NDArray[np.float64]

SHIFT = np.array([0.0, 0.0, 1.0, 1.0])[:, None]  # a phase moves the secondary's edges


@dataclass(frozen=True, slots=True, kw_only=True)
class Accuracy:
    """How well an orbit closes: in current (relative, from 1 A on), delays (Th), power (relative, from 10 W)."""

    closed: float
    settled: float
    power: float


# 25 fs at 20 kHz: far below anything measured, above rounding
FINE = Accuracy(closed=1e-10, settled=1e-9, power=2e-7)
NEAR = Accuracy(closed=1e-6, settled=1e-6, power=1e-5)  # one step of Newton's rule from there is fine
COARSE = Accuracy(closed=1e-5, settled=1e-5, power=1e-3)  # while something else still moves


@dataclass(frozen=True, slots=True, kw_only=True)
class Orbit:
    """A periodic steady state: start current (N,), delays of the edges in units of Th (4, N), and the rest.

    ``closed`` tells at which points current and delays came back to themselves.
    """

    start_A: Array
    delay: Array
    pieces: Pieces
    commutation: Commutation
    closed: NDArray[np.bool_]

    def start_of(self, chosen: NDArray[np.intp]) -> Self:
        """Start current and delays at some points, enough to start from again."""
        return replace(self, start_A=self.start_A[chosen], delay=self.delay.take(chosen, axis=1))

    def among(self, size: int, rows: NDArray[np.intp]) -> "Orbit":
        """This orbit as some points of so many; of the others nothing is known."""
        whole: Orbit = _among(self, size, rows)
        return whole

    def renewed(self, rows: NDArray[np.intp], part: "Orbit") -> "Orbit":
        """This orbit with some of its points taken from another one; its arrays are written to."""
        put(self, rows, part)
        return replace(self, pieces=replace(self.pieces))  # without the integrals of what was there

    def output_power_W(self) -> Array:
        """Power into the ideal secondary bridge: the mean of n vs i, and what the magnetizing current carries."""
        return bridge_power_W(self.pieces)

    def input_power_W(self) -> Array:
        """Mean of vp i over the half period: power out of the ideal primary bridge."""
        return _mean_power_W(self.pieces, self.pieces.vp_V)


def _among(part: Any, size: int, rows: NDArray[np.intp]) -> Any:
    changed: dict[str, Any] = {}
    for field in fields(part):
        own = getattr(part, field.name)
        if is_dataclass(own):
            changed[field.name] = _among(own, size, rows)
        elif isinstance(own, np.ndarray):
            changed[field.name] = np.zeros((*own.shape[:-1], size), dtype=own.dtype)
            changed[field.name][..., rows] = own
    return replace(part, **changed)


def _mean_power_W(pieces: Pieces, voltage_V: Array) -> Array:
    """Mean of a voltage, (K, N) over the pieces, times the current."""
    return np.asarray(np.sum(voltage_V * pieces.charge(), axis=0) / pieces.half_period_s)


def bridge_power_W(pieces: Pieces) -> Array:
    """Power (N,) into the ideal secondary bridge."""
    return np.asarray(np.sum(pieces.bridge_energy(), axis=0) / pieces.half_period_s)


@dataclass(frozen=True, slots=True, kw_only=True)
class Sweep:
    """One half period and its dead times from a state (6, N): start current, delays, phase.

    ``view``, what Newton's rule needs of the edges, is there where it was asked for.
    """

    steps: Steps
    pieces: Pieces
    commutation: Commutation
    view: EdgeView | None
    gap_A: Array
    late: Array  # delays that the dead times make, less those assumed

    @classmethod
    def of(cls, circuit: Circuit, edges: Array, state: Array, *, sloped: bool = True) -> "Sweep":
        """From a state; without ``sloped`` at half the cost where legs meet."""
        edges = edges + SHIFT * state[5]
        flips = edges + state[1:5]
        steps = Steps.of(circuit, flips)
        pieces = march(circuit, steps, state[0])
        commutation, view = commutations(circuit, edges, flips, steps, pieces, sloped=sloped)
        return cls(
            steps=steps, pieces=pieces, commutation=commutation, view=view,
            gap_A=pieces.end_A[-1] + state[0],
            late=commutation.delay_s / circuit.half_period_s - state[1:5],
        )  # fmt: skip

    def closes(self, start_A: Array, accuracy: Accuracy) -> NDArray[np.bool_]:
        """Whether current and delays came back to themselves."""
        near = np.abs(self.gap_A) <= accuracy.closed * (1.0 + np.abs(start_A))
        return np.asarray(near & np.all(np.abs(self.late) <= accuracy.settled, axis=0))

    def orbit(self, state: Array, accuracy: Accuracy) -> Orbit:
        """The orbit that this sweep is, if it closes."""
        return Orbit(
            start_A=state[0], delay=state[1:5], pieces=self.pieces, commutation=self.commutation,
            closed=self.closes(state[0], accuracy),
        )  # fmt: skip
