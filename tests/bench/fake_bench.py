"""A bench without wires: instruments with the drivers' methods over a few lines of arithmetic."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from datetime import datetime
from types import SimpleNamespace

import numpy as np

from bench.campaign import Surroundings, run_campaign
from bench.config import BenchConfig, CampaignConfig, check
from bench.connect import Inspection
from bench.instruments import Bench
from bench.job import CampaignOutcome, Job
from bench.prediction import Asked, Forecast
from bench.store import Store
from drivers.clock import StepClock
from drivers.controller import Applied, Telemetry
from drivers.dc_device import DcState
from drivers.errors import LinkLost
from drivers.health import Health
from drivers.identity import Identity
from drivers.reading import Quality, Reading

SIMULATED = 0.98
TRUE = 0.97  # efficiency of the fake converter: one point below its simulation
TAU_S = 20.0

BENCH = {
    "name": "fake bench",
    "virtual": True,
    "analyzer": {"resource": "fake", "update_s": 0.5},
    "supply": {"map": "ea_psi9000", "resource": "fake"},
    "load": {"map": "ea_elr9000", "resource": "fake"},
    "controller": {"resource": "fake", "heartbeat_s": 2.0},
    "limits": {
        "voltage_V": 320,
        "current_A": 10,
        "power_W": 2200,
        "output_voltage_V": 160,
        "again_s": 0,
        "recover_s": 0,
    },
}
CAMPAIGN = {
    "name": "six points",
    "plan": {"kind": "latin_hypercube", "points": 6, "reference_every": 3, "standby": 1, "no_load": 1},
    "settling": {"window_s": 6, "sample_every_s": 2, "limit_s": 120},
    "measure": {"samples": 4},
}


def bench_config(**changes: object) -> BenchConfig:
    """The fake bench's settings with some tables changed."""
    return check({**BENCH, **changes}, BenchConfig, file="bench.toml")


def campaign_config(**changes: object) -> CampaignConfig:
    """The six-point campaign with some tables changed."""
    return check({**CAMPAIGN, **changes}, CampaignConfig, file="campaign.toml")


def predict(asked: Asked) -> Forecast:
    """A simulator that carries any power while D1 exceeds D2, at one efficiency."""
    feasible = asked.D1 > asked.D2
    efficiency = np.where(feasible & (asked.power_W > 0), SIMULATED, np.nan)
    reason = np.where(feasible, "", "D1 and D2 carry at most 0 W")
    return Forecast(
        feasible=feasible,
        reason=reason,
        columns={"efficiency": efficiency, "P1_W": asked.power_W / efficiency},
    )


IDENTITY = Identity(maker="fake", model="bench", serial="1", firmware="0")


def volts(value: float) -> Reading:
    """A good reading of a voltage."""
    return Reading(value=value, unit="V", time_s=0.0)


@dataclass
class FakeInstruments:
    """Analyzer, supply, load and controller in one object; ``done`` lists what was switched, in order."""

    clock: StepClock = field(default_factory=StepClock)
    done: list[str] = field(default_factory=list)
    broken: set[str] = field(default_factory=set)  # calls that fail with LinkLost
    failing: dict[str, Exception] = field(default_factory=dict)  # calls that fail once, and how
    supply_on: bool = False
    supply_rises_s: float = 0.0  # from on to its whole voltage, on a line
    load_on: bool = False
    pwm: bool = False
    power_W: float = 0.0
    faults: tuple[str, ...] = ()
    alarms: tuple[tuple[str, str], ...] = ()  # device and alarm
    local: tuple[str, ...] = ()  # devices that somebody has taken to local control
    heatsink_C: float = 25.0
    noise: float = 1e-5
    last_beat_s: float = 0.0
    longest_silence_s: float = 0.0
    _supply_since_s: float = 0.0
    _stepped_s: float = 0.0
    _rng: np.random.Generator = field(default_factory=lambda: np.random.default_rng(5))

    def call(self, name: str) -> None:
        if name in self.broken:
            raise LinkLost(f"{name}: unplugged")
        if name in self.failing:
            raise self.failing.pop(name)
        self.done.append(name)

    @property
    def off(self) -> bool:
        return not (self.supply_on or self.load_on or self.pwm)

    @property
    def supply_V(self) -> float:
        """What the supply has come up to."""
        if not self.supply_on:
            return 0.0
        on_s = self.clock.now() - self._supply_since_s
        return 300.0 if on_s >= self.supply_rises_s else 300.0 * on_s / self.supply_rises_s

    def turn_supply_on(self) -> None:
        """At 0 V first."""
        self.set("supply on", supply_on=True)
        self._supply_since_s = self.clock.now()

    def step(self) -> None:
        """Let the heatsink follow the load since the last call."""
        passed_s, self._stepped_s = self.clock.now() - self._stepped_s, self.clock.now()
        target_C = 25.0 + (0.02 * self.power_W if self.load_on else 0.0)
        self.heatsink_C = target_C + (self.heatsink_C - target_C) * float(np.exp(-passed_s / TAU_S))

    def set(self, name: str, **state: object) -> None:
        self.step()
        self.call(name)
        for key, value in state.items():
            setattr(self, key, value)

    def read(self) -> dict[str, Reading]:
        self.call("read")
        self.clock.sleep(0.5)
        self.step()
        P2_W = self.power_W if self.load_on and self.pwm else 0.0
        P1_W = (
            (P2_W / (TRUE - 1e-5 * (self.heatsink_C - 25.0)) + 5.0 * self.pwm + 3.0)
            if self.supply_on
            else 0.0
        )
        V1_V, V2_V = self.supply_V, 140.0 * (self.pwm and self.supply_on)
        values = {"U1": V1_V, "I1": P1_W / 300.0, "P1": P1_W, "U2": V2_V, "I2": P2_W / 140.0, "P2": P2_W}
        now, spread = self.clock.now(), self._rng.normal(1.0, self.noise, 6)
        return {
            item: Reading(value=value * k, unit="", time_s=now, quality=Quality.GOOD)
            for (item, value), k in zip(values.items(), spread, strict=True)
        }

    def heartbeat(self) -> Telemetry:
        self.call("beat")
        now = self.clock.now()
        if self.pwm:
            self.longest_silence_s = max(self.longest_silence_s, now - self.last_beat_s)
        self.last_beat_s = now
        return Telemetry(
            pwm_on=self.pwm, armed=True, table_in_use=False, D0=0.1, D1=0.5, D2=0.1,
            V2_V=140.0 * self.pwm, T_heatsink_C=self.heatsink_C, T_transformer_C=30.0, T_inductor_C=30.0,
            T_ambient_C=25.0, faults=self.faults,
        )  # fmt: skip

    def set_modulation(self, D1: float, D2: float) -> Applied:
        self.call("modulation")
        self.done[-1] = f"modulation {D1:g} {D2:g}"
        return Applied(D1=round(D1, 3), D2=round(D2, 3), mode="hybrid")

    def dc_state(self, name: str, *, on: bool) -> DcState:
        """What supply or load says of itself."""
        self.call(f"{name} state")
        alarms = tuple(alarm for device, alarm in self.alarms if device == name)
        return DcState(on=on, mode="CV", remote=name not in self.local, alarms=alarms)

    def bench(self, config: BenchConfig, faults: list[str] | None = None) -> Bench:
        """A bench whose instruments are all this object."""
        silent = lambda *_, **__: None  # noqa: E731
        common = {"health": Health(), "resource": "fake", "identify": lambda: IDENTITY}
        dc = {
            "take_remote": silent, "set_voltage": silent, "set_current_limit": silent, "allow_current": silent,
            "accept_any_voltage": silent, **common,
        }  # fmt: skip
        instruments = SimpleNamespace(
            analyzer=SimpleNamespace(
                **common,
                read=self.read,
                configure=silent,
                ranges=lambda: {"U1": 300.0, "I1": 5.0, "U2": 150.0, "I2": 20.0},
                model=SimpleNamespace(error_limit=lambda _q, _k, W, range_W: 0.0005 * W + 0.001 * range_W),
            ),
            supply=SimpleNamespace(
                set_power_limit=silent,
                on=self.turn_supply_on,
                off=lambda: self.set("supply off", supply_on=False),
                state=lambda: self.dc_state("supply", on=self.supply_on),
                actual=lambda: {"U": volts(300.0 * self.supply_on)},
                **dc,
            ),
            load=SimpleNamespace(
                set_power=lambda W: self.set("load power", power_W=W),
                on=lambda: self.set("load on", load_on=True),
                off=lambda: self.set("load off", load_on=False),
                state=lambda: self.dc_state("load", on=self.load_on),
                actual=lambda: {"U": volts(140.0 * self.pwm)},
                **dc,
            ),
            controller=SimpleNamespace(
                **common,
                heartbeat=self.heartbeat,
                arm=lambda: self.call("arm"),
                disarm=silent,
                set_modulation=self.set_modulation,
                enable=lambda: self.set("PWM on", pwm=True),
                disable=lambda: self.set("PWM off", pwm=False),
            ),
        )
        inspection = Inspection(identities={"analyzer": IDENTITY}, faults=faults or [])
        return Bench(config, instruments, self.clock, inspection)  # type: ignore[arg-type]

    @contextmanager
    def connect(self, config: BenchConfig, _clock: object) -> Iterator[Bench]:
        """In the place of ``open_bench``."""
        yield self.bench(config)

    def around(self, today: Callable[[], datetime] = datetime.now) -> Surroundings:
        """What a campaign on this bench is handed."""
        off = lambda config, _clock: self.bench(config).power_off()  # noqa: E731
        return Surroundings(connect=self.connect, make_safe=off, today=today)


def memory() -> Store:
    """A database that is gone with the test."""
    return Store("sqlite://")


def job(**changes: object) -> Job:
    """The six-point campaign with some tables changed, planned for the fake bench."""
    return Job.prepare(campaign_config(**changes), bench_config(), predict=predict)


def run(fake: FakeInstruments, store: Store, a_job: Job | None = None, **watch: object) -> CampaignOutcome:
    """That campaign, or another, on a fake bench."""
    return run_campaign(a_job or job(), store, fake.clock, around=fake.around(), **watch)  # type: ignore[arg-type]
