"""The byte link to an instrument: a serial port, or whatever a pyserial URL names.

``ByteLink.open("/dev/serial/by-id/...")`` opens it for this program alone; ``socket://host:port`` and
``rfc2217://host:port`` work the same way. A link that was lost is opened anew by the next ``write``: under the same
name, which for a name in ``/dev/serial/by-id`` may by then lead to another device path; a name with ``*`` or ``?`` in
it stands for whatever single port matches. Who answers then is for the drivers to ask.

Every read has a deadline, an instant on the real clock (``deadline_in``). After a timeout the answer may still come,
late, and would pass for the answer to the next question: such a link is put in ``quarantine`` before it is used again.
"""

import contextlib
import glob
import os
import termios
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any, Protocol, Self

import serial

from drivers.errors import LinkLost, LinkTimeout, LinkUnavailable, ReplyError
from drivers.health import Health
from drivers.tcp_port import SCHEME, TcpPort

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


@dataclass(frozen=True, slots=True, kw_only=True)
class Patience:
    """Real seconds: longest wait for an immediate reply, and how late one may come after that, at the worst."""

    timeout_s: float = 2.0
    lateness_s: float = 1.0


USUAL = Patience()


class Port(Protocol):
    """What a link needs of an open pyserial port."""

    @property
    def in_waiting(self) -> int: ...
    def read(self, size: int = 1, /) -> bytes: ...
    def write(self, data: bytes, /) -> int | None: ...
    def close(self) -> None: ...


Spy = Callable[[str, bytes], None]
"""Hears every byte of a link: ``(">", sent)`` or ``("<", received)``."""


def deadline_in(seconds: float) -> float:
    """The instant ``seconds`` from now, on the clock that reads are held to (``time.monotonic``)."""
    return time.monotonic() + seconds


class ByteLink:
    """Bytes to and from one instrument; one exchange at a time, under ``lock``."""

    def __init__(
        self,
        port: Port,
        resource: str,
        *,
        reopen: Callable[[], Port] | None = None,
        spy: Spy | None = None,
    ) -> None:
        self._port: Port | None = port
        self._reopen = reopen
        self._spy = spy
        self._received = bytearray()
        self.resource = resource
        self.health = Health()
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
        spy: Spy | None = None,
    ) -> Self:
        """Open ``resource`` for this program alone.

        Raises
        ------
        LinkUnavailable : no such port, not permitted, refused, or busy; the reason is told.
        """
        settings: dict[str, Any] = {"baudrate": baud, "parity": parity, "stopbits": stop_bits}
        reopen = partial(_open_port, resource, settings, timeout_s)
        return cls(reopen(), resource, reopen=reopen, spy=spy)

    def write(self, data: bytes) -> None:
        """Send ``data``; a lost link is opened anew first.

        Raises
        ------
        LinkLost : it hung up, or is gone and cannot be opened again.
        LinkTimeout : nothing drains the line.
        """
        if self._port is None:
            self._open_again()
        if self._spy is not None:
            self._spy(">", data)
        try:
            self._open_now().write(data)
        except (serial.SerialTimeoutException, TimeoutError) as error:
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
        port, self._port = self._port, None
        self._reopen = None
        if port is not None:
            port.close()

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
                port = self._open_now()
                if chunk := port.read(max(1, port.in_waiting)):
                    return self._heard(chunk)
        except (OSError, termios.error) as error:
            raise self._lost(error) from error
        return b""

    def _waiting(self) -> bytes:
        """The bytes that are there already."""
        chunk = b""
        try:
            port = self._open_now()
            while len(chunk) <= LONGEST_REPLY and (waiting := port.in_waiting):
                chunk += port.read(waiting)
        except (OSError, termios.error) as error:
            raise self._lost(error) from error
        return self._heard(chunk) if chunk else chunk

    def _heard(self, chunk: bytes) -> bytes:
        if self._spy is not None:
            self._spy("<", chunk)
        return chunk

    def _open_now(self) -> Port:
        if self._port is None:
            raise LinkLost(f"{self.resource} was lost before", resource=self.resource)
        return self._port

    def _open_again(self) -> None:
        """Open what was lost; what came before belongs to nobody."""
        if self._reopen is None:
            raise LinkLost(f"{self.resource} is closed", resource=self.resource)
        try:
            self._port = self._reopen()
        except LinkUnavailable as error:
            raise LinkLost(f"still gone: {error.message}", resource=self.resource) from error
        self._received.clear()

    def _lost(self, error: Exception) -> LinkLost:
        """The error for a link that has hung up; the port is given back, so that its name can be used again."""
        port, self._port = self._port, None
        self._received.clear()
        if port is not None:
            with contextlib.suppress(OSError, termios.error):
                port.close()
        return LinkLost(
            f"{self.resource} is gone: {error}; unplugged, or switched off?", resource=self.resource
        )


def _open_port(resource: str, settings: dict[str, Any], timeout_s: float) -> Port:
    """An open port; ``LinkUnavailable`` with the reason, and advice where there is some."""
    try:
        if resource.startswith(SCHEME):
            return TcpPort.open(resource, timeout_s=timeout_s, poll_s=POLL_S)
        port: Port = serial.serial_for_url(
            _matching(resource), timeout=POLL_S, write_timeout=timeout_s, exclusive=True, **settings
        )
        return port
    except (OSError, ValueError, termios.error) as error:
        reason = str(error)
        advice = next((advice for sign, advice in _ADVICE if sign in reason), "")
        number = getattr(error, "errno", None)
        # pyserial says it three times
        short = os.strerror(number) if number and "lock" not in reason else reason
        raise LinkUnavailable(
            f"cannot open {resource}: {short}" + (f"; {advice}" if advice else ""), resource=resource
        ) from error


def _matching(resource: str) -> str:
    """The one port that a pattern stands for; any other name as it is."""
    if not set("*?[") & set(resource) or "://" in resource:
        return resource
    found = sorted(glob.glob(resource))
    if len(found) != 1:
        there = ", ".join(found) or "no port"
        raise OSError(f"{there} matches {resource}; it must be exactly one: No such file")
    return found[0]
