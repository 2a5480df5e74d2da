"""Faults as data: what goes wrong, at which instrument, in which exchange, how often.

A file of faults (``d2ea mock --fault FILE``, ``d2ea run --rehearse --fault FILE``, and the tests)::

    seed = 1

    [[fault]]
    instrument = "analyzer"      # analyzer, supply, load, controller; or database, for a rehearsal
    kind = "late_reply"          # see KINDS in fault_kinds.py
    on = ":NUMERIC:NORMAL:VALUE?"  # only exchanges whose request holds this text (or these bytes, as "03 01 f9")
    after = 40                   # so many matching exchanges go well first
    every = 10                   # then every tenth one is struck
    count = 3                    # three times in all; 0 is for ever
    chance = 0.5                 # each with this probability, drawn from the seed
    seconds = 1.5                # how late, or how long unplugged (real time)
    value = 6                    # an exception code, a reason, the name of an alarm

An exchange is a request that the instrument answers.
"""

import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Self

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, model_validator

from drivers.mocks.fault_kinds import KINDS, WIRES, Exchange, Line

DATABASE = "database"
DATABASE_KINDS = ("disk_full", "read_only", "locked", "gone")


class Fault(BaseModel):
    """One entry of the file."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    instrument: str = Field(description="analyzer, supply, load, controller, database")
    kind: str = Field(description="what goes wrong")
    on: str = Field(default="", description="only exchanges whose request holds this text, or these bytes")
    after: int = Field(default=0, ge=0, description="matching exchanges that go well first")
    every: int = Field(default=1, ge=1, description="then every so many is struck")
    count: int = Field(default=1, ge=0, description="how often in all; 0 is for ever")
    chance: float = Field(default=1.0, gt=0.0, le=1.0, description="probability of each")
    seconds: float = Field(default=0.5, gt=0.0, le=600.0, description="how late, or how long unplugged")
    value: int | str | None = Field(default=None, description="exception code, reason, or name of an alarm")

    @model_validator(mode="after")
    def _possible(self) -> Self:
        if self.instrument == DATABASE:
            possible: Sequence[str] = DATABASE_KINDS
        elif self.instrument in WIRES:
            possible = sorted(name for name, kind in KINDS.items() if WIRES[self.instrument] & kind.wires)
        else:
            raise ValueError(f"no instrument {self.instrument!r}; there are {', '.join([*WIRES, DATABASE])}")
        if self.kind not in possible:
            raise ValueError(
                f"{self.kind!r} cannot happen to the {self.instrument}; possible: {', '.join(possible)}"
            )
        return self

    @property
    def needle(self) -> bytes:
        """The bytes that a request must hold."""
        try:
            return bytes.fromhex(self.on) if " " in self.on else self.on.encode("ascii")
        except ValueError:
            return self.on.encode("ascii", "replace")


class FaultFile(BaseModel):
    """All faults of a run."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    seed: int = Field(default=1, ge=0, description="of what is left to chance")
    fault: list[Fault] = Field(default_factory=list)

    def at(self, instrument: str) -> list[Fault]:
        """The faults of one instrument, in the file's order."""
        return [fault for fault in self.fault if fault.instrument == instrument]


NO_FAULTS = FaultFile()


@dataclass(frozen=True, slots=True, kw_only=True)
class Struck:
    """A fault that has happened: which, and in which exchange of its instrument, counted from 1."""

    fault: Fault
    exchange: int
    request: bytes


@dataclass(slots=True)
class _Armed:
    fault: Fault
    matched: int = 0
    struck: int = 0

    def strikes(self, request: bytes, draw: Callable[[], float]) -> bool:
        fault = self.fault
        if fault.needle not in request or (fault.count and self.struck >= fault.count):
            return False
        self.matched += 1
        due = self.matched > fault.after and (self.matched - fault.after - 1) % fault.every == 0
        if not due or (fault.chance < 1.0 and draw() >= fault.chance):
            return False
        self.struck += 1
        return True


@dataclass(slots=True)
class Injector:
    """Stands between one instrument and its wire; ``struck`` lists what it has done, and ``exchanges`` counts."""

    faults: Sequence[Fault]
    seed: int
    line: Line
    listener: Callable[[bytes, bytes | None], object] | None = None  # hears every exchange, before any fault
    struck: list[Struck] = field(default_factory=list)
    exchanges: int = 0
    _armed: list[_Armed] = field(init=False)
    _rng: np.random.Generator = field(init=False)
    _last: dict[bytes, bytes] = field(default_factory=dict)
    _lock: threading.Lock = field(default_factory=threading.Lock)

    def __post_init__(self) -> None:
        self._armed = [_Armed(fault) for fault in self.faults]
        self._rng = np.random.default_rng(self.seed)

    def tamper(self, request: bytes, reply: bytes | None) -> bytes | None:
        """What is really sent in the place of ``reply``."""
        if self.listener is not None:
            self.listener(request, reply)
        if reply is None or not self._armed:
            return reply
        with self._lock:
            self.exchanges += 1
            before, self._last[request[:8]] = self._last.get(request[:8]), reply
            for armed in self._armed:
                if reply is not None and armed.strikes(request, self._rng.random):
                    self.struck.append(Struck(fault=armed.fault, exchange=self.exchanges, request=request))
                    exchange = Exchange(
                        request=request,
                        reply=reply,
                        before=before,
                        seconds=armed.fault.seconds,
                        value=armed.fault.value,
                        line=self.line,
                        rng=self._rng,
                    )
                    reply = KINDS[armed.fault.kind].strike(exchange)
            return reply
