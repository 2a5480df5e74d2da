"""The lab's losses by its own laws: harmonics, modified Steinmetz, quadratic switching energy."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from drivers.mocks.lab.choke import Choke
from drivers.mocks.lab.waveforms import Heat, channel_Ohm, series_Ohm, winding_Ohm
from sim.parameters import Converter, Core, SwitchingEnergy, Winding
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


def _energy(law: SwitchingEnergy, current_A: Array, voltage_V: Array, junction_C: Array) -> Array:
    """Switching energy as a quadratic through the datasheet point: 30 % linear, 70 % to the law's power."""
    share = np.maximum(current_A, 0.0) / law.reference_A
    shape = 0.3 * share + 0.7 * share**law.current_exponent
    scaled = shape * (voltage_V / law.reference_V) ** law.voltage_exponent
    return np.asarray(law.energy_J * scaled * np.exp(law.energy_per_K * (junction_C - 25.0)))


def _harmonics(orbit: Orbit, half_period_s: Array, choke: Choke) -> Array:
    """Mean-square link current of each odd harmonic, (harmonics, N), by quadrature over the waveform."""
    place = (np.arange(_SAMPLES) + 0.5) / _SAMPLES
    current = choke.current(orbit.pieces.current_at(place[:, None] * half_period_s))
    phase = np.exp(-1j * np.pi * _HARMONICS[:, None] * place)
    amplitude = 2.0 * phase @ current / _SAMPLES
    return np.asarray(0.5 * np.abs(amplitude) ** 2)


def _copper(winding: Winding, temperature_C: Array, squares: Array) -> Array:
    """Dowell's rise with the square of frequency, which flattens at high harmonics."""
    k2 = _HARMONICS[:, None].astype(float) ** 2
    factor = 1 + winding.ac_extra * k2 / (1 + 0.004 * (k2 - 1))
    return np.asarray(winding_Ohm(winding.resistance_Ohm, temperature_C) * np.sum(factor * squares, axis=0))


def _core(
    core: Core, flux_Vs: Array, mean_square_V2: Array, frequency_Hz: float, temperature_C: Array
) -> Array:
    """Modified Steinmetz equation: the equivalent frequency of the flux' mean squared slope (Albach, 1996).

    ``flux_Vs`` is the peak-to-peak flux linkage. The loss has a flat minimum at 95 degC.
    """
    equivalent_Hz = 2 / np.pi**2 * mean_square_V2 / np.maximum(flux_Vs, 1e-12) ** 2 / frequency_Hz
    amplitude_T = flux_Vs / 2 / (core.turns * core.area_m2)
    per_volume = core.k * equivalent_Hz ** (core.alpha - 1) * amplitude_T**core.beta * frequency_Hz
    warm = 0.98 + 1.5e-5 * (temperature_C - 95.0) ** 2
    return np.asarray(per_volume * core.volume_m3 * warm)


def _magnetics(
    converter: Converter, heat: Heat, circuit: Circuit, orbit: Orbit, choke: Choke
) -> tuple[Array, Array]:
    """Copper and core of inductor and transformer."""
    pieces, half_period, f = orbit.pieces, circuit.half_period_s, converter.frequency_Hz
    squares = _harmonics(orbit, half_period, choke)
    across = pieces.vp_V - pieces.nvs_V

    def mean_square(voltage_V: Array) -> Array:
        return np.asarray(np.sum(pieces.duration_s * voltage_V**2, axis=0) / half_period)

    swing_A = 2 * np.maximum(np.max(np.abs(pieces.current_A), axis=0), np.abs(pieces.end_A[-1]))
    inductor_flux = converter.inductor.inductance_H * swing_A
    transformer_flux = np.sum(pieces.duration_s * np.abs(pieces.nvs_V), axis=0)
    inductor, transformer = converter.inductor, converter.transformer
    return (
        _copper(inductor.winding, heat.inductor_C, squares)
        + _core(inductor.core, inductor_flux, mean_square(across), f, heat.inductor_C),
        _copper(transformer.winding, heat.transformer_C, squares)
        + _core(transformer.core, transformer_flux, mean_square(pieces.nvs_V), f, heat.transformer_C),
    )


def _switching(
    converter: Converter, heat: Heat, circuit: Circuit, orbit: Orbit, choke: Choke
) -> dict[str, Array]:
    """Losses at the edges by kind of device."""
    c, f = orbit.commutation, converter.frequency_Hz
    outer, inner, clamp = (
        converter.three_level.outer,
        converter.three_level.inner,
        converter.three_level.clamp,
    )
    low = converter.secondary.switch
    half, V2 = 0.5 * circuit.V1_V, circuit.nV2_V / circuit.turns_ratio
    ratio = np.stack([np.ones_like(V2), np.ones_like(V2), circuit.turns_ratio, circuit.turns_ratio])
    off, on = (ratio * choke.current(current / ratio) for current in (c.turn_off_A, c.turn_on_A))
    missing = c.missing
    stored = sum(np.asarray(d.capacitance.charge_C(half)) for d in (outer, inner, clamp))
    hard_J = 0.5 * stored * half * missing[:2] ** 2
    recovered = np.asarray(clamp.recovery.at(current_A=on[0], junction_C=heat.clamp_C))
    outer_J = (
        _energy(outer.turn_on, on[0], half, heat.outer_C)
        + _energy(outer.turn_off, off[1], half, heat.outer_C)
        + hard_J[0]
        + 0.6 * recovered * half
        + (c.opposite_C[0] + c.same_C[1]) * outer.reverse.threshold_V
    )
    inner_J = (
        _energy(inner.turn_off, off[0], half, heat.inner_C)
        + _energy(inner.turn_on, on[1], half, heat.inner_C)
        + hard_J[1]
        + np.asarray(outer.recovery.at(current_A=on[1], junction_C=heat.outer_C)) * half
    )
    secondary_J = (
        _energy(low.turn_off, off[2:], V2, heat.secondary_C)
        + _energy(low.turn_on, on[2:], V2, heat.secondary_C)
        + np.asarray(low.capacitance.charge_C(V2)) * V2 * missing[2:] ** 2
        + np.asarray(low.recovery.at(current_A=on[2:], junction_C=heat.secondary_C)) * V2
        + (c.opposite_C[2:] + c.same_C[2:]) * low.reverse.threshold_V
    )
    each = 4 * f  # two legs, two half periods
    return {
        "outer": each * outer_J,
        "inner": each * inner_J,
        "clamp": each * 0.4 * recovered * half,
        "secondary": 2 * f * np.sum(secondary_J, axis=0),
    }


def _conduction(
    converter: Converter, heat: Heat, circuit: Circuit, orbit: Orbit, choke: Choke
) -> tuple[dict[str, Array], Array]:
    """Conduction by kind of device, and the mean-square link current."""
    pieces = orbit.pieces
    n, low = converter.transformer.turns_ratio, converter.secondary.switch
    live = np.abs(pieces.vp_V) > 0.5 * circuit.V1_V
    along = pieces.vp_V * pieces.sign > 0
    charge = np.abs(choke.charge(pieces)) / circuit.half_period_s
    square = choke.square(pieces) / circuit.half_period_s

    def loop(chosen: NDArray[np.bool_], drops: Array) -> Array:
        """Everything the loop loses in one conduction state."""
        return np.asarray(np.sum(np.where(chosen, charge * drops[0] + square * drops[1], 0.0), axis=0))

    states = ((live & along, circuit.forward), (live & ~along, circuit.reverse), (~live, circuit.zero))
    whole = sum((loop(chosen, drops) for chosen, drops in states), np.zeros(1))
    square_A2 = np.sum(square, axis=0)
    secondary = 2 * n**2 * channel_Ohm(low.on, heat.secondary_C) * square_A2
    outer = (
        2
        * channel_Ohm(converter.three_level.outer.on, heat.outer_C)
        * np.sum(np.where(live, square, 0), axis=0)
    )
    clamp = loop(
        ~live, np.stack([2 * np.asarray(converter.three_level.clamp.on.threshold_V), np.asarray(0.0)])
    )
    clamp = clamp + loop(
        ~live, np.stack([np.asarray(0.0), 2 * np.asarray(converter.three_level.clamp.on.resistance_Ohm)])
    )
    inner = np.maximum(whole - secondary - series_Ohm(converter, heat) * square_A2 - outer - clamp, 0.0)
    return {"outer": outer, "inner": inner, "clamp": clamp, "secondary": secondary}, square_A2


def lab_losses(converter: Converter, heat: Heat, circuit: Circuit, orbit: Orbit, choke: Choke) -> LabLosses:
    """All losses of N solved points."""
    conduction, square_A2 = _conduction(converter, heat, circuit, orbit, choke)
    switching = _switching(converter, heat, circuit, orbit, choke)
    inductor, transformer = _magnetics(converter, heat, circuit, orbit, choke)
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
