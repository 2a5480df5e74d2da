"""Replies that come late, at random, on Modbus RTU and on SCPI: is any taken for the answer to another question?

Every question has an answer of its own, so a wrong attribution cannot hide. A late reply comes after its deadline, and
within the lateness that the link is told to expect: often in the middle of the exchanges that follow.
"""

import struct
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from pymodbus.framer import FramerType

from drivers.errors import LinkTimeout, ReplyError
from drivers.mocks.checksum import crc16
from drivers.mocks.wire import PtyServer
from drivers.modbus_link import ModbusLink
from drivers.modbus_map import Space
from drivers.scpi import ScpiLink
from drivers.transport import ByteLink

TIMEOUT_S, LATENESS_S = 0.03, 0.12
LATE = 0.02  # of all replies
# of the lateness that is used: timers and threads on a busy machine have a lateness of their own
SPREAD = 0.5


@dataclass(slots=True)
class LateReport:
    """Exchanges, replies that were late, answers that were refused or missing, and answers that were wrong."""

    wire: str
    exchanges: int = 0
    late: int = 0
    missing: int = 0
    misattributed: int = 0


class LateServer:
    """Answers by a function, some replies late, from a seed."""

    def __init__(self, answer: Callable[[bytes], bytes | None], seed: int) -> None:
        self._answer, self._rng = answer, np.random.default_rng(seed)
        self.late = 0
        self.server = PtyServer(self._handle)

    def _handle(self, chunk: bytes) -> bytes | None:
        reply = self._answer(chunk)
        if reply is None or self._rng.random() >= LATE:
            return reply
        self.late += 1
        delay_s = TIMEOUT_S + float(self._rng.uniform(0.0, SPREAD * LATENESS_S))
        last_s = time.monotonic() + TIMEOUT_S + 0.75 * LATENESS_S
        timer = threading.Timer(delay_s, self._send, [reply, last_s])
        timer.daemon = True
        timer.start()
        return None

    def _send(self, reply: bytes, last_s: float) -> None:
        """A reply that this machine has held up beyond the lateness that the link was told of never comes."""
        if time.monotonic() <= last_s:
            self.server.send(reply)


def register_value(address: int) -> int:
    """What the register at an address holds: no two neighbours the same."""
    return (address * 40503 + 77) & 0xFFFF


def _answer_rtu(request: bytes) -> bytes | None:
    if len(request) != 8 or crc16(request[:-2]) != request[-2:]:
        return None
    address, count = struct.unpack(">HH", request[2:6])
    values = struct.pack(f">{count}H", *(register_value(address + k) for k in range(count)))
    reply = request[:2] + bytes([len(values)]) + values
    return reply + crc16(reply)


def _answer_scpi(request: bytes) -> bytes | None:
    replies = [
        "1" if line == "*OPC?" else line.rpartition(" ")[2]
        for line in request.decode("ascii").splitlines()
        if line != "*CLS"
    ]
    return "".join(f"{reply}\r\n" for reply in replies).encode() or None


def late_on_rtu(exchanges: int, seed: int) -> LateReport:
    """Reads of random registers."""
    rng, late = np.random.default_rng([seed, 1]), LateServer(_answer_rtu, seed)
    with late.server as server:

        def open_bytes() -> ByteLink:
            return ByteLink.open(server.path, baud=115200)

        link = ModbusLink(open_bytes, FramerType.RTU, timeout_s=TIMEOUT_S, longest_lateness_s=LATENESS_S)

        def ask(number: int) -> bool:
            return link.read(1, Space.HOLDING, number, 1) == [register_value(number)]

        report = _exchange(ask, rng, exchanges, "Modbus RTU")
        link.close()
    report.late = late.late
    return report


def late_on_scpi(exchanges: int, seed: int) -> LateReport:
    """Queries with random numbers."""
    rng, late = np.random.default_rng([seed, 2]), LateServer(_answer_scpi, seed)
    with late.server as server, ByteLink.open(server.path) as bytes_:
        link = ScpiLink(bytes_, timeout_s=TIMEOUT_S, lateness_s=LATENESS_S)
        report = _exchange(lambda n: link.query(f":ECHO? {n}", int) == n, rng, exchanges, "SCPI")
    report.late = late.late
    return report


def _exchange(ask: Callable[[int], bool], rng: np.random.Generator, exchanges: int, wire: str) -> LateReport:
    report = LateReport(wire=wire, exchanges=exchanges)
    for number in rng.integers(0, 60_000, exchanges):
        try:
            report.misattributed += not ask(int(number))
        except (LinkTimeout, ReplyError):
            report.missing += 1
    return report
