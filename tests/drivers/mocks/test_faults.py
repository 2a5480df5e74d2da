"""Faults as data: what a file may say, when a fault strikes, and what each does to the wire."""

import time

import pytest
from pydantic import ValidationError

from drivers.controller import Controller, Telemetry
from drivers.errors import LinkLost, LinkTimeout, ReplyError
from drivers.mocks.fault_kinds import KINDS, WIRES
from drivers.mocks.faults import Fault, FaultFile, Injector
from drivers.mocks.rack import FaultLine, Rack
from drivers.modbus import ModbusDevice
from drivers.modbus_errors import DeviceBusy
from drivers.modbus_link import open_link
from drivers.modbus_map import load_map
from drivers.transport import ByteLink
from tests.drivers.fake_plant import FakePlant

QUICK = {"timeout_s": 0.1, "lateness_s": 0.2}


def struck(**settings: object) -> list[int]:
    """In which of thirty exchanges a silence strikes."""
    fault = Fault.model_validate({"instrument": "analyzer", "kind": "silence", **settings})
    injector = Injector(faults=[fault], seed=3, line=FaultLine("scpi", None))
    for k in range(30):
        injector.tamper(b":VALUE?\n" if k % 2 else b"*IDN?\n", b"1\r\n")
    return [one.exchange for one in injector.struck]


@pytest.mark.parametrize(
    ("settings", "when"),
    [
        ({}, [1]),
        ({"after": 4, "every": 5, "count": 3}, [5, 10, 15]),
        ({"on": ":VALUE?", "after": 2, "count": 2}, [6, 8]),
        ({"on": "2a 49 44", "count": 2}, [1, 3]),  # the bytes of *ID
    ],
)
def test_a_fault_strikes_when_and_where_its_entry_says(settings: dict[str, object], when: list[int]) -> None:
    assert struck(**settings) == when


def test_chance_is_drawn_from_the_seed() -> None:
    first, again = (struck(chance=0.3, count=0) for _ in range(2))
    assert first == again
    assert 2 <= len(first) <= 18  # 9 in the mean; beyond these lies a thousandth


@pytest.mark.parametrize(
    ("entry", "said"),
    [
        ({"instrument": "toaster", "kind": "silence"}, "no instrument 'toaster'"),
        ({"instrument": "supply", "kind": "headers_on"}, "cannot happen to the supply"),
        ({"instrument": "analyzer", "kind": "silence", "evry": 2}, "evry"),
        ({"instrument": "analyzer", "kind": "silence", "chance": 0.0}, "chance"),
        ({"instrument": "database", "kind": "silence"}, "disk_full"),
    ],
)
def test_an_entry_that_cannot_be_is_refused(entry: dict[str, object], said: str) -> None:
    with pytest.raises(ValidationError, match=said):
        FaultFile.model_validate({"fault": [entry]})


@pytest.mark.parametrize("name", sorted(KINDS))
def test_every_kind_can_happen_somewhere_and_says_what_it_is(name: str) -> None:
    assert any(KINDS[name].wires & wires for wires in WIRES.values())
    assert KINDS[name].strike.__doc__


def faulted(instrument: str, kind: str, **settings: object) -> Rack:
    entry = {"instrument": instrument, "kind": kind, **settings}
    return Rack(FakePlant(), faults=FaultFile.model_validate({"fault": [entry]}))


@pytest.mark.parametrize(
    "kind", ["late_reply", "truncated_reply", "local_echo", "garbage", "silence", "bad_crc"]
)
def test_a_beat_with_a_disturbed_reply_is_an_error_and_the_next_one_is_right(kind: str) -> None:
    with faulted("controller", kind, after=3, seconds=0.15) as rack:
        link = ByteLink.open(rack.bench_config()["controller"]["resource"])  # type: ignore[index]
        controller = Controller(link, heartbeat_s=2.0, **QUICK)
        controller.identify()
        controller.heartbeat()
        controller.heartbeat()
        with pytest.raises((LinkTimeout, ReplyError)):
            controller.heartbeat()
        assert controller.heartbeat().V2_V == 140.0
        controller.close()


def load_of(rack: Rack) -> ModbusDevice:
    resource = rack.bench_config()["load"]["resource"]  # type: ignore[index]
    link = open_link(resource, timeout_s=QUICK["timeout_s"], longest_lateness_s=QUICK["lateness_s"])
    return ModbusDevice(link, load_map("ea_elr9000"), 1)


def test_busy_never_becomes_a_value() -> None:
    with faulted("load", "exception", value=6, on="01 03 01 fb") as rack:  # a read of register 507
        load = load_of(rack)
        load.identify()
        with pytest.raises(DeviceBusy):
            load.read("actual_voltage")
        assert load.read("actual_voltage") == pytest.approx(140.0, abs=0.01)  # counts of 3.8 mV
        load.close()


def beat_within(controller: Controller, seconds: float) -> Telemetry:
    until = time.monotonic() + seconds
    while True:
        try:
            return controller.heartbeat()
        except (LinkLost, LinkTimeout):
            assert time.monotonic() < until


def test_a_plug_comes_back_under_another_path_and_the_same_name() -> None:
    with faulted("controller", "hang_up", after=2, seconds=0.1) as rack:
        name, before = rack.controller_server.resource, rack.controller_server.path
        controller = Controller(ByteLink.open(name), heartbeat_s=2.0, **QUICK)
        controller.identify()
        controller.heartbeat()
        with pytest.raises((LinkLost, LinkTimeout)):
            controller.heartbeat()
        assert beat_within(controller, 5.0).V2_V == 140.0
        assert rack.controller_server.path != before
        controller.close()


def test_a_rack_that_stops_while_a_plug_is_out_leaves_nothing_behind() -> None:
    with faulted("controller", "hang_up", seconds=0.2) as rack, pytest.raises((LinkLost, LinkTimeout)):
        Controller(ByteLink.open(rack.controller_server.resource), **QUICK).identify()
    time.sleep(0)
    with pytest.raises(RuntimeError, match="not running"):
        _ = rack.controller_server.path
