"""The whole rack: what it says of itself connects, and nothing is left behind when it stops."""

import os
import threading

import pytest

from drivers.analyzer import Analyzer, load_analyzer_model
from drivers.controller import Controller
from drivers.load import ElectronicLoad
from drivers.mocks.faults import FaultFile
from drivers.mocks.rack import Rack
from drivers.modbus import ModbusDevice
from drivers.modbus_link import open_link
from drivers.modbus_map import load_map
from drivers.supply import DcSupply
from drivers.transport import ByteLink
from tests.drivers.fake_plant import FakePlant


def test_it_writes_the_bench_that_it_is() -> None:
    with Rack(FakePlant(), speed=20.0, heartbeat_s=1.5) as rack:
        config = rack.bench_config()
    assert config["virtual"] is True
    assert (config["speed"], config["controller"]["heartbeat_s"]) == (20.0, 1.5)
    assert config["supply"]["resource"].startswith("tcp://127.0.0.1:")
    assert {key: set(table) for key, table in config.items() if isinstance(table, dict)} == {
        "analyzer": {"model", "resource", "baud", "update_s", "wiring", "timeout_s"},
        "supply": {"map", "resource", "unit", "timeout_s"},
        "load": {"map", "resource", "baud", "unit", "timeout_s"},
        "controller": {"resource", "baud", "heartbeat_s", "timeout_s"},
        "limits": {"voltage_V", "current_A", "power_W", "output_voltage_V", "heatsink_C", "winding_C"},
        "converter": {"input_voltage_V", "output_voltage_V"},
    }


def test_only_what_no_fault_can_silence_is_waited_for_long() -> None:
    silent = FaultFile.model_validate({"fault": [{"instrument": "load", "kind": "silence"}]})
    with Rack(FakePlant(), faults=silent) as rack:
        config = rack.bench_config()
    waited = {name: config[name].get("timeout_s") for name in rack.injectors}
    assert waited == {"analyzer": 10.0, "supply": 10.0, "load": None, "controller": 10.0}


@pytest.mark.parametrize(("section", "kind"), [("supply", DcSupply), ("load", ElectronicLoad)])
def test_supply_and_load_are_where_it_says(section: str, kind: type[DcSupply | ElectronicLoad]) -> None:
    with Rack(FakePlant()) as rack:
        table = rack.bench_config()[section]
        device = ModbusDevice(open_link(table["resource"]), load_map(table["map"]), table["unit"])
        with kind(device) as instrument:
            assert instrument.identify().serial == "VIRTUAL LAB"
            instrument.take_remote()
            assert instrument.state().remote


def test_the_analyzer_is_where_it_says() -> None:
    with Rack(FakePlant()) as rack:
        table = rack.bench_config()["analyzer"]
        with ByteLink.open(table["resource"], baud=table["baud"]) as link:
            assert Analyzer(link, load_analyzer_model(table["model"])).identify().model.startswith("7603")


def test_the_controller_is_where_it_says() -> None:
    with Rack(FakePlant()) as rack:
        table = rack.bench_config()["controller"]
        with ByteLink.open(table["resource"], baud=table["baud"]) as link:
            controller = Controller(link, heartbeat_s=table["heartbeat_s"])
            assert "virtual" in controller.identify().model


def test_it_leaves_no_thread_and_no_open_file_behind() -> None:
    Rack(FakePlant()).start().stop()  # what is opened once and for all is open now
    threads, files = threading.active_count(), len(os.listdir("/proc/self/fd"))
    for _ in range(3):
        with Rack(FakePlant()) as rack:
            open_link(rack.bench_config()["supply"]["resource"]).close()
    assert (threading.active_count(), len(os.listdir("/proc/self/fd"))) == (threads, files)


def test_a_rack_that_cannot_start_closes_what_it_opened() -> None:
    threads = threading.active_count()
    rack = Rack(FakePlant())
    with Rack(FakePlant()) as other:
        rack.supply_server._wanted_port = other.supply_server.port
        with pytest.raises(OSError, match="in use"):
            rack.start()
    assert threading.active_count() == threads


def test_it_can_be_started_again_on_new_ports() -> None:
    rack = Rack(FakePlant())
    for _ in range(2):
        with rack, ByteLink.open(rack.bench_config()["load"]["resource"]):
            pass


@pytest.mark.parametrize(("speed", "pwm"), [(1.0, False), (100.0, True)])
def test_only_a_fast_rack_waits_for_a_late_beat_in_real_time(speed: float, pwm: bool) -> None:
    plant = FakePlant()
    with Rack(plant, speed=speed, heartbeat_s=20.0) as rack:
        table = rack.bench_config()["controller"]
        with ByteLink.open(table["resource"], baud=table["baud"]) as link:
            controller = Controller(link, heartbeat_s=20.0)
            controller.identify()
            controller.arm()
            controller.set_modulation(0.7, 0.3)
            controller.enable()
            plant.clock.sleep(100.0)  # five beats, in no real time
            assert controller.heartbeat().pwm_on is pwm
