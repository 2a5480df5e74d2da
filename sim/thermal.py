"""Steady temperatures from losses: junctions on one heatsink, each winding in still air."""

import numpy as np
from numpy.typing import NDArray

from sim.circuit import Temperatures
from sim.parameters import Converter, Quantity

Array = NDArray[np.float64]

SEMICONDUCTORS = {
    "outer": ("primary_outer_conduction", "primary_outer_switching"),
    "inner": ("primary_inner_conduction", "primary_inner_switching"),
    "clamp": ("primary_clamp_conduction", "primary_clamp_recovery"),
    "secondary": ("secondary_conduction", "secondary_switching"),
}
_PIECES_OF_EACH = 4  # four outer, four inner switches, four clamp diodes, four secondary switches
_HOTTEST_C = 250.0  # beyond any part's rating; keeps an overloaded point's iteration finite


def temperatures(converter: Converter, losses: dict[str, Array], ambient_C: Quantity) -> Temperatures:
    """Temperatures in degC that the losses (W, each (N,)) keep up."""
    primary, secondary = converter.primary, converter.secondary
    per_kind = {kind: sum((losses[p] for p in parts), np.zeros(1)) for kind, parts in SEMICONDUCTORS.items()}
    heatsink = ambient_C + converter.heatsink_K_per_W * sum(per_kind.values())
    rise = {
        "outer": primary.outer.thermal_K_per_W,
        "inner": primary.inner.thermal_K_per_W,
        "clamp": primary.clamp.thermal_K_per_W,
        "secondary": secondary.switch.thermal_K_per_W,
    }

    def limited(value: Quantity) -> Array:
        return np.asarray(np.minimum(value, _HOTTEST_C))

    def winding(name: str, thermal_K_per_W: Quantity) -> Array:
        return limited(ambient_C + thermal_K_per_W * (losses[f"{name}_copper"] + losses[f"{name}_core"]))

    junctions = {
        f"{kind}_C": limited(heatsink + rise[kind] * loss / _PIECES_OF_EACH)
        for kind, loss in per_kind.items()
    }
    return Temperatures(
        heatsink_C=limited(heatsink),
        inductor_C=winding("inductor", converter.inductor.thermal_K_per_W),
        transformer_C=winding("transformer", converter.transformer.thermal_K_per_W),
        **junctions,
    )
