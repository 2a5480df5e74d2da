"""How large a converter is against the prototype: what is stated in the prototype's watts, ohms and amperes goes by it.

A 20-kW converter has ten times the auxiliary power on an ordinary day, its analyzer stands on another range, and a
milliohm in its ac link means more to it.
"""

from collections.abc import Callable
from functools import cache

import numpy as np

from sim.parameters import Converter, Quantity
from sim.prototype import prototype

_SERIES = (1.0, 2.0, 5.0)  # of an analyzer's ranges, times powers of ten
_OF_RANGE = 0.75  # of the rated current at the terminals: overrange allows the rest


@cache
def current_range_A(current_A: float, further: int = 0) -> float:
    """The least range of 1, 2, 5 ... A that holds a current, or the one so many ranges ``further`` up.

    >>> current_range_A(5.0), current_range_A(25.0), current_range_A(5.0, -1)
    (5.0, 50.0, 2.0)
    """
    decade = int(np.floor(np.log10(current_A)))
    ranges = [step * 10.0**power for power in range(decade - 2, decade + 4) for step in _SERIES]
    return float(ranges[int(np.searchsorted(ranges, current_A * (1.0 - 1e-9))) + further])


def size(what: str, converter: Converter) -> float:
    """How large a converter is against the prototype, by its nominal data; exactly one for the prototype.

    ``what`` is its power, its input_current, its input_resistance or output_resistance (V²/P), the analyzer's
    input_range, or its magnetizing inductance.
    """
    return _NOMINAL[what](converter) / _of_prototype(what)


def _one(value: Quantity) -> float:
    return value if isinstance(value, float) else float(np.mean(value))


def _resistance_Ohm(voltage_V: Quantity, converter: Converter) -> float:
    return _one(voltage_V) ** 2 / _one(converter.rated_power_W)


def _current_A(converter: Converter) -> float:
    return _one(converter.rated_power_W) / _one(converter.V1_V)


_NOMINAL: dict[str, Callable[[Converter], float]] = {
    "power": lambda c: _one(c.rated_power_W),
    "input_current": _current_A,
    "input_resistance": lambda c: _resistance_Ohm(c.V1_V, c),
    "output_resistance": lambda c: _resistance_Ohm(c.V2_V, c),
    "input_range": lambda c: current_range_A(_OF_RANGE * _current_A(c)),
    "magnetizing": lambda c: _one(c.transformer.magnetizing_H),
}


@cache
def _of_prototype(what: str) -> float:
    return _NOMINAL[what](prototype())
