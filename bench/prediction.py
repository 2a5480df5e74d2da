"""What the simulator says of set points, before any of them is set."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from bench.config import ConverterConfig
from bench.model_file import model_from
from sim.model import Model
from sim.simulate import Points, simulate

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True)
class Asked:
    """N set points, arrays (N,): output power in W, ambient in degC; ``pwm`` false is standby."""

    D1: FloatArray
    D2: FloatArray
    power_W: FloatArray
    ambient_C: float
    pwm: NDArray[np.bool_] | bool = True


@dataclass(frozen=True, slots=True, kw_only=True)
class Forecast:
    """Simulated columns of N set points; NaN, and a reason, where the converter cannot get there."""

    feasible: NDArray[np.bool_]
    reason: NDArray[np.str_]
    columns: dict[str, FloatArray]

    def row(self, index: int) -> dict[str, float]:
        """The columns of one set point."""
        return {name: float(values[index]) for name, values in self.columns.items()}


class Predictor(Protocol):
    """Anything that forecasts set points; the campaign needs no more of the simulator than this."""

    def __call__(self, asked: Asked) -> Forecast:
        """Forecast N set points."""
        ...


@dataclass(frozen=True, slots=True, kw_only=True)
class SimulatedConverter:
    """The simulator at the bench's own voltages."""

    model: Model
    input_voltage_V: float
    output_voltage_V: float

    @classmethod
    def of(cls, converter: ConverterConfig) -> "SimulatedConverter":
        """The model file of the bench, or the baseline when it names none."""
        return cls(
            model=model_of(converter),
            input_voltage_V=converter.input_voltage_V,
            output_voltage_V=converter.output_voltage_V,
        )

    def __call__(self, asked: Asked) -> Forecast:
        """Simulate N set points."""
        result = simulate(
            self.model,
            Points(
                D1=asked.D1,
                D2=asked.D2,
                power_W=asked.power_W,
                V1_V=self.input_voltage_V,
                V2_V=self.output_voltage_V,
                ambient_C=asked.ambient_C,
                pwm=asked.pwm,
            ),
        )
        return Forecast(feasible=result.feasible, reason=result.reason, columns=dict(result.values))


def model_of(converter: ConverterConfig) -> Model:
    """The simulation model of a bench, under the bench's modulation."""
    model = model_from(converter.model)
    return model if converter.modulation is None else model.driven_by(converter.modulation)


def modulation_of(converter: ConverterConfig) -> str:
    """The modulation of a bench: its own where it names one, else its model's."""
    return model_of(converter).converter.modulation
