"""What the simulator can carry and the bench may do: set points beyond its limits count as infeasible."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np

from bench.config import BenchConfig
from bench.plan_config import PlanConfig
from bench.prediction import Asked, FloatArray, Forecast, Predictor
from bench.safety import Limits
from bench.wording import channel_name


@dataclass(frozen=True, slots=True)
class Within:
    """A predictor to which a point beyond the bench's limits is as infeasible as one without a solution.

    So is one that cannot carry ``spare`` more of its power. How far what is measured may be off what is predicted are
    the margins of the ``plan``.
    """

    predict: Predictor
    bench: BenchConfig
    plan: PlanConfig
    spare: float = 0.0

    def __call__(self, asked: Asked) -> Forecast:
        """Forecast N set points."""
        forecast = self.predict(asked)
        feasible, reason = forecast.feasible.copy(), forecast.reason.astype("U96")
        if self.spare:
            carried = self.predict(replace(asked, power_W=(1 + self.spare) * asked.power_W)).feasible
            reason[feasible & ~carried] = f"less than {100 * self.spare:.0f} % of the power to spare"
            feasible &= carried
        columns = {**forecast.columns, **self._derived(forecast.columns, asked)}
        for name, limit, of in self._ceilings():
            if name in columns:
                beyond = self._expected(name, columns[name], asked.ambient_C) > limit
                reason[beyond & feasible] = f"{channel_name(name)} predicted too near {of} or above it"
                feasible &= ~beyond
        return replace(forecast, feasible=feasible, reason=reason)

    def _ceilings(self) -> Iterator[tuple[str, float, str]]:
        """Column, its highest value, and whose that is: the safety limits, and ranges that are fixed."""
        for name, limit in Limits.of(self.bench.limits, self.bench.converter).upper.items():
            yield name, limit, "its limit"
        if self.bench.limits.link_peak_A is not None:
            yield "I_L_peak_A", self.bench.limits.link_peak_A, "its limit"
        wiring = self.bench.analyzer.wiring
        for port, element in ((1, wiring.input), (2, wiring.output)):
            for quantity, unit in (("U", "V"), ("I", "A")):
                fixed = self.bench.analyzer.ranges.get(f"{quantity}{element}")
                if fixed is not None:
                    column = f"{'V' if quantity == 'U' else 'I'}{port}_{unit}"
                    yield column, fixed, "the analyzer's range"

    def _derived(self, columns: Mapping[str, FloatArray], asked: Asked) -> dict[str, FloatArray]:
        """What follows from the forecast and the voltages that are held: port currents, peak of the link."""
        V1, V2 = self.bench.converter.input_voltage_V, self.bench.converter.output_voltage_V
        ones = np.ones_like(asked.power_W)
        found = {"V1_V": V1 * ones, "V2_V": V2 * ones, "I2_A": asked.power_W / V2}
        if "P1_W" in columns:
            found["I1_A"] = columns["P1_W"] / V1
        if "I_L_pp_A" in columns:
            found["I_L_peak_A"] = columns["I_L_pp_A"] / 2  # the steady state is half-wave symmetric
        return found

    def _expected(self, name: str, value: FloatArray, ambient_C: float) -> FloatArray:
        if name.startswith("T_"):
            return value + self.plan.heat_margin * (value - ambient_C)
        return value if name.endswith("_V") else value * (1 + self.plan.power_margin)  # voltages are held
