"""Named registers in SI units: limits before the wire, read-back after, in step after a disturbance."""

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.errors import IdentityError, LimitError, LinkTimeout, ReadbackError, ReplyError
from drivers.mocks.modbus_dc import MockLoad, MockSupply
from drivers.mocks.modbus_device import MockModbusDevice
from drivers.mocks.modbus_wire import RtuServer, crc16
from drivers.modbus import ModbusDevice
from drivers.modbus_errors import DeviceBusy, IllegalValue, ModbusRefused
from drivers.modbus_link import open_link
from drivers.modbus_map import ModbusMap, Raw, load_map
from drivers.supply import DcSupply
from tests.drivers.fake_dc_plant import FakeDcPlant, Wired, wired


@pytest.fixture(scope="module")
def wires():
    """A supply on RTU, remote, with the panel's limits turned down to 320 V, 10 A, 2200 W."""
    plant = FakeDcPlant()
    with wired(MockSupply(plant, unit=1), plant, rtu=True) as wires:
        wires.mock.remote = True
        wires.mock.counts |= {
            "limit_voltage_max": 33554,
            "limit_current_max": 17476,
            "limit_power_max": 23068,
        }
        wires.mock.counts |= {"limit_voltage_min": 1049}  # 10.004 V
        yield wires


HIGHEST = {"set_voltage": 320.0, "set_current": 10.0, "set_power": 2200.0}
ADDRESS = {"set_voltage": 500, "set_current": 501, "set_power": 502}
COUNTS = {"set_voltage": (1049, 33554), "set_current": (0, 17476), "set_power": (0, 23068)}


@settings(max_examples=200, deadline=None)
@given(name=st.sampled_from(sorted(HIGHEST)), share=st.floats(-0.05, 1.05) | st.floats())
def test_nothing_outside_the_limits_reaches_the_wire(wires: Wired, name: str, share: float) -> None:
    value = share * HIGHEST[name]
    before = len(wires.writes)
    try:
        wires.device.write(name, value)
    except LimitError:
        assert len(wires.writes) == before
        return
    (pdu,) = wires.writes[before:]
    lowest, highest = COUNTS[name]
    counts = int.from_bytes(pdu[3:5], "big")
    assert (pdu[0], int.from_bytes(pdu[1:3], "big")) == (6, ADDRESS[name])
    assert lowest <= counts <= highest
    full_V_A_W = {"set_voltage": 500, "set_current": 30, "set_power": 5000}[name]
    # half a count of rounding; at a limit, which is whole counts, the same half count
    assert counts * full_V_A_W / 0xCCCC == pytest.approx(value, abs=0.5001 * full_V_A_W / 0xCCCC)


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf, -1.0, 9.9, 320.1])
def test_a_value_outside_the_limits_is_refused_with_what_is_allowed(wires: Wired, value: float) -> None:
    with pytest.raises(LimitError, match=r"10\.0042 to 320.* V; nothing was sent"):
        wires.device.write("set_voltage", value)


@settings(max_examples=200, deadline=None)
@given(ceiling_A=st.floats(0.01, 9.9))
def test_the_very_ceiling_of_a_bench_can_be_set_and_nothing_above_reaches_the_wire(
    wires: Wired, ceiling_A: float
) -> None:
    wires.device.ceilings = {"set_current": ceiling_A}
    try:
        wires.device.write("set_current", ceiling_A)
        held_A = wires.mock.counts["set_current"] * 30 / 0xCCCC
        assert ceiling_A - 30 / 0xCCCC < held_A <= ceiling_A * (1 + 1e-8)  # down to a count
        with pytest.raises(LimitError, match="nothing was sent"):
            wires.device.write("set_current", 1.0001 * ceiling_A)
    finally:
        wires.device.ceilings = {}


@settings(max_examples=100, deadline=None)
@given(count=st.integers(1, 17476), half=st.sampled_from([-0.5, 0.0, 0.5]))
def test_what_rounds_to_the_devices_limit_is_allowed_and_can_be_set(
    wires: Wired, count: int, half: float
) -> None:
    before = wires.mock.counts["limit_current_max"]
    try:
        wires.mock.counts["limit_current_max"] = count
        wires.device.forget()
        value_A = (count + half) * 30 / 0xCCCC * (1 - 1e-12)
        assert wires.device.allows("set_current", value_A)
        wires.device.write("set_current", value_A)
        assert wires.mock.counts["set_current"] <= count
        assert not wires.device.allows("set_current", (count + 0.51) * 30 / 0xCCCC)
    finally:
        wires.mock.counts["limit_current_max"] = before
        wires.device.forget()


def test_limits_are_the_devices_own_in_si_units(wires: Wired) -> None:
    lowest_V, highest_V = wires.device.limits("set_voltage")
    assert highest_V == pytest.approx(320.0, abs=500 / 0xCCCC)  # one count
    assert lowest_V == pytest.approx(10.0, abs=500 / 0xCCCC)


def test_protections_may_be_set_to_110_percent_and_no_higher(wires: Wired) -> None:
    wires.device.write("protect_voltage", 550.0)
    assert wires.mock.counts["protect_voltage"] == 0xE147
    with pytest.raises(LimitError):
        wires.device.write("protect_voltage", 551.0)


def test_a_register_that_is_not_writable_is_not_written(wires: Wired) -> None:
    with pytest.raises(LimitError, match="not written"):
        wires.device.write("actual_voltage", 5.0)


@pytest.fixture
def load():
    plant = FakeDcPlant()
    with wired(MockLoad(plant), plant, rtu=True) as wires:
        wires.mock.remote = True
        yield wires


def test_a_set_point_that_the_instrument_clips_is_found_out(load: Wired) -> None:
    load.device.limits("set_power")  # known to the driver before somebody turns the limit down
    load.mock.counts["limit_power_max"] = 1000
    load.mock.clips = True
    with pytest.raises(ReadbackError, match="set_power was set to 2000"):
        load.device.write("set_power", 2000.0)


@pytest.mark.parametrize(("off_by", "accepted"), [(0, True), (1, True), (-1, True), (2, False), (-2, False)])
def test_a_read_back_may_differ_by_one_count(load: Wired, off_by: int, accepted: bool) -> None:
    load.mock._within_limits = lambda name, counts: counts + off_by
    if accepted:
        load.device.write("set_power", 1000.0)
    else:
        with pytest.raises(ReadbackError):
            load.device.write("set_power", 1000.0)


def test_a_value_that_the_instrument_does_not_take_is_refused_once_and_not_repeated(load: Wired) -> None:
    load.device.limits("set_power")
    load.mock.counts["limit_power_max"] = 1000
    with pytest.raises(IllegalValue):
        load.device.write("set_power", 2000.0)
    assert len(load.writes) == 1


def test_busy_is_an_error_and_the_write_is_not_repeated(load: Wired) -> None:
    load.device.limits("set_power")
    load.mock.busy = 1
    with pytest.raises(DeviceBusy):
        load.device.write("set_power", 100.0)
    assert len(load.writes) == 1


def test_a_write_that_got_no_reply_is_not_repeated(load: Wired) -> None:
    load.device.limits("set_power")
    load.server.tamper = lambda request, reply: load.record(request, None)
    with pytest.raises(LinkTimeout):
        load.device.write("set_power", 100.0)
    assert len(load.writes) == 1


def test_lost_remote_mode_is_told_as_the_reason(load: Wired) -> None:
    load.mock.press_local()
    with pytest.raises(ModbusRefused, match=r"local control.*needs remote.*LOCAL") as caught:
        load.device.write("set_power", 100.0)
    assert caught.value.context["register"] == "set_power"
    assert caught.value.code == 0x17


@pytest.mark.parametrize("nominal_W", [0.0, -3500.0, math.nan, math.inf])
def test_a_nominal_value_that_makes_no_sense_is_not_used(load: Wired, nominal_W: float) -> None:
    load.mock._nominal = lambda name: nominal_W
    with pytest.raises(ReplyError, match="make no sense"):
        load.device.write("set_power", 100.0)
    assert load.writes == []


def test_registers_side_by_side_come_in_one_request(load: Wired) -> None:
    load.device.read_raw(["state"])
    before = len(load.frames)
    load.device.read_raw(["actual_power", "state", "actual_voltage", "actual_current"])
    (pdu,) = [request[1:-2] for request, _ in load.frames[before:]]
    assert pdu.hex(" ") == "03 01 f9 00 05"  # 505 to 509


def test_after_a_timeout_a_late_reply_as_the_identity_keeps_the_link_closed_to_writes(load: Wired) -> None:
    load.device.read("state")
    load.server.tamper = lambda request, reply: None
    with pytest.raises(LinkTimeout):
        load.device.read("state")
    stranger = bytes.fromhex("01 03 28") + b"ANOTHER ONE".ljust(40, b"\0")
    load.server.tamper = lambda request, reply: load.record(request, stranger + crc16(stranger))
    with pytest.raises(IdentityError, match="ANOTHER ONE"):
        load.device.write("set_power", 100.0)
    assert load.writes == []
    load.server.tamper = None
    load.device.write("set_power", 100.0)  # in step again


def test_a_unit_id_that_the_instrument_cannot_have_is_refused() -> None:
    plant = FakeDcPlant()
    with wired(MockLoad(plant), plant, rtu=True) as wires, pytest.raises(LimitError, match="0 to 1"):
        ModbusDevice(wires.device.link, wires.mock.map, 5)


class Riden(MockModbusDevice):
    """Registers that hold what is written to them: all that this supply does, seen from outside."""

    def __init__(self, map: ModbusMap, id: int) -> None:
        super().__init__(map, unit=1)
        self.held: dict[str, Raw] = dict.fromkeys(map.registers, 0)
        self.held |= {"id": id, "serial_number": 4_000_000_001, "firmware": 128}

    def get(self, name: str) -> Raw:
        return self.held[name]

    def put(self, name: str, raw: Raw) -> None:
        self.held[name] = raw


def riden(id: int):
    mock = Riden(load_map("riden_rd60xx"), id)
    return mock, RtuServer(mock)


def test_the_same_driver_serves_a_supply_without_coils_remote_mode_or_nominal_values() -> None:
    mock, server = riden(60062)
    with server, DcSupply(ModbusDevice(open_link(server.path), mock.map)) as supply:
        assert str(supply.identify()) == "Riden 60062"
        assert supply.identify().serial == "4000000001"
        supply.take_remote()
        supply.set_voltage(12.34)
        supply.set_current_limit(1.5)
        before = dict(mock.held)
        supply.set_power_limit(18.0)  # it has no such register
        assert mock.held == before
        supply.on()
        mock.held |= {"actual_voltage": 1233, "actual_power": 70000, "regulation": 1}
        assert (mock.held["set_voltage"], mock.held["set_current"], mock.held["output"]) == (1234, 1500, 1)
        assert (supply.state().on, supply.state().mode, supply.state().remote) == (True, "CC", True)
        assert supply.actual()["U"].value == pytest.approx(12.33, rel=1e-12)
        assert supply.actual()["P"].value == pytest.approx(700.0, rel=1e-12)
        mock.held["protection"] = 2
        assert supply.state().alarms == ("OCP",)


@pytest.mark.parametrize(("id", "counts", "highest_A"), [(60062, 1500, 6.0), (60181, 150, 18.0)])
def test_digits_and_limits_follow_the_model_that_answers(id: int, counts: int, highest_A: float) -> None:
    mock, server = riden(id)
    with server, DcSupply(ModbusDevice(open_link(server.path), mock.map)) as supply:
        supply.set_current_limit(1.5)
        assert mock.held["set_current"] == counts
        assert supply.limits().current_A == (0.0, highest_A)
        with pytest.raises(LimitError):
            supply.set_current_limit(highest_A + 0.1)


def test_a_model_that_the_map_does_not_know_is_refused() -> None:
    mock, server = riden(60065)
    with server, DcSupply(ModbusDevice(open_link(server.path), mock.map)) as supply:
        with pytest.raises(IdentityError, match="60065"):
            supply.identify()
        with pytest.raises(IdentityError, match="60065"):
            supply.set_voltage(1.0)
