"""Ports that Modbus mocks answer on: a loopback TCP socket, and RTU on a pseudo-terminal.

Both give whole requests to a ``MockModbusDevice`` and frame what it answers. ``tamper(request, reply)`` sees
each exchange as frames and returns what is really sent (``None``: nothing), and ``send`` writes bytes that
nobody asked for: with the two, a test can drop, delay, cut or forge any reply.
"""

import contextlib
import os
import selectors
import socket
import struct
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Self

from drivers.mocks.checksum import crc16
from drivers.mocks.modbus_device import MockModbusDevice
from drivers.mocks.wire import PtyServer

__all__ = ["RtuServer", "TcpServer", "crc16"]

Tamper = Callable[[bytes, bytes | None], bytes | None]

SCPI_FROM = 42  # EA devices take what begins with this byte or a higher one for SCPI text
SILENCE_S = 0.05  # an RTU request that pauses longer than this is given up; the standard's 3.5 characters
STOP_WITHIN_S = 5.0


class RtuServer:
    """One device on a pseudo-terminal; a client opens ``path``."""

    def __init__(
        self, device: MockModbusDevice, *, baud: float | None = None, name: Path | None = None
    ) -> None:
        self.tamper: Tamper | None = None
        self._device = device
        self._pty = PtyServer(self._receive, baud=baud, name=name)
        self._buffer = b""
        self._heard_at = 0.0

    @property
    def path(self) -> str:
        """The device path; a new one after each ``start``."""
        return self._pty.path

    def start(self) -> Self:
        """Open the pseudo-terminal and begin to answer."""
        self._pty.start()
        return self

    def stop(self) -> None:
        """Hang up and close; harmless when not running."""
        self._pty.stop()

    @property
    def resource(self) -> str:
        """What a driver opens: the stable name, where there is one."""
        return self._pty.resource

    def send(self, data: bytes) -> None:
        """Write bytes that nobody asked for."""
        self._pty.send(data)

    def replug(self, seconds: float) -> None:
        """Pull the plug, and put it back after some real seconds: under another device path."""
        self._pty.replug(seconds)

    def __enter__(self) -> Self:
        return self.start()

    def __exit__(self, *_: object) -> None:
        self.stop()

    def _receive(self, chunk: bytes) -> bytes | None:
        now = time.monotonic()
        if now - self._heard_at > SILENCE_S:
            self._buffer = b""
        self._heard_at = now
        self._buffer += chunk
        length = _rtu_length(self._buffer)
        if length is None or len(self._buffer) < length:
            return None
        request, self._buffer = self._buffer[:length], b""
        reply = None
        if crc16(request[:-2]) == request[-2:]:
            pdu = self._device.answer(request[0], request[1:-2])
            if pdu is not None:
                reply = bytes([request[0]]) + pdu
                reply += crc16(reply)
        return self.tamper(request, reply) if self.tamper else reply


def _rtu_length(frame: bytes) -> int | None:
    """How long this request will be, as far as can be told: a frame does not say."""
    if len(frame) < 4:
        return None
    if 1 <= frame[1] <= 6:
        return 8
    if frame[1] in (15, 16):
        return 9 + frame[6] if len(frame) > 6 else None
    return len(frame)


class TcpServer:
    """One device on a loopback TCP port, for any number of clients; ``port`` 0 takes a free one."""

    def __init__(self, device: MockModbusDevice, *, port: int = 0) -> None:
        self.tamper: Tamper | None = None
        self.port = port
        self._wanted_port = port
        self._device = device
        self._thread: threading.Thread | None = None
        self._jobs: list[tuple[Callable[[], None], threading.Event]] = []
        self._clients: dict[socket.socket, bytes] = {}
        self._deaf_until = 0.0

    @property
    def resource(self) -> str:
        """What a driver opens."""
        return f"tcp://127.0.0.1:{self.port}"

    def start(self) -> Self:
        """Listen, and begin to answer; raises ``OSError`` when the port is taken."""
        if self._thread is not None:
            raise RuntimeError("the TCP server is already running")
        self._listener = socket.create_server(("127.0.0.1", self._wanted_port))
        self._listener.setblocking(False)
        self.port = self._listener.getsockname()[1]
        self._wake_read, self._wake_write = os.pipe()
        self._running = True
        self._thread = threading.Thread(target=self._serve, name="modbus-tcp", daemon=True)
        self._thread.start()
        return self

    def stop(self) -> None:
        """Close the port and every connection; harmless when not running."""
        if self._thread is None:
            return
        self._do(self._end)
        self._thread.join(STOP_WITHIN_S)
        self._thread = None
        os.close(self._wake_read)
        os.close(self._wake_write)

    def replug(self, seconds: float) -> None:
        """Lose the network for some real seconds: every connection is closed, and each new one at once."""
        self._deaf_until = time.monotonic() + seconds
        self._do(self._drop_all)

    def drop_clients(self) -> None:
        """Close every connection, as an instrument does with idle ones; returns when it is done."""
        self._do(self._drop_all)

    def send(self, data: bytes) -> None:
        """Write bytes that nobody asked for to every client."""
        self._do(lambda: self._to_all(data))

    def __enter__(self) -> Self:
        return self.start()

    def __exit__(self, *_: object) -> None:
        self.stop()

    def _do(self, job: Callable[[], None]) -> None:
        """Have the serving thread do something, and wait until it has; lost when nobody serves."""
        if threading.current_thread() is self._thread:
            job()
            return
        if self._thread is None:
            return
        done = threading.Event()
        self._jobs.append((job, done))
        os.write(self._wake_write, b"!")
        done.wait(STOP_WITHIN_S)

    def _serve(self) -> None:
        with selectors.DefaultSelector() as self._selector:
            self._selector.register(self._listener, selectors.EVENT_READ)
            self._selector.register(self._wake_read, selectors.EVENT_READ)
            while self._running:
                for key, _ in self._selector.select():
                    self._attend(key.fileobj)

    def _attend(self, ready: object) -> None:
        if ready is self._listener:
            client, _ = self._listener.accept()
            if time.monotonic() < self._deaf_until:
                client.close()
                return
            client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            self._clients[client] = b""
            self._selector.register(client, selectors.EVENT_READ)
        elif isinstance(ready, socket.socket):
            if ready in self._clients:  # it may have been dropped since it was found ready
                self._receive(ready)
        else:
            os.read(self._wake_read, 1)
            job, done = self._jobs.pop(0)
            job()
            done.set()

    def _receive(self, client: socket.socket) -> None:
        try:
            chunk = client.recv(65536)
        except OSError:
            chunk = b""
        if not chunk:
            self._drop(client)
            return
        self._clients[client] += chunk
        while client in self._clients and (request := self._next_request(client)):
            pdu = self._device.answer(request[6], request[7:])
            reply = None
            if pdu is not None:
                reply = request[:4] + struct.pack(">HB", len(pdu) + 1, request[6]) + pdu
            if self.tamper:
                reply = self.tamper(request, reply)
            if reply:
                self._send(client, reply)

    def _next_request(self, client: socket.socket) -> bytes:
        """The next whole request of a client, taken from its buffer; empty when there is none."""
        buffer = self._clients[client]
        while buffer and buffer[0] >= SCPI_FROM:  # text, up to the end of its line: not answered here
            buffer = self._clients[client] = buffer.partition(b"\n")[2]
        if buffer[2:4] not in (b"", b"\0", b"\0\0"):
            self._clients[client] = b""  # no Modbus at all
            return b""
        length = 6 + int.from_bytes(buffer[4:6], "big")
        if len(buffer) < 8 or len(buffer) < length:
            return b""
        self._clients[client] = buffer[length:]
        return buffer[:length]

    def _send(self, client: socket.socket, data: bytes) -> None:
        with contextlib.suppress(OSError):  # a client that went away loses its reply
            client.sendall(data)

    def _to_all(self, data: bytes) -> None:
        for client in self._clients:
            self._send(client, data)

    def _drop(self, client: socket.socket) -> None:
        del self._clients[client]
        self._selector.unregister(client)
        client.close()

    def _drop_all(self) -> None:
        for client in list(self._clients):
            self._drop(client)

    def _end(self) -> None:
        self._running = False
        self._drop_all()
        self._listener.close()
