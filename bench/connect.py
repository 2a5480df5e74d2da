"""Opening all instruments of a bench, and inspecting them: every fault at once, not the first."""

from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field, fields
from typing import Protocol, TypeVar

from bench.config import BenchConfig, DcDeviceConfig
from bench.errors import BenchError
from bench.prediction import model_of
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
from drivers.transport import ByteLink

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


@contextmanager
def open_instruments(config: BenchConfig, clock: Clock) -> Iterator[tuple[Instruments, Inspection]]:
    """All instruments, open, and what an inspection found; BenchFaults when not all of them could be opened.

    Faults of a bench that is open do not raise here: whoever holds it can still switch it off.
    """
    inspection = Inspection()
    with ExitStack() as stack:
        opened = _open_all(config, clock, inspection, stack)
        _inspect(config, opened, inspection)
        if len(opened) < len(fields(Instruments)):
            raise BenchFaults(inspection.faults)
        yield Instruments(**opened), inspection  # type: ignore[arg-type]  # opened under the same names


def inspect_bench(config: BenchConfig, clock: Clock) -> Inspection:
    """Reach every instrument, compare limits and states; switches nothing."""
    inspection = Inspection()
    with ExitStack() as stack:
        _inspect(config, _open_all(config, clock, inspection, stack), inspection)
    return inspection


def _open_all(
    config: BenchConfig, clock: Clock, inspection: Inspection, stack: ExitStack
) -> dict[str, Instrument]:
    openers: dict[str, Callable[[], Instrument]] = {
        "analyzer": lambda: _analyzer(config, clock),
        "supply": lambda: DcSupply(_modbus(config.supply), clock=clock),
        "load": lambda: ElectronicLoad(_modbus(config.load), clock=clock),
        "controller": lambda: _controller(config),
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
        "supply": {"voltage_V": converter.input_voltage_V, "current_A": limits.current_A},
        "load": {"power_W": limits.power_W},
    }
    for name, instrument in opened.items():
        identity = inspection.attempt(name, instrument.identify)
        if identity is None:
            continue  # not the instrument expected: its limits mean nothing
        inspection.identities[name] = identity
        if isinstance(instrument, DcDevice):
            _inspect_dc(name, instrument, needed[name], inspection)
        elif isinstance(instrument, Controller):
            _inspect_controller(name, instrument, inspection)


def _inspect_dc(name: str, device: DcDevice, needed: Mapping[str, float], inspection: Inspection) -> None:
    if (allowed := inspection.attempt(name, device.limits)) is not None:
        for quantity, value in needed.items():
            low, high = getattr(allowed, quantity)
            if not low <= value <= high:
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


def _analyzer(config: BenchConfig, clock: Clock) -> Analyzer:
    model = load_analyzer_model(config.analyzer.model)
    link = ByteLink.open(config.analyzer.resource, baud=config.analyzer.baud)
    return Analyzer(link, model, clock=clock, speed=config.speed)


def _controller(config: BenchConfig) -> Controller:
    link = ByteLink.open(config.controller.resource, baud=config.controller.baud)
    modulation = model_of(config.converter).converter.modulation
    return Controller(link, heartbeat_s=config.controller.heartbeat_s, modulation=modulation)


def _modbus(config: DcDeviceConfig) -> ModbusDevice:
    map = load_map(config.map)
    link = open_link(config.resource, baud=config.baud)
    try:
        return ModbusDevice(link, map, config.unit)
    except InstrumentError:
        link.close()
        raise
