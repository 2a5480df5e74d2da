"""The lab's losses by its own laws: harmonics, modified Steinmetz, drawn shapes."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from drivers.mocks.lab.laws import Laws
from drivers.mocks.lab.legs import KINDS, Edges, channel_Ohm, primary_legs, two_level_J
from drivers.mocks.lab.waveforms import Heat, junctions, winding_Ohm
from sim.parameters import Converter, Core, Winding
from sim.steady_state import Circuit, Orbit

Array = NDArray[np.float64]

_HARMONICS = np.arange(1, 40, 2)  # the link current is half-wave symmetric: odd harmonics only
_SAMPLES = 200  # of the current over a half period: ten to the highest harmonic's


@dataclass(frozen=True, slots=True, kw_only=True)
class LabLosses:
    """Losses in W by place, each (N,), and what heats the semiconductors one by one."""

    primary: Array
    link: Array
    secondary_conduction: Array
    secondary_switching: Array
    by_kind: dict[str, Array]
    inductor: Array
    transformer: Array
    rms_A: Array


def _harmonics(orbit: Orbit, half_period_s: Array, laws: Laws) -> Array:
    """Mean-square link current of each odd harmonic, (harmonics, N), by quadrature over the waveform."""
    place = (np.arange(_SAMPLES) + 0.5) / _SAMPLES
    current = laws.choke.current(orbit.pieces.current_at(place[:, None] * half_period_s))
    phase = np.exp(-1j * np.pi * _HARMONICS[:, None] * place)
    amplitude = 2.0 * phase @ current / _SAMPLES
    return np.asarray(0.5 * np.abs(amplitude) ** 2)


def _copper(winding: Winding, temperature_C: Array, squares: Array, laws: Laws) -> Array:
    """Eddy currents harmonic by harmonic."""
    factor = 1 + winding.ac_extra * laws.eddy_rise(_HARMONICS[:, None])
    return np.asarray(winding_Ohm(winding.resistance_Ohm, temperature_C) * np.sum(factor * squares, axis=0))


def _core(core: Core, flux_Vs: Array, mean_square_V2: Array, frequency_Hz: float) -> Array:
    """Modified Steinmetz equation: the equivalent frequency of the flux' mean squared slope (Albach, 1996).

    ``flux_Vs`` is the peak-to-peak flux linkage. How warm the core is comes on top.
    """
    equivalent_Hz = 2 / np.pi**2 * mean_square_V2 / np.maximum(flux_Vs, 1e-12) ** 2 / frequency_Hz
    amplitude_T = flux_Vs / 2 / (core.turns * core.area_m2)
    per_volume = core.k * equivalent_Hz ** (core.alpha - 1) * amplitude_T**core.beta * frequency_Hz
    return np.asarray(per_volume * core.volume_m3)


def _magnetics(
    converter: Converter, heat: Heat, circuit: Circuit, orbit: Orbit, laws: Laws
) -> tuple[Array, Array]:
    """Copper and core of inductor and transformer."""
    pieces, half_period, f = orbit.pieces, circuit.half_period_s, converter.frequency_Hz
    squares = _harmonics(orbit, half_period, laws)
    across = pieces.vp_V - pieces.nvs_V

    def mean_square(voltage_V: Array) -> Array:
        return np.asarray(np.sum(pieces.duration_s * voltage_V**2, axis=0) / half_period)

    swing_A = 2 * np.maximum(np.max(np.abs(pieces.current_A), axis=0), np.abs(pieces.end_A[-1]))
    inductor_flux = converter.inductor.inductance_H * swing_A
    transformer_flux = np.sum(pieces.duration_s * np.abs(pieces.nvs_V), axis=0)
    inductor, transformer = converter.inductor, converter.transformer
    return (
        _copper(inductor.winding, heat.inductor_C, squares, laws)
        + _core(inductor.core, inductor_flux, mean_square(across), f) * laws.core_warmth(heat.inductor_C),
        _copper(transformer.winding, heat.transformer_C, squares, laws)
        + _core(transformer.core, transformer_flux, mean_square(pieces.nvs_V), f)
        * laws.core_warmth(heat.transformer_C),
    )


def _edges(orbit: Orbit, which: slice, turns: Array | float, laws: Laws) -> Edges:
    """The edges of one bridge, whose current is ``turns`` times the link's."""
    c = orbit.commutation
    off, on = (turns * laws.choke.current(current[which] / turns) for current in (c.turn_off_A, c.turn_on_A))
    return Edges(
        off_A=off,
        on_A=on,
        missing=c.missing[which],
        opposite_C=c.opposite_C[which],
        same_C=c.same_C[which],
    )


def _switching(
    converter: Converter, heat: Heat, circuit: Circuit, orbit: Orbit, laws: Laws
) -> dict[str, Array]:
    """Losses at the edges by kind of device."""
    V2, low = circuit.nV2_V / circuit.turns_ratio, converter.secondary.switch
    primary = _edges(orbit, slice(0, 2), 1.0, laws)
    secondary = _edges(orbit, slice(2, 4), circuit.turns_ratio, laws)
    energies = primary_legs(converter).energies_J(junctions(heat), circuit.V1_V, primary, laws)
    energies["secondary"] = two_level_J(low, heat.secondary_C, V2, secondary, laws)
    return {kind: 2 * converter.frequency_Hz * energy for kind, energy in energies.items()}


def _conduction(
    converter: Converter, heat: Heat, circuit: Circuit, orbit: Orbit, laws: Laws
) -> tuple[dict[str, Array], Array]:
    """Conduction by kind of device, and the mean-square link current."""
    pieces = orbit.pieces
    n, low = converter.transformer.turns_ratio, converter.secondary.switch
    live = np.abs(pieces.vp_V) > 0.5 * circuit.V1_V
    along = pieces.vp_V * pieces.sign > 0
    charge = np.abs(laws.choke.charge(pieces)) / circuit.half_period_s
    square = laws.choke.square(pieces) / circuit.half_period_s
    square_A2 = np.sum(square, axis=0)
    lost = dict.fromkeys(KINDS, np.zeros_like(square_A2))
    states = primary_legs(converter).states(junctions(heat))
    for path, chosen in zip(states, (live & along, live & ~along, ~live), strict=True):
        mean_A, mean_A2 = (np.sum(np.where(chosen, x, 0.0), axis=0) for x in (charge, square))
        for device in path:
            threshold_V, resistance_Ohm = device.drop
            watts = device.count * (threshold_V * mean_A + resistance_Ohm * mean_A2)
            lost[device.kind] = lost[device.kind] + watts
    handed_on_A2 = np.sum(laws.choke.secondary_square(pieces), axis=0) / circuit.half_period_s
    secondary = 2 * n**2 * channel_Ohm(low.on, heat.secondary_C) * handed_on_A2
    return lost | {"secondary": secondary}, square_A2


def lab_losses(converter: Converter, heat: Heat, circuit: Circuit, orbit: Orbit, laws: Laws) -> LabLosses:
    """All losses of N solved points."""
    conduction, square_A2 = _conduction(converter, heat, circuit, orbit, laws)
    switching = _switching(converter, heat, circuit, orbit, laws)
    inductor, transformer = _magnetics(converter, heat, circuit, orbit, laws)
    by_kind = {kind: conduction[kind] + switching[kind] for kind in conduction}
    return LabLosses(
        primary=by_kind["outer"] + by_kind["inner"] + by_kind["clamp"],
        link=inductor + transformer + converter.link_resistance_Ohm * square_A2,
        secondary_conduction=conduction["secondary"],
        secondary_switching=switching["secondary"],
        by_kind=by_kind,
        inductor=inductor,
        transformer=transformer,
        rms_A=np.sqrt(square_A2),
    )
