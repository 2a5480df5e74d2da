"""One clock for everything that waits: plant, settling, analyzer updates, heartbeat.

It is handed in, so that a campaign of hours passes in seconds on the mock bench, and the same code
waits for real on a real one. Deadlines of a link's bytes are not its business: they run on real time.
"""

import fcntl
import mmap
import os
import struct
import threading
import time
from pathlib import Path
from typing import Protocol

_SECONDS = struct.Struct("<d")


class Clock(Protocol):
    """Seconds that pass, and a way to let them pass."""

    def now(self) -> float:
        """Seconds since this clock's own zero."""
        ...

    def sleep(self, seconds: float) -> None:
        """Return once ``seconds`` (>= 0) have passed on this clock."""
        ...


class WallClock:
    """Real time, run ``speed`` times as fast (1 on a real bench)."""

    def __init__(self, speed: float = 1.0) -> None:
        if not speed > 0:
            raise ValueError(f"clock speed is {speed}; it must be above 0 (1 is real time)")
        self.speed = speed
        self._start_s = time.monotonic()

    def now(self) -> float:
        """Seconds since the clock was made, times the speed."""
        return (time.monotonic() - self._start_s) * self.speed

    def sleep(self, seconds: float) -> None:
        """Wait ``seconds`` of this clock."""
        time.sleep(max(0.0, seconds) / self.speed)


class StepClock:
    """Time that passes only when somebody sleeps: deterministic, and as fast as the machine."""

    def __init__(self, start_s: float = 0.0) -> None:
        self._now_s = start_s
        self._lock = threading.Lock()

    def now(self) -> float:
        """Seconds stepped so far."""
        with self._lock:
            return self._now_s

    def sleep(self, seconds: float) -> None:
        """Step the clock by ``seconds`` at once."""
        with self._lock:
            self._now_s += max(0.0, seconds)


class SharedStepClock:
    """A step clock that several processes share through a file: it stands still while one of them is being killed."""

    def __init__(self, path: Path) -> None:
        self._file = os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)
        if os.fstat(self._file).st_size < _SECONDS.size:
            os.ftruncate(self._file, _SECONDS.size)
        self._map = mmap.mmap(self._file, _SECONDS.size)
        self._lock = threading.Lock()

    def now(self) -> float:
        """Seconds stepped so far, by all processes together."""
        return float(_SECONDS.unpack_from(self._map)[0])

    def sleep(self, seconds: float) -> None:
        """Step the clock by ``seconds`` at once, for everybody."""
        with self._lock:
            fcntl.flock(self._file, fcntl.LOCK_EX)
            try:
                _SECONDS.pack_into(self._map, 0, self.now() + max(0.0, seconds))
            finally:
                fcntl.flock(self._file, fcntl.LOCK_UN)

    def close(self) -> None:
        """Give the file back; it stays."""
        self._map.close()
        os.close(self._file)
