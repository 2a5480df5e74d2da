"""A Modbus device behind a register map: takes a request's PDU, gives the reply's.

The map says where registers are and how they are packed; a subclass says what they hold (``get``) and what
a write does (``put``). What the standard asks of a server is here: function codes, counts, whole registers,
exception replies. Frames and ports are not: see ``modbus_wire``.
"""

import struct
import threading
from abc import ABC, abstractmethod

from drivers.modbus_map import ModbusMap, Raw, Register, Space

ILLEGAL_FUNCTION, ILLEGAL_ADDRESS, ILLEGAL_VALUE, DEVICE_FAILURE, BUSY = 1, 2, 3, 4, 6
READ_SPACES = {1: Space.COIL, 2: Space.DISCRETE, 3: Space.HOLDING, 4: Space.INPUT}
COIL_WORDS = {0x0000: 0, 0xFF00: 1}


class Refusal(Exception):
    """The device answers with an exception code."""

    def __init__(self, code: int) -> None:
        super().__init__(f"exception code {code}")
        self.code = code


class MockModbusDevice(ABC):
    """One unit on a wire.

    Parameters
    ----------
    map : its registers.
    unit : the only unit id that it answers; to any other it is silent.
    limited : behave as EA devices do as delivered: a read of coils is answered like a read of registers.
        Assumption: two bytes per coil, 0xFF00 or 0x0000; the manual says that the reply is not conformant.
    """

    def __init__(self, map: ModbusMap, *, unit: int, limited: bool = False) -> None:
        self.map = map
        self.unit = unit
        self.limited = limited
        self.busy = 0  # so many requests more are answered with "busy"
        self.lock = threading.RLock()
        spaces = {register.space for register in map.registers.values()}
        self._functions = {code for code, space in READ_SPACES.items() if space in spaces}
        self._functions |= ({5} if Space.COIL in spaces else set()) | {6, 16}
        self._at: dict[tuple[Space, int], Register] = {
            (r.space, r.address + offset): r for r in map.registers.values() for offset in range(r.count)
        }

    @abstractmethod
    def get(self, name: str) -> Raw:
        """What a register holds now, unscaled."""

    @abstractmethod
    def put(self, name: str, raw: Raw) -> None:
        """Take a write, or raise ``Refusal``; called for whole registers that the map calls writable."""

    def answer(self, unit: int, pdu: bytes) -> bytes | None:
        """The reply to a request for ``unit``: its PDU, or ``None`` for silence."""
        if unit != self.unit or not pdu:
            return None
        with self.lock:
            try:
                if self.busy:
                    self.busy -= 1
                    raise Refusal(BUSY)
                return self._perform(pdu)
            except Refusal as refusal:
                return bytes([pdu[0] | 0x80, refusal.code])

    def _perform(self, pdu: bytes) -> bytes:
        code, body = pdu[0], pdu[1:]
        if code not in self._functions:
            raise Refusal(ILLEGAL_FUNCTION)
        if len(body) < 4 or (code != 16 and len(body) != 4):
            raise Refusal(ILLEGAL_VALUE)
        address, second = struct.unpack(">HH", body[:4])
        if code in (1, 2):
            return self._read_bits(code, address, second)
        if code in (3, 4):
            return self._read_words(code, address, second)
        if code == 5:
            if second not in COIL_WORDS:
                raise Refusal(ILLEGAL_VALUE)
            self._write(Space.COIL, address, [COIL_WORDS[second]])
        elif code == 6:
            self._write(Space.HOLDING, address, [second])
        else:
            data = body[5:]
            if not 1 <= second <= 123 or len(data) != 2 * second or body[4] != 2 * second:
                raise Refusal(ILLEGAL_VALUE)
            self._write(Space.HOLDING, address, list(struct.unpack(f">{second}H", data)))
        return pdu[:5]

    def _read_bits(self, code: int, address: int, count: int) -> bytes:
        bits = self._words(READ_SPACES[code], address, count)
        if self.limited:
            data = b"".join(b"\xff\x00" if bit else b"\0\0" for bit in bits)
        else:
            packed = sum(bit << place for place, bit in enumerate(bits))
            data = packed.to_bytes((count + 7) // 8, "little")
        return bytes([code, len(data)]) + data

    def _read_words(self, code: int, address: int, count: int) -> bytes:
        words = self._words(READ_SPACES[code], address, count)
        return bytes([code, 2 * count]) + struct.pack(f">{count}H", *words)

    def _words(self, space: Space, address: int, count: int) -> list[int]:
        """What ``count`` addresses hold; each register is asked once, so that its words belong together."""
        if not 1 <= count <= 125:
            raise Refusal(ILLEGAL_VALUE)
        words: list[int] = []
        while len(words) < count:
            register = self._at.get((space, address + len(words)))
            if register is None:
                raise Refusal(ILLEGAL_ADDRESS)
            skipped = address + len(words) - register.address
            words += register.encode(self.get(register.name))[skipped:]
        return words[:count]

    def _write(self, space: Space, address: int, words: list[int]) -> None:
        """Write whole registers; nothing is done when one of them is not there or not writable."""
        writes: list[tuple[str, Raw]] = []
        while words:
            register = self._at.get((space, address))
            if register is None or register.address != address or "w" not in register.access:
                raise Refusal(ILLEGAL_ADDRESS)
            if len(words) < register.count:
                raise Refusal(ILLEGAL_VALUE)
            writes.append((register.name, register.decode(words[: register.count])))
            address, words = address + register.count, words[register.count :]
        for name, raw in writes:
            self.put(name, raw)
