"""What a foreign effect can touch: the circuit, the losses by place, the set point, the input, the readings.

A family overrides one or two of the methods; every other one hands back what it got, so that a size of zero
leaves all readings bit-identical.
"""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from drivers.mocks.lab.waveforms import Demand, Heat
from sim.parameters import Converter
from sim.steady_state import Circuit, Orbit

Array = NDArray[np.float64]

# the readings that a campaign's table holds of a loaded point
POWER, D0, RMS = "P1_W", "D0", "I_L_rms_A"
LINK_1, LINK_2 = "P_link1_W", "P_link2_W"
HEATSINK, TRANSFORMER, INDUCTOR = "T_heatsink_C", "T_transformer_C", "T_inductor_C"

_SINE_NODES = np.cos(
    np.pi * np.array([3.0, 1.0, 5.0]) / 6
)  # Gauss and Chebyshev: the mean over a sine, centre first


@dataclass(frozen=True, slots=True, kw_only=True)
class Moment:
    """A solved circuit at N points, as an effect sees it."""

    converter: Converter
    heat: Heat
    demand: Demand
    circuit: Circuit
    orbit: Orbit

    @property
    def live(self) -> NDArray[np.bool_]:
        """Pieces (K, N) in which the primary's voltage is on."""
        return np.asarray(np.abs(self.orbit.pieces.vp_V) > 0.5 * self.circuit.V1_V)

    def mean(self, integral: Array) -> Array:
        """A sum of integrals over pieces (K, N) as a mean over the half period, (N,)."""
        return np.asarray(np.sum(integral, axis=0) / self.circuit.half_period_s)

    @property
    def square_A2(self) -> Array:
        """Mean-square link current, (N,)."""
        return self.mean(self.orbit.pieces.square())


@dataclass(frozen=True, slots=True, kw_only=True)
class Added:
    """Watts that an effect adds, by place, (N,) or one number each.

    ``input`` is drawn from the dc link and warms nothing that is measured, ``primary`` and ``secondary`` warm
    the heatsink, ``transformer`` its winding, ``link`` and ``output`` nothing. What is added behind the ac link
    has to come through it: D0 moves.
    """

    input: Array | float = 0.0
    primary: Array | float = 0.0
    link: Array | float = 0.0
    transformer: Array | float = 0.0
    secondary: Array | float = 0.0
    output: Array | float = 0.0


NOTHING = Added()


@dataclass(frozen=True, slots=True, kw_only=True)
class AcReading:
    """What an ac element reads at N points: power, rms voltage and current, and which element it is."""

    element: int
    watts: Array
    volts: Array
    amps: Array


@dataclass(frozen=True, slots=True, kw_only=True)
class ForeignEffect:
    """One family with its size; ``drawn`` is the range from which an unnamed size is drawn."""

    size: float

    name: ClassVar[str]
    unit: ClassVar[str]
    where: ClassVar[str]
    says: ClassVar[str]
    drawn: ClassVar[tuple[float, float]]
    touches: ClassVar[frozenset[str]]

    def circuit(self, circuit: Circuit, demand: Demand, heat: Heat) -> Circuit:
        """The circuit that the waveforms are solved in."""
        return circuit

    def excursions(self, demand: Demand) -> tuple[Demand, ...]:
        """Set points that the converter visits in turn, equally often; readings are their mean."""
        return (demand,)

    def added(self, moment: Moment) -> Added:
        """Losses that the lab's converter does not have otherwise."""
        return NOTHING

    def drawn_W(self, V1_V: Array, heatsink_C: Array, time_s: Array | float) -> Array | float:
        """Power drawn between the analyzer's input terminals and the dc link, also in standby."""
        return 0.0

    def input_gain(self, time_s: Array | float) -> Array | float:
        """Relative error of port 1, by time."""
        return 0.0

    def ac_watts(self, reading: AcReading) -> Array:
        """The power that an ac element shows."""
        return reading.watts


def along_a_sine(amplitude: float) -> tuple[float, ...]:
    """Three values that stand for a sine of this amplitude, exact for means up to the fifth power.

    >>> sum(x**2 for x in along_a_sine(2.0)) / 3  # doctest: +ELLIPSIS
    2.0...
    """
    return tuple(float(amplitude * node) for node in _SINE_NODES)
