"""A signal in the middle of an exchange: its reply, still under way, answers nothing that is asked afterwards."""

from collections.abc import Callable

import pytest
from pymodbus.framer import FramerType

from drivers.controller import Controller
from drivers.mocks.checksum import crc16
from drivers.mocks.controller import MockController
from drivers.modbus_link import ModbusLink
from drivers.modbus_map import Space
from drivers.scpi import ScpiLink
from drivers.transport import ByteLink
from tests.drivers.fake_plant import FakePlant

SOON_S = 0.02


class Signal(BaseException):
    """What a signal's handler raises."""


class Interrupted:
    """A port over an instrument; the read after the given write is interrupted, and its reply comes at the next."""

    def __init__(self, answer: Callable[[bytes], bytes | None], interrupted: int) -> None:
        self._answer, self._interrupted = answer, interrupted
        self._writes, self._waiting, self._late = 0, b"", b""
        self._signalled = False

    @property
    def in_waiting(self) -> int:
        return len(self._waiting)

    def write(self, data: bytes, /) -> int:
        self._writes += 1
        reply = self._answer(data) or b""
        if self._writes == self._interrupted:
            self._late = reply
        else:
            self._waiting += reply
        return len(data)

    def read(self, size: int = 1, /) -> bytes:
        if self._late and not self._signalled:
            self._signalled = True
            raise Signal
        if self._late:
            late, self._late = self._late, b""
            return late
        data, self._waiting = self._waiting[:size], self._waiting[size:]
        return data

    def close(self) -> None: ...


def test_scpi() -> None:
    answers = {b"A?\n": b"1\n", b"B?\n": b"2\n", b"*OPC?\n": b"1\n"}
    link = ScpiLink(ByteLink(Interrupted(answers.get, 1), "x"), timeout_s=SOON_S, lateness_s=SOON_S)
    with pytest.raises(Signal):
        link.query("A?", int)
    assert link.query("B?", int) == 2


def test_modbus() -> None:
    def registers(request: bytes) -> bytes:
        reply = request[:2] + b"\x02" + request[2:4]  # a register holds its own address
        return reply + crc16(reply)

    port = Interrupted(registers, 1)
    link = ModbusLink(
        lambda: ByteLink(port, "x"), FramerType.RTU, timeout_s=SOON_S, longest_lateness_s=SOON_S
    )
    with pytest.raises(Signal):
        link.read(1, Space.HOLDING, 500, 1)
    assert link.read(1, Space.HOLDING, 501, 1) == [501]
    assert link.disturbances == 1  # a device asks who answers before it goes on


def test_controller() -> None:
    mock = MockController(FakePlant())
    controller = Controller(ByteLink(Interrupted(mock.handle, 2), "x"), timeout_s=SOON_S, lateness_s=SOON_S)
    controller.identify()
    with pytest.raises(Signal):
        controller.heartbeat()
    assert controller.heartbeat().V2_V == 140.0
