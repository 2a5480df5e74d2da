"""A stranger's Modbus server, libmodbus, driven by our driver: registers of an EA supply in its memory."""

import contextlib
import ctypes
import ctypes.util
import socket
import struct
import threading
from collections.abc import Iterator

import pytest

from drivers.errors import LinkError, ReadbackError
from drivers.modbus import ModbusDevice
from drivers.modbus_errors import IllegalAddress
from drivers.modbus_link import open_link
from drivers.modbus_map import Register, load_map

FOUND = ctypes.util.find_library("modbus")
pytestmark = pytest.mark.skipif(FOUND is None, reason="missing program: libmodbus (it comes with mbpoll)")
MAP = load_map("ea_psi9000")


class Mapping(ctypes.Structure):
    """``modbus_mapping_t`` of modbus.h."""

    _fields_ = (
        *((name, ctypes.c_int) for name in ("nb_bits", "start_bits", "nb_input_bits", "start_input_bits")),
        *((name, ctypes.c_int) for name in ("nb_input_registers", "start_input_registers")),
        *((name, ctypes.c_int) for name in ("nb_registers", "start_registers")),
        ("tab_bits", ctypes.POINTER(ctypes.c_uint8)),
        ("tab_input_bits", ctypes.POINTER(ctypes.c_uint8)),
        ("tab_input_registers", ctypes.POINTER(ctypes.c_uint16)),
        ("tab_registers", ctypes.POINTER(ctypes.c_uint16)),
    )


class Stranger:
    """libmodbus behind a TCP port, until its client goes."""

    def __init__(self) -> None:
        self.library = ctypes.CDLL(FOUND)
        self.library.modbus_new_tcp.restype = ctypes.c_void_p
        self.library.modbus_mapping_new.restype = ctypes.POINTER(Mapping)
        with contextlib.closing(socket.create_server(("127.0.0.1", 0))) as free:
            self.port = free.getsockname()[1]
        self.context = ctypes.c_void_p(self.library.modbus_new_tcp(b"127.0.0.1", self.port))
        self.memory = self.library.modbus_mapping_new(500, 500, 9100, 0)
        self.listener = self.library.modbus_tcp_listen(self.context, 1)
        self.thread = threading.Thread(target=self._serve, daemon=True)
        self.thread.start()

    def _serve(self) -> None:
        accepted = ctypes.c_int(self.listener)
        self.library.modbus_tcp_accept(self.context, ctypes.byref(accepted))
        request = (ctypes.c_uint8 * 260)()
        while (length := self.library.modbus_receive(self.context, request)) != -1:
            self.library.modbus_reply(self.context, request, length, self.memory)

    def put(self, register: Register, raw: float | str) -> None:
        for offset, word in enumerate(register.encode(raw)):
            self.memory.contents.tab_registers[register.address + offset] = word

    def words(self, register: Register) -> list[int]:
        return [self.memory.contents.tab_registers[register.address + k] for k in range(register.count)]

    def close(self) -> None:
        self.thread.join(5)
        self.library.modbus_close(self.context)
        self.library.modbus_mapping_free(self.memory)
        self.library.modbus_free(self.context)


@pytest.fixture
def stranger() -> Iterator[tuple[Stranger, ModbusDevice]]:
    server = Stranger()
    values = {
        "device_type": "PSI 9500-30 3U", "manufacturer": "EA Elektro-Automatik", "serial_number": "42",
        "firmware": "V2.26", "nominal_voltage": 500.0, "nominal_current": 30.0, "nominal_power": 5000.0,
        "limit_voltage_max": 0xD0E5, "limit_current_max": 0xD0E5, "actual_voltage": 0x6666,
    }  # fmt: skip
    for name, raw in values.items():
        server.put(MAP.registers[name], raw)
    device = ModbusDevice(open_link(f"tcp://127.0.0.1:{server.port}"), MAP, 0)
    yield server, device
    device.close()
    server.close()


def test_it_is_identified_and_read_in_volts(stranger: tuple[Stranger, ModbusDevice]) -> None:
    _, device = stranger
    assert device.identify().serial == "42"
    # the same arithmetic
    assert device.read("actual_voltage") == pytest.approx(500.0 * 0x6666 / 0xCCCC, rel=1e-12)


def test_a_set_point_arrives_in_its_registers(stranger: tuple[Stranger, ModbusDevice]) -> None:
    server, device = stranger
    device.write("set_voltage", 300.0)
    assert server.words(MAP.registers["set_voltage"]) == [round(300.0 * 0xCCCC / 500.0)]


def test_a_coil_is_written_and_its_missing_effect_is_noticed(stranger: tuple[Stranger, ModbusDevice]) -> None:
    """The coil takes the write; the state register of this server never follows."""
    server, device = stranger
    with pytest.raises(ReadbackError, match="remote was set to True"):
        device.write("remote", True)
    assert server.memory.contents.tab_bits[MAP.registers["remote"].address] == 1


def test_an_address_it_does_not_have_is_its_own_exception(stranger: tuple[Stranger, ModbusDevice]) -> None:
    _, device = stranger
    with pytest.raises(IllegalAddress):
        device.link.read(0, MAP.registers["state"].space, 60_000, 1)


def test_it_packs_numbers_as_the_map_says(stranger: tuple[Stranger, ModbusDevice]) -> None:
    server, device = stranger
    high, low = server.words(MAP.registers["nominal_power"])
    assert struct.unpack(">f", struct.pack(">HH", high, low))[0] == device.read("nominal_power") == 5000.0
    assert issubclass(LinkError, Exception)
