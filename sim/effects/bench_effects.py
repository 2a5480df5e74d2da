"""Effects outside the converter: what is set, what surrounds, what the analyzer shows."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cache
from typing import Self

import numpy as np
from numpy.typing import NDArray

from sim.effects.base import Effect, EffectParameter, Values
from sim.operating_points import Points, efficiency
from sim.parameters import Converter, Quantity
from sim.size import current_range_A

Array = NDArray[np.float64]

_HOUR_S = 3600.0


@dataclass(frozen=True, slots=True, kw_only=True)
class DutyOffset(Effect):
    """D1 as applied differs from D1 as set."""

    def set_points(self, points: Points, values: Values) -> Points:
        """D1 moved, kept in [0, 1]; a D1 of 1 has no edge that could be off."""
        offset = self.value(values)
        if offset == 0.0:
            return points
        D1 = np.asarray(points.D1)
        return replace(points, D1=np.where(D1 < 1.0, np.clip(D1 + offset, 0.0, 1.0), D1))


@dataclass(frozen=True, slots=True, kw_only=True)
class AmbientDrift(Effect):
    """The room warms while the campaign runs."""

    def set_points(self, points: Points, values: Values) -> Points:
        """Ambient raised in proportion to time."""
        rate = self.value(values)
        return (
            points
            if rate == 0.0
            else replace(points, ambient_C=points.ambient_C + rate * points.time_s / _HOUR_S)
        )


def _read(seen: Quantity, simulated: Array | float) -> Array:
    """What was read, else what is simulated, (N,): the room is not modelled, and a range is chosen by a reading."""
    return np.where(np.isnan(seen), simulated, seen)


def _unsure(seen: Quantity, sigma: Array) -> Array:
    """One sigma of that, (N,): none where it was read."""
    return np.where(np.isnan(seen), sigma, 0.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class FanStep(Effect):
    """A fan that switches on above a heatsink temperature."""

    def added_loss_W(self, points: Points, state: Mapping[str, Array], values: Values) -> Array | float:
        """The fan's power where the heatsink is warmer than the threshold."""
        hot = _read(points.seen_heatsink_C, state["T_heatsink_C"]) > self.value(values, "threshold_C")
        return np.where(hot, self.value(values), 0.0)

    def undecided(
        self, points: Points, state: Mapping[str, Array], sigma: Mapping[str, Array], values: Values
    ) -> Array:
        """Where the heatsink is about as warm as the threshold."""
        seen, name = points.seen_heatsink_C, "T_heatsink_C"
        return self.near("threshold_C", _read(seen, state[name]), _unsure(seen, sigma[name]), values)


@dataclass(frozen=True, slots=True, kw_only=True)
class WarmUpDrift(Effect):
    """All losses rise over the campaign, like the temperature of something slow that starts cold."""

    def added_loss_W(self, points: Points, state: Mapping[str, Array], values: Values) -> Array | float:
        """A share of the loss that approaches its end with a time constant; the value is that at the last point."""
        end_s = max(float(np.max(points.time_s)), 1e-9)
        slow_s = self.value(values, "time_constant_s")
        course = np.expm1(-np.asarray(points.time_s) / slow_s) / np.expm1(-end_s / slow_s)
        return np.asarray(self.value(values) * (state["P1_W"] - state["P2_W"]) * course)


def _show_input(points: Points, truth: dict[str, Array], power_W: Array) -> dict[str, Array]:
    return truth | {
        "P1_W": power_W,
        "I1_A": power_W / np.asarray(points.V1_V),
        "efficiency": efficiency(power_W, truth["P2_W"]),
    }


@dataclass(frozen=True, slots=True, kw_only=True)
class AnalyzerGain(Effect):
    """Port 1 reads in another proportion than port 2."""

    def observe(self, points: Points, truth: dict[str, Array], values: Values) -> dict[str, Array]:
        """Input power scaled."""
        gain = self.value(values)
        return truth if gain == 0.0 else _show_input(points, truth, truth["P1_W"] * (1.0 + gain))


@dataclass(frozen=True, slots=True, kw_only=True)
class AnalyzerOffset(Effect):
    """Port 1's current has a zero offset."""

    def observe(self, points: Points, truth: dict[str, Array], values: Values) -> dict[str, Array]:
        """Input power shifted by V1 times the offset."""
        offset = self.value(values)
        return truth if offset == 0.0 else _show_input(points, truth, truth["P1_W"] + offset * points.V1_V)


_RANGE_A = 5.0  # of the input's current at the prototype
_SHOWN_ABOVE = 2.0  # prior scales of a step: how far above a boundary the lower range may show a current


@cache
def _ranges_about(range_A: float) -> tuple[float, ...]:
    """The analyzer's ranges that a converter's current may cross, from two below the one in use to one above."""
    return tuple(current_range_A(range_A, further) for further in (-2, -1, 0, 1))


@dataclass(frozen=True, slots=True, kw_only=True)
class AnalyzerRangeStep(Effect):
    """Port 1 reads in another proportion on its lower current range."""

    def at(self, converter: Converter) -> Self:
        """With the ranges about the one in use: they are 1, 2, 5 ... A, whatever the converter."""
        sized = Effect.at(self, converter)
        if sized is self:
            return self
        step, boundary = sized.parameters
        return replace(sized, parameters=(step, replace(boundary, scan=_ranges_about(boundary.off))))

    def observe(self, points: Points, truth: dict[str, Array], values: Values) -> dict[str, Array]:
        """Input power scaled where the current is below the boundary between the ranges.

        A current that was read there has the step in it.
        """
        step, seen = self.value(values), points.seen_I1_A
        if step == 0.0:
            return truth
        shown = np.where(np.isnan(seen), 1.0, max(1.0 + step, 1.0))
        low = _read(seen, truth["I1_A"]) < shown * self.value(values, "boundary_A")
        return _show_input(points, truth, truth["P1_W"] * np.where(low, 1.0 + step, 1.0))

    def undecided(
        self, points: Points, state: Mapping[str, Array], sigma: Mapping[str, Array], values: Values
    ) -> Array:
        """Where the input current is about the boundary, or was read as far above as the lower range may show it."""
        seen, name = points.seen_I1_A, "I1_A"
        boundary_A = self.value(values, "boundary_A")
        above = np.where(np.isnan(seen), 0.0, _SHOWN_ABOVE * self.headline.prior * boundary_A)
        read = _read(seen, state[name])
        nearer = np.where(read > boundary_A, np.maximum(read - above, boundary_A), read)
        return self.near("boundary_A", nearer, _unsure(seen, sigma[name]), values)


def _one(name: str, unit: str, tolerance: float, prior: float, lower: float, upper: float) -> EffectParameter:
    return EffectParameter(name=name, unit=unit, tolerance=tolerance, prior=prior, lower=lower, upper=upper)


BENCH_EFFECTS: tuple[Effect, ...] = (
    FanStep(
        name="fan_step",
        stage="supply, wiring",
        parameters=(
            replace(_one("power_W", "W", 0.4, 3.0, 0.0, 30.0), goes_by="power"),
            EffectParameter(
                name="threshold_C",
                scan=(30.0, 35.0, 40.0, 45.0, 50.0, 55.0, 60.0),
                unit="degC",
                tolerance=1.5,  # by which model and sensor may miss the heatsink's temperature
                prior=5.0,
                lower=25.0,
                upper=90.0,
                off=40.0,
            ),
        ),
        says="a fan switches on above a heatsink temperature and is fed from the input",
        check_on_bench="listen for the fan; read the input power in standby with the fan forced on",
        threshold=True,
    ),
    WarmUpDrift(
        name="warm_up_drift",
        stage="thermal, time",
        parameters=(
            _one("relative_loss_at_end", "1", 0.005, 0.1, -0.5, 1.0),
            EffectParameter(
                name="time_constant_s",
                scan=(100 * _HOUR_S, 10 * _HOUR_S, 5 * _HOUR_S, 2 * _HOUR_S),
                unit="s",
                tolerance=0.0,
                prior=10 * _HOUR_S,
                lower=60.0,
                upper=1e8,
                off=100 * _HOUR_S,  # a straight line over any campaign
            ),
        ),
        law=0.1,
        over_time=True,
        says="losses rise over the campaign: something warms up more slowly than the settling waits for",
        says_below="losses fall over the campaign: an instrument that drifts, or something that needs long to warm up",
        check_on_bench="repeat the first point at the end; wait longer before the first point",
        below_off=(
            "losses that fall while the bench warms up are rather an instrument's drift: warm the analyzer up for its "
            "stated time, zero it, and check its gain at the start and at the end"
        ),
    ),
    AmbientDrift(
        name="ambient_drift",
        stage="thermal, time",
        parameters=(_one("rate_K_per_h", "K/h", 0.1, 3.0, -20.0, 20.0),),
        over_time=True,
        says="the room's temperature drifts while the campaign runs",
        check_on_bench="log the ambient temperature at the heatsink's air inlet",
    ),
    AnalyzerGain(
        name="analyzer_gain",
        stage="measurement, command",
        parameters=(_one("relative_error", "1", 4e-4, 5e-3, -0.05, 0.05),),
        law=0.01,
        says="the analyzer's two dc ports disagree in proportion: calibration, range or wiring",
        check_on_bench="swap the two elements and measure the same point again: an error of theirs changes its sign",
    ),
    AnalyzerOffset(
        name="analyzer_offset",
        stage="measurement, command",
        # 0.05 % of a range of 5 A, uniform: a sigma of that over root three
        parameters=(replace(_one("current_A", "A", 1.5e-3, 0.02, -0.2, 0.2), goes_by="input_range"),),
        law=0.01,
        inside_limits=True,
        says="the analyzer's input current has a zero offset, or something draws as much at the input, in standby too",
        check_on_bench="zero the analyzer with the input open; read standby with the leads off: what only the leads "
        "bring is a load that runs in standby too",
    ),
    AnalyzerRangeStep(
        name="analyzer_range_step",
        stage="measurement, command",
        parameters=(
            _one("relative_step", "1", 3e-4, 4e-3, -0.05, 0.05),
            EffectParameter(
                name="boundary_A",
                scan=_ranges_about(_RANGE_A),
                unit="A",
                tolerance=0.02,
                prior=1.0,
                lower=0.1,
                upper=20.0,
                off=_RANGE_A,
                goes_by="input_range",
            ),
        ),
        law=0.01,
        says="the analyzer reads in another proportion on the lower of two current ranges",
        check_on_bench="measure one point on both ranges; fix the range",
        threshold=True,
    ),
    DutyOffset(
        name="duty_offset",
        stage="measurement, command",
        parameters=(_one("offset", "1", 6e-4, 0.01, -0.05, 0.05),),
        says="D1 at the gates differs from D1 as set: rounding, minimum pulse, dead-time compensation",
        check_on_bench="measure the pulse width of S1 against its set point with an oscilloscope",
    ),
)
