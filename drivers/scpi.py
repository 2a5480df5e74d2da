"""SCPI over a byte link: one query at a time, each reply attributed to its query or to none.

Replies are parsed into values here, and nothing else is believed about them: headers may come although
they were switched off, numbers may be the words ``NAN`` and ``INF``, or the finite stand-ins for them that
binary blocks carry. After a timeout, or a reply that makes no sense, the link is in doubt: before the next
exchange it is quarantined and resynchronised (``*CLS``, ``*OPC?``).
"""

import contextlib
import math
import re
import struct
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeVar

from drivers.errors import InstrumentError, InstrumentRefused, LinkError, LinkLost, ReplyError
from drivers.reading import Quality
from drivers.transport import ByteLink, deadline_in

T = TypeVar("T")

NO_DATA, OVERRANGE = 9.91e37, 9.9e37  # the finite stand-ins: 0x7E951BEE and 0x7E94F56A as float32
_HEADER = re.compile(r"^:[A-Za-z0-9:*_]+ +")
_NUMBER = re.compile(r"^[+-]?\d+(\.\d*)?(E[+-]?\d{2,3})?$", re.IGNORECASE)
_ERROR = re.compile(r'^([+-]?\d{1,6}) *, *"(.*)"$')
_LONGEST_QUEUE = 32


@dataclass(frozen=True, slots=True)
class Number:
    """One value of a reply, and whether the instrument vouches for it."""

    value: float
    quality: Quality = Quality.GOOD


@dataclass(frozen=True, slots=True)
class QueuedError:
    """One entry of the instrument's error queue; code 0 means that there is none."""

    code: int
    message: str


def strip_header(reply: str) -> str:
    """The data of a reply, without the header that an instrument may put before it.

    >>> strip_header(":NUMERIC:NORMAL:NUMBER 15"), strip_header("15")
    ('15', '15')
    """
    return _HEADER.sub("", reply.strip(), count=1)


def classify(value: float) -> Number:
    """A number with its quality: the stand-ins for "no data" and "over range" are not measurements."""
    if math.isnan(value) or math.isclose(value, NO_DATA, rel_tol=1e-5):
        return Number(math.nan, Quality.NO_DATA)
    if math.isinf(value) or math.isclose(abs(value), OVERRANGE, rel_tol=1e-5):
        return Number(math.copysign(math.inf, value), Quality.OVERRANGE)
    return Number(value)


def parse_number(text: str) -> Number:
    """One NR1, NR2 or NR3 number, or the words NAN and INF; anything else is a ``ReplyError``.

    An exponent has at least two digits on these instruments, so that one cut short is noticed.

    >>> parse_number("103.79E+00").value, parse_number("INF").quality.value
    (103.79, 'overrange')
    """
    word = text.strip().upper()
    if word in ("NAN", "INF", "+INF", "-INF"):
        return classify(float(word))
    if not _NUMBER.match(word):
        raise ReplyError(f"{text!r} is not a number", reply=text)
    return classify(float(word))


def parse_numbers(text: str) -> list[Number]:
    """Numbers separated by commas."""
    return [parse_number(word) for word in text.split(",")]


def parse_measured(text: str) -> list[Number]:
    """Measured values separated by commas: each with an exponent, or NAN or INF.

    Analyzers write them so (NR3); without the exponent a value is the front part of one that was cut.
    """
    for word in text.split(","):
        if _NUMBER.match(word.strip()) and "E" not in word.upper():
            raise ReplyError(f"{word!r} is not a whole measured value: its exponent is missing", reply=text)
    return parse_numbers(text)


def parse_setting(text: str) -> float:
    """One number that must be a plain one: a setting read back."""
    number = parse_number(text)
    if number.quality is not Quality.GOOD:
        raise ReplyError(f"{text!r} is not a setting", reply=text)
    return number.value


def parse_register(text: str) -> int:
    """A status register of 16 bits."""
    word = text.strip()
    if not re.fullmatch(r"[0-9]{1,5}", word) or int(word) > 0xFFFF:
        raise ReplyError(f"{text!r} is not a register of 16 bits", reply=text)
    return int(word)


def parse_any_switch(text: str) -> bool:
    """Whether one of several switches is on, each with a header of its own or none.

    >>> parse_any_switch(":INPUT:SCALING:STATE:ELEMENT1 0;ELEMENT2 1")
    True
    """
    words = [part.split()[-1].upper() for part in re.split("[;,]", text) if part.strip()]
    if not words or not set(words) <= {"0", "1", "OFF", "ON"}:
        raise ReplyError(f"{text!r} are not switches, 0 or 1 each", reply=text)
    return not {"1", "ON"}.isdisjoint(words)


def parse_floats(block: bytes) -> list[Number]:
    """The content of a FLOAT block: single precision, high byte first."""
    if not block or len(block) % 4:
        raise ReplyError(f"a FLOAT block of {len(block)} bytes is no whole number of values", reply=block)
    return [classify(value) for (value,) in struct.iter_unpack(">f", block)]


def parse_error(text: str) -> QueuedError:
    """An entry of the error queue: ``113,"Undefined Header"``."""
    match = _ERROR.match(text.strip())
    if match is None:
        raise ReplyError(f"{text!r} is not an entry of an error queue", reply=text)
    return QueuedError(int(match[1]), match[2])


def parse_identity(text: str) -> tuple[str, str, str, str]:
    """Maker, model, serial number and firmware of ``*IDN?``."""
    fields = [field.strip() for field in text.split(",")]
    if len(fields) != 4 or not all(fields[:2]):
        raise ReplyError(f"{text!r} is not an answer to *IDN?: four fields are", reply=text)
    return fields[0], fields[1], fields[2], fields[3]


class ScpiLink:
    """One SCPI instrument on a byte link.

    Parameters
    ----------
    link : the open byte link.
    timeout_s : longest wait for a reply, in real seconds, where a query gives none of its own.
    lateness_s : no reply comes later than this after its deadline, in real seconds.
    terminator : what ends a message to the instrument; its replies end in LF, with or without CR.
    """

    def __init__(
        self, link: ByteLink, *, timeout_s: float = 2.0, lateness_s: float = 1.0, terminator: bytes = b"\n"
    ) -> None:
        self._link = link
        self._timeout_s = timeout_s
        self._terminator = terminator
        self._doubted_at: float | None = None
        self.lateness_s = lateness_s
        self.lock = link.lock

    def write(self, command: str) -> None:
        """Send a command that has no reply; whether it was understood, the error queue tells."""
        with self.lock:
            self._make_ready()
            self._send(command)

    def command(self, command: str) -> None:
        """Send a command and read the error queue; ``InstrumentRefused`` with what it says."""
        with self.lock:
            self.write(command)
            if errors := self.errors():
                said = "; ".join(f'{error.code} "{error.message}"' for error in errors)
                raise InstrumentRefused(f"the instrument refused {command}: {said}", command=command)

    def query(self, command: str, parse: Callable[[str], T], timeout_s: float | None = None) -> T:
        """Send one query and return its parsed reply.

        Raises
        ------
        LinkTimeout : nothing came in time; instruments also say nothing to the commands of an option
            that is not fitted.
        ReplyError : what came is not an answer to this query.
        """
        return self._exchange(command, timeout_s, lambda deadline: parse(self._line(command, deadline)))

    def query_block(self, command: str, parse: Callable[[bytes], T], timeout_s: float | None = None) -> T:
        """Send one query whose reply is a block of binary data (``#``, digits, length, data)."""
        return self._exchange(command, timeout_s, lambda deadline: parse(self._block(deadline)))

    def errors(self) -> list[QueuedError]:
        """Read, and so empty, the error queue."""
        found: list[QueuedError] = []
        while (error := self.query(":STATUS:ERROR?", parse_error)).code != 0:
            found.append(error)
            if len(found) >= _LONGEST_QUEUE:
                raise ReplyError("the error queue has no end", reply=error.message)
        return found

    def resynchronise(self) -> None:
        """Empty the instrument's queues and make sure that its next reply answers our next query."""
        with self.lock:
            if self._doubted_at is not None:
                with contextlib.suppress(LinkLost):  # nothing can come late from a link that is gone
                    self._link.quarantine(self.lateness_s - (time.monotonic() - self._doubted_at))
            self._doubted_at = time.monotonic()
            self._send("*CLS")
            self._send("*OPC?")
            try:
                if (answer := self._line("*OPC?", deadline_in(self._timeout_s))) != "1":
                    raise ReplyError("the answer to *OPC? is 1", reply=answer)
            except InstrumentError as error:
                elapsed_s = round(time.monotonic() - self._doubted_at, 3)
                raise error.with_context(
                    command="*OPC?", elapsed_s=elapsed_s, resource=self._link.resource
                ) from error.__cause__
            self._doubted_at = None

    def _exchange(self, command: str, timeout_s: float | None, receive: Callable[[float], T]) -> T:
        with self.lock:
            self._link.health.exchanges += 1
            started = time.monotonic()
            try:
                self._make_ready()
                self._send(command)
                return receive(deadline_in(self._timeout_s if timeout_s is None else timeout_s))
            except InstrumentError as error:
                self._link.health.failed(error)
                if isinstance(error, LinkError | ReplyError):
                    self._doubted_at = time.monotonic()
                elapsed_s = round(time.monotonic() - started, 3)
                raise error.with_context(
                    command=command, elapsed_s=elapsed_s, resource=self._link.resource
                ) from error.__cause__
            except BaseException:  # a signal: the reply is still under way
                self._doubted_at = time.monotonic()
                raise

    def _make_ready(self) -> None:
        """Nothing may be under way that could pass for the next reply."""
        if self._doubted_at is not None:
            self.resynchronise()
        self._link.drain()

    def _send(self, command: str) -> None:
        self._link.write(command.encode("ascii") + self._terminator)

    def _line(self, command: str, deadline: float) -> str:
        raw = self._link.read_until(b"\n", deadline)
        try:
            line = raw.decode("ascii").strip()
        except UnicodeDecodeError:
            raise ReplyError("the reply is not text; are baud rate and parity right?", reply=raw) from None
        if line == command:
            raise ReplyError("the link repeats what is sent: switch local echo off", reply=line)
        return strip_header(line)

    def _block(self, deadline: float) -> bytes:
        self._link.read_until(b"#", deadline)
        digits = self._link.read_exactly(1, deadline)
        if digits not in (b"1", b"2", b"3", b"4", b"5"):
            raise ReplyError("a block begins with #, the number of digits, and the length", reply=digits)
        length = self._link.read_exactly(int(digits), deadline)
        if not length.isdigit():
            raise ReplyError("the length of a block is a number", reply=length)
        block = self._link.read_exactly(int(length), deadline)
        if rest := self._link.read_until(b"\n", deadline).strip():
            raise ReplyError(f"{len(rest)} bytes follow the block", reply=rest)
        return block
