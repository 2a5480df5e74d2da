"""A bench without wires or waiting: what is left of a campaign's time is the bench software's own."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np

from bench.campaign import Surroundings
from bench.config import BenchConfig, check
from bench.connect import Inspection
from bench.instruments import Bench
from bench.safety import PowerOffReport
from drivers.clock import Clock, StepClock
from drivers.controller import Applied, Telemetry
from drivers.dc_device import DcState
from drivers.health import Health
from drivers.identity import Identity
from drivers.reading import Reading
from experiments.survey.steady_plant import NOISE, Setting, truth

SETTINGS: dict[str, Any] = {
    "virtual": True,
    "analyzer": {"resource": "none", "update_s": 0.5},
    "supply": {"map": "ea_psi9000", "resource": "none"},
    "load": {"map": "ea_elr9000", "resource": "none"},
    "controller": {"resource": "none", "heartbeat_s": 2.0},
    "limits": {
        "voltage_V": 320, "current_A": 10, "power_W": 2200, "output_voltage_V": 160, "again_s": 0, "recover_s": 0,
    },
}  # fmt: skip
WHO = Identity("instant", "bench", "1", "0")


def instant_bench(name: str) -> BenchConfig:
    """The settings of such a bench."""
    return check({**SETTINGS, "name": name}, BenchConfig, file="instant bench")


class InstantBench:
    """All instruments in one object; ``setting`` is what is commanded."""

    def __init__(self, seed: int) -> None:
        self.clock = StepClock()
        self.setting = Setting()
        self._rng = np.random.default_rng(seed)

    @property
    def off(self) -> bool:
        """Whether nothing is on."""
        return not (self.setting.pwm or self.setting.supply_on or self.setting.load_on)

    def around(self) -> Surroundings:
        """What a campaign on this bench is handed."""
        return Surroundings(connect=self._connect, make_safe=self._make_safe)

    @contextmanager
    def _connect(self, config: BenchConfig, _clock: Clock) -> Iterator[Bench]:
        yield self._bench(config)

    def _make_safe(self, config: BenchConfig, _clock: Clock) -> PowerOffReport:
        return self._bench(config).power_off()

    def _set(self, **changes: Any) -> None:
        self.setting = replace(self.setting, **changes)

    def _read(self) -> dict[str, Reading]:
        self.clock.sleep(0.5)
        shown = truth(self.setting)
        noise = self._rng.normal(1.0, NOISE, len(shown))
        now = self.clock.now()
        return {
            item: Reading(value=value * k, unit="", time_s=now)
            for (item, value), k in zip(shown.items(), noise, strict=True)
        }

    def _heartbeat(self) -> Telemetry:
        s = self.setting
        return Telemetry(
            pwm_on=s.pwm, armed=True, table_in_use=False, D0=0.1, D1=s.D1, D2=s.D2, V2_V=140.0 * s.converts,
            T_heatsink_C=30.0, T_transformer_C=30.0, T_inductor_C=30.0, T_ambient_C=25.0, faults=(),
        )  # fmt: skip

    def _modulate(self, D1: float, D2: float) -> Applied:
        self._set(D1=D1, D2=D2)
        return Applied(D1=D1, D2=D2, mode="hybrid")

    def _bench(self, config: BenchConfig) -> Bench:
        def nothing(*_: object, **__: object) -> None: ...

        common = {"health": Health(), "resource": "none", "identify": lambda: WHO}
        told = (
            "take_remote", "set_voltage", "set_current_limit", "set_power_limit", "allow_current", "accept_any_voltage",
        )  # fmt: skip
        dc = dict.fromkeys(told, nothing) | common
        instruments: Any = SimpleNamespace(
            analyzer=SimpleNamespace(
                read=self._read, configure=nothing, **common,
                ranges=lambda: {"U1": 300.0, "I1": 10.0, "U2": 150.0, "I2": 20.0},
                model=SimpleNamespace(error_limit=lambda _q, _k, W, range_W: 0.0005 * W + 0.001 * range_W),
            ),
            supply=SimpleNamespace(
                on=lambda: self._set(supply_on=True, supply_V=300.0), off=lambda: self._set(supply_on=False),
                state=lambda: DcState(on=self.setting.supply_on, mode="CV", remote=True, alarms=()),
                actual=lambda: {"U": Reading(value=300.0 * self.setting.supply_on, unit="V", time_s=0.0)}, **dc,
            ),
            load=SimpleNamespace(
                set_power=lambda W: self._set(load_W=W), on=lambda: self._set(load_on=True),
                off=lambda: self._set(load_on=False),
                state=lambda: DcState(on=self.setting.load_on, mode="CP", remote=True, alarms=()),
                actual=lambda: {"U": Reading(value=140.0 * self.setting.converts, unit="V", time_s=0.0)}, **dc,
            ),
            controller=SimpleNamespace(
                heartbeat=self._heartbeat, arm=nothing, disarm=nothing, set_modulation=self._modulate,
                enable=lambda: self._set(pwm=True), disable=lambda: self._set(pwm=False), **common,
            ),
        )  # fmt: skip
        return Bench(config, instruments, self.clock, Inspection(identities={"analyzer": WHO}))
