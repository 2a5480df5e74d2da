"""A TCP connection with the few methods that a serial port has, for ``socket://host:port``.

pyserial has one, too; it waits 0.3 s when it is closed, and leaves the socket open when the peer has reset it.
"""

import array
import fcntl
import select
import socket
import termios
from typing import Self
from urllib.parse import urlsplit

SCHEME = "socket://"
MOST = 65536


class TcpPort:
    """An open connection; a peer that closed it is an ``OSError`` at the next look, not an empty read."""

    def __init__(self, connection: socket.socket, poll_s: float) -> None:
        self._socket = connection
        self._poll_s = poll_s

    @classmethod
    def open(cls, url: str, *, timeout_s: float, poll_s: float) -> Self:
        """Connect to ``socket://host:port``; ``OSError`` or ``ValueError`` when that is not possible."""
        parts = urlsplit(url)
        if not parts.hostname or not parts.port:
            raise ValueError(f"{url} is not socket://host:port; the protocol needs both")
        connection = socket.create_connection((parts.hostname, parts.port), timeout=timeout_s)
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        return cls(connection, poll_s)

    @property
    def in_waiting(self) -> int:
        """Bytes that can be read at once."""
        if not self._ready(0.0):
            return 0
        count = array.array("i", [0])
        fcntl.ioctl(self._socket.fileno(), termios.FIONREAD, count)
        if not count[0]:
            raise ConnectionResetError("the instrument closed the connection")
        return count[0]

    def read(self, size: int = 1, /) -> bytes:
        """Up to ``size`` bytes, whatever comes first; ``b""`` when nothing does within the poll time."""
        if not self._ready(self._poll_s):
            return b""
        chunk = self._socket.recv(min(size, MOST))
        if not chunk:
            raise ConnectionResetError("the instrument closed the connection")
        return chunk

    def write(self, data: bytes, /) -> int:
        """Send all of ``data``; ``TimeoutError`` when the peer takes no more."""
        self._socket.sendall(data)
        return len(data)

    def close(self) -> None:
        """Close at once."""
        self._socket.close()

    def _ready(self, timeout_s: float) -> bool:
        return bool(select.select([self._socket], [], [], timeout_s)[0])
