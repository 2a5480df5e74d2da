"""A mock controller: the protocol of ``docs/controller-protocol.md`` in front of the plant's bridges.

Give ``tick`` to the server too: the watch over the heartbeat must not depend on a client that is silent.
"""

import math
import struct
import time
from collections.abc import Callable, Collection
from itertools import pairwise
from typing import Protocol

import numpy as np

from drivers.clock import Clock
from drivers.controller_messages import (
    APPLIED,
    ARM,
    ARMED,
    IDENTITY,
    MODES,
    NACK,
    PWM_ON,
    REFUSAL,
    REPLY,
    SET_MODULATION,
    SWITCH,
    TABLE_IN_USE,
    TABLE_ROWS,
    TELEMETRY,
    Reason,
    Request,
    TableRow,
    fault_word,
    pack_table,
    unpack_table,
)
from drivers.errors import ReplyError
from drivers.frames import DELIMITER, LONGEST_PAYLOAD, Frame, decode, encode
from sim.modulation import outside_modulation

MISSED_BEATS = 4  # so many, and the PWM trips
SHORTEST_PERIOD_MS, LONGEST_PERIOD_MS = 10, 60_000
FAULT_NAMES = {"overtemperature": "heatsink_overtemperature"}  # of the plant, where it has words of its own
NEWER = 0x8000  # a sequence number is newer when it is less than this ahead, modulo 65536


class BridgeState(Protocol):
    """What the controller's own sensors see."""

    @property
    def load_V(self) -> float: ...
    @property
    def load_A(self) -> float: ...
    @property
    def D0(self) -> float: ...
    @property
    def T_heatsink_C(self) -> float: ...
    @property
    def T_transformer_C(self) -> float: ...
    @property
    def T_inductor_C(self) -> float: ...
    @property
    def T_ambient_C(self) -> float: ...


class ControllerPlant(Protocol):
    """What the controller sees of the plant."""

    @property
    def clock(self) -> Clock: ...
    @property
    def modulations(self) -> Collection[str]: ...
    @property
    def faults(self) -> tuple[str, ...]: ...
    def set_bridge(self, *, pwm: bool, D1: float, D2: float, mode: str) -> None: ...
    def collapse(self) -> None: ...
    def state(self) -> BridgeState: ...


class Refusal(Exception):
    """A request that is not carried out; its argument is the ``Reason``."""


class MockController:
    """The controller's state; ``handle`` takes the host's bytes and returns the replies.

    Parameters
    ----------
    counts : PWM counts in half a switching period.
    dead_time : in half periods; a pulse or zero state that is shorter cannot be made.
    patience_s : of real time without a beat before the PWM trips, however many beats the plant's clock has missed:
        where that clock runs fast, a host that waits for its turn on a busy machine has not hung.
    real_s : seconds of real time.

    It has the modulations of the converter behind it.
    """

    def __init__(
        self,
        plant: ControllerPlant,
        *,
        identity: str = "d2ea,virtual controller,0,1.0",
        counts: int = 2500,
        dead_time: float = 0.016,
        patience_s: float = 0.0,
        real_s: Callable[[], float] = time.monotonic,
    ) -> None:
        self._plant = plant
        self._identity = identity
        self._counts = counts
        self._dead_counts = round(dead_time * counts)
        self._modes = {MODES.index(mode) for mode in plant.modulations}
        self._received = bytearray()
        self._last_sequence: int | None = None
        self._armed = self._pwm = self._follow = False
        self._beat_s = self._period_s = 0.0
        self._patience_s, self._real_s = patience_s, real_s
        self._heard_s = 0.0  # of real time
        self._latched: tuple[str, ...] = ()
        self._acknowledged: tuple[str, ...] = ()
        self._mode = 0
        self._duties: tuple[int, int] | None = None
        self._table: tuple[int, tuple[TableRow, ...]] = (0, ())
        self._requests: dict[int, Callable[[bytes], bytes]] = {
            Request.IDENTIFY: self._identify,
            Request.SET_MODULATION: self._set_modulation,
            Request.ARM: self._arm,
            Request.ENABLE: self._enable,
            Request.DISABLE: self._disable,
            Request.HEARTBEAT: self._heartbeat,
            Request.LOAD_TABLE: self._load_table,
            Request.READ_TABLE: self._read_table,
            Request.USE_TABLE: self._use_table,
            Request.DISARM: self._disarm,
        }

    def handle(self, chunk: bytes) -> bytes | None:
        """Answer the whole frames that have come; what is not a frame gets no answer."""
        self._received += chunk
        replies = b""
        while (end := self._received.find(DELIMITER)) >= 0:
            coded = bytes(self._received[:end])
            del self._received[: end + 1]
            if coded:
                replies += self._frame(coded)
        del self._received[: -2 * LONGEST_PAYLOAD]
        return replies or None

    def tick(self) -> None:
        """Trip when too many beats have been missed."""
        missed = self._plant.clock.now() - self._beat_s > MISSED_BEATS * self._period_s
        if self._armed and missed and self._real_s() - self._heard_s >= self._patience_s:
            self._trip(("heartbeat_lost",))

    def _hear(self) -> None:
        """A beat, as the plant's clock and the real one have it."""
        self._beat_s, self._heard_s = self._plant.clock.now(), self._real_s()

    def trip(self, fault: str) -> None:
        """The controller finds a fault, and trips."""
        self._trip((fault,))

    def collapse(self) -> None:
        """The converter can hold its output no longer."""
        self._plant.collapse()

    def restart(self) -> None:
        """As after a loss of its own supply: disarmed, PWM off, and no session."""
        self._armed = self._pwm = self._follow = False
        self._duties, self._last_sequence = None, None
        self._drive()

    def _frame(self, coded: bytes) -> bytes:
        try:
            request = decode(coded)
        except ReplyError:
            return b""
        self.tick()
        self._look_for_faults()
        try:
            self._keep_order(request)
            if request.type not in self._requests:
                raise Refusal(Reason.UNKNOWN_TYPE)
            reply = Frame(
                request.sequence, request.type | REPLY, self._requests[request.type](request.payload)
            )
        except Refusal as refusal:
            reply = Frame(request.sequence, NACK, REFUSAL.pack(request.type, refusal.args[0]))
        except struct.error:
            reply = Frame(request.sequence, NACK, REFUSAL.pack(request.type, Reason.WRONG_LENGTH))
        self._follow_table()
        return encode(reply)

    def _keep_order(self, request: Frame) -> None:
        """Each request is newer than the last; to identify and to switch off is allowed at any time."""
        last = self._last_sequence
        newer = last is not None and 0 < (request.sequence - last) % 0x10000 < NEWER
        if newer or request.type == Request.IDENTIFY:
            self._last_sequence = request.sequence
        elif request.type not in (Request.DISABLE, Request.DISARM):
            raise Refusal(Reason.OUT_OF_ORDER)

    # --- requests -----------------------------------------------------------------------------------

    def _identify(self, payload: bytes) -> bytes:
        _empty(payload)
        return IDENTITY.pack(self._counts, TABLE_ROWS) + self._identity.encode("utf-8")

    def _arm(self, payload: bytes) -> bytes:
        (period_ms,) = ARM.unpack(payload)
        if self._pwm:
            raise Refusal(Reason.PWM_IS_ON)
        if not SHORTEST_PERIOD_MS <= period_ms <= LONGEST_PERIOD_MS:
            raise Refusal(Reason.OUT_OF_RANGE)
        self._latched = ()
        self._acknowledged = self._plant.faults
        self._armed = True
        self._period_s = period_ms / 1000
        self._hear()
        return payload

    def _disarm(self, payload: bytes) -> bytes:
        self._disable(payload)
        self._armed = False
        return b""

    def _set_modulation(self, payload: bytes) -> bytes:
        mode, D1, D2 = SET_MODULATION.unpack(payload)
        if mode not in self._modes:
            raise Refusal(Reason.UNKNOWN_MODE)
        duties = self._quantised(mode, D1, D2)
        self._mode, self._duties, self._follow = mode, duties, False
        self._drive()
        return APPLIED.pack(mode, *duties)

    def _enable(self, payload: bytes) -> bytes:
        _empty(payload)
        if self._latched:
            raise Refusal(Reason.FAULT_STANDS)
        if not self._armed:
            raise Refusal(Reason.NOT_ARMED)
        if self._duties is None:
            raise Refusal(Reason.NO_SET_POINT)
        self._pwm = True
        self._drive()
        self._acknowledged = ()
        return b""

    def _disable(self, payload: bytes) -> bytes:
        _empty(payload)
        self._pwm = False
        self._drive()
        return b""

    def _heartbeat(self, payload: bytes) -> bytes:
        _empty(payload)
        self._hear()
        state = self._plant.state()
        flags = PWM_ON * self._pwm | ARMED * self._armed | TABLE_IN_USE * self._follow
        return TELEMETRY.pack(
            flags,
            fault_word(self._latched),
            *(self._duties or (0, 0)),
            state.D0,
            state.load_V,
            state.T_heatsink_C,
            state.T_transformer_C,
            state.T_inductor_C,
            state.T_ambient_C,
        )

    def _load_table(self, payload: bytes) -> bytes:
        mode, rows = unpack_table(payload)
        powers = [row.power_W for row in rows]
        if not 2 <= len(rows) <= TABLE_ROWS or not all(math.isfinite(power_W) for power_W in powers):
            raise Refusal(Reason.BAD_TABLE)
        if mode not in self._modes:
            raise Refusal(Reason.UNKNOWN_MODE)
        if powers != sorted(set(powers)):
            raise Refusal(Reason.BAD_TABLE)
        held = []
        for row in rows:
            n1, n2 = self._quantised(mode, row.D1, row.D2)
            held.append(TableRow(power_W=row.power_W, D1=n1 / self._counts, D2=n2 / self._counts))
        self._table = mode, tuple(held)
        self._follow = False
        return SWITCH.pack(len(rows))

    def _read_table(self, payload: bytes) -> bytes:
        _empty(payload)
        return pack_table(*self._table)

    def _use_table(self, payload: bytes) -> bytes:
        (on,) = SWITCH.unpack(payload)
        if on and not self._table[1]:
            raise Refusal(Reason.BAD_TABLE)
        self._follow = bool(on)
        return payload

    # --- the bridges --------------------------------------------------------------------------------

    def _look_for_faults(self) -> None:
        """Trip at a fault that arming did not acknowledge: the plant keeps old ones until the PWM goes on."""
        faults = self._plant.faults
        if new := tuple(name for name in faults if name not in self._acknowledged):
            self._trip(tuple(FAULT_NAMES.get(name, name).replace(" ", "_") for name in new))

    def _trip(self, faults: tuple[str, ...]) -> None:
        """PWM off, and off it stays until armed anew."""
        self._latched = tuple(dict.fromkeys(self._latched + faults))
        self._armed = False
        if self._pwm:
            self._pwm = False
            self._drive()

    def _drive(self) -> None:
        n1, n2 = self._duties or (0, 0)
        self._plant.set_bridge(
            pwm=self._pwm, D1=n1 / self._counts, D2=n2 / self._counts, mode=MODES[self._mode]
        )

    def _quantised(self, mode: int, D1: float, D2: float) -> tuple[int, int]:
        """D1 and D2 in PWM counts, if the bridges can make them and the modulation has them."""
        if not (0.0 <= D1 <= 1.0 and 0.0 <= D2 <= 1.0):
            raise Refusal(Reason.OUT_OF_RANGE)
        duties = round(D1 * self._counts), round(D2 * self._counts)
        if duties != self._makeable(*duties):
            raise Refusal(Reason.PULSE_TOO_SHORT)
        applied = (np.array([count / self._counts]) for count in duties)
        if outside_modulation(MODES[mode], *applied)[0]:
            raise Refusal(Reason.OUT_OF_RANGE)
        return duties

    def _makeable(self, n1: int, n2: int) -> tuple[int, int]:
        """The nearest counts whose pulses and zero states are no shorter than the dead time, or absent."""
        least = self._dead_counts

        def zero_state(n: int) -> int:
            return n if n >= least else least * (2 * n >= least)

        return self._counts - zero_state(self._counts - max(n1, least)), zero_state(
            min(n2, self._counts - least)
        )

    def _follow_table(self) -> None:
        """Drive by the table at the power that the load draws now."""
        if not self._follow:
            return
        state = self._plant.state()
        mode, rows = self._table
        D1, D2 = _interpolate(rows, state.load_V * state.load_A)
        duties = self._makeable(round(D1 * self._counts), round(D2 * self._counts))
        if (mode, duties) != (self._mode, self._duties):
            self._mode, self._duties = mode, duties
            self._drive()


def _interpolate(rows: tuple[TableRow, ...], power_W: float) -> tuple[float, float]:
    """D1 and D2 on straight lines between rows, and constant beyond the first and the last."""
    if power_W <= rows[0].power_W:
        return rows[0].D1, rows[0].D2
    for low, high in pairwise(rows):
        if power_W <= high.power_W:
            share = (power_W - low.power_W) / (high.power_W - low.power_W)
            return low.D1 + share * (high.D1 - low.D1), low.D2 + share * (high.D2 - low.D2)
    return rows[-1].D1, rows[-1].D2


def _empty(payload: bytes) -> None:
    if payload:
        raise Refusal(Reason.WRONG_LENGTH)
