"""The dc supply's driver against the mock supply, over Modbus TCP as the bench has it."""

import pytest

from drivers.errors import IdentityError, InstrumentTripped, LimitError, ReadbackError
from drivers.identity import Identity
from drivers.mocks.modbus_dc import MockLoad, MockSupply
from drivers.modbus import ModbusDevice
from drivers.modbus_errors import ModbusRefused
from drivers.modbus_map import MapError, load_map
from drivers.reading import Quality
from drivers.supply import DcState, DcSupply
from tests.drivers.fake_dc_plant import FakeDcPlant, wired, wired_supply

ONE_COUNT_V = 500 / 0xCCCC


@pytest.fixture(scope="module")
def shared():
    """One connection for all tests here: closing a TCP link takes 0.3 s."""
    with wired_supply() as (wires, supply):
        yield wires, supply


@pytest.fixture
def bench(shared):
    """The mock supply as after power-on, in remote mode, with the driver connected."""
    wires, supply = shared
    wires.plant.__init__()
    wires.mock.__init__(wires.plant)
    wires.mock.remote = True
    supply.device.forget()
    wires.frames.clear()
    return wires, supply


def test_it_says_who_it_is(bench) -> None:
    _, supply = bench
    assert supply.identify() == Identity("EA Elektro-Automatik", "PSI 9500-30 3U", "VIRTUAL LAB", "mock")


def test_a_run_byte_for_byte(bench) -> None:
    wires, supply = bench
    supply.set_voltage(300.0)
    supply.on()
    supply.off()
    assert [request[7:].hex(" ") for request, _ in wires.frames] == [
        "03 00 79 00 02",  # nominal voltage
        "03 23 29 00 01",  # its lower limit
        "03 23 28 00 01",  # its upper limit
        "06 01 f4 7a e1",  # 300 V of 500 V is 31457 of 52428
        "03 01 f4 00 01",
        "03 01 f9 00 02",  # no alarm stands
        "05 01 95 ff 00",
        "03 01 f9 00 02",  # on
        "05 01 95 00 00",
        "03 01 f9 00 02",  # off
    ]


def test_set_points_reach_the_plant(bench) -> None:
    wires, supply = bench
    supply.set_voltage(300.0)
    supply.set_current_limit(10.0)
    supply.on()
    on, voltage_V, current_A = wires.plant.supply
    assert on
    assert voltage_V == pytest.approx(300.0, abs=ONE_COUNT_V)
    assert current_A == pytest.approx(10.0, abs=30 / 0xCCCC)


def test_readings_have_unit_time_and_quality(bench) -> None:
    wires, supply = bench
    wires.plant.load = (True, 600.0)
    supply.set_voltage(300.0)
    supply.on()
    actual = supply.actual()
    assert actual["U"].value == pytest.approx(300.0, abs=ONE_COUNT_V)
    assert actual["I"].value == pytest.approx(2.0, abs=30 / 0xCCCC)
    assert actual["P"].value == pytest.approx(600.0, abs=5000 / 0xCCCC)
    assert [actual[key].unit for key in "UIP"] == ["V", "A", "W"]
    assert all(reading.good and reading.time_s == 7.0 for reading in actual.values())


def test_the_largest_count_is_overrange_not_a_value(bench, monkeypatch) -> None:
    wires, supply = bench
    supply.set_voltage(400.0)
    supply.on()
    monkeypatch.setattr(wires.mock, "_protect", lambda: None)  # read before the protection acts
    wires.plant.overshoot = 2.0
    assert supply.actual()["U"].quality is Quality.OVERRANGE


@pytest.mark.parametrize(("current_A", "power_W", "mode"), [(10.0, 5000.0, "CV"), (1.0, 5000.0, "CC")])
def test_the_regulation_mode_is_told(bench, current_A: float, power_W: float, mode: str) -> None:
    wires, supply = bench
    wires.plant.load = (True, 600.0)
    supply.set_voltage(300.0)
    supply.set_current_limit(current_A)
    supply.set_power_limit(power_W)
    supply.on()
    assert supply.state() == DcState(on=True, mode=mode, remote=True, alarms=())


def test_a_power_limit_shows_as_constant_power(bench) -> None:
    wires, supply = bench
    wires.plant.load = (True, 600.0)
    supply.set_voltage(300.0)
    supply.set_power_limit(300.0)
    supply.on()
    assert supply.state().mode == "CP"
    assert supply.actual()["I"].value == pytest.approx(1.0, abs=2 * 30 / 0xCCCC)  # two roundings


def test_102_percent_can_be_set_and_no_more(bench) -> None:
    wires, supply = bench
    supply.set_voltage(510.0)
    assert wires.mock.counts["set_voltage"] == 0xD0E5
    with pytest.raises(LimitError):
        supply.set_voltage(510.1)


def test_the_panels_limits_are_asked_when_remote_is_taken(bench) -> None:
    wires, supply = bench
    supply.set_voltage(330.0)
    wires.mock.counts["limit_voltage_max"] = 33554
    supply.take_remote()
    with pytest.raises(LimitError, match="320"):
        supply.set_voltage(330.0)
    assert supply.limits().voltage_V[1] == pytest.approx(320.0, abs=ONE_COUNT_V)


@pytest.mark.parametrize(
    ("alarm", "cause"), [("OVP", "protect_voltage"), ("OCP", "protect_current"), ("OPP", "protect_power")]
)
def test_a_protection_trips_latches_and_is_acknowledged(bench, alarm: str, cause: str) -> None:
    wires, supply = bench
    wires.plant.load = (True, 600.0)
    supply.set_voltage(300.0)
    supply.on()
    wires.mock.counts[cause] = 1
    state = supply.state()
    assert (state.on, state.alarms) == (False, (alarm,))
    assert wires.plant.supply[0] is False
    with pytest.raises(InstrumentTripped, match=alarm):
        supply.on()
    assert supply.state().alarms == (alarm,)  # latched
    supply.acknowledge()
    assert supply.state().alarms == ()


def test_an_alarm_whose_cause_stands_cannot_be_acknowledged(bench) -> None:
    wires, supply = bench
    wires.mock.trip("OT", lasting=True)
    with pytest.raises(InstrumentTripped, match="OT"):
        supply.acknowledge()
    wires.mock.heal()
    supply.acknowledge()
    assert supply.state().alarms == ()


def test_an_alarm_without_a_name_is_told_too(bench) -> None:
    wires, supply = bench
    wires.mock.trip("mains")
    assert supply.state().alarms == ("alarm",)


def test_a_trip_at_switching_on_is_told_as_one(bench) -> None:
    wires, supply = bench
    wires.plant.overshoot = 1.2
    supply.set_voltage(480.0)  # 576 V at the terminals; the protection is at 550 V
    with pytest.raises(InstrumentTripped, match=r"OVP.*did not stay on"):
        supply.on()


def test_local_pressed_is_seen_in_the_state_and_refuses_set_points(bench) -> None:
    wires, supply = bench
    wires.mock.press_local()
    assert supply.state().remote is False
    with pytest.raises(ModbusRefused, match="LOCAL"):
        supply.set_voltage(10.0)


def test_off_takes_remote_mode_back_if_it_must(bench) -> None:
    wires, supply = bench
    supply.on()
    wires.mock.press_local()
    supply.off()
    assert wires.plant.supply[0] is False


def test_off_that_cannot_be_done_is_never_silent(bench) -> None:
    wires, supply = bench
    supply.on()
    wires.mock.press_local()
    wires.mock.locked = True
    with pytest.raises(ReadbackError, match="not seen off after 3 attempts"):
        supply.off()


def test_off_outlasts_a_busy_instrument(bench) -> None:
    wires, supply = bench
    supply.on()
    wires.mock.busy = 3
    supply.off()
    assert wires.plant.supply[0] is False


def test_off_is_not_believed_from_the_write_alone(bench, monkeypatch) -> None:
    wires, supply = bench
    monkeypatch.setattr("drivers.modbus.CONFIRM_S", 0.0)
    supply.on()
    monkeypatch.setattr(wires.mock, "_switch", lambda on: None)  # a contactor that sticks
    with pytest.raises(ReadbackError, match="not seen off"):
        supply.off()


def test_release_switches_off_and_gives_the_panel_back(bench) -> None:
    wires, supply = bench
    supply.on()
    supply.release()
    assert (wires.mock.on, wires.mock.remote) == (False, False)


def test_a_panel_locked_to_local_refuses_remote_mode() -> None:
    plant = FakeDcPlant()
    with wired(MockSupply(plant), plant) as wires:
        wires.mock.locked = True
        with pytest.raises(ModbusRefused, match="local control"):
            DcSupply(wires.device).take_remote()


def test_a_load_in_the_supplys_place_is_found_out() -> None:
    plant = FakeDcPlant()
    with wired(MockLoad(plant), plant, rtu=True) as wires:
        supply = DcSupply(ModbusDevice(wires.device.link, load_map("ea_psi9000"), 1))
        with pytest.raises(IdentityError, match=r"ELR 9200-70.*PSI 9"):
            supply.identify()


def test_a_loads_map_is_not_taken_for_a_supply() -> None:
    plant = FakeDcPlant()
    with wired(MockLoad(plant), plant, rtu=True) as wires, pytest.raises(MapError, match="is a load"):
        DcSupply(wires.device)
