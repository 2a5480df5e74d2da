"""Settling, and the measured row with its uncertainty.

Settled: over the last ``window_s`` of samples a straight line is fitted to every channel. Its slope must be
small or not distinguishable from zero (below twice its own standard error), and what is left about it must
be small. Channels are efficiency, P1 and P2 (relative), and all reported temperatures (slope only).

Uncertainty (k = 1) of a power P on a range R, from n updates with standard deviation s:

    u_A = s / √n                                 (type A; updates taken as independent)
    u_B = (a · |P| + b · R) / √3                 (type B; the analyzer's limit of error, rectangular)
    u_P² = u_A² + u_B²
    u_η² = u_A(η)² + η² · ((u_B(P1)/P1)² + (u_B(P2)/P2)²)

One converter's two ports are taken to have independent errors.
"""

import math
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from statistics import fmean, stdev

import numpy as np
from numpy.typing import NDArray

from bench.config import MeasureConfig, SettlingConfig
from bench.instruments import TEMPERATURES, Sample
from bench.plan import Kind, PlannedPoint
from bench.store.live import Settling
from bench.wording import channel_name, minus
from drivers.reading import Quality

Take = Callable[[], Sample]
ErrorLimit = Callable[[float, float], float]  # of a power reading in W on a range in W
Floats = NDArray[np.float64]
LEAST_SAMPLES = 3  # a line and one degree of freedom
SMALL_POWER = 0.1  # of the power limit: relative slopes of a power are taken of at least this
SMALL_EFFICIENCY = 0.1
RECTANGULAR = math.sqrt(3.0)
SIGNIFICANT = 2.0  # standard errors


@dataclass(frozen=True, slots=True, kw_only=True)
class Settled:
    """Whether a point settled, how long it took, and what had not when it did not."""

    ok: bool
    seconds: float
    said: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Measurement:
    """The mean of the updates by column, with uncertainties, and the updates themselves."""

    numbers: dict[str, float]
    quality: str
    samples: tuple[Mapping[str, float], ...]


# --- settling ---------------------------------------------------------------------------------------


def settle(
    take: Take,
    wait: Callable[[float], None],
    settings: SettlingConfig,
    *,
    power_W: float,
    told: Callable[[Settling], None] | None = None,
) -> Settled:
    """Sample until settled or until the time limit; ``power_W`` is the bench's power limit.

    ``told`` hears after each sample how far it is.
    """
    first_s = math.nan
    window: deque[Sample] = deque()
    while True:
        window.append(take())
        while len(window) > LEAST_SAMPLES and window[-1].time_s - window[1].time_s >= settings.window_s:
            window.popleft()
        first_s = window[0].time_s if math.isnan(first_s) else first_s
        elapsed_s = window[-1].time_s - first_s
        full = elapsed_s >= settings.window_s
        moving = unsettled(window, settings, power_W=power_W) if full else ""
        if told is not None:
            told(_progress(elapsed_s, settings, moving))
        if full:
            if not moving:
                return Settled(ok=True, seconds=elapsed_s, said="")
            if elapsed_s >= settings.limit_s:
                return Settled(
                    ok=False, seconds=elapsed_s, said=f"not settled in {elapsed_s:.0f} s: {moving}"
                )
        wait(settings.sample_every_s)


def _progress(elapsed_s: float, settings: SettlingConfig, moving: str) -> Settling:
    return Settling(elapsed_s=elapsed_s, window_s=settings.window_s, limit_s=settings.limit_s, moving=moving)


def unsettled(window: Sequence[Sample], settings: SettlingConfig, *, power_W: float) -> str:
    """What still moves in a window of samples; empty when nothing does."""
    values = np.array([_channels(sample) for sample in window])
    slope, error, spread = line(np.array([sample.time_s for sample in window]), values)
    mean = values.mean(axis=0)
    said = []
    for k, name in enumerate(("efficiency", "P1", "P2")):
        if not math.isfinite(mean[k]) or (name == "efficiency" and abs(mean[k]) < SMALL_EFFICIENCY):
            continue  # nothing flows through: efficiency has no meaning
        scale = 1.0 if name == "efficiency" else max(abs(mean[k]), SMALL_POWER * power_W)
        if abs(slope[k]) > max(settings.slope * scale, SIGNIFICANT * error[k]):
            said.append(f"{name} drifts by {slope[k] / scale:.2g} per s")
        if spread[k] > settings.spread * scale:
            said.append(f"{name} spreads by {spread[k] / scale:.2g}")
    for k, name in enumerate(TEMPERATURES, start=3):
        if abs(slope[k]) > max(settings.temperature_slope_K_per_s, SIGNIFICANT * error[k]):
            said.append(f"{channel_name(name)} drifts by {slope[k]:.2g} K/s")
    return minus(", ".join(said))


def line(times_s: Floats, values: Floats) -> tuple[Floats, Floats, Floats]:
    """Least-squares line through each column of ``values`` (N, K).

    Returns its slope, the slope's standard error, and the standard deviation about it, all (K,).

    >>> line(np.array([0.0, 1.0, 2.0, 3.0]), np.array([[1.0], [3.0], [5.0], [7.0]]))
    (array([2.]), array([0.]), array([0.]))
    """
    t = times_s - times_s.mean()
    y = values - values.mean(axis=0)
    square = t @ t
    slope = t @ y / square
    left = y - np.outer(t, slope)
    spread = np.sqrt((left * left).sum(axis=0) / max(len(t) - 2, 1))
    return slope, spread / np.sqrt(square), spread


def _channels(sample: Sample) -> tuple[float, ...]:
    values = sample.values
    return (sample.efficiency, values["P1_W"], values["P2_W"], *(values[name] for name in TEMPERATURES))


# --- measuring --------------------------------------------------------------------------------------


def measure(
    take: Take, settings: MeasureConfig, error_limit_W: ErrorLimit, ranges: Mapping[str, float]
) -> Measurement:
    """Average fresh updates; ``ranges`` are columns ``range_U1_V`` ... of the measurement table."""
    samples = [take() for _ in range(settings.samples)]
    numbers = {name: fmean(sample.values[name] for sample in samples) for name in samples[0].values}
    numbers["time_s"] = fmean(sample.time_s for sample in samples)
    numbers |= ranges
    numbers |= uncertainties(samples, error_limit_W, ranges)
    if not math.isnan(samples[0].efficiency):
        numbers["efficiency"] = numbers["P2_W"] / numbers["P1_W"]
    bad = [sample.quality.value for sample in samples if sample.quality is not Quality.GOOD]
    kept = tuple({"time_s": sample.time_s, **sample.values} for sample in samples)
    return Measurement(numbers=numbers, quality=bad[0] if bad else Quality.GOOD.value, samples=kept)


def uncertainties(
    samples: Sequence[Sample], error_limit_W: ErrorLimit, ranges: Mapping[str, float]
) -> dict[str, float]:
    """``u_P1_W u_P2_W u_efficiency`` of the mean of ``samples``, as in the module's equations."""
    type_B = {}
    found = {}
    for port in (1, 2):
        powers_W = [sample.values[f"P{port}_W"] for sample in samples]
        range_W = ranges[f"range_U{port}_V"] * ranges[f"range_I{port}_A"]
        mean_W = fmean(powers_W)
        type_B[port] = error_limit_W(mean_W, range_W) / RECTANGULAR
        found[f"u_P{port}_W"] = math.hypot(_type_A(powers_W), type_B[port])
        type_B[port] /= abs(mean_W) if mean_W else math.nan
    efficiencies = [sample.efficiency for sample in samples]
    if all(map(math.isfinite, efficiencies)):
        relative = math.hypot(type_B[1], type_B[2])
        found["u_efficiency"] = math.hypot(_type_A(efficiencies), fmean(efficiencies) * relative)
    return found


def _type_A(values: Sequence[float]) -> float:
    return stdev(values) / math.sqrt(len(values))


def rejected(row: PlannedPoint, numbers: Mapping[str, float], quality: str, target: "Target") -> str | None:
    """Why a measured row cannot be accepted; None when it can."""
    if quality != Quality.GOOD.value:
        return f"the analyzer's data are not good: {quality}"
    if row.kind is Kind.STANDBY:
        return None
    V2_V = numbers["V2_V"]
    if abs(V2_V - target.output_voltage_V) > target.settings.voltage_tolerance * target.output_voltage_V:
        return f"V2 = {V2_V:.2f} V is not held at {target.output_voltage_V:g} V"
    if row.kind is Kind.NO_LOAD:
        return None
    P2_W = numbers["P2_W"]
    if abs(P2_W - row.power_W) > target.settings.power_tolerance * row.power_W:
        return f"P2 = {P2_W:.1f} W is not at its set point {row.power_W:.1f} W"
    return None


@dataclass(frozen=True, slots=True, kw_only=True)
class Target:
    """What a measured row is held against."""

    output_voltage_V: float
    settings: MeasureConfig
