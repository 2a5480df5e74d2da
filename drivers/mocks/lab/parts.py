"""The lab's own converter: every part off by its everyday spread, drawn by a seed."""

import numpy as np

from sim.parameters import Converter
from sim.prototype import prototype
from sim.spread import everyday_spread

_WITHIN = 2.5  # sigmas: incoming inspection sorts out what is further off
_POSITIVE_ONLY = {"input_cable_Ohm", "output_cable_Ohm", "auxiliary_power_W"}


def draw_converter(rng: np.random.Generator, design: Converter | None = None) -> Converter:
    """A converter as it was really built, by default after the prototype's design."""
    converter = design or prototype()
    for spread in everyday_spread(converter):
        off = float(np.clip(rng.standard_normal(), -_WITHIN, _WITHIN))
        if spread.path in _POSITIVE_ONLY:
            off = abs(off)
        converter = spread.shifted(converter, off)
    return converter
