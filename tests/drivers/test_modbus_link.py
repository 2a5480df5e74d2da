"""One request, one reply that is known to be its own: byte-exact, and every way a reply can be wrong."""

import random
import struct
import time

import pytest
from pymodbus.framer import FramerType

from drivers.errors import InstrumentError, LinkTimeout, LinkUnavailable, ReplyError
from drivers.mocks.modbus_dc import MockLoad, MockSupply
from drivers.mocks.modbus_wire import crc16
from drivers.modbus_errors import (
    DeviceBusy,
    DeviceFailure,
    IllegalAddress,
    IllegalFunction,
    IllegalValue,
    ModbusRefused,
)
from drivers.modbus_link import ModbusLink, open_link
from drivers.modbus_map import Space
from tests.drivers.fake_dc_plant import LATENESS_S, TIMEOUT_S, FakeDcPlant, Wired, wired, wired_supply


@pytest.fixture
def tcp():
    plant = FakeDcPlant()
    with wired(MockSupply(plant), plant) as wires:
        yield wires


@pytest.fixture
def rtu():
    plant = FakeDcPlant()
    with wired(MockLoad(plant), plant, rtu=True) as wires:
        yield wires


def read_class(wires: Wired) -> list[int]:
    return wires.device.link.read(wires.mock.unit, Space.HOLDING, 0, 1)


def with_crc(text: str) -> bytes:
    frame = bytes.fromhex(text)
    return frame + crc16(frame)


def test_a_tcp_dialogue_byte_for_byte(tcp: Wired) -> None:
    link = tcp.device.link
    link.write(0, Space.COIL, 402, [1])
    link.write(0, Space.HOLDING, 500, [0x7AE1])
    assert link.read(0, Space.HOLDING, 500, 1) == [0x7AE1]
    assert [(a.hex(" "), b.hex(" ")) for a, b in tcp.frames] == [
        ("00 01 00 00 00 06 00 05 01 92 ff 00", "00 01 00 00 00 06 00 05 01 92 ff 00"),
        ("00 02 00 00 00 06 00 06 01 f4 7a e1", "00 02 00 00 00 06 00 06 01 f4 7a e1"),
        ("00 03 00 00 00 06 00 03 01 f4 00 01", "00 03 00 00 00 05 00 03 02 7a e1"),
    ]


def test_an_rtu_dialogue_byte_for_byte(rtu: Wired) -> None:
    link = rtu.device.link
    link.write(1, Space.COIL, 402, [1])
    assert link.read(1, Space.COIL, 402, 1) == [1]
    link.write(1, Space.HOLDING, 501, [0x1000, 0x2000])
    assert [(a.hex(" "), b.hex(" ")) for a, b in rtu.frames] == [
        ("01 05 01 92 ff 00 2c 2b", "01 05 01 92 ff 00 2c 2b"),
        ("01 01 01 92 00 01 5d db", "01 01 01 01 90 48"),
        ("01 10 01 f5 00 02 04 10 00 20 00 2c 44", "01 10 01 f5 00 02 50 06"),
    ]


@pytest.mark.parametrize(
    ("code", "error"),
    [(1, IllegalFunction), (2, IllegalAddress), (3, IllegalValue), (4, DeviceFailure), (6, DeviceBusy)],
)
def test_an_exception_reply_is_raised_and_never_a_value(rtu: Wired, code: int, error: type) -> None:
    rtu.server.tamper = lambda request, reply: with_crc(f"01 83 {code:02x}")
    with pytest.raises(error) as caught:
        read_class(rtu)
    assert caught.value.code == code
    assert caught.value.context["command"] == "01 03 00 00 00 01 84 0a"


def test_an_exception_leaves_the_link_in_step(rtu: Wired) -> None:
    rtu.mock.busy = 1
    with pytest.raises(DeviceBusy):
        read_class(rtu)
    assert read_class(rtu) == [40]
    assert rtu.device.link.disturbances == 0


def test_the_makers_own_exception_code_is_kept(rtu: Wired) -> None:
    rtu.server.tamper = lambda request, reply: with_crc("01 83 17")
    with pytest.raises(ModbusRefused) as caught:
        read_class(rtu)
    assert caught.value.code == 0x17


WRONG_RTU = {
    "function code": "01 04 02 00 28",
    "function code of an exception": "01 84 02",
    "unknown function code": "01 63 02 00 28",
    "one register too many": "01 03 04 00 28 00 00",
    "no register": "01 03 00",
    "half a register": "01 03 01 28",
    "unit": "02 03 02 00 28",
    "a write's echo": "01 06 00 00 00 28",
}


@pytest.mark.parametrize("wrong", WRONG_RTU.values(), ids=WRONG_RTU.keys())
def test_a_wrong_rtu_reply_is_an_error_and_the_next_one_is_right(rtu: Wired, wrong: str) -> None:
    rtu.server.tamper = lambda request, reply: with_crc(wrong)
    with pytest.raises(ReplyError) as caught:
        read_class(rtu)
    assert caught.value.context["reply"] == with_crc(wrong).hex(" ")
    rtu.server.tamper = None
    assert read_class(rtu) == [40]


WRONG_TCP = {
    "transaction": lambda r: bytes([r[0], r[1] ^ 1]) + r[2:],
    "transaction zero": lambda r: b"\0\0" + r[2:],
    "protocol": lambda r: r[:3] + b"\1" + r[4:],
    "unit": lambda r: r[:6] + b"\7" + r[7:],
    "function code": lambda r: r[:7] + b"\4" + r[8:],
    "count": lambda r: r[:5] + b"\7" + r[6:8] + b"\4" + r[9:] + b"\0\0",
    "byte count": lambda r: r[:8] + b"\4" + r[9:],
    "cut": lambda r: r[:-1],
}


@pytest.mark.parametrize("wrong", WRONG_TCP.values(), ids=WRONG_TCP.keys())
def test_a_wrong_tcp_reply_is_an_error_and_the_next_one_is_right(tcp: Wired, wrong) -> None:
    tcp.server.tamper = lambda request, reply: wrong(reply)
    with pytest.raises(ReplyError):
        read_class(tcp)
    tcp.server.tamper = None
    assert read_class(tcp) == [33]


def test_a_bad_checksum_is_an_error(rtu: Wired) -> None:
    rtu.server.tamper = lambda request, reply: reply[:-1] + bytes([reply[-1] ^ 1])
    with pytest.raises(ReplyError):
        read_class(rtu)


def test_a_write_whose_echo_differs_is_an_error(rtu: Wired) -> None:
    rtu.mock.remote = True
    rtu.server.tamper = lambda request, reply: with_crc("01 06 01 f4 00 02")
    with pytest.raises(ReplyError, match="repeat"):
        rtu.device.link.write(1, Space.HOLDING, 500, [1])


def test_a_reply_in_pieces_is_whole(rtu: Wired) -> None:
    def in_pieces(request: bytes, reply: bytes | None) -> bytes | None:
        for byte in reply[:-1]:
            rtu.server.send(bytes([byte]))
        return reply[-1:]

    rtu.server.tamper = in_pieces
    assert read_class(rtu) == [40]


def test_bytes_that_nobody_asked_for_are_not_the_reply(rtu: Wired) -> None:
    stray = with_crc("01 03 02 00 63")
    rtu.server.send(stray)
    give_up = time.monotonic() + 5.0
    while rtu.device.link._client.bytes._port.in_waiting < len(stray) and time.monotonic() < give_up:
        pass  # the kernel brings them over in its own time
    assert read_class(rtu) == [40]


def test_silence_is_a_timeout_and_is_told_as_one(rtu: Wired) -> None:
    rtu.server.tamper = lambda request, reply: None
    with pytest.raises(LinkTimeout) as caught:
        read_class(rtu)
    assert caught.value.context["elapsed_s"] >= TIMEOUT_S


def test_a_late_rtu_reply_never_answers_the_next_request(rtu: Wired) -> None:
    late: list[bytes] = []

    def hold(request: bytes, reply: bytes | None) -> bytes | None:
        late.append(reply)
        return None

    rtu.server.tamper = hold
    with pytest.raises(LinkTimeout):
        rtu.device.link.read(1, Space.HOLDING, 502, 1)
    rtu.server.tamper = None
    rtu.server.send(late[0])  # as long as the quarantine lasts
    assert read_class(rtu) == [40]


def test_a_serial_link_waits_out_the_lateness_after_a_timeout(rtu: Wired, monkeypatch) -> None:
    waits: list[float] = []
    link = rtu.device.link
    monkeypatch.setattr(link._client.bytes, "quarantine", waits.append)
    rtu.server.tamper = lambda request, reply: None
    with pytest.raises(LinkTimeout):
        read_class(rtu)
    rtu.server.tamper = None
    read_class(rtu)
    read_class(rtu)
    assert len(waits) == 1
    assert 0 < waits[0] <= LATENESS_S


def test_a_late_tcp_reply_dies_with_its_connection(tcp: Wired) -> None:
    connection = tcp.device.link._client.bytes
    tcp.server.tamper = lambda request, reply: None
    with pytest.raises(LinkTimeout):
        read_class(tcp)
    tcp.server.tamper = None
    assert read_class(tcp) == [33]
    assert tcp.device.link._client.bytes is not connection
    assert tcp.device.link.disturbances == 1


def test_an_idle_connection_that_the_instrument_closed_is_opened_anew(tcp: Wired) -> None:
    tcp.device.link.write(0, Space.COIL, 402, [1])
    tcp.server.drop_clients()
    tcp.device.link.write(0, Space.HOLDING, 500, [5])  # not sent twice: see the count
    assert len([f for f, _ in tcp.frames if f[7] == 6]) == 1
    assert tcp.mock.counts["set_voltage"] == 5


def test_transaction_ids_stay_below_what_the_instrument_takes_for_scpi(tcp: Wired) -> None:
    tcp.device.link._client.transaction.next_tid = 0x29FE
    for _ in range(3):
        assert read_class(tcp) == [33]
    assert [request[:2].hex() for request, _ in tcp.frames] == ["29ff", "0001", "0002"]


def test_no_reply_whatever_is_in_it_raises_anything_but_an_instrument_error() -> None:
    rng = random.Random(1)  # seeded: the same 300 replies each time

    class Babble:
        resource = "babble"

        def __init__(self) -> None:
            self.chunks: list[bytes] = []

        def write(self, data: bytes) -> None:
            junk = rng.randbytes(rng.randrange(12))
            unit_and_code = struct.pack(">BB", 1, rng.choice([3, 0x83, 4, 1, 8, 43, 24]))
            self.chunks = [with_crc((unit_and_code + junk).hex()) if rng.random() < 0.8 else junk]

        def read_some(self, deadline: float) -> bytes:
            return self.chunks.pop() if self.chunks else b""

        def drain(self) -> bytes:
            return b""

        def quarantine(self, longest_lateness_s: float) -> None: ...
        def close(self) -> None: ...

    link = ModbusLink(Babble, FramerType.RTU, timeout_s=0.01)
    refusals = 0
    for _ in range(300):
        try:
            values = link.read(1, Space.HOLDING, 0, 1)
            assert len(values) == 1
        except InstrumentError:
            refusals += 1
    assert refusals > 250  # nearly all of it is no reply; a valid one by chance may pass


@pytest.mark.parametrize("resource", ["/dev/no-such-port", "tcp://127.0.0.1:1", "tcp://:5", "tcp://host:x"])
def test_what_cannot_be_opened_is_said_at_once(resource: str) -> None:
    with pytest.raises(LinkUnavailable, match=r"cannot open|is not tcp"):
        open_link(resource)


def test_a_serial_device_that_another_program_holds_is_unavailable(rtu: Wired) -> None:
    with pytest.raises(LinkUnavailable, match="another program"):
        open_link(rtu.server.path)


def test_a_wrong_unit_is_met_with_silence(rtu: Wired) -> None:
    with pytest.raises(LinkTimeout):
        rtu.device.link.read(2, Space.HOLDING, 0, 1)


def test_in_limited_mode_coils_cannot_be_read() -> None:
    with wired_supply() as (wires, _), pytest.raises(ReplyError, match="16 values"):
        wires.device.link.read(0, Space.COIL, 402, 1)
