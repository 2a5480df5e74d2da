"""The instrument's side of SCPI: messages in, headers matched in long and short form, replies out.

A table says which header leads to which method: ``":NUMeric:NORMal:ITEM#"`` matches
``:NUMERIC:NORMAL:ITEM3``, ``:num:norm:item3`` and nothing between; ``[...]`` may be left out. What is wrong
goes to the error queue, never into a reply.
"""

import re
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass

UNDEFINED_HEADER = (113, "Undefined Header")
MISSING_PARAMETER = (109, "Missing parameter")
WRONG_PARAMETER = (141, "Invalid character data")
OUT_OF_RANGE = (222, "Data out of range")
_QUEUE_LENGTH = 16


class CommandError(Exception):
    """A message unit that the instrument does not carry out: code and text for its error queue."""


@dataclass(frozen=True, slots=True)
class Call:
    """One message unit: the number in its header, whether it asks, and its parameters in capitals."""

    number: int | None
    asks: bool
    arguments: tuple[str, ...]

    @property
    def argument(self) -> str:
        """The only parameter; a command without one is an error."""
        if len(self.arguments) != 1:
            raise CommandError(*MISSING_PARAMETER)
        return self.arguments[0]


Method = Callable[[Call], str | bytes | None]


@dataclass(frozen=True, slots=True)
class Entry:
    """One row of the table, ready for matching."""

    pattern: re.Pattern[str]
    long: str
    short: str
    method: Method


def compile_header(header: str, method: Method) -> Entry:
    """The row for a header written with its short form in capitals."""
    plain = header.replace("[", "").replace("]", "")
    pattern = re.escape(header).replace(r"\[", "(?:").replace(r"\]", ")?").replace(r"\#", r"(?P<number>\d+)")
    pattern = re.sub(r"([A-Z]+)([a-z]+)", lambda m: f"{m[1]}(?:{m[2].upper()})?", pattern)
    if header.startswith(":"):
        pattern = f":?{pattern[1:]}"
    short = re.sub(r"[a-z]+", "", plain)
    return Entry(re.compile(pattern), plain.upper(), short, method)


class ScpiServer:
    """Takes apart what arrives, calls the table's methods, puts replies together.

    Parameters
    ----------
    table : header to method.
    not_fitted : headers of options that this instrument lacks: they get silence, not even an error.
    """

    def __init__(self, table: Mapping[str, Method], not_fitted: tuple[str, ...] = ()) -> None:
        own: dict[str, Method] = {
            "*CLS": self._clear,
            "*OPC": lambda call: "1" if call.asks else None,
            ":STATus:ERRor": lambda _: self._next_error(),
            ":COMMunicate:HEADer": self._header,
            ":COMMunicate:VERBose": self._verbose,
        }
        self._entries = [compile_header(header, method) for header, method in {**own, **table}.items()]
        self._not_fitted = [compile_header(header, lambda _: None).pattern for header in not_fitted]
        self._received = bytearray()
        self._errors: deque[tuple[int, str]] = deque(maxlen=_QUEUE_LENGTH)
        self.headers = True
        self.verbose = True

    def handle(self, chunk: bytes) -> bytes | None:
        """Bytes from the client; returns the bytes of all replies to whole messages."""
        self._received += chunk
        replies = b""
        while (end := self._received.find(b"\n")) >= 0:
            message = bytes(self._received[:end])
            del self._received[: end + 1]
            replies += self._message(message.decode("ascii", errors="replace").strip())
        return replies or None

    def _message(self, message: str) -> bytes:
        """Carry out one message; several units, separated by semicolons, share one reply line."""
        replies: list[bytes] = []
        branch = ""
        for unit in filter(None, (unit.strip() for unit in message.split(";"))):
            absolute = unit if unit.startswith((":", "*")) or not branch else branch + unit
            if not absolute.startswith("*"):
                branch = re.split(r"[ ?]", absolute, maxsplit=1)[0].rpartition(":")[0] + ":"
            reply = self._unit(absolute)
            if reply is not None:
                replies.append(reply)
        return b";".join(replies) + b"\r\n" if replies else b""

    def _unit(self, unit: str) -> bytes | None:
        header, _, rest = unit.upper().partition(" ")
        name = header.removesuffix("?")
        arguments = tuple(word.strip() for word in rest.split(",")) if rest.strip() else ()
        for entry in self._entries:
            if match := entry.pattern.fullmatch(name):
                number = match.groupdict().get("number")
                call = Call(int(number) if number else None, header.endswith("?"), arguments)
                return self._call(entry, call)
        if not any(pattern.match(name) for pattern in self._not_fitted):
            self._errors.append(UNDEFINED_HEADER)
        return None

    def _call(self, entry: Entry, call: Call) -> bytes | None:
        try:
            reply = entry.method(call)
        except CommandError as error:
            self._errors.append((int(error.args[0]), str(error.args[1])))
            return None
        if reply is None:
            return None
        data = reply if isinstance(reply, bytes) else reply.encode("ascii")
        if not self.headers or entry.long.startswith("*"):
            return data
        header = (entry.long if self.verbose else entry.short).replace("#", str(call.number))
        return header.encode("ascii") + b" " + data

    def _clear(self, _: Call) -> None:
        self._errors.clear()

    def _next_error(self) -> str:
        code, text = self._errors.popleft() if self._errors else (0, "No error")
        return f'{code},"{text}"'

    def _header(self, call: Call) -> str | None:
        if call.asks:
            return str(int(self.headers))
        self.headers = parse_switch(call.argument)
        return None

    def _verbose(self, call: Call) -> str | None:
        if call.asks:
            return str(int(self.verbose))
        self.verbose = parse_switch(call.argument)
        return None


def parse_switch(word: str) -> bool:
    """ON and OFF, 1 and 0."""
    if word not in ("ON", "OFF", "1", "0"):
        raise CommandError(*WRONG_PARAMETER)
    return word in ("ON", "1")


def parse_quantity(word: str, unit: str) -> float:
    """A number with an optional multiplier and unit: ``500MS``, ``300V``, ``0.5``."""
    match = re.fullmatch(rf"([+-]?\d+(?:\.\d*)?(?:E[+-]?\d+)?)(K|M|U)?(?:{unit})?", word)
    if match is None:
        raise CommandError(*WRONG_PARAMETER)
    return float(match[1]) * {"K": 1e3, "M": 1e-3, "U": 1e-6, None: 1.0}[match[2]]
