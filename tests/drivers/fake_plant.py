"""A plant small enough to predict: what it measures is arithmetic on its settings."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

from drivers.clock import Clock, StepClock


@dataclass(frozen=True, slots=True, kw_only=True)
class FakeState:
    """The state that the mocks see."""

    time_s: float = 0.0
    supply_V: float = 300.0
    supply_A: float = 2.0
    supply_mode: str = "CV"
    load_V: float = 140.0
    load_A: float = 4.0
    D0: float = 0.25
    D1: float = 0.0
    D2: float = 0.0
    pwm: bool = False
    T_heatsink_C: float = 40.0
    T_transformer_C: float = 50.0
    T_inductor_C: float = 60.0
    T_ambient_C: float = 25.0
    faults: tuple[str, ...] = ()


@dataclass
class FakePlant:
    """Holds a state, records what is set; update ``n`` of the analyzer adds ``n`` millivolts to U1."""

    clock: Clock = field(default_factory=StepClock)
    present: FakeState = FakeState()
    mode: str = ""
    modulations: tuple[str, ...] = ("hybrid", "dps")
    broken: tuple[str, ...] = ()  # the faults that come whenever the PWM goes on

    @property
    def faults(self) -> tuple[str, ...]:
        return self.present.faults

    @property
    def output_V(self) -> float:
        return self.present.load_V

    def state(self) -> FakeState:
        return replace(self.present, time_s=self.clock.now())

    def set_supply(self, *, on: bool, voltage_V: float, current_limit_A: float) -> None:
        self.present = replace(self.present, supply_V=voltage_V if on else 0.0, supply_A=current_limit_A)

    def set_load(self, *, on: bool, power_W: float) -> None:
        self.present = replace(self.present, load_A=power_W / self.present.load_V if on else 0.0)

    def set_bridge(self, *, pwm: bool, D1: float, D2: float, mode: str) -> None:
        faults = self.broken if pwm and not self.present.pwm else self.present.faults
        self.present = replace(self.present, pwm=pwm, D1=D1, D2=D2, faults=faults)
        self.mode = mode

    def collapse(self) -> None:
        self.present = replace(self.present, pwm=False, faults=("output_undervoltage",))

    def analyzer(self, update: int, update_s: float, ranges: Mapping[str, float]) -> dict[str, float]:
        now = self.present
        U = {1: now.supply_V + 0.001 * update, 2: now.load_V, 3: 310.0, 4: 145.0}
        I = {1: now.supply_A, 2: now.load_A, 3: 3.0, 4: 6.0}  # noqa: E741
        readings: dict[str, float] = {}
        for n in U:
            readings |= {f"U{n}": U[n], f"I{n}": I[n], f"P{n}": U[n] * I[n]}
        return readings
