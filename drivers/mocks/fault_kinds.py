"""The kinds of faults: each takes one exchange and says what really goes out on the wire.

``KINDS`` is the list; a kind says on which wires it can happen: ``scpi`` (the analyzer's text), ``tcp`` and ``rtu``
(Modbus), ``frames`` (the controller's). What befalls the instrument, not the wire (a trip, a pressed key), is done to
its front panel, and shows from the next exchange on.
"""

import struct
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from drivers.controller_messages import NACK, REFUSAL, REPLY, Reason, Request
from drivers.errors import ReplyError
from drivers.frames import DELIMITER, Frame, decode, encode
from drivers.mocks.checksum import crc16

SPLIT_S = 0.03
VALUES = b"VALUE?"
GARBAGE_BYTES = 12


class Line(Protocol):
    """What a fault can do to the wire and to the instrument at its end."""

    @property
    def wire(self) -> str: ...
    @property
    def panel(self) -> Any: ...  # the mock instrument
    def send(self, data: bytes) -> None: ...
    def unplug(self, seconds: float) -> None: ...


@dataclass(frozen=True, slots=True, kw_only=True)
class Exchange:
    """One exchange that a fault befalls; ``before`` is the reply to the last request like this one."""

    request: bytes
    reply: bytes
    before: bytes | None
    seconds: float
    value: int | str | None
    line: Line
    rng: np.random.Generator


@dataclass(frozen=True, slots=True)
class Kind:
    """On which wires, and what happens."""

    wires: frozenset[str]
    strike: Callable[[Exchange], bytes | None]


SCPI, TCP, RTU, FRAMES = "scpi", "tcp", "rtu", "frames"
WIRES = {
    "analyzer": frozenset({SCPI}),
    "supply": frozenset({TCP}),
    "load": frozenset({RTU}),
    "controller": frozenset({FRAMES}),
}

# --- any wire -----------------------------------------------------------------------------------------


def late_reply(x: Exchange) -> bytes | None:
    """The reply comes, after its deadline, perhaps in the middle of the next exchange."""
    timer = threading.Timer(x.seconds, x.line.send, [x.reply])
    timer.daemon = True
    timer.start()
    return None


def split_reply(x: Exchange) -> bytes | None:
    """The reply comes in two pieces."""
    half = max(1, len(x.reply) // 2)
    x.line.send(x.reply[:half])
    time.sleep(SPLIT_S)
    return x.reply[half:]


def truncated_reply(x: Exchange) -> bytes | None:
    """The end of the reply is missing; of a line of text, its end in front of the terminator."""
    if x.line.wire == SCPI:
        text = x.reply.rstrip(b"\r\n")
        return text[: max(1, len(text) - 4)] + b"\r\n"
    return x.reply[: max(1, len(x.reply) - 3)]


def missing_terminator(x: Exchange) -> bytes | None:
    """The reply has no end."""
    return x.reply.rstrip(b"\r\n") if x.line.wire == SCPI else x.reply.rstrip(DELIMITER)


def local_echo(x: Exchange) -> bytes | None:
    """The line repeats what was sent, in front of the reply."""
    return x.request + x.reply


def garbage(x: Exchange) -> bytes | None:
    """A burst of noise in front of the reply."""
    return x.rng.integers(1, 256, GARBAGE_BYTES, dtype=np.uint8).tobytes() + x.reply


def silence(_: Exchange) -> bytes | None:
    """No reply: the command of an option that is not fitted, or an instrument that hangs."""
    return None


def hang_up(x: Exchange) -> bytes | None:
    """The plug is pulled, and put back in after some seconds: a serial port has another device path then."""
    x.line.unplug(x.seconds)
    return None


# --- the analyzer's text ------------------------------------------------------------------------------


def _first_value(x: Exchange, word: bytes) -> bytes:
    """The reply with its first value replaced; a reply that holds no values as it is."""
    if VALUES not in x.request.upper():
        return x.reply
    return word + x.reply[x.reply.index(b",") :] if b"," in x.reply else word + b"\r\n"


def no_data(x: Exchange) -> bytes | None:
    """NAN where a number should be."""
    return _first_value(x, b"NAN")


def overrange(x: Exchange) -> bytes | None:
    """INF where a number should be."""
    return _first_value(x, b"INF")


def sentinel(x: Exchange) -> bytes | None:
    """The finite number that stands for no data in binary blocks, in text."""
    return _first_value(x, b"9.91000E+37")


def headers_on(x: Exchange) -> bytes | None:
    """Headers are on again."""
    return b":NUMERIC:NORMAL:VALUE " + x.reply if VALUES in x.request.upper() else x.reply


def stale(x: Exchange) -> bytes | None:
    """The record of before once more."""
    return x.before if x.before is not None and VALUES in x.request.upper() else x.reply


def hold_on(x: Exchange) -> bytes | None:
    """Somebody has frozen the display: every value stays as it is."""
    x.line.panel.handle(b":NUMERIC:HOLD ON\n")
    return x.reply


def error_entry(x: Exchange) -> bytes | None:
    """Something stands in the error queue."""
    x.line.panel.handle(b":NO:SUCH:COMMAND\n")
    return x.reply


# --- Modbus -------------------------------------------------------------------------------------------


def _modbus(x: Exchange, change: Callable[[bytes, bytes], tuple[bytes, bytes]]) -> bytes:
    """The reply with unit and PDU changed, and checksum or length made right for it."""
    if x.line.wire == RTU:
        unit, pdu = change(x.reply[:1], x.reply[1:-2])
        return unit + pdu + crc16(unit + pdu)
    unit, pdu = change(x.reply[6:7], x.reply[7:])
    return x.reply[:4] + struct.pack(">H", len(pdu) + 1) + unit + pdu


def exception(x: Exchange) -> bytes | None:
    """An exception reply; ``value`` is its code."""
    code = int(x.value or 4)
    return _modbus(x, lambda unit, pdu: (unit, bytes([pdu[0] | 0x80, code])))


def wrong_function(x: Exchange) -> bytes | None:
    """The reply to another kind of request."""
    return _modbus(x, lambda unit, pdu: (unit, bytes([pdu[0] ^ 0x07]) + pdu[1:]))


def wrong_count(x: Exchange) -> bytes | None:
    """A register more than was asked for; of a write, another address."""

    def change(unit: bytes, pdu: bytes) -> tuple[bytes, bytes]:
        if pdu[0] in (3, 4):
            return unit, bytes([pdu[0], pdu[1] + 2]) + pdu[2:] + b"\x00\x01"
        return unit, pdu[:1] + bytes([pdu[1] ^ 0x01]) + pdu[2:]

    return _modbus(x, change)


def wrong_unit(x: Exchange) -> bytes | None:
    """The reply of another unit."""
    return _modbus(x, lambda unit, pdu: (bytes([(unit[0] + 5) % 248]), pdu))


def wrong_transaction(x: Exchange) -> bytes | None:
    """The reply to another transaction."""
    number = (int.from_bytes(x.reply[:2], "big") + 1) & 0xFFFF
    return number.to_bytes(2, "big") + x.reply[2:]


def bad_crc(x: Exchange) -> bytes | None:
    """A bit was turned over on the way."""
    if x.line.wire == FRAMES:
        middle = 1 + (len(x.reply) - 2) // 2
        turned = x.reply[middle] ^ 0x10 or 0x30
        return x.reply[:middle] + bytes([turned]) + x.reply[middle + 1 :]
    return x.reply[:-1] + bytes([x.reply[-1] ^ 0x10])


def local(x: Exchange) -> bytes | None:
    """Somebody presses LOCAL at the front panel."""
    x.line.panel.press_local()
    return x.reply


def trip(x: Exchange) -> bytes | None:
    """An alarm or a fault, which is latched: ``value`` is its name."""
    name = str(x.value or "OVP")
    x.line.panel.trip(name if x.line.wire != FRAMES or x.value else "overcurrent")
    return x.reply


def clip(x: Exchange) -> bytes | None:
    """From now on a set point beyond a limit of the instrument is held at the limit, which is a low one now."""
    panel = x.line.panel
    panel.clips = True
    name = "limit_voltage_max" if panel.map.kind == "supply" else "limit_power_max"
    panel.counts[name] //= 4
    return x.reply


# --- the controller's frames --------------------------------------------------------------------------


def _frame(reply: bytes) -> Frame | None:
    try:
        return decode(reply.strip(DELIMITER))
    except ReplyError:
        return None


def nack(x: Exchange) -> bytes | None:
    """The controller refuses; ``value`` is the reason."""
    frame = _frame(x.reply)
    if frame is None or frame.type == (Request.IDENTIFY | REPLY):
        return x.reply
    reason = int(x.value or Reason.OUT_OF_RANGE)
    return encode(Frame(frame.sequence, NACK, REFUSAL.pack(frame.type & ~REPLY & 0xFF, reason)))


def replayed(x: Exchange) -> bytes | None:
    """The reply to the request before, with its old sequence number."""
    frame = _frame(x.reply)
    if frame is None:
        return x.reply
    return encode(Frame((frame.sequence - 1) & 0xFFFF, frame.type, frame.payload))


def heartbeat_lost(x: Exchange) -> bytes | None:
    """The controller has missed its beats, and tripped."""
    x.line.panel.trip("heartbeat_lost")
    return x.reply


def collapse(x: Exchange) -> bytes | None:
    """The converter's output voltage breaks down."""
    x.line.panel.collapse()
    return x.reply


def restart(x: Exchange) -> bytes | None:
    """The controller restarts: it forgets the session, and the PWM is off."""
    x.line.panel.restart()
    return x.reply


def _on(*wires: str) -> frozenset[str]:
    return frozenset(wires)


ANY = _on(SCPI, TCP, RTU, FRAMES)
KINDS = {
    "late_reply": Kind(ANY, late_reply),
    "split_reply": Kind(ANY, split_reply),
    "truncated_reply": Kind(ANY, truncated_reply),
    "missing_terminator": Kind(_on(SCPI, FRAMES), missing_terminator),
    "local_echo": Kind(ANY, local_echo),
    "garbage": Kind(ANY, garbage),
    "silence": Kind(ANY, silence),
    "hang_up": Kind(ANY, hang_up),
    "no_data": Kind(_on(SCPI), no_data),
    "overrange": Kind(_on(SCPI), overrange),
    "sentinel": Kind(_on(SCPI), sentinel),
    "headers_on": Kind(_on(SCPI), headers_on),
    "stale": Kind(_on(SCPI), stale),
    "hold_on": Kind(_on(SCPI), hold_on),
    "error_entry": Kind(_on(SCPI), error_entry),
    "exception": Kind(_on(TCP, RTU), exception),
    "wrong_function": Kind(_on(TCP, RTU), wrong_function),
    "wrong_count": Kind(_on(TCP, RTU), wrong_count),
    "wrong_unit": Kind(_on(TCP, RTU), wrong_unit),
    "wrong_transaction": Kind(_on(TCP), wrong_transaction),
    "bad_crc": Kind(_on(RTU, FRAMES), bad_crc),
    "local": Kind(_on(TCP, RTU), local),
    "clip": Kind(_on(TCP, RTU), clip),
    "trip": Kind(_on(TCP, RTU, FRAMES), trip),
    "nack": Kind(_on(FRAMES), nack),
    "replayed": Kind(_on(FRAMES), replayed),
    "heartbeat_lost": Kind(_on(FRAMES), heartbeat_lost),
    "collapse": Kind(_on(FRAMES), collapse),
    "restart": Kind(_on(FRAMES), restart),
}
