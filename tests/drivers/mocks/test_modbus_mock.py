"""The mock Modbus devices as a stranger sees them: answers, refusals, silence."""

import socket
import struct

import minimalmodbus
import pytest

from drivers.mocks.modbus_dc import MockLoad, MockSupply
from drivers.mocks.modbus_wire import RtuServer, TcpServer, crc16
from tests.drivers.fake_dc_plant import FakeDcPlant


@pytest.fixture
def mock() -> MockSupply:
    return MockSupply(FakeDcPlant(), unit=1)


def ask(mock: MockSupply, pdu: str) -> str:
    reply = mock.answer(mock.unit, bytes.fromhex(pdu))
    assert reply is not None
    return reply.hex(" ")


@pytest.mark.parametrize(
    ("request_", "reply"),
    [
        ("03 00 79 00 02", "03 04 43 fa 00 00"),  # nominal voltage, 500.0 as float32, high word first
        ("03 00 79 00 01", "03 02 43 fa"),  # half of it
        ("03 01 f9 00 02", "03 04 00 00 00 00"),  # off, local, CV
        ("03 23 28 00 05", "03 0a d0 e5 00 00 d0 e5 00 00 d0 e5"),  # adjustment limits
        ("01 01 95 00 01", "01 01 00"),
        ("05 01 92 ff 00", "05 01 92 ff 00"),
    ],
)
def test_what_it_answers(mock: MockSupply, request_: str, reply: str) -> None:
    assert ask(mock, request_) == reply


@pytest.mark.parametrize(
    ("request_", "reply"),
    [
        ("04 00 79 00 02", "84 01"),  # no input registers
        ("2b 0e 01 00", "ab 01"),
        ("03 03 e7 00 01", "83 02"),  # no register 999
        ("03 01 f5 00 04", "83 02"),  # 501 to 504, and there is no 503
        ("03 00 00 00 00", "83 03"),
        ("03 00 00 00 7e", "83 03"),
        ("05 01 92 12 34", "85 03"),
        ("06 01 fb 00 01", "86 02"),  # actual voltage is not writable
        ("06 01 f4 d0 e6", "86 03"),  # above 102 %
        ("10 01 f4 00 02 04 00 01", "90 03"),
        ("06 01", "86 03"),
    ],
)
def test_what_it_refuses(mock: MockSupply, request_: str, reply: str) -> None:
    mock.remote = True
    assert ask(mock, request_) == reply


def test_without_remote_mode_nothing_but_remote_mode_can_be_written(mock: MockSupply) -> None:
    assert ask(mock, "06 01 f4 00 01") == "86 17"
    assert ask(mock, "05 01 95 ff 00") == "85 17"
    assert ask(mock, "05 01 92 ff 00") == "05 01 92 ff 00"
    assert ask(mock, "06 01 f4 00 01") == "06 01 f4 00 01"


def test_the_state_bits_are_where_the_register_list_has_them(mock: MockSupply) -> None:
    mock.remote = mock.on = True
    assert ask(mock, "03 01 f9 00 02") == "03 04 00 00 08 80"  # bits 7 and 11
    mock.trip("OVP")
    mock.trip("OT")
    assert ask(mock, "03 01 f9 00 02") == "03 04 00 09 88 00"  # bits 11, 15, 16, 19


def test_with_an_alarm_standing_it_does_not_switch_on_until_acknowledged(mock: MockSupply) -> None:
    mock.remote = True
    mock.trip("OVP")
    assert ask(mock, "05 01 95 ff 00") == "85 04"
    assert ask(mock, "05 01 9b ff 00") == "05 01 9b ff 00"
    assert ask(mock, "05 01 95 ff 00") == "05 01 95 ff 00"


def test_constant_current_shows_in_bits_9_and_10() -> None:
    plant = FakeDcPlant(load=(True, 600.0))
    mock = MockSupply(plant, unit=1)
    mock.remote = True
    mock.put("set_voltage", 31457)
    mock.put("set_current", 1000)
    mock.put("output", 1)
    assert ask(mock, "03 01 f9 00 02") == "03 04 00 00 0c 80"  # 0b10 at bit 9


def test_actual_values_are_counts_of_nominal_up_to_125_percent(mock: MockSupply) -> None:
    mock.remote = True
    mock.put("set_voltage", 0xCCCC // 2)
    mock.put("output", 1)
    assert ask(mock, "03 01 fb 00 01") == "03 02 66 66"
    mock.plant.overshoot = 3.0
    mock.counts["protect_voltage"] = 0xFFFF * 2
    assert ask(mock, "03 01 fb 00 01") == "03 02 ff ff"


def test_several_registers_are_written_all_or_none(mock: MockSupply) -> None:
    mock.remote = True
    assert ask(mock, "10 01 f4 00 02 04 00 10 00 20") == "10 01 f4 00 02"
    assert (mock.counts["set_voltage"], mock.counts["set_current"]) == (0x10, 0x20)
    assert ask(mock, "10 01 f6 00 02 04 00 30 00 40") == "90 02"  # 502, and there is no 503
    assert mock.counts["set_power"] == 0xCCCC


def test_as_delivered_it_answers_only_unit_0_and_misreads_coils() -> None:
    mock = MockSupply(FakeDcPlant())
    assert mock.answer(1, bytes.fromhex("03 00 00 00 01")) is None
    assert ask(mock, "03 00 00 00 01") == "03 02 00 21"
    mock.remote = True
    assert ask(mock, "01 01 92 00 01") == "01 02 ff 00"


def test_a_frame_with_a_bad_checksum_is_not_answered_and_the_next_is() -> None:
    frame = bytes.fromhex("01 03 00 00 00 01")
    server = RtuServer(MockLoad(FakeDcPlant()))
    assert server._receive(frame + b"\0\0") is None
    assert server._receive(frame + crc16(frame)) == bytes.fromhex("01 03 02 00 28 b8 5a")


def test_a_request_in_pieces_is_answered_once_it_is_whole() -> None:
    frame = bytes.fromhex("01 03 00 00 00 01")
    server = RtuServer(MockLoad(FakeDcPlant()))
    replies = [server._receive(bytes([byte])) for byte in frame + crc16(frame)]
    assert replies[:-1] == [None] * 7
    assert replies[-1] is not None


@pytest.fixture
def client():
    with (
        TcpServer(MockSupply(FakeDcPlant())) as server,
        socket.create_connection(("127.0.0.1", server.port), timeout=5) as client,
    ):
        yield client


GET_CLASS = bytes.fromhex("00 07 00 00 00 06 00 03 00 00 00 01")
CLASS = bytes.fromhex("00 07 00 00 00 05 00 03 02 00 21")


def test_two_tcp_requests_at_once_get_two_replies(client: socket.socket) -> None:
    client.sendall(GET_CLASS + GET_CLASS[:5])
    assert client.recv(64) == CLASS
    client.sendall(GET_CLASS[5:])
    assert client.recv(64) == CLASS


def test_what_looks_like_scpi_text_on_the_tcp_port_gets_no_modbus_reply(client: socket.socket) -> None:
    starred = struct.pack(">H", 0x2A00) + GET_CLASS[2:]  # transaction 10752: its first byte is "*"
    client.sendall(starred + b"\n" + GET_CLASS)
    assert client.recv(64) == CLASS


def test_minimalmodbus_reads_and_sets_the_supply_over_rtu(mock: MockSupply) -> None:
    with RtuServer(mock) as server:
        stranger = minimalmodbus.Instrument(server.path, 1)
        stranger.serial.timeout = 5.0  # s; by itself it gives up after 50 ms, which a busy machine may take
        try:
            assert stranger.read_string(1, 20).rstrip("\0") == "PSI 9500-30 3U"
            assert stranger.read_float(121) == 500.0
            stranger.write_bit(402, 1)
            stranger.write_register(500, 31457, functioncode=6)
            assert stranger.read_register(500) == 31457
            with pytest.raises(minimalmodbus.IllegalRequestError):
                stranger.read_register(999)
        finally:
            stranger.serial.close()
