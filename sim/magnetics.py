r"""Copper and core losses of inductor and transformer, from the true current and flux.

Copper: the resistance of harmonic k is R_dc (1 + c k^2) with c the extra at the switching frequency, or what flattening
leaves of it at a point (:mod:`sim.harmonics`), so by Parseval no Fourier series is needed:

.. math:: \sum_k R_k I_k^2 = R_{dc} (I_{rms}^2 + c \, \langle \dot\imath^2 \rangle / \omega_s^2)

The circuit carries both parts (:mod:`sim.steady_state`): the first is series resistance, the second a resistor parallel
to the inductance.

Core: improved generalised Steinmetz equation (Venkatachalam, Sullivan, Abdallah and Tacca, 2002, eq. 7)

.. math:: P_v = k_i \, \Delta B^{\beta - \alpha} \, \langle |\dot B|^\alpha \rangle, \quad
          k_i = \frac{k}{(2\pi)^{\alpha-1} \int_0^{2\pi} |\cos\theta|^\alpha 2^{\beta-\alpha} d\theta}

Assumption: minor loops are not split off.
"""

from dataclasses import dataclass
from math import gamma

import numpy as np
from numpy.typing import NDArray

from sim.circuit import Temperatures
from sim.parameters import Converter, Core, Quantity, Winding
from sim.pieces import Pieces

Array = NDArray[np.float64]


def steinmetz_rate(core: Core) -> Quantity:
    """k_i of the improved generalised Steinmetz equation.

    >>> core = Core(k=3.9, alpha=1.0, beta=2.0, area_m2=1e-4, volume_m3=1e-5, turns=10.0)
    >>> round(float(steinmetz_rate(core)), 4)  # k / (2 * 4)
    0.4875
    """
    cosine = 2.0 * np.sqrt(np.pi) * gamma((core.alpha + 1) / 2) / gamma(core.alpha / 2 + 1)
    return core.k / float((2 * np.pi) ** (core.alpha - 1) * cosine * 2.0 ** (core.beta - core.alpha))


def core_loss_W(core: Core, flux_swing_Vs: Array, rate_power: Array) -> Array:
    """Core loss in W from the peak-to-peak flux linkage (V s) and the mean of |V|^alpha, each (N,).

    A square wave of 280 V at 20 kHz on 36 turns of E65/32/27 swings 7 mV s, 0.36 T:

    >>> core = Core(k=3.9, alpha=1.36, beta=2.6, area_m2=535e-6, volume_m3=78.7e-6, turns=36.0)
    >>> round(core_loss_W(core, np.array([7e-3]), np.array([280.0**1.36])).item(), 2)
    2.42
    """
    turns_area = core.turns * core.area_m2
    density = (flux_swing_Vs / turns_area) ** (core.beta - core.alpha) * rate_power / turns_area**core.alpha
    return np.asarray(steinmetz_rate(core) * density * core.volume_m3)


def copper_loss_W(
    winding: Winding, temperature_C: Quantity, square_A2: Array, slope_share_A2: Array
) -> Array:
    """Copper loss in W from mean i^2 and mean (di/dt)^2 / omega^2, each (N,).

    For a sine both are the same, and the resistance that of the switching frequency:

    >>> winding = Winding(resistance_Ohm=0.045, ac_extra=0.10)
    >>> round(copper_loss_W(winding, 25.0, np.array([64.0]), np.array([64.0])).item(), 3)
    3.168
    """
    return np.asarray(winding.at(temperature_C) * (square_A2 + winding.ac_extra * slope_share_A2))


@dataclass(frozen=True, slots=True, kw_only=True)
class LinkCurrent:
    """Measures of the link current, each (N,): mean square, mean squared slope over omega^2, peak to peak.

    Where the inductance drops, the slope counts by the voltage across it: eddy currents follow the flux.
    """

    square_A2: Array
    slope_share_A2: Array
    peak_to_peak_A: Array


def link_current(pieces: Pieces, frequency_Hz: float) -> LinkCurrent:
    """Measure the half-wave symmetric link current."""
    half_period = pieces.half_period_s
    return LinkCurrent(
        square_A2=np.sum(pieces.square(), axis=0) / half_period,
        slope_share_A2=np.sum(pieces.squared_induced(), axis=0)
        / half_period
        / (2 * np.pi * frequency_Hz) ** 2,
        peak_to_peak_A=2 * np.maximum(np.max(np.abs(pieces.current_A), axis=0), np.abs(pieces.end_A[-1])),
    )


def magnetic_losses(
    converter: Converter, t: Temperatures, pieces: Pieces, current: LinkCurrent
) -> dict[str, Array]:
    """Copper and core of both magnetic parts, and the link's plain resistance."""
    inductor, transformer = converter.inductor, converter.transformer
    half_period = pieces.half_period_s
    rise_A = np.abs(pieces.end_A - pieces.current_A)
    with np.errstate(divide="ignore", invalid="ignore"):
        slope = np.where(pieces.duration_s > 0, rise_A / pieces.duration_s, 0.0)
    induced_V = inductor.inductance_H * pieces.relative_L * slope
    inductor_rate = np.sum(pieces.duration_s * induced_V**inductor.core.alpha, axis=0) / half_period
    secondary_V = np.abs(pieces.nvs_V)
    transformer_rate = np.sum(pieces.duration_s * secondary_V**transformer.core.alpha, axis=0) / half_period
    return {
        "inductor_copper": copper_loss_W(
            inductor.winding, t.inductor_C, current.square_A2, current.slope_share_A2
        ),
        "transformer_copper": copper_loss_W(
            transformer.winding, t.transformer_C, current.square_A2, current.slope_share_A2
        ),
        "inductor_core": core_loss_W(
            inductor.core, 2.0 * inductor.flux_Vs(0.5 * current.peak_to_peak_A), inductor_rate
        ),
        "transformer_core": core_loss_W(
            transformer.core, np.sum(pieces.duration_s * secondary_V, axis=0), transformer_rate
        ),
        "link_resistance": np.asarray(converter.link_resistance_Ohm * current.square_A2),
    }
