"""Random commands to a bench with random limits: is anything outside the limits ever on a wire?

Every request to the supply, the load and the controller is taken off the mock wires and read as what it commands.
"""

import math
import struct
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, field

import numpy as np

from bench.config import BenchConfig, check
from bench.errors import BenchError
from bench.instruments import Bench, open_bench
from bench.plan import Kind, PlannedPoint
from drivers.clock import StepClock
from drivers.controller_messages import SET_MODULATION, Request
from drivers.errors import InstrumentError, ReplyError
from drivers.frames import DELIMITER, decode
from drivers.mocks.fault_kinds import FRAMES, RTU
from drivers.mocks.rack import Rack
from experiments.survey.campaign import bench_of
from experiments.survey.steady_plant import SteadyPlant

WRITE_ONE = 6
SET_VOLTAGE, SET_CURRENT, SET_POWER = 500, 501, 502
WILD = (math.nan, math.inf, -math.inf, -1.0, 0.0, 1.0, 1e9, -1e-9, 1.0000001)
COMMANDS = ("row", "modulation", "voltage", "current", "power", "power_up", "power_off")


@dataclass(slots=True)
class Commanded:
    """What was seen on the wires: requests that command something, and those beyond a limit."""

    seen: int = 0
    beyond: list[str] = field(default_factory=list)

    def check(self, what: str, value: float, low: float, high: float, slack: float) -> None:
        """Count one command; it must lie within the limits, to the resolution of the instrument."""
        self.seen += 1
        if not low - slack <= value <= high + slack:
            self.beyond.append(f"{what} = {value:g}, allowed {low:g} to {high:g}")


@dataclass(frozen=True, slots=True, kw_only=True)
class Limits:
    """The random limits of one bench."""

    voltage_V: float
    current_A: float
    power_W: float

    @classmethod
    def draw(cls, rng: np.random.Generator) -> "Limits":
        """Limits that leave room for a converter at 300 V."""
        return cls(
            voltage_V=float(rng.uniform(300.0, 480.0)),
            current_A=float(rng.uniform(3.0, 25.0)),
            power_W=float(rng.uniform(200.0, 3000.0)),
        )


def commanded(commands: int, seed: int) -> Commanded:
    """Send so many random commands, most of them wild, to a bench with random limits."""
    rng = np.random.default_rng(seed)
    limits, seen = Limits.draw(rng), Commanded()
    plant = SteadyPlant(StepClock(), seed=seed, row=lambda: (0, 0))
    with Rack(plant) as rack:
        _listen(rack, limits, seen)
        with open_bench(_config(rack, limits), plant.clock) as bench:
            bench.check()
            bench.configure()
            for _ in range(commands):
                with suppress(BenchError, InstrumentError):
                    _command(bench, rng, limits)
            bench.power_off()
    return seen


def _config(rack: Rack, limits: Limits) -> BenchConfig:
    settings = bench_of(rack).model_dump(mode="json", exclude_none=True)
    settings["limits"] |= {
        "voltage_V": limits.voltage_V, "current_A": limits.current_A, "power_W": limits.power_W,
    }  # fmt: skip
    return check(settings, BenchConfig, file="random limits")


def _wild(rng: np.random.Generator, high: float) -> float:
    """A number within limits, just beyond them, or none at all."""
    if rng.random() < 0.3:
        return float(rng.choice(WILD))
    return float(rng.uniform(-0.2 * high, 1.4 * high))


def _command(bench: Bench, rng: np.random.Generator, limits: Limits) -> None:
    instruments = bench.instruments
    match str(rng.choice(COMMANDS)):
        case "row":
            kind = Kind(str(rng.choice([kind.value for kind in Kind])))
            D1, D2, power_W = _wild(rng, 1.0), _wild(rng, 0.6), _wild(rng, limits.power_W)
            bench.set_point(PlannedPoint(point=0, repeat=0, kind=kind, D1=D1, D2=D2, power_W=power_W))
        case "modulation":
            instruments.controller.set_modulation(_wild(rng, 1.0), _wild(rng, 1.0))
        case "voltage":
            instruments.supply.set_voltage(_wild(rng, limits.voltage_V))
        case "current":
            instruments.supply.set_current_limit(_wild(rng, limits.current_A))
        case "power":
            instruments.load.set_power(_wild(rng, limits.power_W))
        case "power_up":
            bench.power_up()
        case _:
            bench.power_off()


def _listen(rack: Rack, limits: Limits, seen: Commanded) -> None:
    """Read every request before its instrument's fault injector, which has no faults here, passes it on."""
    supply, load = rack.supply, rack.load
    allowed = {
        "supply": {
            SET_VOLTAGE: ("voltage", limits.voltage_V, supply.rating.voltage_V),
            SET_CURRENT: ("current", limits.current_A, supply.rating.current_A),
        },
        "load": {SET_POWER: ("power", limits.power_W, load.rating.power_W)},
    }
    for name, injector in rack.injectors.items():
        wire = injector.line.wire

        def hear(request: bytes, reply: bytes | None, name: str = name, wire: str = wire) -> bytes | None:
            if wire == FRAMES:
                _hear_controller(request, seen)
            elif name in allowed:
                for address, value in _writes(request if wire == RTU else request[6:]):
                    if address in allowed[name]:
                        what, high, nominal = allowed[name][address]
                        count = nominal / 0xCCCC
                        seen.check(f"{name} {what}", value * count, 0.0, high, 0.51 * count)
            return reply

        injector.listener = hear


def _writes(frame: bytes) -> Iterator[tuple[int, int]]:
    """Addresses and values that a request writes, from its unit id on; this bench writes single registers."""
    if len(frame) >= 6 and frame[1] == WRITE_ONE:
        yield struct.unpack(">HH", frame[2:6])


def _hear_controller(request: bytes, seen: Commanded) -> None:
    for coded in filter(None, request.split(DELIMITER)):
        try:
            frame = decode(coded)
        except ReplyError:
            continue
        if frame.type == Request.SET_MODULATION:
            _, D1, D2 = SET_MODULATION.unpack(frame.payload)
            seen.check("D1", D1, 0.0, 1.0, 0.0)
            seen.check("D2", D2, 0.0, 1.0, 0.0)
