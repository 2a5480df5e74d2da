"""The electronic load's driver against the mock load, over Modbus RTU on a pseudo-terminal."""

import pytest

from drivers.errors import InstrumentTripped, LimitError
from drivers.load import DcState
from tests.drivers.fake_dc_plant import wired_load

ONE_COUNT_W = 3500 / 0xCCCC


@pytest.fixture
def bench():
    with wired_load() as (wires, load):
        wires.frames.clear()
        yield wires, load


def test_a_run_byte_for_byte(bench) -> None:
    wires, load = bench
    load.set_power(600.0)
    load.on()
    load.off()
    assert [request[1:-2].hex(" ") for request, _ in wires.frames] == [
        "03 00 7d 00 02",  # nominal power
        "03 23 2c 00 01",  # its upper limit; a lower one does not exist
        "06 01 f6 23 1c",  # 600 W of 3500 W is 8988 of 52428
        "03 01 f6 00 01",
        "03 01 f9 00 02",  # no alarm stands
        "05 01 95 ff 00",
        "03 01 f9 00 02",
        "05 01 95 00 00",
        "03 01 f9 00 02",
    ]


def test_it_draws_the_set_power_from_the_plant(bench) -> None:
    wires, load = bench
    load.set_power(600.0)
    load.on()
    assert wires.plant.load == (True, pytest.approx(600.0, abs=ONE_COUNT_W))
    assert load.state() == DcState(on=True, mode="CP", remote=True, alarms=())
    assert load.actual()["P"].value == pytest.approx(600.0, abs=2 * ONE_COUNT_W)  # set and actual, rounded
    assert load.actual()["U"].value == pytest.approx(140.0, abs=200 / 0xCCCC)


def test_at_its_current_limit_it_is_in_constant_current(bench) -> None:
    wires, load = bench
    load.set_power(600.0)
    load.set_current_limit(2.0)
    load.on()
    assert load.state().mode == "CC"
    assert wires.plant.load[1] == pytest.approx(280.0, abs=140 * 70 / 0xCCCC)  # 2 A at 140 V, one count


def test_power_beyond_the_limits_is_refused(bench) -> None:
    wires, load = bench
    assert load.limits().power_W == pytest.approx((0.0, 3570.0), abs=ONE_COUNT_W)
    with pytest.raises(LimitError, match="set_power = 4000 W"):
        load.set_power(4000.0)
    with pytest.raises(LimitError, match="set_power = -100 W"):
        load.set_power(-100.0)
    assert wires.writes == []


def test_an_overvoltage_trips_it(bench) -> None:
    wires, load = bench
    load.set_power(600.0)
    load.on()
    wires.plant.output_V = 230.0  # above 110 % of 200 V
    assert load.state().alarms == ("OVP",)
    assert wires.plant.load[0] is False
    with pytest.raises(InstrumentTripped):
        load.on()


def test_without_voltage_at_its_terminals_it_waits_at_the_set_power(bench) -> None:
    wires, load = bench
    wires.plant.output_V = 0.0
    load.set_power(600.0)
    load.on()
    assert wires.plant.load == (True, pytest.approx(600.0, abs=ONE_COUNT_W))


def test_more_current_than_it_allows_is_as_much_as_it_allows(bench) -> None:
    wires, load = bench
    load.allow_current(500.0)
    assert wires.mock.si("set_current") == pytest.approx(71.4, abs=70 / 0xCCCC)  # 102 % of 70 A
    load.allow_current(20.0)
    assert wires.mock.si("set_current") == pytest.approx(20.0, abs=70 / 0xCCCC)


def test_a_voltage_that_somebody_left_set_keeps_it_from_drawing_until_any_is_accepted(bench) -> None:
    wires, load = bench
    wires.mock.counts["set_voltage"] = 0xCCCC  # 200 V, at a source of 140 V
    load.set_power(600.0)
    load.on()
    assert wires.plant.load == (True, 0.0)
    load.accept_any_voltage()
    assert wires.plant.load == (True, pytest.approx(600.0, abs=ONE_COUNT_W))
