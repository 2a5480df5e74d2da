"""Pseudo-terminals that mocks answer on: a real operating-system port for a stranger's client to open.

``PtyServer(handler)`` gives every chunk of bytes that arrives to ``handler`` and writes back what it
returns. A handler keeps its own buffer: a chunk may hold half a message, or three. Two servers whose
handlers are each other's ``send`` are a bridge between two paths::

    near = PtyServer(lambda data: far.send(data))
    far = PtyServer(near.send)
"""

import os
import select
import threading
import time
import tty
from collections.abc import Callable
from pathlib import Path
from typing import Self

Handler = Callable[[bytes], bytes | None]

BITS_PER_BYTE = 10  # 8N1 on the wire: start, eight data, stop


class PtyPort:
    """One open pseudo-terminal: we hold the master end, a client opens ``path``.

    The slave end stays open here too, so that a client's closing is not a hang-up; it is set raw,
    so that nothing is echoed or translated. ``close`` is what pulling the plug looks like to a client.
    """

    def __init__(self) -> None:
        self._master, self._slave = os.openpty()
        tty.setraw(self._slave)
        os.set_blocking(self._master, False)
        self._stopped, self._stopping = os.pipe()
        self._writing, self._ending = threading.Lock(), threading.Lock()
        self._closed = False
        self.path = os.ttyname(self._slave)

    def read(self, timeout_s: float | None = None) -> bytes:
        """Wait for bytes from the client: ``b""`` after ``timeout_s`` or when ``interrupt`` was called."""
        ready, _, _ = select.select([self._master, self._stopped], [], [], timeout_s)
        if self._master not in ready or self._stopped in ready:
            return b""
        try:
            return os.read(self._master, 65536)
        except OSError:  # a client that hangs up mid-read
            return b""

    def write(self, data: bytes) -> None:
        """Send bytes to the client; into a closed port, or one that is being closed, they are lost."""
        with self._writing:
            while data and not self._closed:
                ready, writable, _ = select.select([self._stopped], [self._master], [])
                if ready:
                    return
                if writable:
                    data = data[os.write(self._master, data) :]

    def interrupt(self) -> None:
        """Make every ``read`` and ``write``, now and from now on, return at once."""
        with self._ending:
            if not self._closed:
                os.write(self._stopping, b"!")

    def close(self) -> None:
        """Hang up: the client sees an input/output error. For when nobody reads any more; once is enough."""
        with self._ending:
            if self._closed:
                return
            os.write(self._stopping, b"!")
            self._closed = True
        with self._writing:
            for descriptor in (self._slave, self._master, self._stopping, self._stopped):
                os.close(descriptor)


class PtyServer:
    """Answers on a pseudo-terminal from a thread of its own.

    Parameters
    ----------
    handler : gets each chunk of bytes; what it returns is written back (``None``: nothing).
    baud : when given, each reply takes as long as on a real 8N1 line of that speed (a pty does not
        pace itself). Multiply by the clock's speed for a mock that runs faster than real time.
    tick : called every ``tick_s`` real seconds while nothing arrives, and after each chunk: for a mock
        that must act when its client is silent.
    name : a stable name for the port, a symbolic link as those in ``/dev/serial/by-id``: it is there while
        the port is, and leads to its present path.
    """

    def __init__(
        self,
        handler: Handler,
        *,
        baud: float | None = None,
        tick: Callable[[], None] | None = None,
        tick_s: float = 0.02,
        name: Path | None = None,
    ) -> None:
        self._name = name
        self._handler = handler
        self._baud = baud
        self._tick = tick
        self._tick_s = tick_s if tick else None
        self._port: PtyPort | None = None
        self._thread: threading.Thread | None = None
        self._stop = threading.Event()
        self._wanted = False

    @property
    def path(self) -> str:
        """Where a client connects; a new one after each ``start``."""
        if self._port is None:
            raise RuntimeError("the pty server is not running: call start() before asking for its path")
        return self._port.path

    @property
    def resource(self) -> str:
        """What a driver opens: the stable name, where there is one."""
        return self.path if self._name is None else str(self._name)

    def start(self) -> Self:
        """Open the pseudo-terminal and begin to answer."""
        if self._port is not None:
            raise RuntimeError("the pty server is already running")
        self._wanted = True
        self._serve_on(PtyPort())
        return self

    def _serve_on(self, port: PtyPort) -> None:
        self._stop.clear()
        self._port = port
        if self._name is not None:
            self._name.unlink(missing_ok=True)
            self._name.symlink_to(port.path)
        self._thread = threading.Thread(target=self._serve, args=(port,), name="pty", daemon=True)
        self._thread.start()

    def stop(self) -> None:
        """Hang up, wait for the thread, and close everything; harmless when not running."""
        self._wanted = False
        self._hang_up()

    def _hang_up(self) -> None:
        port, thread = self._port, self._thread
        if port is None or thread is None:
            return
        self._stop.set()
        if self._name is not None:
            self._name.unlink(missing_ok=True)
        port.interrupt()
        thread.join()
        port.close()
        self._port = self._thread = None

    def replug(self, seconds: float) -> None:
        """Pull the plug, and put it back after some real seconds: under another device path."""
        if self._port is None:
            return
        another = PtyPort()  # while the old one is still open: so it cannot have the old one's path
        self._hang_up()
        time.sleep(seconds)
        if self._wanted:  # nobody has stopped it for good meanwhile
            self._serve_on(another)
        else:
            another.close()

    def send(self, data: bytes) -> None:
        """Write bytes that nobody asked for (a late reply, garbage, a bridge); lost when not running."""
        if (port := self._port) is not None:
            port.write(data)

    def __enter__(self) -> Self:
        return self.start()

    def __exit__(self, *_: object) -> None:
        self.stop()

    def _serve(self, port: PtyPort) -> None:
        while not self._stop.is_set():
            chunk = port.read(self._tick_s)
            reply = self._handler(chunk) if chunk else None
            if reply:
                if self._baud:
                    time.sleep(len(reply) * BITS_PER_BYTE / self._baud)
                port.write(reply)
            if self._tick:
                self._tick()
