"""Which converter a table of D1 and D2 is for, in one line that two converters share only where it fits both.

It holds what a table depends on before any part's spread: name, voltages, power, frequency, modulation, the link's
inductance and the transformer's ratio. Parts that are described better do not make another converter of it.
"""

import re

import numpy as np

from bench.errors import InputError
from sim.model import Model
from sim.parameters import Quantity


def stated_converter(model: Model) -> str:
    """The converter of a simulation model.

    >>> stated_converter(Model.baseline())
    'NPC-DAB prototype, 2 kW: 300 V to 140 V, 2000 W, 20 kHz, hybrid, link 236 uH, ratio 2'
    """
    c = model.converter
    return (
        f"{c.name}: {c.V1_V:g} V to {c.V2_V:g} V, {c.rated_power_W:g} W, {c.frequency_Hz / 1e3:g} kHz, {c.modulation}, "
        f"link {_one(c.inductor.inductance_H) * 1e6:.4g} uH, ratio {_one(c.transformer.turns_ratio):.3g}"
    )


def in_c(text: str) -> str:
    """Text as a comment or a string of C can hold it.

    >>> in_c('Prüfling "A" */')
    'Pr?fling ?A? ?'
    """
    return re.sub(r'[^\x20-\x7e]|["\\]|[*/]{2,}', "?", text)


def check_same_converter(file: object, stated: str, bench: str, model: Model) -> None:
    """InputError where a table states another converter than the one of a bench."""
    own = stated_converter(model)
    if in_c(stated) == in_c(own):
        return
    allowed = (
        f"the converter of bench {bench!r} is {own!r}, and other D1 and D2 are right for it. Load a table that d2ea "
        "optimise made from this bench's measurements; or, if the table is right, name its simulation model in the "
        'bench\'s file: [converter] model = "MODEL.toml"'
    )
    raise InputError.of(file, "converter", stated, allowed)


def _one(value: Quantity) -> float:
    return float(np.mean(value))
