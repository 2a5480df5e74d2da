"""The whole mock rack: analyzer, supply, load and controller on real ports, one plant behind them.

::

    with Rack(plant) as rack:
        config = rack.bench_config()   # what bench.toml says of a bench like this one
"""

import shutil
import tempfile
import threading
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol, Self

from drivers.mocks.controller import BridgeState, ControllerPlant, MockController
from drivers.mocks.fault_kinds import FRAMES, RTU, SCPI, TCP
from drivers.mocks.faults import NO_FAULTS, FaultFile, Injector
from drivers.mocks.modbus_dc import DcPlant, DcTerminals, MockLoad, MockSupply
from drivers.mocks.modbus_wire import RtuServer, TcpServer
from drivers.mocks.scpi_analyzer import AnalyzerPlant, ScpiAnalyzer
from drivers.mocks.wire import PtyServer

# of real time: plant and client are processes on a computer that may be busy with other things
PATIENCE_S = 10.0

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


class Server(Protocol):
    """What serves one instrument."""

    def send(self, data: bytes) -> None: ...
    def replug(self, seconds: float) -> None: ...


@dataclass(slots=True)
class FaultLine:
    """One instrument and its wire, as a fault can reach them."""

    wire: str
    panel: Any
    server: Server | None = None

    def send(self, data: bytes) -> None:
        """Bytes onto the wire; lost when nothing serves it."""
        if self.server is not None:
            self.server.send(data)

    def unplug(self, seconds: float) -> None:
        """Pull the plug for some real seconds; from a thread of its own, for a server cannot stop itself."""
        if self.server is not None:
            threading.Thread(target=self.server.replug, args=(seconds,), daemon=True).start()


class Rack:
    """Four mock instruments; ``analyzer``, ``supply``, ``load`` and ``controller`` are their front panels.

    Serial ports have stable names in a folder of their own, as in ``/dev/serial/by-id``.

    Parameters
    ----------
    plant : the one physical state that they share, with its clock.
    speed : how many of the plant's seconds pass in a real one; a campaign scales its waits by it. Above 1 the
        controller waits for a late beat for some real seconds, as a client waits for a late answer.
    heartbeat_s : beat that the controller is told to expect.
    faults : what goes wrong; ``injectors`` tell what has, by instrument.
    """

    def __init__(
        self,
        plant: RackPlant,
        *,
        speed: float = 1.0,
        heartbeat_s: float = 2.0,
        faults: FaultFile = NO_FAULTS,
    ) -> None:
        self.speed = speed
        self.heartbeat_s = heartbeat_s
        self.analyzer = ScpiAnalyzer(plant)
        self.supply = MockSupply(plant)
        self.load = MockLoad(plant)
        self.controller = MockController(plant, patience_s=PATIENCE_S if speed > 1 else 0.0)
        self._names = Path(tempfile.mkdtemp(prefix="d2ea-ports-"))
        panels = {
            "analyzer": (SCPI, self.analyzer),
            "supply": (TCP, self.supply),
            "load": (RTU, self.load),
            "controller": (FRAMES, self.controller),
        }
        lines = {name: FaultLine(wire, panel) for name, (wire, panel) in panels.items()}
        self._sound = frozenset(name for name in panels if not faults.at(name))
        self.injectors = {
            name: Injector(faults=faults.at(name), seed=faults.seed + k, line=line)
            for k, (name, line) in enumerate(lines.items())
        }
        analyzer, controller = self.injectors["analyzer"], self.injectors["controller"]
        self.analyzer_server = PtyServer(
            lambda chunk: analyzer.tamper(chunk, self.analyzer.handle(chunk)), name=self._names / "analyzer"
        )
        self.supply_server = TcpServer(self.supply)
        self.load_server = RtuServer(self.load, name=self._names / "load")
        self.controller_server = PtyServer(
            lambda chunk: controller.tamper(chunk, self.controller.handle(chunk)),
            tick=self.controller.tick,
            name=self._names / "controller",
        )
        self.supply_server.tamper = self.injectors["supply"].tamper
        self.load_server.tamper = self.injectors["load"].tamper
        servers: tuple[Server, ...] = (
            self.analyzer_server, self.supply_server, self.load_server, self.controller_server,
        )  # fmt: skip
        for line, server in zip(lines.values(), servers, strict=True):
            line.server = server
        self._running = ExitStack()

    def start(self) -> Self:
        """Open all ports and begin to answer."""
        with ExitStack() as started:
            self._names.mkdir(exist_ok=True)
            started.callback(shutil.rmtree, self._names, ignore_errors=True)
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
        """The content of a bench.toml that connects to this rack; only while it runs.

        An instrument that no fault can silence is waited for longer than a real one.
        """
        instruments: dict[str, dict[str, object]] = {
            "analyzer": {
                "model": "wt3000",
                "resource": self.analyzer_server.resource,
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
                "resource": self.load_server.resource,
                "baud": 115200,
                "unit": self.load.unit,
            },
            "controller": {
                "resource": self.controller_server.resource,
                "baud": 115200,
                "heartbeat_s": self.heartbeat_s,
            },
        }
        for name in self._sound:
            instruments[name]["timeout_s"] = PATIENCE_S
        return {
            "name": "virtual lab",
            "virtual": True,
            "speed": self.speed,
            **instruments,
            "limits": dict(LIMITS),
            "converter": {"input_voltage_V": 300.0, "output_voltage_V": 140.0},
        }
