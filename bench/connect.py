"""Opening all instruments of a bench, and inspecting them: every fault at once, not the first."""

from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field, fields
from functools import partial
from typing import Protocol, TypeVar

from bench.config import BenchConfig, DcDeviceConfig
from bench.errors import BenchError
from bench.lock import ports_of_bench
from bench.prediction import modulation_of
from bench.spy import log_of
from bench.wiring import analyzer_columns
from drivers.analyzer import Analyzer, load_analyzer_model
from drivers.clock import Clock
from drivers.controller import Controller
from drivers.dc_device import DcDevice
from drivers.errors import InstrumentError
from drivers.identity import Identity
from drivers.load import ElectronicLoad
from drivers.modbus import ModbusDevice
from drivers.modbus_link import open_link
from drivers.modbus_map import load_map
from drivers.supply import DcSupply
from drivers.transport import ByteLink, Patience, Spy

T = TypeVar("T")
CLEARED_BY_ARMING = frozenset({"heartbeat_lost"})  # what a killed campaign leaves behind


class BenchFaults(BenchError):
    """What keeps a bench from being used; one line per fault."""

    def __init__(self, faults: list[str]) -> None:
        super().__init__("\n".join(faults))
        self.faults = tuple(faults)


class Instrument(Protocol):
    """What all instruments have in common."""

    def identify(self) -> Identity: ...
    def close(self) -> None: ...


@dataclass(frozen=True, slots=True, kw_only=True)
class Instruments:
    """The four instruments of a bench, open."""

    analyzer: Analyzer
    supply: DcSupply
    load: ElectronicLoad
    controller: Controller


@dataclass(slots=True, kw_only=True)
class Inspection:
    """Who answered, by instrument, and everything that is wrong."""

    identities: dict[str, Identity] = field(default_factory=dict)
    faults: list[str] = field(default_factory=list)

    def attempt(self, name: str, ask: Callable[[], T]) -> T | None:
        """The answer, or None with the fault noted under the instrument's name."""
        try:
            return ask()
        except (InstrumentError, ValueError) as error:
            self.faults.append(f"{name}: {error}")
            return None


SpyOf = Callable[[str], Spy | None]
"""The spy on the link of an instrument, by its name; None: nobody listens."""


@contextmanager
def open_instruments(
    config: BenchConfig, clock: Clock, spy_of: SpyOf = log_of
) -> Iterator[tuple[Instruments, Inspection]]:
    """All instruments, open, and what an inspection found; BenchFaults when not all of them could be opened.

    Faults of a bench that is open do not raise here: whoever holds it can still switch it off.
    """
    inspection = Inspection()
    with ports_of_bench(config), ExitStack() as stack:
        opened = open_all(config, clock, inspection, stack, spy_of)
        _inspect(config, opened, inspection)
        if len(opened) < len(fields(Instruments)):
            raise BenchFaults(inspection.faults)
        yield Instruments(**opened), inspection  # type: ignore[arg-type]  # opened under the same names


def inspect_bench(config: BenchConfig, clock: Clock) -> Inspection:
    """Reach every instrument, compare limits and states; switches nothing.

    Raises BenchTaken while somebody has the bench: to greet a controller once more would disturb who works with it.
    """
    inspection = Inspection()
    with ports_of_bench(config), ExitStack() as stack:
        _inspect(config, open_all(config, clock, inspection, stack), inspection)
    return inspection


def acknowledge_alarms(config: BenchConfig, clock: Clock) -> list[str]:
    """Clear the alarms that stand in the supply and the load, where their causes are gone; which those were.

    Either is off afterwards where it had one. What could not be reached or cleared, an inspection tells. Raises
    BenchTaken while somebody has the bench.
    """
    cleared: list[str] = []
    unreached = Inspection()
    with ports_of_bench(config), ExitStack() as stack:
        for name, instrument in open_all(config, clock, unreached, stack).items():
            if isinstance(instrument, DcDevice) and unreached.attempt(name, instrument.identify) is not None:
                alarms = unreached.attempt(name, partial(_acknowledge, instrument)) or ()
                cleared += [f"{name} {alarm}" for alarm in alarms]
    return cleared


def _acknowledge(device: DcDevice) -> tuple[str, ...]:
    """The alarms that stood and are cleared; InstrumentTripped when one still stands."""
    if alarms := device.state().alarms:
        device.take_remote()
        try:
            device.acknowledge()
        finally:
            device.release()
    return alarms


def open_all(
    config: BenchConfig,
    clock: Clock,
    inspection: Inspection,
    stack: ExitStack,
    spy_of: SpyOf = log_of,
) -> dict[str, Instrument]:
    """Whatever can be opened, by name, closed with the stack; the inspection holds why the rest could not."""
    limits = config.limits
    of_supply = {
        "set_voltage": limits.voltage_V,
        "set_current": limits.current_A,
        "set_power": limits.power_W,
    }
    of_load = {"set_power": limits.power_W}
    openers: dict[str, Callable[[], Instrument]] = {
        "analyzer": lambda: _analyzer(config, clock, spy_of("analyzer")),
        "supply": lambda: DcSupply(_modbus(config.supply, of_supply, spy_of("supply")), clock=clock),
        "load": lambda: ElectronicLoad(_modbus(config.load, of_load, spy_of("load")), clock=clock),
        "controller": lambda: open_controller(config, spy_of("controller")),
    }
    opened = {}
    for name, opener in openers.items():
        if (instrument := inspection.attempt(name, opener)) is not None:
            stack.callback(instrument.close)
            opened[name] = instrument
    return opened


def _inspect(config: BenchConfig, opened: Mapping[str, Instrument], inspection: Inspection) -> None:
    limits, converter = config.limits, config.converter
    needed = {
        "supply": {
            "voltage_V": converter.input_voltage_V,
            "current_A": limits.current_A,
            "power_W": limits.power_W,
        },
        "load": {"current_A": limits.power_W / converter.output_voltage_V, "power_W": limits.power_W},
    }
    for name, instrument in opened.items():
        identity = inspection.attempt(name, instrument.identify)
        if identity is None:
            continue  # not the instrument expected: its limits mean nothing
        inspection.identities[name] = identity
        if isinstance(instrument, DcDevice):
            _inspect_dc(name, instrument, needed[name], inspection)
        elif isinstance(instrument, Analyzer):
            own = config.analyzer
            columns = list(analyzer_columns(config))
            wrong = instrument.problems(columns, own.update_s, own.ranges, scaled=own.scaled)
            inspection.faults += [f"{name}: {problem}" for problem in wrong]
        elif isinstance(instrument, Controller):
            _inspect_controller(name, instrument, inspection)


def _inspect_dc(name: str, device: DcDevice, needed: Mapping[str, float], inspection: Inspection) -> None:
    if (allowed := inspection.attempt(name, device.limits)) is not None:
        for quantity, value in needed.items():
            if not device.allows(quantity, value):
                low, high = getattr(allowed, quantity)
                inspection.faults.append(
                    f"{name}: {quantity} = {value:g} is needed by bench.toml; the instrument allows "
                    f"{low:g} to {high:g}"
                )
    if (state := inspection.attempt(name, device.state)) is not None:
        inspection.faults += [f"{name}: alarm {alarm} stands" for alarm in state.alarms]
        if state.on:
            inspection.faults.append(f"{name}: its output is on; switch it off first")


def _inspect_controller(name: str, controller: Controller, inspection: Inspection) -> None:
    if (telemetry := inspection.attempt(name, controller.heartbeat)) is not None:
        if telemetry.pwm_on:
            inspection.faults.append(f"{name}: the PWM is on; switch it off first")
        inspection.faults += [
            f"{name}: fault {fault} stands" for fault in telemetry.faults if fault not in CLEARED_BY_ARMING
        ]


def _analyzer(config: BenchConfig, clock: Clock, spy: Spy | None) -> Analyzer:
    c = config.analyzer
    model = load_analyzer_model(c.model)
    link = ByteLink.open(c.resource, baud=c.baud, spy=spy)
    return Analyzer(
        link,
        model,
        clock=clock,
        speed=config.speed,
        patience=Patience(timeout_s=c.timeout_s, lateness_s=c.lateness_s),
    )


def open_controller(config: BenchConfig, spy: Spy | None = None) -> Controller:
    """The controller of a bench; nothing has been said to it."""
    c = config.controller
    link = ByteLink.open(c.resource, baud=c.baud, spy=spy)
    return Controller(
        link,
        heartbeat_s=c.heartbeat_s,
        timeout_s=c.timeout_s,
        lateness_s=c.lateness_s,
        modulation=modulation_of(config.converter),
    )


def _modbus(config: DcDeviceConfig, ceilings: dict[str, float], spy: Spy | None) -> ModbusDevice:
    map = load_map(config.map)
    link = open_link(
        config.resource,
        baud=config.baud,
        timeout_s=config.timeout_s,
        longest_lateness_s=config.lateness_s,
        spy=spy,
    )
    try:
        device = ModbusDevice(link, map, config.unit)
    except InstrumentError:
        link.close()
        raise
    device.ceilings = ceilings
    return device
