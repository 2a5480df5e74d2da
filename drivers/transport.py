"""The byte link to an instrument: a serial port, or whatever a pyserial URL names.

``ByteLink.open("/dev/serial/by-id/...")`` opens it for this program alone; ``socket://host:port`` and
``rfc2217://host:port`` work the same way. Every read has a deadline, an instant on the real clock
(``deadline_in``). After a timeout the answer may still come, late, and would pass for the answer to the
next question: such a link is put in ``quarantine`` before it is used again.
"""

import termios
import threading
import time
from typing import Protocol, Self

import serial

from drivers.errors import LinkLost, LinkTimeout, LinkUnavailable, ReplyError

POLL_S = 0.02  # one read blocks no longer; so much a deadline may be overrun
LONGEST_REPLY = 65536  # bytes without a terminator: that is noise, not a reply

_ADVICE = (
    ("exclusively lock", "another program holds it: close that program, or find it with fuser"),
    ("resource busy", "another program holds it: close that program, or find it with fuser"),
    ("No such file", "no such port: is it plugged in, and is the name right? See /dev/serial/by-id"),
    ("Permission denied", "this user may not open it: join the group that owns it (often dialout)"),
    ("refused", "nothing listens there: is the instrument on, and are host and port right?"),
    ("protocol", "use a device path, socket://host:port or rfc2217://host:port"),
)


class Port(Protocol):
    """What a link needs of an open pyserial port."""

    @property
    def in_waiting(self) -> int: ...
    def read(self, size: int = 1, /) -> bytes: ...
    def write(self, data: bytes, /) -> int | None: ...
    def close(self) -> None: ...


def deadline_in(seconds: float) -> float:
    """The instant ``seconds`` from now, on the clock that reads are held to (``time.monotonic``)."""
    return time.monotonic() + seconds


class ByteLink:
    """Bytes to and from one instrument; one exchange at a time, under ``lock``."""

    def __init__(self, port: Port, resource: str) -> None:
        self._port = port
        self._received = bytearray()
        self.resource = resource
        self.lock = threading.RLock()

    @classmethod
    def open(
        cls,
        resource: str,
        *,
        baud: int = 9600,
        parity: str = "N",
        stop_bits: float = 1,
        timeout_s: float = 2.0,
    ) -> Self:
        """Open ``resource`` for this program alone.

        Raises
        ------
        LinkUnavailable : no such port, not permitted, refused, or busy; the reason is told.
        """
        try:
            port = serial.serial_for_url(
                resource,
                baudrate=baud,
                parity=parity,
                stopbits=stop_bits,
                timeout=POLL_S,
                write_timeout=timeout_s,
                exclusive=True,
            )
        except (OSError, ValueError, termios.error) as error:
            reason = str(error)
            advice = next((advice for sign, advice in _ADVICE if sign in reason), "")
            raise LinkUnavailable(
                f"cannot open {resource}: {reason}" + (f"; {advice}" if advice else ""), resource=resource
            ) from error
        return cls(port, resource)

    def write(self, data: bytes) -> None:
        """Send ``data``; raises ``LinkLost`` on hang-up, ``LinkTimeout`` when nothing drains the line."""
        try:
            self._port.write(data)
        except serial.SerialTimeoutException as error:
            raise LinkTimeout("the link takes no more bytes", resource=self.resource) from error
        except (OSError, termios.error) as error:
            raise self._lost(error) from error

    def read_some(self, deadline: float) -> bytes:
        """Whatever comes first, as soon as it comes; ``b""`` when nothing does before ``deadline``."""
        return self._take(len(self._received)) or self._arrive(deadline)

    def read_until(self, terminator: bytes, deadline: float) -> bytes:
        """The bytes up to ``terminator``, without it.

        Raises
        ------
        LinkTimeout : the deadline passed first; what had come is in the context.
        ReplyError : more bytes than any reply has, and no terminator.
        """
        while (end := self._received.find(terminator)) < 0:
            self._receive(deadline)
        return self._take(end, len(terminator))

    def read_exactly(self, count: int, deadline: float) -> bytes:
        """The next ``count`` bytes; raises as ``read_until`` does."""
        while len(self._received) < count:
            self._receive(deadline)
        return self._take(count)

    def drain(self) -> bytes:
        """Throw away, and return, what has come so far; never waits."""
        return self._take(len(self._received)) + self._waiting()

    def quarantine(self, longest_lateness_s: float) -> None:
        """Wait until no late byte can come any more, and throw away what came."""
        deadline = deadline_in(longest_lateness_s)
        while time.monotonic() < deadline:
            self.read_some(deadline)
        self.drain()

    def close(self) -> None:
        """Give the port back; harmless when it is gone."""
        self._port.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _take(self, count: int, skip: int = 0) -> bytes:
        data = bytes(self._received[:count])
        del self._received[: count + skip]
        return data

    def _receive(self, deadline: float) -> None:
        """Add what comes next to what was received."""
        held = bytes(self._received[:200])
        if len(self._received) > LONGEST_REPLY:
            reason = f"{len(self._received)} bytes came without an end; is the baud rate right?"
            raise ReplyError(reason, resource=self.resource, reply=held)
        chunk = self._arrive(deadline)
        if not chunk:
            raise LinkTimeout("no whole reply before the deadline", resource=self.resource, reply=held)
        self._received += chunk

    def _arrive(self, deadline: float) -> bytes:
        """The bytes that come next; ``b""`` when none do before the deadline."""
        try:
            while time.monotonic() < deadline:
                if chunk := self._port.read(max(1, self._port.in_waiting)):
                    return chunk + self._waiting()  # a socket tells of one waiting byte only
        except (OSError, termios.error) as error:
            raise self._lost(error) from error
        return b""

    def _waiting(self) -> bytes:
        """The bytes that are there already."""
        chunk = b""
        try:
            while len(chunk) <= LONGEST_REPLY and (waiting := self._port.in_waiting):
                chunk += self._port.read(waiting)
        except (OSError, termios.error) as error:
            raise self._lost(error) from error
        return chunk

    def _lost(self, error: Exception) -> LinkLost:
        return LinkLost(
            f"{self.resource} is gone: {error}; unplugged, or switched off?", resource=self.resource
        )
