r"""The loop that holds the output voltage: PI on D0, and its margin.

Small signals: the controller samples v2 once a switching period T and its D0 acts a period later and is then held,
T + T/2 of delay; the bridge delivers g amperes per unit of phase into the capacitor, whose load draws constant power:

.. math::
    F(s) = \left( K_p + \frac{K_i}{s} \right) \frac{g \, e^{-1.5 s T}}{s C - P / V_2^2}

The load's negative resistance puts a pole into the right half plane, far below the crossover.
"""

from dataclasses import dataclass

import numpy as np

from sim.parameters import ParameterError

_DELAY_PERIODS = 1.5
_FREQUENCIES = np.geomspace(1.0, 1e6, 60001)


@dataclass(frozen=True, slots=True, kw_only=True)
class VoltageLoop:
    """Output capacitor, gains (D0 per V, and per V s) and the filter of the load power that D1 and D2 follow."""

    capacitance_F: float
    proportional_per_V: float
    integral_per_V_s: float
    load_filter_s: float

    def __post_init__(self) -> None:
        for name in ("capacitance_F", "proportional_per_V", "integral_per_V_s", "load_filter_s"):
            value = getattr(self, name)
            if not (np.isfinite(value) and value > 0):
                raise ParameterError(f"VoltageLoop.{name} is {value}; allowed: finite and > 0")


@dataclass(frozen=True, slots=True, kw_only=True)
class LoopPlant:
    """What the loop acts on at an operating point: dI2/dD0 in A, load in W, output voltage, switching period."""

    slope_A: float
    load_W: float
    V2_V: float
    period_s: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Margin:
    """Phase margin in degrees, and the frequency at which the loop's gain is one."""

    phase_deg: float
    crossover_Hz: float


def margin(loop: VoltageLoop, plant: LoopPlant) -> Margin:
    """Phase margin of the loop at an operating point, at the highest frequency at which its gain crosses one.

    >>> loop = VoltageLoop(capacitance_F=470e-6, proportional_per_V=0.04, integral_per_V_s=25.0, load_filter_s=1e-4)
    >>> found = margin(loop, LoopPlant(slope_A=50.0, load_W=1000.0, V2_V=140.0, period_s=50e-6))
    >>> round(found.crossover_Hz), round(found.phase_deg)
    (684, 62)
    """
    s = 2j * np.pi * _FREQUENCIES
    controller = loop.proportional_per_V + loop.integral_per_V_s / s
    delay = np.exp(-_DELAY_PERIODS * plant.period_s * s)
    gain = controller * plant.slope_A * delay / (s * loop.capacitance_F - plant.load_W / plant.V2_V**2)
    above = np.flatnonzero(np.abs(gain) >= 1.0)
    if not above.size:
        raise ParameterError(f"{loop}: the loop's gain is below one at every frequency")
    k = above[-1]
    lag = -np.unwrap(np.angle(gain))[k]
    return Margin(phase_deg=float(180.0 - np.degrees(lag) % 360.0), crossover_Hz=float(_FREQUENCIES[k]))
