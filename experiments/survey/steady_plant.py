"""A plant without a memory: what it shows depends on what is set, and its noise on the row that is measured.

Noise is drawn by seed, point, repeat and number of the update since the set point was reached, so that a row measured
anew after a crash reads the same numbers again. ``truth`` says what it would show without noise: any number stored
can be held against it. Losses are made up: 1 % and what grows from there with current and D1.
"""

import threading
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from drivers.clock import Clock

NOISE = 2e-5  # relative, one standard deviation of an update
AMBIENT_C = 25.0

Row = tuple[int, int]  # point and repeat


@dataclass(frozen=True, slots=True, kw_only=True)
class SteadyState:
    """What the instruments see."""

    supply_V: float = 0.0
    supply_A: float = 0.0
    supply_mode: str = "CV"
    load_V: float = 0.0
    load_A: float = 0.0
    D0: float = 0.0
    D1: float = 0.0
    D2: float = 0.0
    T_heatsink_C: float = AMBIENT_C
    T_transformer_C: float = AMBIENT_C
    T_inductor_C: float = AMBIENT_C
    T_ambient_C: float = AMBIENT_C


@dataclass(frozen=True, slots=True, kw_only=True)
class Setting:
    """All that was commanded."""

    supply_on: bool = False
    supply_V: float = 0.0
    load_on: bool = False
    load_W: float = 0.0
    pwm: bool = False
    D1: float = 0.0
    D2: float = 0.0

    @property
    def converts(self) -> bool:
        """Whether power can flow."""
        return self.pwm and self.supply_on


def efficiency(D1: float, D2: float, power_W: float) -> float:
    """Of the made-up converter: between 0.90 and 0.99 anywhere in the box."""
    return 0.985 - 0.02 * (1.0 - D1) ** 2 - 0.01 * D2 - 2.0 / (power_W + 100.0)


def truth(setting: Setting) -> dict[str, float]:
    """What the analyzer would show without noise: U, I and P of elements 1 to 4."""
    V1 = setting.supply_V if setting.supply_on else 0.0
    V2 = 140.0 if setting.converts else 0.0
    P2 = setting.load_W if setting.converts and setting.load_on else 0.0
    P1 = 0.0
    if setting.supply_on:
        P1 = 2.0 + 5.0 * setting.pwm
    if P2 > 0.0:
        P1 = P2 / efficiency(setting.D1, setting.D2, P2)
    link = 0.5 * (P1 + P2)
    volts = {1: V1, 2: V2, 3: 300.0 * setting.converts, 4: 140.0 * setting.converts}
    powers = {1: P1, 2: P2, 3: link, 4: link}
    shown: dict[str, float] = {}
    for n, U in volts.items():
        shown |= {f"U{n}": U, f"I{n}": powers[n] / U if U else 0.0, f"P{n}": powers[n]}
    return shown


class SteadyPlant:
    """The plant behind a rack; ``row`` tells which row is being measured now."""

    def __init__(self, clock: Clock, *, seed: int, row: Callable[[], Row]) -> None:
        self.clock = clock
        self._seed = seed
        self._row = row
        self._lock = threading.RLock()
        self._setting = Setting()
        self._faults: tuple[str, ...] = ()
        self._since_s = 0.0
        self._known: Row | None = None

    @property
    def modulations(self) -> tuple[str, ...]:
        """What its controller can modulate."""
        return ("hybrid",)

    def set_supply(self, *, on: bool, voltage_V: float, current_limit_A: float) -> None:
        """What the dc supply is told."""
        self._set(replace(self._setting, supply_on=on, supply_V=voltage_V))

    def set_load(self, *, on: bool, power_W: float) -> None:
        """What the electronic load is told."""
        self._set(replace(self._setting, load_on=on, load_W=power_W))

    def set_bridge(self, *, pwm: bool, D1: float, D2: float, mode: str) -> None:
        """What the controller applies; switching on clears the faults of before."""
        with self._lock:
            if pwm and not self._setting.pwm:
                self._faults = ()
            self._set(replace(self._setting, pwm=pwm, D1=D1, D2=D2))

    def collapse(self) -> None:
        """The converter can hold its output no longer."""
        with self._lock:
            self._set(replace(self._setting, pwm=False))
            self._faults = ("output_undervoltage",)

    @property
    def setting(self) -> Setting:
        """What is commanded now."""
        return self._setting

    @property
    def off(self) -> bool:
        """Whether nothing is on: not the PWM, not the supply, not the load."""
        s = self._setting
        return not (s.pwm or s.supply_on or s.load_on)

    @property
    def output_V(self) -> float:
        """Output voltage at this moment."""
        return self.state().load_V

    @property
    def faults(self) -> tuple[str, ...]:
        """What has tripped."""
        return self._faults

    def state(self) -> SteadyState:
        """What the instruments' own sensors see now."""
        with self._lock:
            s, shown = self._setting, truth(self._setting)
            warm = 0.01 * shown["P2"]
            return SteadyState(
                supply_V=shown["U1"],
                supply_A=shown["I1"],
                load_V=shown["U2"],
                load_A=shown["I2"],
                D0=0.1 + 0.1 * s.D1 if s.converts else 0.0,
                D1=s.D1,
                D2=s.D2,
                T_heatsink_C=AMBIENT_C + warm,
                T_transformer_C=AMBIENT_C + 2 * warm,
                T_inductor_C=AMBIENT_C + 2 * warm,
            )

    def analyzer(self, update: int, update_s: float, ranges: Mapping[str, float]) -> dict[str, float]:
        """One update of the analyzer, with its noise."""
        with self._lock:
            if (row := self._row()) != self._known:
                self._known, self._since_s = row, self.clock.now()
            shown = truth(self._setting)
            number = update - int(self._since_s / update_s)
            noise = np.random.default_rng([self._seed, *row, number]).normal(1.0, NOISE, len(shown))
        return {name: value * k for (name, value), k in zip(shown.items(), noise, strict=True)}

    def _set(self, setting: Setting) -> None:
        with self._lock:
            if setting != self._setting:
                self._setting, self._since_s = setting, self.clock.now()
