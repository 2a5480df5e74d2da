"""Which process owns something, so that another one can tell whether it still lives."""

import os
import socket
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Self

LEASE_S = 120.0  # a process on another machine that has not been heard of for so long is taken for dead


@dataclass(frozen=True, slots=True, kw_only=True)
class Owner:
    """A process: machine, number, and when it began in ticks since boot, since numbers are given out again."""

    host: str
    process: int
    began: str

    @classmethod
    def here(cls) -> Self:
        """This process."""
        return cls(host=socket.gethostname(), process=os.getpid(), began=_began(os.getpid()))

    @classmethod
    def stored(cls, row: Mapping[Any, Any]) -> Self | None:
        """The owner in a row with the columns ``host``, ``process`` and ``began``; None without one."""
        if row["process"] is None:
            return None
        return cls(host=str(row["host"]), process=int(row["process"]), began=str(row["began"]))

    def columns(self) -> dict[str, object]:
        """The columns that ``stored`` reads."""
        return asdict(self)

    def lives(self, heard_of: str | None = None) -> bool:
        """Whether it still runs; on another machine: whether it was heard of (UTC, ISO) within the lease."""
        if self.host == socket.gethostname():
            return _began(self.process) == self.began
        if heard_of is None:
            return False
        return (datetime.now(UTC) - datetime.fromisoformat(heard_of)).total_seconds() < LEASE_S

    def __str__(self) -> str:
        return f"process {self.process} on {self.host}"


def _began(process: int) -> str:
    """Start time of a process in clock ticks since boot (proc(5), field 22 of stat); empty when it is gone."""
    try:
        stat = Path(f"/proc/{process}/stat").read_text(encoding="utf-8", errors="replace")
    except OSError:
        return ""
    fields = stat.rpartition(")")[2].split()
    return "" if fields[0] in "ZX" else fields[19]
