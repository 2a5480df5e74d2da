"""The mock analyzer's habits, which are those of the instrument, and a stranger's client on its port."""

import struct

import pytest
import pyvisa
from hypothesis import given
from hypothesis import strategies as st
from pyvisa.resources import MessageBasedResource

from drivers.mocks.scpi_analyzer import ScpiAnalyzer
from drivers.mocks.wire import PtyServer
from tests.drivers.fake_plant import FakePlant


@pytest.fixture
def plant() -> FakePlant:
    return FakePlant()


@pytest.fixture
def mock(plant: FakePlant) -> ScpiAnalyzer:
    """An analyzer with headers off that has seen one update."""
    mock = ScpiAnalyzer(plant)
    mock.handle(b":COMMUNICATE:HEADER OFF\n")
    plant.clock.sleep(0.5)
    return mock


def ask(mock: ScpiAnalyzer, message: str) -> str:
    return (mock.handle(message.encode() + b"\n") or b"").decode()


def test_pyvisa_py_reads_identity_and_values(plant: FakePlant) -> None:
    """A program that has never heard of this project, on the pseudo-terminal."""
    mock = ScpiAnalyzer(plant)
    plant.clock.sleep(0.5)
    manager = pyvisa.ResourceManager("@py")
    with PtyServer(mock.handle) as server:
        client = manager.open_resource(
            f"ASRL{server.path}::INSTR", read_termination="\r\n", write_termination="\n", timeout=5000
        )
        assert isinstance(client, MessageBasedResource)
        assert client.query("*IDN?") == "YOKOGAWA,760304-40-MV,0,F5.01"
        client.write(":COMMUNICATE:HEADER OFF")
        client.write(":NUMERIC:NORMAL:NUMBER 3")
        assert client.query_ascii_values(":NUMERIC:NORMAL:VALUE?") == pytest.approx([300.001, 2.0, 600.002])
        client.close()
    manager.close()


def test_headers_and_verbose_are_on_until_switched_off() -> None:
    mock = ScpiAnalyzer(FakePlant())
    assert ask(mock, ":NUMERIC:NORMAL:NUMBER?") == ":NUMERIC:NORMAL:NUMBER 15\r\n"
    ask(mock, ":COMMUNICATE:VERBOSE OFF")
    assert ask(mock, ":NUMERIC:NORMAL:NUMBER?") == ":NUM:NORM:NUMB 15\r\n"
    ask(mock, ":COMMUNICATE:HEADER OFF")
    assert ask(mock, ":NUMERIC:NORMAL:NUMBER?") == "15\r\n"


@pytest.mark.parametrize(
    "header", [":NUM:NORM:NUMB?", "numeric:normal:number?", ":NUM:NUMBER?", ":NUMERIC:NUMB?"]
)
def test_headers_match_in_long_and_short_form(mock: ScpiAnalyzer, header: str) -> None:
    assert ask(mock, header) == "15\r\n"


@pytest.mark.parametrize("header", [":NUMER:NORM:NUMB?", ":NUM:NORM:NUMBERS?", ":BLUNDER 3", "*XYZ?"])
def test_an_unknown_header_is_an_error_and_no_reply(mock: ScpiAnalyzer, header: str) -> None:
    assert ask(mock, header) == ""
    assert ask(mock, ":STATUS:ERROR?") == '113,"Undefined Header"\r\n'
    assert ask(mock, ":STATUS:ERROR?") == '0,"No error"\r\n'


def test_an_option_that_is_not_fitted_gets_silence(mock: ScpiAnalyzer) -> None:
    assert ask(mock, ":HARMONICS:ORDER?") == ""
    assert ask(mock, ":STATUS:ERROR?") == '0,"No error"\r\n'


def test_clear_empties_the_error_queue(mock: ScpiAnalyzer) -> None:
    ask(mock, ":BLUNDER")
    ask(mock, "*CLS")
    assert ask(mock, ":STATUS:ERROR?") == '0,"No error"\r\n'


def test_message_units_share_a_line_and_a_branch(mock: ScpiAnalyzer) -> None:
    ask(mock, ":NUMERIC:NORMAL:NUMBER 2;ITEM1 UDC,2;ITEM2 P,2")
    assert ask(mock, ":NUMERIC:NORMAL:ITEM1?;ITEM2?;:RATE?") == "UDC,2;P,2;500E-03\r\n"


def test_a_message_may_come_in_pieces(mock: ScpiAnalyzer) -> None:
    assert mock.handle(b":RA") is None
    assert mock.handle(b"TE?\r\n:RATE?\r\n:R") == b"500E-03\r\n500E-03\r\n"


def test_values_follow_the_selected_items(mock: ScpiAnalyzer) -> None:
    ask(mock, ":NUMERIC:NORMAL:NUMBER 3;ITEM1 P,4;ITEM2 IRMS,2;ITEM3 LAMBDA,1")
    assert ask(mock, ":NUMERIC:NORMAL:VALUE?") == "8.70000E+02,4.00000E+00,NAN\r\n"
    assert ask(mock, ":NUMERIC:NORMAL:VALUE? 2") == "4.00000E+00\r\n"


@pytest.mark.parametrize(
    "command",
    [
        ":NUMERIC:NORMAL:NUMBER 0",
        ":NUMERIC:NORMAL:NUMBER 256",
        ":NUMERIC:NORMAL:ITEM1 P,5",
        ":RATE 300MS",
        ":INPUT:VOLTAGE:RANGE:ELEMENT1 250V",
    ],
)
def test_a_value_that_does_not_exist_is_out_of_range(mock: ScpiAnalyzer, command: str) -> None:
    ask(mock, command)
    assert ask(mock, ":STATUS:ERROR?") == '222,"Data out of range"\r\n'


@pytest.mark.parametrize(
    "command", [":RATE SOON", ":NUMERIC:HOLD MAYBE", ":NUMERIC:NORMAL:ITEM1 ZZ,1", ":RATE"]
)
def test_a_word_that_does_not_exist_is_an_error(mock: ScpiAnalyzer, command: str) -> None:
    ask(mock, command)
    assert not ask(mock, ":STATUS:ERROR?").startswith("0,")


def test_a_value_is_of_its_update_and_repeats_within_it(mock: ScpiAnalyzer, plant: FakePlant) -> None:
    first = ask(mock, ":NUMERIC:NORMAL:VALUE? 1")
    plant.clock.sleep(0.25)
    assert ask(mock, ":NUMERIC:NORMAL:VALUE? 1") == first == "3.00001E+02\r\n"
    plant.clock.sleep(0.25)
    assert ask(mock, ":NUMERIC:NORMAL:VALUE? 1") == "3.00002E+02\r\n"


def test_rate_sets_how_often_values_change(mock: ScpiAnalyzer, plant: FakePlant) -> None:
    ask(mock, ":RATE 50MS")
    plant.clock.sleep(0.5)
    assert ask(mock, ":NUMERIC:NORMAL:VALUE? 1") == "3.00020E+02\r\n"


def test_hold_freezes_the_values(mock: ScpiAnalyzer, plant: FakePlant) -> None:
    ask(mock, ":NUMERIC:HOLD ON")
    held = ask(mock, ":NUMERIC:NORMAL:VALUE? 1")
    plant.clock.sleep(5.0)
    assert ask(mock, ":NUMERIC:NORMAL:VALUE? 1") == held
    ask(mock, ":NUMERIC:HOLD OFF")
    assert ask(mock, ":NUMERIC:NORMAL:VALUE? 1") != held


def test_scaling_is_told_of_each_element(mock: ScpiAnalyzer) -> None:
    assert ask(mock, ":INPUT:SCALING:STATE?") == "0;0;0;0\r\n"
    ask(mock, ":INPUT:SCALING:STATE:ALL ON")
    assert ask(mock, ":INPUT:SCALING:STATE?") == "1;1;1;1\r\n"
    ask(mock, "*RST")
    assert ask(mock, ":INPUT:SCALING:STATE?") == "0;0;0;0\r\n"


def test_it_has_no_averaging_to_switch_on(mock: ScpiAnalyzer) -> None:
    ask(mock, ":MEASURE:AVERAGING:STATE OFF")
    assert ask(mock, ":STATUS:ERROR?").startswith("0,")
    ask(mock, ":MEASURE:AVERAGING:STATE ON")
    assert ask(mock, ":STATUS:ERROR?").startswith("222,")


def test_no_data_from_a_range_change_to_the_next_update(mock: ScpiAnalyzer, plant: FakePlant) -> None:
    ask(mock, ":INPUT:VOLTAGE:RANGE:ELEMENT1 300V")
    assert ask(mock, ":NUMERIC:NORMAL:VALUE? 1") == "NAN\r\n"
    plant.clock.sleep(0.5)
    assert ask(mock, ":NUMERIC:NORMAL:VALUE? 1") == "3.00002E+02\r\n"


def test_over_range_is_inf_and_a_condition_bit(mock: ScpiAnalyzer, plant: FakePlant) -> None:
    ask(mock, ":INPUT:CURRENT:RANGE:ELEMENT2 1A")
    plant.clock.sleep(0.5)
    ask(mock, ":NUMERIC:NORMAL:ITEM1 I,2;ITEM2 P,2;ITEM3 UDC,2;NUMBER 3;ITEM1 IDC,2")
    assert ask(mock, ":NUMERIC:NORMAL:VALUE?") == "INF,INF,1.40000E+02\r\n"
    assert ask(mock, ":STATUS:CONDITION?") == f"{1 << 9}\r\n"


def test_float_blocks_carry_finite_sentinels(mock: ScpiAnalyzer) -> None:
    ask(mock, ":NUMERIC:FORMAT FLOAT;:NUMERIC:NORMAL:NUMBER 2;ITEM1 UDC,2;ITEM2 Q,1")
    reply = mock.handle(b":NUMERIC:NORMAL:VALUE?\n")
    assert reply == b"#40008" + struct.pack(">f", 140.0) + bytes.fromhex("7E951BEE") + b"\r\n"


def test_wait_steps_the_plant_to_the_next_update(mock: ScpiAnalyzer, plant: FakePlant) -> None:
    ask(mock, ":STATUS:FILTER1 FALL")
    plant.clock.sleep(0.2)
    assert ask(mock, ":STATUS:EESR?") == "0\r\n"
    ask(mock, ":COMMUNICATE:WAIT 1")
    assert plant.clock.now() == pytest.approx(1.0, abs=1e-5)
    assert ask(mock, ":STATUS:EESR?") == "1\r\n"


def test_wait_returns_at_once_for_an_update_that_has_ended(mock: ScpiAnalyzer, plant: FakePlant) -> None:
    ask(mock, ":STATUS:FILTER1 FALL")
    plant.clock.sleep(0.7)
    before = plant.clock.now()
    ask(mock, ":COMMUNICATE:WAIT 1")
    assert plant.clock.now() == before


def test_wait_for_an_event_that_nobody_asked_for_never_ends(mock: ScpiAnalyzer) -> None:
    ask(mock, ":COMMUNICATE:WAIT 1")
    assert ask(mock, "*IDN?") == ""


@given(chunk=st.binary(max_size=80) | st.text(":;?*NUMERICVALITEM0123 ,\n", max_size=80).map(str.encode))
def test_nothing_that_is_sent_breaks_it(chunk: bytes) -> None:
    mock = ScpiAnalyzer(FakePlant())
    mock.handle(chunk)
    assert (mock.handle(b"\n*IDN?\n") or b"").endswith(b"F5.01\r\n")
