"""A Modbus instrument by the names of its register map, in SI units, with every write checked.

``read`` gives a value; ``write`` refuses what lies outside the register's range and the device's own limits
before anything is sent, sends once, and reads back from where the map says. A write is never repeated here.
"""

import math
import struct
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager

from drivers.errors import IdentityError, InstrumentError, LimitError, ReadbackError, ReplyError
from drivers.identity import Identity
from drivers.modbus_errors import ModbusRefused, refused
from drivers.modbus_link import ModbusLink
from drivers.modbus_map import ModbusMap, Raw, Register

Value = float | bool | str

CONFIRM_S = 1.0  # a state may take this long to follow a write (contactors, soft start)
POLL_S = 0.02
FULL_BLOCK = 125  # registers in one read
HIGHEST_FLOAT: float = struct.unpack(">f", b"\x7f\x7f\xff\xff")[0]
FLOAT_MATCH = 1e-6  # relative: two float32 counts
ROUNDED_UP = 1.0 + 1e-9  # a ceiling of a whole number of counts is not lost to rounding


class ModbusDevice:
    """One instrument on a link: its map and its unit id (as delivered, unless given)."""

    def __init__(self, link: ModbusLink, register_map: ModbusMap, unit: int | None = None) -> None:
        self.link = link
        self.map = register_map
        self.unit = register_map.unit if unit is None else unit
        first, last = register_map.units
        if not first <= self.unit <= last:
            raise LimitError(f"unit id {self.unit} of {register_map.series}; allowed are {first} to {last}")
        self.ceilings: dict[
            str, float
        ] = {}  # by register, in SI: what the bench allows, whatever the device does
        self._constants: dict[str, float] = {}
        self._disturbances = link.disturbances
        self._resync_answer: Raw | None = None

    def identify(self) -> Identity:
        """Ask who answers; raises ``IdentityError`` when the map is for something else."""
        names = self.map.identity
        model = self._text(names.model)
        if not model.startswith(names.accepts):
            raise IdentityError(
                f"{model!r} answered where a {self.map.maker} {self.map.series} was expected "
                f"(its model begins with one of {list(names.accepts)}); check resource, unit id and map",
                **self._context(),
            )
        told = {
            key: self._text(name) for key in ("maker", "serial", "firmware") if (name := getattr(names, key))
        }
        return Identity(
            told.get("maker", self.map.maker), model, told.get("serial", ""), told.get("firmware", "")
        )

    def read(self, name: str) -> Value:
        """The value of one register: SI units, a bool, or a text."""
        return self.value(name, self.read_raw([name])[name])

    def read_raw(self, names: Sequence[str]) -> dict[str, Raw]:
        """Unscaled values by name; registers side by side come in one request, so from one instant."""
        registers = sorted((self._register(name) for name in names), key=lambda r: (r.space, r.address))
        blocks: list[list[Register]] = []
        for register in registers:
            if not blocks or not _adjoins(blocks[-1], register):
                blocks.append([])
            blocks[-1].append(register)
        self._resynchronise()
        return {name: raw for block in blocks for name, raw in self._fetch(block).items()}

    def value(self, name: str, raw: Raw) -> Value:
        """What a raw value of this register means in SI units."""
        register = self._register(name)
        if isinstance(raw, str):
            return raw
        if register.type == "bool":
            return bool(raw)
        return raw * self._per_count(register)

    def overrange(self, name: str, raw: Raw) -> bool:
        """True when the instrument shows its largest count, which stands for anything above, too."""
        ceiling = self._register(name).overrange
        return ceiling is not None and not isinstance(raw, str) and raw >= ceiling

    def constant(self, name: str) -> float:
        """A number that does not change while a campaign runs: a nominal value, a limit, a digit count.

        From the device, asked once, or from the map's table of its model; ``forget`` asks anew.
        """
        if name not in self._constants:
            if name in self.map.registers:
                self._constants[name] = float(self.read(name))
            else:
                model = self._text(self.map.identity.model)
                tables = [table for prefix, table in self.map.models.items() if model.startswith(prefix)]
                if not tables:
                    raise IdentityError(f"no {name} is known for model {model!r}", **self._context())
                self._constants[name] = tables[0][name]
        return self._constants[name]

    def forget(self) -> None:
        """Ask the device anew for limits and nominal values when they are next needed."""
        self._constants.clear()

    def flag(self, name: str) -> bool:
        """Whether a state flag of the map stands, read now."""
        flag = self.map.flags[name]
        return flag.stands(self.read_raw([flag.of]))

    def limits(self, name: str) -> tuple[float, float]:
        """The lowest and highest value that ``write`` lets through, in SI units."""
        register = self._register(name)
        lowest, highest = self._allowed_counts(register)
        per_count = self._per_count(register)
        return lowest * per_count, highest * per_count

    def allows(self, name: str, value: float) -> bool:
        """Whether the device takes a value, rounded to a whole count; what the bench allows may be less."""
        register = self._register(name)
        lowest, highest = self._allowed_counts(register)
        half = FLOAT_MATCH * abs(highest) if register.type == "f32" else 0.5
        return lowest - half <= value / self._per_count(register) <= highest + half  # False for NaN, too

    def write(self, name: str, value: float | bool) -> None:
        """Check against the limits, send once, read back.

        Raises ``LimitError`` (nothing was sent), ``ModbusRefused``, ``ReadbackError``, ``LinkError``.
        """
        register = self._register(name)
        if "w" not in register.access:
            raise LimitError(
                f"{name} of {self.map.series} can be read, not written", **self._context(register)
            )
        raw = self._counts(register, value)
        self._resynchronise()
        try:
            with self._telling(register):
                self.link.write(self.unit, register.space, register.address, register.encode(raw))
        except ModbusRefused as error:
            raise self._explained(error, register) from error
        self._verify(register, raw)

    def close(self) -> None:
        """Close the link."""
        self.link.close()

    def _per_count(self, register: Register) -> float:
        """SI units in one count, from what the device tells; ``ReplyError`` when that makes no sense."""
        per_count = register.scaling.per_count(self.constant)
        if not 0 < per_count < math.inf:
            raise ReplyError(
                f"one count of {register.name} would be {per_count} {register.unit}: its nominal value or "
                "digits, as the device tells them, make no sense",
                **self._context(register),
            )
        return per_count

    def _counts(self, register: Register, value: float | bool) -> Raw:
        """The raw value to send, or ``LimitError``: the same comparison in counts that the device makes."""
        if register.type == "bool":
            return bool(value)
        per_count, ceiling = self._per_count(register), self.ceilings.get(register.name, math.inf)
        lowest, highest = self._allowed_counts(register)
        counts = value / per_count
        if not (self.allows(register.name, value) and value <= ceiling * ROUNDED_UP):
            raise LimitError(
                f"{register.name} = {value:g} {register.unit} is outside what {self.map.series} and bench allow, "
                f"{lowest * per_count:g} to {min(highest * per_count, ceiling):g} {register.unit}; nothing was sent",
                **self._context(register),
            )
        if register.type == "f32":
            return float(counts)
        most = math.floor(min(highest, ceiling / per_count * ROUNDED_UP))  # none is rounded up beyond it
        return min(max(round(counts), int(lowest)), most)

    def _allowed_counts(self, register: Register) -> tuple[float, float]:
        per_count = self._per_count(register)
        lowest, highest = register.range or _range_of(register.type)
        whole: Callable[[float], float] = float if register.type == "f32" else round
        if register.lowest:
            lowest = max(lowest, whole(self.constant(register.lowest) / per_count))
        if register.highest:
            highest = min(highest, whole(self.constant(register.highest) / per_count))
        return lowest, highest

    def _verify(self, register: Register, raw: Raw) -> None:
        """Compare with what the device now holds, one count of tolerance; a flag gets time to follow."""
        source = register.read_back
        if source == "none":
            return
        if source.startswith("flag."):
            deadline = time.monotonic() + CONFIRM_S
            while (held := self.flag(source.removeprefix("flag."))) != bool(raw):
                if time.monotonic() > deadline:
                    raise self._readback_error(register, raw, held)
                time.sleep(POLL_S)
            return
        name = register.name if source == "self" else source
        got = self.read_raw([name])[name]
        one_count = 0 if register.type == "bool" else 1
        tolerance = abs(float(raw)) * FLOAT_MATCH if register.type == "f32" else one_count
        if abs(float(got) - float(raw)) > tolerance:
            raise self._readback_error(register, raw, got)

    def _readback_error(self, register: Register, raw: Raw, got: Raw) -> ReadbackError:
        sent, held = self.value(register.name, raw), self.value(register.name, got)
        return ReadbackError(
            f"{register.name} was set to {sent} and reads back as {held} {register.unit}".rstrip(),
            **self._context(register),
        )

    def _explained(self, error: ModbusRefused, register: Register) -> ModbusRefused:
        """The refusal in the maker's words, with the preconditions that do not stand."""
        explained = refused(error.code, self.map.exceptions).with_context(**error.context)
        try:
            lacking = [flag for flag in register.requires if not self.flag(flag)]
        except InstrumentError:  # the refusal is the news; why, could not be found out
            lacking = []
        if lacking:
            explained.message += f"; it needs {' and '.join(lacking)}, which is off (someone pressed LOCAL?)"
        return explained

    def _fetch(self, block: list[Register]) -> dict[str, Raw]:
        """Registers side by side, in one request."""
        start, last = block[0].address, block[-1]
        with self._telling(block[0]):
            words = self.link.read(self.unit, last.space, start, last.address + last.count - start)
        return {r.name: r.decode(words[r.address - start :][: r.count]) for r in block}

    def _resynchronise(self) -> None:
        """After a disturbed exchange, go on only when the device gives the answer that it always gave."""
        disturbances = self.link.disturbances
        if self._resync_answer is not None and disturbances == self._disturbances:
            return
        register = self._register(self.map.identity.resync)
        answer = self._fetch([register])[register.name]
        if answer != (self._resync_answer or answer):
            self.link.distrust()
            raise IdentityError(
                f"{register.name} read {self._resync_answer!r} before and {answer!r} after a disturbance: "
                "a late reply, or another instrument",
                **self._context(register),
            )
        self._resync_answer, self._disturbances = answer, disturbances

    @contextmanager
    def _telling(self, register: Register) -> Iterator[None]:
        """Let an error say which instrument and register it was about."""
        try:
            yield
        except InstrumentError as error:
            error.with_context(**self._context(register))
            raise

    def _text(self, name: str) -> str:
        value = self.read(name)
        return f"{value:.10g}" if isinstance(value, float) else str(value)

    def _register(self, name: str) -> Register:
        return self.map.registers[name]

    def _context(self, register: Register | None = None) -> dict[str, object]:
        context: dict[str, object] = {"instrument": f"{self.map.maker} {self.map.series}", "unit": self.unit}
        return {**context, "register": register.name, "address": register.address} if register else context


def _adjoins(block: list[Register], register: Register) -> bool:
    first, last = block[0], block[-1]
    return (
        register.space == last.space
        and register.address == last.address + last.count
        and register.address + register.count - first.address <= FULL_BLOCK
    )


def _range_of(kind: str) -> tuple[float, float]:
    """The lowest and highest count that a register of this type holds."""
    bits = int(kind[1:])
    match kind[0]:
        case "u":
            return 0, 2**bits - 1
        case "i":
            return -(2 ** (bits - 1)), 2 ** (bits - 1) - 1
        case _:
            return -HIGHEST_FLOAT, HIGHEST_FLOAT
