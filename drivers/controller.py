"""The converter's controller: D1 and D2 in, telemetry out, and a heartbeat that keeps the PWM alive.

The protocol is in ``docs/controller-protocol.md``. Silence is a fault on both sides: the controller trips
the PWM when beats stay away, and here a reply that does not come, or is not the one asked for, is raised.
After that the link is quarantined and the controller asked who it is before anything else is said.
"""

import contextlib
import math
import struct
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

from drivers.controller_messages import (
    APPLIED,
    ARM,
    ARMED,
    IDENTITY,
    MODES,
    NACK,
    OF_THE_SET_POINT,
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
    fault_names,
    pack_table,
    unpack_table,
)
from drivers.errors import (
    InstrumentError,
    InstrumentRefused,
    InstrumentTripped,
    LimitError,
    LinkError,
    LinkLost,
    ReadbackError,
    ReplyError,
    SetPointRefused,
)
from drivers.frames import DELIMITER, Frame, decode, encode
from drivers.health import Health
from drivers.identity import Identity
from drivers.transport import ByteLink, deadline_in

__all__ = ["Applied", "Controller", "TableRow", "Telemetry"]

DISABLE_ATTEMPTS = 3  # switching off may be repeated: doing it twice does no harm
FLOAT32 = 1e-6  # D1 and D2 travel in single precision


@dataclass(frozen=True, slots=True, kw_only=True)
class Applied:
    """The modulation in effect, in PWM counts of the controller: D1 and D2 in half periods."""

    D1: float
    D2: float
    mode: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Telemetry:
    """What the controller says of itself and the converter at one beat; D0, D1, D2 in half periods."""

    pwm_on: bool
    armed: bool
    table_in_use: bool
    D0: float
    D1: float
    D2: float
    V2_V: float
    T_heatsink_C: float
    T_transformer_C: float
    T_inductor_C: float
    T_ambient_C: float
    faults: tuple[str, ...]


class Controller:
    """A controller on an open byte link.

    Parameters
    ----------
    heartbeat_s : time between two beats that ``arm`` announces, in seconds of the bench's clock.
    timeout_s : longest wait for a reply, in real seconds.
    lateness_s : no reply comes later than this after its deadline, in real seconds.
    modulation : what ``set_modulation`` and ``load_table`` ask for when they are not told.
    """

    def __init__(
        self,
        link: ByteLink,
        *,
        heartbeat_s: float = 2.0,
        timeout_s: float = 1.0,
        lateness_s: float = 1.0,
        modulation: str = MODES[0],
    ) -> None:
        self._link = link
        self._modulation = modulation
        self._heartbeat_s = heartbeat_s
        self._timeout_s = timeout_s
        self._lateness_s = lateness_s
        self._sequence = 0
        self._counts = 0
        self._in_step = False
        self._doubted_at: float | None = None

    def identify(self) -> Identity:
        """Begin a session and say who answers; changes nothing else in the controller."""
        with self._link.lock:
            return self._get_in_step()

    def arm(self) -> None:
        """Clear latched faults and start the heartbeat watch: from now on, beats are due.

        Raises ``InstrumentTripped`` when a fault still stands.
        """
        period_ms = round(self._heartbeat_s * 1000)
        (taken_ms,) = self._unpack(ARM, self._exchange(Request.ARM, ARM.pack(period_ms)))
        if taken_ms != period_ms:
            raise ReadbackError(f"the heartbeat period is {taken_ms} ms after it was set to {period_ms} ms")

    def disarm(self) -> None:
        """Switch the PWM off and end the heartbeat watch."""
        self._exchange(Request.DISARM)
        if self.heartbeat().armed:
            raise ReadbackError("the controller is still armed after it was disarmed")

    def set_modulation(self, D1: float, D2: float, *, mode: str | None = None) -> Applied:
        """Set D1 and D2, in half periods, 0 to 1; returns the values in effect, whole PWM counts.

        Raises
        ------
        LimitError : refused here; nothing was sent.
        SetPointRefused : the controller runs and will not take it, for instance a pulse shorter than the dead time.
        InstrumentRefused : refused by the controller for another reason.
        ReadbackError : the controller applied something else.
        """
        mode = mode or self._modulation
        if wrong := _duty_problems("D1", D1) + _duty_problems("D2", D2) + _mode_problems(mode):
            raise LimitError("; ".join(wrong))
        with self._link.lock:
            request = SET_MODULATION.pack(MODES.index(mode), D1, D2)
            taken, n1, n2 = self._unpack(APPLIED, self._exchange(Request.SET_MODULATION, request))
            applied = Applied(D1=n1 / self._counts, D2=n2 / self._counts, mode=_mode_name(taken))
            if applied.mode != mode or not self._same(applied.D1, D1) or not self._same(applied.D2, D2):
                raise ReadbackError(f"{applied} is in effect after D1={D1:g}, D2={D2:g}, {mode} was set")
            return applied

    def enable(self) -> None:
        """Switch the PWM on; returns once the controller says that it is, and that nothing tripped."""
        with self._link.lock:
            self._exchange(Request.ENABLE)
            telemetry = self.heartbeat()
        if telemetry.faults:
            raise InstrumentTripped("the controller tripped when it was switched on", faults=telemetry.faults)
        if not telemetry.pwm_on:
            raise ReadbackError("the PWM is off after it was switched on")

    def disable(self) -> None:
        """Switch the PWM off; returns only once the controller says that it is."""
        with self._link.lock:
            for attempt in range(1, DISABLE_ATTEMPTS + 1):
                try:
                    self._exchange(Request.DISABLE)
                    telemetry = self.heartbeat()
                    break
                except (LinkError, ReplyError, InstrumentRefused):
                    if attempt == DISABLE_ATTEMPTS:
                        raise
        if telemetry.pwm_on:
            raise ReadbackError("the PWM is on after it was switched off", faults=telemetry.faults)

    def heartbeat(self) -> Telemetry:
        """One beat: keeps an armed controller going, and brings its telemetry."""
        with self._link.lock:
            fields = self._unpack(TELEMETRY, self._exchange(Request.HEARTBEAT))
            counts = self._counts
        flags, faults, n1, n2, D0, V2, heatsink, transformer, inductor, ambient = fields
        return Telemetry(
            pwm_on=bool(flags & PWM_ON),
            armed=bool(flags & ARMED),
            table_in_use=bool(flags & TABLE_IN_USE),
            D0=D0,
            D1=n1 / counts,
            D2=n2 / counts,
            V2_V=V2,
            T_heatsink_C=heatsink,
            T_transformer_C=transformer,
            T_inductor_C=inductor,
            T_ambient_C=ambient,
            faults=fault_names(faults),
        )

    def load_table(self, rows: Sequence[TableRow], *, mode: str | None = None) -> tuple[TableRow, ...]:
        """Load D1 and D2 over output power and read the table back; it is not yet in use.

        Raises ``LimitError``, ``InstrumentRefused``, ``ReadbackError`` as ``set_modulation`` does.
        """
        mode = mode or self._modulation
        if wrong := _table_problems(rows) + _mode_problems(mode):
            raise LimitError("; ".join(wrong))
        with self._link.lock:
            self._exchange(Request.LOAD_TABLE, pack_table(MODES.index(mode), tuple(rows)))
            loaded_mode, loaded = self.read_table()
        same = loaded_mode == mode and len(loaded) == len(rows)
        for row, back in zip(rows, loaded, strict=False):
            same &= math.isclose(row.power_W, back.power_W, rel_tol=FLOAT32, abs_tol=FLOAT32)
            same &= self._same(row.D1, back.D1) and self._same(row.D2, back.D2)
        if not same:
            raise ReadbackError("the table read back is not the table that was loaded", reply=loaded)
        return loaded

    def read_table(self) -> tuple[str, tuple[TableRow, ...]]:
        """Mode and rows of the table that the controller holds."""
        payload = self._exchange(Request.READ_TABLE)
        try:
            mode, rows = unpack_table(payload)
        except struct.error as error:
            raise self._doubt(ReplyError(f"not a table: {error}", reply=payload.hex(" "))) from error
        return _mode_name(mode), tuple(
            replace(row, D1=self._whole(row.D1), D2=self._whole(row.D2)) for row in rows
        )

    def use_table(self, on: bool = True) -> None:
        """Follow the table over the measured power, or (``False``) keep the D1 and D2 in effect now."""
        with self._link.lock:
            self._exchange(Request.USE_TABLE, SWITCH.pack(on))
            if self.heartbeat().table_in_use != on:
                raise ReadbackError(f"the table is {'not ' if on else ''}in use after it was switched")

    @property
    def health(self) -> Health:
        """How well its link does."""
        return self._link.health

    @property
    def resource(self) -> str:
        """Where it is reached."""
        return self._link.resource

    def close(self) -> None:
        """Close the link; an armed controller will miss its beats and trip."""
        self._link.close()

    def _exchange(self, request: Request, payload: bytes = b"") -> bytes:
        """One request and the payload of its reply, in step."""
        with self._link.lock:
            if not self._in_step:
                self._get_in_step()
            return self._ask(request, payload)

    def _get_in_step(self) -> Identity:
        """Wait out what may come late, then begin a session."""
        if self._doubted_at is not None:
            with contextlib.suppress(LinkLost):  # nothing can come late from a link that is gone
                self._link.quarantine(self._lateness_s - (time.monotonic() - self._doubted_at))
        payload = self._ask(Request.IDENTIFY, b"")
        try:
            counts, _ = IDENTITY.unpack_from(payload)
            maker, model, serial, firmware = payload[IDENTITY.size :].decode("utf-8").split(",")
        except (struct.error, ValueError) as error:
            reply = payload.hex(" ")
            raise self._doubt(ReplyError(f"not an identity: {error}", reply=reply)) from error
        if counts == 0:
            raise self._doubt(ReplyError("the controller has no PWM counts per half period"))
        self._counts, self._in_step, self._doubted_at = counts, True, None
        return Identity(maker=maker, model=model, serial=serial, firmware=firmware)

    def _ask(self, request: Request, payload: bytes) -> bytes:
        self._sequence = (self._sequence + 1) & 0xFFFF
        sent = Frame(self._sequence, request, payload)
        started = time.monotonic()
        self._link.health.exchanges += 1
        try:
            self._drain()
            self._link.write(encode(sent))
            return self._answer(sent, self._receive(deadline_in(self._timeout_s)))
        except InstrumentError as error:
            self._link.health.failed(error)
            if isinstance(error, LinkError | ReplyError):
                self._doubt(error)
            elapsed_s = round(time.monotonic() - started, 3)
            raise error.with_context(
                command=request.name, elapsed_s=elapsed_s, resource=self._link.resource
            ) from error.__cause__
        except BaseException:  # a signal: the reply is still under way
            self._in_step, self._doubted_at = False, time.monotonic()
            raise

    def _drain(self) -> None:
        """Nothing may be under way that could pass for the reply; a lost link has nothing to identify by."""
        try:
            self._link.drain()
        except LinkLost:
            if self._in_step:  # who answers after it is opened anew has to be asked
                raise

    def _receive(self, deadline: float) -> Frame:
        coded = b""
        while not coded:  # the zero in front of a frame
            coded = self._link.read_until(DELIMITER, deadline)
        return decode(coded)

    def _answer(self, sent: Frame, reply: Frame) -> bytes:
        """The payload of the reply to ``sent``, if it is that."""
        if reply == sent:
            raise ReplyError("the link repeats what is sent: switch local echo off")
        if reply.sequence != sent.sequence:
            raise ReplyError(f"a reply to request {reply.sequence} came; request {sent.sequence} was sent")
        if reply.type == NACK:
            type_, code = self._unpack(REFUSAL, reply.payload)
            if type_ != sent.type:
                raise ReplyError(f"request type {type_:#04x} is refused; {sent.type:#04x} was sent")
            raise self._refusal(code)
        if reply.type != sent.type | REPLY:
            raise ReplyError(f"a reply of type {reply.type:#04x} came to a request of type {sent.type:#04x}")
        return reply.payload

    def _refusal(self, code: int) -> InstrumentError:
        if code == Reason.FAULT_STANDS:
            return InstrumentTripped("the controller refuses: a fault stands; see its fault word")
        if code == Reason.OUT_OF_ORDER:
            self._in_step = False
            return InstrumentRefused("the controller lost the session: it was restarted, or has another host")
        known = code in set(Reason)
        reason = Reason(code).name.lower().replace("_", " ") if known else f"reason {code}"
        refused = SetPointRefused if code in OF_THE_SET_POINT else InstrumentRefused
        return refused(f"the controller refuses: {reason}")

    def _unpack(self, layout: struct.Struct, payload: bytes) -> tuple[Any, ...]:
        if len(payload) != layout.size:
            error = ReplyError(f"a payload of {len(payload)} bytes came; {layout.size} are due")
            raise self._doubt(error.with_context(reply=payload.hex(" ")))
        return layout.unpack(payload)

    def _doubt(self, error: InstrumentError) -> InstrumentError:
        """Mark the link: before the next request, wait and begin anew."""
        self._in_step = False
        self._doubted_at = time.monotonic()
        return error

    def _whole(self, duty: float) -> float:
        """A duty in whole PWM counts, freed of what single precision did to it on the way."""
        return round(duty * self._counts) / self._counts

    def _same(self, applied: float, wanted: float) -> bool:
        """Whether a value in effect is the wanted one, to the nearest PWM count."""
        return abs(applied - wanted) <= 0.5 / self._counts + FLOAT32


def _duty_problems(name: str, value: float) -> list[str]:
    return [] if 0.0 <= value <= 1.0 else [f"{name} = {value:g}: 0 to 1 half periods are possible"]


def _mode_problems(mode: str) -> list[str]:
    return [] if mode in MODES else [f"mode {mode!r}: there are {', '.join(MODES)}"]


def _table_problems(rows: Sequence[TableRow]) -> list[str]:
    wrong = []
    if not 2 <= len(rows) <= TABLE_ROWS:
        wrong.append(f"{len(rows)} rows: 2 to {TABLE_ROWS} are possible")
    powers = [row.power_W for row in rows]
    if not all(math.isfinite(power_W) for power_W in powers):
        wrong.append("a power is not a number")
    if any(b <= a for a, b in pairwise(powers)):
        wrong.append("the powers do not rise from row to row")
    for row in rows:
        wrong += [
            f"{row.power_W:g} W: {problem}"
            for name, value in (("D1", row.D1), ("D2", row.D2))
            for problem in _duty_problems(name, value)
        ]
    return wrong


def _mode_name(mode: int) -> str:
    if mode >= len(MODES):
        raise ReplyError(f"modulation mode {mode} is unknown: there are 0 to {len(MODES) - 1}")
    return MODES[mode]
