"""A plant of arithmetic behind the dc mocks, and the mocks with a driver connected to them."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field

from drivers.clock import StepClock
from drivers.load import ElectronicLoad
from drivers.mocks.modbus_dc import MockDc, MockLoad, MockSupply
from drivers.mocks.modbus_wire import RtuServer, TcpServer
from drivers.modbus import ModbusDevice
from drivers.modbus_link import open_link
from drivers.supply import DcSupply

TIMEOUT_S = 0.5  # ample for a loopback answer; a test that provokes silence waits this long
LATENESS_S = 0.2


@dataclass
class FakeDcPlant:
    """No losses: the supply gives what the load takes, up to its current limit."""

    supply: tuple[bool, float, float] = (False, 0.0, 0.0)
    load: tuple[bool, float] = (False, 0.0)
    output_V: float = 140.0
    overshoot: float = 1.0  # of the supply's voltage: a fault of the virtual kind
    settings: list[tuple[object, ...]] = field(default_factory=list)

    def set_supply(self, *, on: bool, voltage_V: float, current_limit_A: float) -> None:
        self.supply = (on, voltage_V, current_limit_A)
        self.settings.append(self.supply)

    def set_load(self, *, on: bool, power_W: float) -> None:
        self.load = (on, power_W)
        self.settings.append(self.load)

    def state(self) -> "FakeDcPlant":
        return self

    @property
    def supply_V(self) -> float:
        return self.supply[1] * self.overshoot if self.supply[0] else 0.0

    @property
    def _wanted_A(self) -> float:
        return self.load_A * self.output_V / self.supply_V if self.supply_V else 0.0

    @property
    def supply_A(self) -> float:
        return min(self._wanted_A, self.supply[2])

    @property
    def supply_mode(self) -> str:
        return "CC" if self._wanted_A > self.supply[2] else "CV"

    @property
    def load_V(self) -> float:
        return self.output_V

    @property
    def load_A(self) -> float:
        return self.load[1] / self.output_V if self.load[0] and self.output_V else 0.0


@dataclass
class Wired:
    """A mock, the port it answers on, the frames that passed, and a device of the driver's side."""

    plant: FakeDcPlant
    mock: MockDc
    server: TcpServer | RtuServer
    device: ModbusDevice
    frames: list[tuple[bytes, bytes | None]] = field(default_factory=list)

    def record(self, request: bytes, reply: bytes | None) -> bytes | None:
        self.frames.append((request, reply))
        return reply

    @property
    def writes(self) -> list[bytes]:
        """The PDUs of the writes that reached the wire."""
        pdus = [
            request[1:-2] if isinstance(self.server, RtuServer) else request[7:] for request, _ in self.frames
        ]
        return [pdu for pdu in pdus if pdu[0] in (5, 6, 16)]


@contextmanager
def wired(mock: MockDc, plant: FakeDcPlant, *, rtu: bool = False) -> Iterator[Wired]:
    """``mock`` on a TCP port or an RTU pty, and a device connected to it."""
    server: TcpServer | RtuServer = RtuServer(mock) if rtu else TcpServer(mock)
    with server:
        resource = server.path if isinstance(server, RtuServer) else server.resource
        link = open_link(resource, timeout_s=TIMEOUT_S, longest_lateness_s=LATENESS_S)
        wires = Wired(plant, mock, server, ModbusDevice(link, mock.map, mock.unit))
        server.tamper = wires.record
        try:
            yield wires
        finally:
            link.close()


@contextmanager
def wired_supply(*, rtu: bool = False) -> Iterator[tuple[Wired, DcSupply]]:
    """A mock supply with a driver that has taken remote control."""
    plant = FakeDcPlant()
    with wired(MockSupply(plant), plant, rtu=rtu) as wires:
        supply = DcSupply(wires.device, clock=StepClock(7.0))
        supply.take_remote()
        yield wires, supply


@contextmanager
def wired_load(*, rtu: bool = True) -> Iterator[tuple[Wired, ElectronicLoad]]:
    """A mock load with a driver that has taken remote control."""
    plant = FakeDcPlant()
    with wired(MockLoad(plant), plant, rtu=rtu) as wires:
        load = ElectronicLoad(wires.device, clock=StepClock(7.0))
        load.take_remote()
        yield wires, load
