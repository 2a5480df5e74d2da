"""Errors of the lab's instruments: fixed ones inside the specification, and noise on every update."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

# What the analyzer's maker promises of an element, dc (1, 2) and ac (3, 4): errors are uniform up to there.
GAIN = {1: 5e-4, 2: 5e-4, 3: 3e-3, 4: 3e-3}  # of reading: of voltage, of current, and of power
OFFSET_A = {1: 2.5e-3, 2: 5e-3, 3: 0.0, 4: 0.0}  # 0.05 % of ranges of 5 A and 10 A
OFFSET_W = {1: 0.0, 2: 0.0, 3: 3.0, 4: 3.0}  # 0.2 % of a range of 1500 W
# of them: one sigma of a voltage's or a current's, where that of the power is uniform
FACTOR = (5 / 18) ** 0.5
_NOISE = {1: 1e-4, 2: 1e-4, 3: 4e-4, 4: 4e-4}  # of reading, one update
_SENSORS = ("heatsink", "inductor", "transformer")
TEMPERATURE_OFFSET_K = 0.3  # one sigma
_ROOT_3 = 3**0.5
_OUTPUT_SENSE, _SUPPLY_V = 5e-4 * _ROOT_3, 0.1 * _ROOT_3  # of reading, V: the converter's sensor, the supply
_TAIL = 6.0  # degrees of freedom of the noise: heavier tails than normal


@dataclass(frozen=True, slots=True, kw_only=True)
class InstrumentErrors:
    """The fixed errors of one lab's instruments, drawn once, and the noise on top of them.

    ``noise`` scales the noise, as one number or for each of a table's rows; ``tail`` is the degrees of freedom of
    its distribution, ``correlation`` that of a row's noise with the next one's.
    """

    voltage_gain: dict[int, float]
    current_gain: dict[int, float]
    offset_A: dict[int, float]
    offset_W: dict[int, float]
    temperature_K: dict[str, float]
    output_sense: float
    supply_V: float
    noise: float | Array = 1.0
    tail: float = _TAIL
    correlation: float = 0.0


def perfect_instruments() -> InstrumentErrors:
    """Instruments that read what is there, and the noise of good ones."""
    none = dict.fromkeys(GAIN, 0.0)
    return InstrumentErrors(
        voltage_gain=none,
        current_gain=none,
        offset_A=none,
        offset_W=none,
        temperature_K=dict.fromkeys(_SENSORS, 0.0),
        output_sense=0.0,
        supply_V=0.0,
    )


def draw_instruments(rng: np.random.Generator) -> InstrumentErrors:
    """One lab's instruments, anywhere inside their specification."""

    def within(most: float) -> float:
        return float(rng.uniform(-1, 1) * most)

    power = {e: within(most) for e, most in GAIN.items()}
    offset_A = {e: within(most) for e, most in OFFSET_A.items()}
    offset_W = {e: within(most) for e, most in OFFSET_W.items()}
    temperature_K = {n: float(rng.normal(0, TEMPERATURE_OFFSET_K)) for n in _SENSORS}
    output_sense, supply_V = within(_OUTPUT_SENSE), within(_SUPPLY_V)
    # of one power's gain the voltage has any share that leaves both it and the current inside
    voltage = {e: 0.5 * g + within(GAIN[e] - 0.5 * abs(g)) for e, g in power.items()}
    return InstrumentErrors(
        voltage_gain=voltage,
        current_gain={e: g - voltage[e] for e, g in power.items()},
        offset_A=offset_A,
        offset_W=offset_W,
        temperature_K=temperature_K,
        output_sense=output_sense,
        supply_V=supply_V,
    )


def _correlated(white: Array, correlation: float) -> Array:
    """A first-order autoregression of unit variance along the last axis."""
    from scipy.signal import lfilter  # here: it loads slowly, and only trials ask for it

    fresh = np.sqrt(1 - correlation**2) * white
    fresh[..., 0] = white[..., 0]
    return np.asarray(lfilter([1.0], [1.0, -correlation], fresh, axis=-1))


def read_element(
    errors: InstrumentErrors, element: int, volt_amp_watt: Sequence[Array], rng: np.random.Generator
) -> tuple[Array, Array, Array]:
    """U, I and P of one element as it shows them in one update; inputs and results have one shape."""
    volts, amps, watts = volt_amp_watt
    gain_U, gain_I = 1 + errors.voltage_gain[element], 1 + errors.current_gain[element]
    offset_A = errors.offset_A[element]

    def noise() -> Array:
        draw = rng.standard_t(errors.tail, np.shape(watts)) * np.sqrt((errors.tail - 2) / errors.tail)
        if errors.correlation and np.ndim(watts):
            draw = _correlated(draw, errors.correlation)
        return np.asarray(1 + errors.noise * _NOISE[element] * draw)

    offset_W = offset_A * volts + errors.offset_W[element]
    shown_W = watts * gain_U * gain_I * noise() + offset_W * (1 + 0.05 * (noise() - 1))
    return (
        volts * gain_U * (1 + 0.3 * (noise() - 1)),
        (amps * gain_I + offset_A) * (1 + 0.5 * (noise() - 1)),
        shown_W,
    )
