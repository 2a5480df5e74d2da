"""The whole mock rack: analyzer, supply, load and controller on real ports, one plant behind them.

::

    with Rack(plant) as rack:
        config = rack.bench_config()   # what bench.toml says of a bench like this one
"""

from contextlib import ExitStack
from typing import Protocol, Self

from drivers.mocks.controller import BridgeState, ControllerPlant, MockController
from drivers.mocks.modbus_dc import DcPlant, DcTerminals, MockLoad, MockSupply
from drivers.mocks.modbus_wire import RtuServer, TcpServer
from drivers.mocks.scpi_analyzer import AnalyzerPlant, ScpiAnalyzer
from drivers.mocks.wire import PtyServer

LIMITS = {
    "voltage_V": 320.0,
    "current_A": 10.0,
    "power_W": 2200.0,
    "output_voltage_V": 160.0,
    "heatsink_C": 90.0,
    "winding_C": 120.0,
}


class RackState(BridgeState, DcTerminals, Protocol):
    """What all instruments together see."""


class RackPlant(AnalyzerPlant, ControllerPlant, DcPlant, Protocol):
    """What all instruments together reach."""

    def state(self) -> RackState: ...


class Rack:
    """Four mock instruments; ``analyzer``, ``supply``, ``load`` and ``controller`` are their front panels.

    Parameters
    ----------
    plant : the one physical state that they share, with its clock.
    speed : how many of the plant's seconds pass in a real one; a campaign scales its waits by it.
    heartbeat_s : beat that the controller is told to expect.
    """

    def __init__(self, plant: RackPlant, *, speed: float = 1.0, heartbeat_s: float = 2.0) -> None:
        self.speed = speed
        self.heartbeat_s = heartbeat_s
        self.analyzer = ScpiAnalyzer(plant)
        self.supply = MockSupply(plant)
        self.load = MockLoad(plant)
        self.controller = MockController(plant)
        self.analyzer_server = PtyServer(self.analyzer.handle)
        self.supply_server = TcpServer(self.supply)
        self.load_server = RtuServer(self.load)
        self.controller_server = PtyServer(self.controller.handle, tick=self.controller.tick)
        self._running = ExitStack()

    def start(self) -> Self:
        """Open all ports and begin to answer."""
        with ExitStack() as started:
            started.enter_context(self.analyzer_server)
            started.enter_context(self.supply_server)
            started.enter_context(self.load_server)
            started.enter_context(self.controller_server)
            self._running = started.pop_all()
        return self

    def stop(self) -> None:
        """Close all ports and end all threads; harmless when not running."""
        self._running.close()

    def __enter__(self) -> Self:
        return self.start()

    def __exit__(self, *_: object) -> None:
        self.stop()

    def bench_config(self) -> dict[str, object]:
        """The content of a bench.toml that connects to this rack; only while it runs."""
        return {
            "name": "virtual lab",
            "virtual": True,
            "speed": self.speed,
            "analyzer": {
                "model": "wt3000",
                "resource": self.analyzer_server.path,
                "baud": 9600,
                "update_s": 0.5,
                "wiring": {"input": 1, "output": 2, "link1": 3, "link2": 4},
            },
            "supply": {
                "map": "ea_psi9000",
                "resource": self.supply_server.resource,
                "unit": self.supply.unit,
            },
            "load": {
                "map": "ea_elr9000",
                "resource": self.load_server.path,
                "baud": 115200,
                "unit": self.load.unit,
            },
            "controller": {
                "resource": self.controller_server.path,
                "baud": 115200,
                "heartbeat_s": self.heartbeat_s,
            },
            "limits": dict(LIMITS),
            "converter": {"input_voltage_V": 300.0, "output_voltage_V": 140.0},
        }
