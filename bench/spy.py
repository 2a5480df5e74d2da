"""Listening to the wires: every byte to and from every instrument, into the log or into a file of its own.

A line of the file: seconds since the spy began, instrument, ``>`` sent or ``<`` received, and the bytes, as text where
they are text and as hexadecimal digits where they are not.
"""

import logging
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from threading import Lock

from bench.errors import InputError
from bench.log import log, wire
from drivers.transport import Spy


def readable(data: bytes) -> str:
    """Bytes for people.

    >>> readable(b"*IDN?\\n"), readable(bytes([0, 3, 255]))
    ("'*IDN?\\\\n'", '00 03 ff')
    """
    text = data.decode("latin-1")
    plain = all(
        character.isascii() and (character.isprintable() or character in "\r\n") for character in text
    )
    return repr(text) if plain else data.hex(" ")


def log_of(instrument: str) -> Spy | None:
    """A spy that writes into the log, where the log wants it."""
    if not wire.isEnabledFor(logging.DEBUG):
        return None

    def hear(direction: str, data: bytes) -> None:
        kind = "command" if direction == ">" else "reply"
        wire.debug(direction, extra={"instrument": instrument, kind: readable(data)})

    return hear


class FileSpy:
    """Writes what all instruments say, and are told, to one file, and into the log, too.

    Where the file takes no more, the spy goes deaf and says so: no exchange fails by it, a power-off least of all.
    """

    def __init__(self, path: Path) -> None:
        try:
            self._file = path.open("w", encoding="utf-8", buffering=1)
        except OSError as error:
            raise InputError.of(
                "command line", "--spy", str(path), f"cannot be written: {error.strerror}"
            ) from error
        self._began = time.monotonic()
        self._lock = Lock()
        self._deaf = False

    def __call__(self, instrument: str) -> Spy:
        """The spy on one instrument's link."""
        logged = log_of(instrument)

        def hear(direction: str, data: bytes) -> None:
            passed_s = time.monotonic() - self._began
            self._write(f"{passed_s:.6f} {instrument} {direction} {readable(data)}\n")
            if logged is not None:
                logged(direction, data)

        return hear

    def _write(self, line: str) -> None:
        with self._lock:
            if self._deaf:
                return
            try:
                self._file.write(line)
            except OSError as error:
                self._deaf = True
                log.warning(
                    "the spy hears no more: %s cannot be written: %s", self._file.name, error.strerror
                )

    def close(self) -> None:
        """Close the file."""
        with suppress(OSError):  # what it took no more is tried once again here
            self._file.close()


@contextmanager
def file_spy(path: Path | None) -> Iterator["FileSpy | None"]:
    """A spy on a file; none without a path."""
    if path is None:
        yield None
        return
    spy = FileSpy(path)
    try:
        yield spy
    finally:
        spy.close()
