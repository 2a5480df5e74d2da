"""The one physical state behind all mock instruments.

Supply, converter, load and room live here and move along the clock that is handed in; each mock instrument
only passes commands in and reads terminals out. The converter is the virtual lab's own.
"""

import threading
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from numpy.typing import NDArray

from drivers.clock import Clock, StepClock
from drivers.mocks.lab.foreign.base import AcReading
from drivers.mocks.lab.instruments import read_element
from drivers.mocks.lab.laboratory import Electrical, Laboratory
from drivers.mocks.lab.waveforms import Demand, Heat

Array = NDArray[np.float64]

_OVERHEAT_C = 100.0
_OVERRANGE = 1.3  # an element shows values up to this share of its range, as power analyzers do
_FAR_K = 5.0  # of warming, beyond which the losses that settle it are worth a second look


@dataclass(frozen=True, slots=True, kw_only=True)
class Command:
    """What the instruments have set, all of it."""

    supply_on: bool = False
    supply_V: float = 0.0
    supply_limit_A: float = 0.0
    load_on: bool = False
    load_W: float = 0.0
    pwm: bool = False
    D1: float = 0.0
    D2: float = 0.0
    modulation: str = "hybrid"


@dataclass(frozen=True, slots=True, kw_only=True)
class PlantState:
    """What instruments can see of the plant at one time, without their own errors."""

    time_s: float
    supply_V: float
    supply_A: float
    supply_mode: str
    load_V: float
    load_A: float
    pwm: bool
    D0: float
    D1: float
    D2: float
    T_heatsink_C: float
    T_transformer_C: float
    T_inductor_C: float
    T_ambient_C: float
    link1_W: float
    link2_W: float
    link_rms_A: float
    faults: tuple[str, ...]


def _one(value: float) -> Array:
    return np.array([value])


@dataclass(frozen=True, slots=True, kw_only=True)
class _Episode:
    """The plant under one command: where its heat started, and the circuit there and where it will settle.

    Both circuits are None where nothing runs, and before ``solved``: only an episode that somebody looks at is
    worth solving, and only one that lasts has an end. ``output_V`` is the output voltage that it started from.
    """

    since_s: float
    heat: Heat
    output_V: float = 0.0
    solved: bool = False
    first: Electrical | None = None
    last: Electrical | None = None


class Plant:
    """A virtual lab that runs along a clock; thread-safe."""

    def __init__(self, laboratory: Laboratory, *, clock: Clock, seed: int) -> None:
        self.laboratory = laboratory
        self.clock = clock
        self._seed = seed
        self._lock = threading.RLock()
        self._command = Command()
        self._faults: tuple[str, ...] = ()
        self._visits: Counter[Command] = Counter()
        heat = laboratory.cold(_one(float(laboratory.ambient_C(clock.now()))))
        self._episode = _Episode(since_s=clock.now(), heat=heat)
        self._told: tuple[_Episode, PlantState] | None = None  # last, for all who ask at one time

    @classmethod
    def virtual(
        cls, *, seed: int, hidden: Mapping[str, float | None] | None = None, clock: Clock | None = None
    ) -> Self:
        """A plant with a lab drawn from a seed; ``hidden`` as in :meth:`Laboratory.draw`."""
        lab = Laboratory.draw(seed=seed, hidden=hidden)
        return cls(lab, clock=StepClock() if clock is None else clock, seed=seed)

    @property
    def modulations(self) -> tuple[str, ...]:
        """What its controller can modulate."""
        return self.laboratory.converter.primary.modulations

    # commands

    def set_supply(self, *, on: bool, voltage_V: float, current_limit_A: float) -> None:
        """What the dc supply is told."""
        self._set(supply_on=on, supply_V=voltage_V, supply_limit_A=current_limit_A)

    def set_load(self, *, on: bool, power_W: float) -> None:
        """What the electronic load is told, in constant power."""
        self._set(load_on=on, load_W=power_W)

    def set_bridge(self, *, pwm: bool, D1: float, D2: float, mode: str = "hybrid") -> None:
        """What the controller applies; switching on clears the faults of before."""
        if mode not in self.modulations:
            allowed = ", ".join(self.modulations)
            raise ValueError(f"this converter's controller does not modulate {mode!r}; it has {allowed}")
        with self._lock:
            if pwm and not self._command.pwm:
                self._faults = ()
            self._set(pwm=pwm, D1=D1, D2=D2, modulation=mode)

    def collapse(self) -> None:
        """The converter stops by itself, as it does where it cannot hold its output."""
        with self._lock:
            self._begin(self._command)
            self._faults = ("output_undervoltage",)

    def _set(self, **changes: float | bool | str) -> None:
        with self._lock:
            command = replace(self._command, **changes)  # type: ignore[arg-type]  # fields by their names
            if command != self._command:
                self._begin(command)

    def _begin(self, command: Command) -> None:
        """End the present episode and start another from its heat."""
        now_s = self.clock.now()
        heat, output_V = self._heat(now_s), self.output_V
        self._command = command
        self._visits[command] += 1
        self._episode = _Episode(since_s=now_s, heat=heat, output_V=output_V)

    def _look(self) -> _Episode:
        """The present episode, solved where it started; and where it will settle, once it has lasted."""
        episode, command = self._episode, self._command
        if not episode.solved:
            runs = command.pwm and not self._faults and command.supply_on and command.supply_V > 0
            first = self._solve_start(command, episode) if runs else None
            self._episode = episode = replace(episode, solved=True, first=first)
        if episode.first is not None and episode.last is None and self.clock.now() > episode.since_s:
            last = self._solve_end(command, episode, episode.first)
            self._episode = episode = replace(episode, last=last)
        return episode

    def _demand(self, command: Command) -> tuple[Demand, Array]:
        power = _one(command.load_W if command.load_on else 0.0)
        lab = self.laboratory
        return lab.demand(_one(command.D1), _one(command.D2), power, _one(command.supply_V)), power

    def _solve_start(self, command: Command, episode: _Episode) -> Electrical | None:
        """The circuit at the heat an episode starts from; trips where it cannot run."""
        lab = self.laboratory.driven_by(command.modulation)
        demand, power = self._demand(command)
        first = lab.run(demand, power, episode.heat)
        if not first.running[0]:
            self._faults = ("output_undervoltage",)
            return None
        _, P1 = lab.input_terminals(first, episode.heat.heatsink_C, episode.since_s)
        if P1[0] > command.supply_V * command.supply_limit_A > 0:
            self._faults = ("input_undervoltage",)
            return None
        return first

    def _solve_end(self, command: Command, episode: _Episode, first: Electrical) -> Electrical:
        """The circuit at the heat an episode will settle at; the first one where it cannot run so hot."""
        lab = self.laboratory.driven_by(command.modulation)
        demand, power = self._demand(command)
        ambient = lab.ambient_C(_one(episode.since_s))
        end = lab.final_heat(first.losses, ambient)
        last = lab.run(demand, power, end, first)
        if np.abs(end.heatsink_C - episode.heat.heatsink_C)[0] > _FAR_K:
            last = lab.run(demand, power, lab.final_heat(last.losses, ambient), last)
        return last if last.running[0] else first

    # what a command meets: an output capacitor keeps its voltage, and a fault takes time to come

    @property
    def _has_just_begun(self) -> bool:
        return not self._episode.solved and self.clock.now() <= self._episode.since_s

    @property
    def output_V(self) -> float:
        """Output voltage at this moment; in the one in which something was set, what it was before."""
        with self._lock:
            if self._has_just_begun:
                return self._episode.output_V
            first = self._look().first
            return 0.0 if first is None else float(first.V2_V[0])

    @property
    def faults(self) -> tuple[str, ...]:
        """What has tripped by now; what is set wrong trips once time has passed."""
        with self._lock:
            return self._faults if self._has_just_begun else self.state().faults

    # state

    def _heat(self, now_s: float) -> Heat:
        elapsed = now_s - self._episode.since_s
        if elapsed <= 0.0:
            return self._episode.heat
        lab, episode = self.laboratory, self._look()
        ambient = lab.ambient_C(_one(now_s))
        if episode.last is None:
            return lab.cooled(episode.heat, ambient, elapsed)
        return lab.warmed(episode.heat, episode.last.losses, ambient, elapsed)

    def _moment(self, now_s: float) -> tuple[Heat, float]:
        """Temperatures now, and how much of the way from first to last the episode has gone."""
        time_constant_s = self.laboratory.inertia.heatsink_s
        return self._heat(now_s), float(-np.expm1(-(now_s - self._episode.since_s) / time_constant_s))

    def state(self) -> PlantState:
        """The plant at the clock's now."""
        with self._lock:
            now_s, episode = self.clock.now(), self._look()
            if self._told is not None:
                (asked, told), at = self._told, (now_s, self._faults)
                if asked is episode and (told.time_s, told.faults) == at:
                    return told
            heat, way = self._moment(now_s)
            if heat.heatsink_C[0] > _OVERHEAT_C and self._episode.last is not None:
                self._faults = (*self._faults, "heatsink_overtemperature")
                self._begin(self._command)
                self._look()
                heat, way = self._moment(now_s)
            told = self._state(now_s, heat, way)
            self._told = self._episode, told
            return told

    def _state(self, now_s: float, heat: Heat, way: float) -> PlantState:
        command, lab = self._command, self.laboratory
        first = self._episode.first
        last = self._episode.last or first

        def between(name: str) -> float:
            return float(getattr(first, name)[0] * (1 - way) + getattr(last, name)[0] * way)

        supply_V, supply_W = self._supply(now_s, heat, way)
        running = first is not None and last is not None
        load_V = between("V2_V") if running else 0.0
        load_W = between("P2_W") if running else 0.0
        return PlantState(
            time_s=now_s,
            supply_V=supply_V,
            supply_A=supply_W / supply_V if supply_V > 0 else 0.0,
            supply_mode="CV",
            load_V=load_V,
            load_A=load_W / load_V if load_V > 0 else 0.0,
            pwm=running,
            D0=between("D0") if running else 0.0,
            D1=command.D1,
            D2=command.D2,
            T_heatsink_C=float(heat.heatsink_C[0]) + lab.errors.temperature_K["heatsink"],
            T_transformer_C=float(heat.transformer_C[0]) + lab.errors.temperature_K["transformer"],
            T_inductor_C=float(heat.inductor_C[0]) + lab.errors.temperature_K["inductor"],
            T_ambient_C=float(
                lab.ambient_C(0.0)
            ),  # the sensor hangs elsewhere: how the room drifts stays hidden
            link1_W=between("P_link1_W") if running else 0.0,
            link2_W=between("P_link2_W") if running else 0.0,
            link_rms_A=between("rms_A") if running else 0.0,
            faults=self._faults,
        )

    def _supply(self, now_s: float, heat: Heat, way: float) -> tuple[float, float]:
        """Voltage and power at the supply's terminals."""
        command, lab, first = self._command, self.laboratory, self._episode.first
        last = self._episode.last or first
        if not command.supply_on:
            return 0.0, 0.0
        if first is None or last is None:
            idle_V = _one(command.supply_V + lab.errors.supply_V)
            return float(idle_V[0]), float(lab.leaked_W(idle_V, heat.heatsink_C, now_s)[0])
        start_V, start_W = lab.input_terminals(first, heat.heatsink_C, now_s)
        end_V, end_W = lab.input_terminals(last, heat.heatsink_C, now_s)
        mix = np.array([1 - way, way])
        return float(mix @ [start_V[0], end_V[0]]), float(mix @ [start_W[0], end_W[0]])

    def analyzer(self, update: int, update_s: float, ranges: Mapping[str, float]) -> dict[str, float]:
        """One update of the power analyzer, U, I and P of elements 1 to 4, with its errors and noise.

        Noise is drawn by seed, command, visit and update, so the same campaign reads the same numbers again.
        Beyond its range an element shows infinity.
        """
        with self._lock:
            state = self.state()
            first_update = int(self._episode.since_s / update_s)
            key = [
                self._seed,
                *_digits(self._command),
                self._visits[self._command],
                max(update - first_update, 0),
            ]
            rng = np.random.default_rng(key)
            shown: dict[str, float] = {}
            for element, triple in self._elements(state).items():
                volts, amps, watts = read_element(
                    self.laboratory.errors, element, [np.asarray(x) for x in triple], rng
                )
                if element == 1:
                    volts, amps, watts = self.laboratory.port_1(volts, amps, watts, state.time_s)
                most_V, most_A = (_OVERRANGE * ranges.get(f"{q}{element}", np.inf) for q in "UI")
                over = bool(volts > most_V or abs(amps) > most_A)
                values = (np.inf,) * 3 if over else (float(volts), float(amps), float(watts))
                shown |= dict(zip((f"U{element}", f"I{element}", f"P{element}"), values, strict=True))
            return shown

    def _elements(self, state: PlantState) -> dict[int, tuple[float, float, float]]:
        """Truth at the four elements: rms voltage, current, power."""
        c = self.laboratory.converter
        primary_V = state.supply_V * np.sqrt(max(state.D1, 0.0)) if state.pwm else 0.0
        secondary_V = state.load_V * np.sqrt(max(1 - state.D2, 0.0)) if state.pwm else 0.0
        n = c.transformer.turns_ratio
        ac = {
            3: (primary_V, state.link_rms_A, state.link1_W),
            4: (secondary_V, n * state.link_rms_A, state.link2_W),
        }
        return {
            1: (state.supply_V, state.supply_A, state.supply_V * state.supply_A),
            2: (state.load_V, state.load_A, state.load_V * state.load_A),
            **{element: self._ac_element(element, *truth) for element, truth in ac.items()},
        }

    def _ac_element(
        self, element: int, volts: float, amps: float, watts: float
    ) -> tuple[float, float, float]:
        """Truth of an ac element with what is wrong with its probes."""
        reading = AcReading(element=element, watts=_one(watts), volts=_one(volts), amps=_one(amps))
        return volts, amps, float(self.laboratory.ac_watts(reading)[0])


def _digits(command: Command) -> list[int]:
    """A command as integers for a seed sequence: the set point, not the switches' history."""
    return [round(abs(command.D1) * 1e6), round(abs(command.D2) * 1e6), round(abs(command.load_W) * 1e3),
            command.load_on * 4 + command.pwm * 2 + command.supply_on]  # fmt: skip
