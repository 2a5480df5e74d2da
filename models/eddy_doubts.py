"""What a model's effects add to eddy currents may be wrong by, in W of the input power.

About which harmonic they flatten is roughly known. And they can be put into a circuit in two ways that lose the same at
the switching frequency: beside the inductance, as the simulator does, where they help in swings, or as a resistance in
series, where they do not. How much of a winding's field follows within a swing is known to that difference.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from models.diagnosis.inaccuracy import at_edges_W
from models.diagnosis.law_errors import of_flattening
from sim.model import Model
from sim.parameters import Converter, Winding
from sim.simulate import Result, simulate_each

Array = NDArray[np.float64]

PARTS = ("inductor", "transformer")
_AGAIN = 0.8  # of a watt less, by how much a cooler winding loses less again: with more it would run away


def eddy_doubts_W(result: Result, model: Model) -> Array:
    """By how much more or less they flatten, and by whether they take part in swings, one sigma each, (2, N).

    ``model`` is the one that was simulated. Zero where its effects add no eddy currents.
    """
    plain, altered = model.converter, model.altered_converter()
    added = {part: _extra(altered, part) - _extra(plain, part) for part in PARTS}
    if not any(added.values()):
        return np.zeros((2, len(result.points)))
    return np.stack([_flattens_W(result, model, added), _in_swings_W(result, model, added)])


def _extra(converter: Converter, part: str) -> float:
    return float(getattr(converter, part).winding.ac_extra)


def _flattens_W(result: Result, model: Model, added: dict[str, float]) -> Array:
    """Half of what flattening takes away; windings that lose less are cooler, and lose less again."""
    altered, square_A2 = model.altered_converter(), np.asarray(result["I_L_rms_A"]) ** 2
    added_W = np.zeros_like(square_A2)
    for part in (part for part, extra in added.items() if extra):
        there = getattr(altered, part)
        winding = there.winding
        copper_W, dc_Ohm = result[f"loss_{part}_copper_W"], winding.at(result[f"T_{part}_C"])
        eddy_W = (copper_W - dc_Ohm * square_A2) * added[part] / winding.ac_extra
        per_K = winding.resistance_per_K * winding.resistance_Ohm / dc_Ohm
        again = np.minimum(there.thermal_K_per_W * per_K * copper_W, _AGAIN)
        added_W += eddy_W / (1.0 - again)
    at = result.points.with_voltages_of(model.converter)
    return np.asarray(added_W * of_flattening(altered, at, np.asarray(result["D0"])))


def _in_swings_W(result: Result, model: Model, added: dict[str, float]) -> Array:
    """What edges cost more with the added eddy currents in series."""
    in_series = Model(converter=_in_series(model.altered_converter(), added))
    (other,) = simulate_each([(in_series, model.set_points(result.points))], near=result)
    return at_edges_W(other) - at_edges_W(result)


def _in_series(converter: Converter, added: dict[str, float]) -> Converter:
    """The converter with so much of each winding's extra resistance at all frequencies instead."""

    def changed(winding: Winding, extra: float) -> Winding:
        more = 1.0 + extra
        resistance_Ohm, left = winding.resistance_Ohm * more, (winding.ac_extra - extra) / more
        return replace(winding, resistance_Ohm=resistance_Ohm, ac_extra=left)

    inductor, transformer = converter.inductor, converter.transformer
    return replace(
        converter,
        inductor=replace(inductor, winding=changed(inductor.winding, added["inductor"])),
        transformer=replace(transformer, winding=changed(transformer.winding, added["transformer"])),
    )
