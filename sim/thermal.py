"""Steady temperatures from losses: junctions on one heatsink, each winding in still air."""

import numpy as np
from numpy.typing import NDArray

from sim.bridges import primary_scheme, secondary_scheme, switching_part
from sim.checks import HOTTEST_C
from sim.circuit import Temperatures
from sim.parameters import Converter, Quantity

Array = NDArray[np.float64]

# a bridge has four of each kind: outer and inner switches, clamp diodes, two-level switches
_PIECES_OF_EACH = 4


def temperatures(converter: Converter, losses: dict[str, Array], ambient_C: Quantity) -> Temperatures:
    """Temperatures in degC that the losses (W, each (N,)) keep up."""
    devices = {**primary_scheme(converter).devices, **secondary_scheme(converter).devices}
    per_kind = {k: losses[f"{k}_conduction"] + losses[switching_part(k, d)] for k, d in devices.items()}
    heatsink = ambient_C + converter.heatsink_K_per_W * sum(per_kind.values())

    def limited(value: Quantity) -> Array:
        return np.asarray(np.minimum(value, HOTTEST_C))

    def winding(name: str, thermal_K_per_W: Quantity) -> Array:
        return limited(ambient_C + thermal_K_per_W * (losses[f"{name}_copper"] + losses[f"{name}_core"]))

    junctions = {
        kind: limited(heatsink + devices[kind].thermal_K_per_W * loss / _PIECES_OF_EACH)
        for kind, loss in per_kind.items()
    }
    return Temperatures(
        heatsink_C=limited(heatsink),
        inductor_C=winding("inductor", converter.inductor.thermal_K_per_W),
        transformer_C=winding("transformer", converter.transformer.thermal_K_per_W),
        junction_C=junctions,
    )
