"""A stranger's program, mbpoll, reads and sets the mock supply over Modbus TCP and Modbus RTU."""

import re
import shutil
import subprocess

import pytest

from drivers.mocks.modbus_dc import MockSupply
from drivers.mocks.modbus_wire import RtuServer, TcpServer
from tests.drivers.fake_dc_plant import FakeDcPlant

MBPOLL = shutil.which("mbpoll")
pytestmark = pytest.mark.skipif(MBPOLL is None, reason="missing program: mbpoll")


@pytest.fixture(params=["tcp", "rtu"])
def bench(request: pytest.FixtureRequest):
    """The plant, and mbpoll's arguments for the port, the unit and the mode."""
    plant = FakeDcPlant()
    if request.param == "tcp":
        with TcpServer(MockSupply(plant, unit=0)) as server:
            yield plant, ["127.0.0.1", "-m", "tcp", "-p", str(server.port), "-a", "0"]
    else:  # mbpoll has no unit 0 on RTU, and a pty no parity
        with RtuServer(MockSupply(plant, unit=1)) as server:
            yield plant, [server.path, "-m", "rtu", "-b", "115200", "-P", "none", "-a", "1"]


def mbpoll(arguments: list[str], *values: int) -> str:
    """Run it once, on addresses that count from 0; what it printed."""
    assert MBPOLL is not None
    resource, *options = arguments
    command = [MBPOLL, *options, "-0", "-1", resource, *map(str, values)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=30, check=False)
    return done.stdout + done.stderr


def values(printed: str) -> list[str]:
    return re.findall(r"^\[\d+\]:\s+(\S+)", printed, re.MULTILINE)


def test_mbpoll_sets_voltage_and_switches_on(bench) -> None:
    plant, port = bench
    assert "Written 1 reference" in mbpoll([*port, "-t", "0", "-r", "402"], 1)
    assert "Written 1 reference" in mbpoll([*port, "-t", "4", "-r", "500"], 31457)
    assert "Written 1 reference" in mbpoll([*port, "-t", "0", "-r", "405"], 1)
    on, voltage_V, _ = plant.supply
    assert on
    assert voltage_V == pytest.approx(300.0, abs=500 / 0xCCCC)  # one count
    assert values(mbpoll([*port, "-t", "4", "-r", "507"])) == ["31457"]


def test_mbpoll_reads_nominal_values_and_state(bench) -> None:
    _, port = bench
    assert values(mbpoll([*port, "-t", "4:float", "-B", "-r", "121", "-c", "3"])) == ["500", "30", "5000"]
    assert values(mbpoll([*port, "-t", "4:hex", "-r", "505", "-c", "2"])) == ["0x0000", "0x0000"]


def test_mbpoll_is_told_what_is_refused(bench) -> None:
    plant, port = bench
    assert "Illegal data address" in mbpoll([*port, "-t", "4", "-r", "999"])
    assert "failed" in mbpoll([*port, "-t", "4", "-r", "500"], 31457)  # without remote mode
    assert plant.settings == []


def test_mbpoll_without_0_counts_from_1(bench) -> None:
    _, (resource, *options) = bench
    command = [str(MBPOLL), *options, "-1", "-t", "4:hex", "-r", "9001", resource]
    done = subprocess.run(command, capture_output=True, text=True, timeout=30, check=False)
    assert values(done.stdout) == ["0xD0E5"]
