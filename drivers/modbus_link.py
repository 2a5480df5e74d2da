"""Modbus requests over one link, each with exactly one reply that is known to be its own.

pymodbus does the framing; ``drivers.transport`` opens the link. What is added here:

* one attempt per request, one lock per link, one deadline per reply (real time);
* an exception reply is raised, never taken for data; function code, address and count are checked (unit and
  transaction id pymodbus checks itself: wrong ones end as an error here);
* after a reply that did not come, or was not one, nothing that is still under way may answer the next
  request: over TCP the connection is dropped and opened anew; on a serial line the link waits longer than
  the worst lateness and throws away what came (quarantine). ``disturbances`` counts these, for a device to
  check that it is in step before it goes on;
* a TCP connection that the instrument closed while idle is opened anew before the request is sent, not after.
"""

import threading
import time
from collections.abc import Callable
from urllib.parse import urlsplit

from pymodbus import ModbusException
from pymodbus.client.base import ModbusBaseSyncClient
from pymodbus.framer import FramerType
from pymodbus.pdu import ModbusPDU
from pymodbus.pdu.bit_message import ReadCoilsRequest, ReadDiscreteInputsRequest, WriteSingleCoilRequest
from pymodbus.pdu.register_message import (
    ReadHoldingRegistersRequest,
    ReadInputRegistersRequest,
    WriteMultipleRegistersRequest,
    WriteSingleRegisterRequest,
)
from pymodbus.transport import CommParams, CommType

from drivers.errors import InstrumentError, LinkLost, LinkTimeout, LinkUnavailable, ReplyError
from drivers.health import Health
from drivers.modbus_errors import refused
from drivers.modbus_map import Space
from drivers.transport import ByteLink, Spy, deadline_in

LAST_TRANSACTION = 0x29FF  # EA devices take a TCP message whose first byte is 42 ("*") or more for SCPI text


READS: dict[Space, type[ModbusPDU]] = {
    Space.COIL: ReadCoilsRequest,
    Space.DISCRETE: ReadDiscreteInputsRequest,
    Space.HOLDING: ReadHoldingRegistersRequest,
    Space.INPUT: ReadInputRegistersRequest,
}


class FramingClient(ModbusBaseSyncClient):
    """pymodbus's client over an open byte link: it frames, decodes and numbers; it opens nothing."""

    def __init__(self, framer: FramerType, timeout_s: float) -> None:
        parameters = CommParams(comm_type=CommType.SERIAL, timeout_connect=timeout_s)
        super().__init__(framer, 0, parameters, None, None, None)
        self.bytes: ByteLink | None = None
        self.sent = self.received = b""
        self._timeout_s = timeout_s
        self._deadline = 0.0

    def connect(self) -> bool:
        """Whether there is a link; it is opened elsewhere."""
        return self.bytes is not None

    def send(self, request: bytes, addr: tuple[object, ...] | None = None) -> int:
        """Write one frame and start the clock of its reply."""
        assert self.bytes is not None
        self.sent, self.received = request, b""
        self.bytes.write(request)
        self._deadline = deadline_in(self._timeout_s)
        return len(request)

    def recv(self, size: int | None) -> bytes:
        """Whatever came before the reply's deadline; nothing when it has passed."""
        assert self.bytes is not None
        chunk = self.bytes.read_some(self._deadline)
        self.received += chunk
        return chunk

    def number_within(self, last: int) -> None:
        """Let the next transaction id be at most ``last``."""
        if self.transaction.next_tid >= last:
            self.transaction.next_tid = 0


class ModbusLink:
    """One link and its requests; safe to call from several threads.

    Parameters
    ----------
    open_bytes : opens the byte link, now and again after it was lost or dropped.
    framer : ``FramerType.SOCKET`` (TCP) or ``FramerType.RTU``.
    timeout_s : longest wait for a reply, in real time.
    longest_lateness_s : no reply is later than this after its timeout; only a serial line waits it out.
    """

    def __init__(
        self,
        open_bytes: Callable[[], ByteLink],
        framer: FramerType,
        *,
        timeout_s: float = 1.0,
        longest_lateness_s: float = 1.0,
    ) -> None:
        self._open = open_bytes
        self._tcp = framer is FramerType.SOCKET
        self._lateness_s = longest_lateness_s
        self._client = FramingClient(framer, timeout_s)
        self._lock = threading.RLock()
        self._quarantined_until: float | None = None
        self.disturbances = 0
        self.health = Health()
        self._client.bytes = open_bytes()
        self.resource = self._client.bytes.resource

    def close(self) -> None:
        """Close the link; a later request opens it again."""
        with self._lock:
            if self._client.bytes is not None:
                self._client.bytes.close()
                self._client.bytes = None

    def read(self, unit: int, space: Space, address: int, count: int) -> list[int]:
        """Read ``count`` registers (0..65535 each) or bits (0 or 1) from ``address`` on.

        Raises ``ModbusRefused`` (its types by exception code), ``ReplyError``, ``LinkError``.
        """
        request = READS[space](dev_id=unit, address=address, count=count)
        with self._lock:
            reply = self._exchange(request)
            values = [int(value) for value in reply.registers or reply.bits]
            expected = count if reply.registers else -(-count // 8) * 8  # bits come in whole bytes
            if len(values) != expected:
                raise self._wrong(f"the reply holds {len(values)} values; {count} were asked for")
            return values[:count]

    def write(self, unit: int, space: Space, address: int, words: list[int]) -> None:
        """Write a coil or registers once; the reply must repeat address and value (or count).

        Raises as ``read``. After a ``LinkError`` or ``ReplyError`` the write may or may not have been done.
        """
        with self._lock:
            if space is Space.COIL:
                bits = [bool(words[0])]
                request: ModbusPDU = WriteSingleCoilRequest(dev_id=unit, address=address, bits=bits)
            elif len(words) == 1:
                request = WriteSingleRegisterRequest(dev_id=unit, address=address, registers=words)
            else:
                request = WriteMultipleRegistersRequest(dev_id=unit, address=address, registers=words)
            reply = self._exchange(request)
            if len(words) > 1:
                repeated = reply.count == len(words)
            else:
                repeated = [*reply.bits, *reply.registers] == [*request.bits, *request.registers]
            if reply.address != address or not repeated:
                raise self._wrong("the reply does not repeat what was written")

    def distrust(self) -> None:
        """See to it that nothing that is still under way answers the next request."""
        if self._tcp:
            self._drop()
        else:
            self.disturbances += 1
            self._quarantined_until = deadline_in(self._lateness_s)

    def _exchange(self, request: ModbusPDU) -> ModbusPDU:
        """One request, one reply with the right function code from the right unit, or an error."""
        self.health.exchanges += 1
        self._client.sent = b""
        started = time.monotonic()
        try:
            self._make_ready()
            return self._checked(request)
        except InstrumentError as error:
            self.health.failed(error)
            elapsed_s = round(time.monotonic() - started, 3)
            error.with_context(
                resource=self.resource, command=self._client.sent.hex(" "), elapsed_s=elapsed_s
            )
            raise
        except BaseException:  # a signal: the reply is still under way
            self.distrust()
            raise

    def _checked(self, request: ModbusPDU) -> ModbusPDU:
        try:
            reply = self._client.execute(False, request)
        except LinkLost:
            self._drop()
            raise
        except (ModbusException, LinkTimeout) as error:
            if self._client.received:
                raise self._wrong("what came is not a whole reply to the request") from error
            self.distrust()
            raise LinkTimeout("no reply before the deadline") from error
        code = request.function_code
        if reply.function_code & 0x7F != code:
            raise self._wrong(f"the reply has function code {reply.function_code}, the request had {code}")
        if reply.isError():
            raise refused(reply.exception_code)
        return reply

    def _make_ready(self) -> None:
        """An open link with nothing on it that could be mistaken for the reply."""
        client = self._client
        client.number_within(LAST_TRANSACTION)
        if client.bytes is not None:
            try:
                if self._quarantined_until is not None:
                    client.bytes.quarantine(self._quarantined_until - time.monotonic())
                client.bytes.drain()
            except LinkLost:
                self._drop()
        if client.bytes is None:
            client.bytes = self._open()
        self._quarantined_until = None

    def _wrong(self, message: str) -> ReplyError:
        """The error for a reply that is none, once the link is marked for it."""
        self.distrust()
        return ReplyError(message, reply=self._client.received.hex(" "))

    def _drop(self) -> None:
        self.disturbances += 1
        self.close()


def open_link(
    resource: str,
    *,
    baud: int = 115200,
    parity: str = "N",
    timeout_s: float = 1.0,
    longest_lateness_s: float = 1.0,
    spy: Spy | None = None,
) -> ModbusLink:
    """Open ``tcp://host:port``, or a serial device by its path for RTU; raises ``LinkUnavailable``."""
    framer, url = FramerType.RTU, resource
    if resource.startswith("tcp://"):
        framer, url = FramerType.SOCKET, _socket_url(resource)

    def open_bytes() -> ByteLink:
        return ByteLink.open(url, baud=baud, parity=parity, timeout_s=timeout_s, spy=spy)

    return ModbusLink(open_bytes, framer, timeout_s=timeout_s, longest_lateness_s=longest_lateness_s)


def _socket_url(resource: str) -> str:
    try:
        parts = urlsplit(resource)
        port = parts.port or 502
    except ValueError as error:
        raise LinkUnavailable(f"{resource!r} is not tcp://host:port: {error}") from error
    if not parts.hostname:
        raise LinkUnavailable(f"{resource!r} is not tcp://host:port: the host is missing")
    return f"socket://{parts.hostname}:{port}"
