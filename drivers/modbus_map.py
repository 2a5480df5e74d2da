"""Register maps: what a Modbus instrument's registers mean, as data (one TOML file per model in ``maps/``).

A map names each register with its space, address, type, word order, scaling, range, limits, preconditions and
read-back source; the state flags, regulation modes and alarms (latched or not) by register, mask and value;
who the instrument says it is; its unit ids; and its watchdog, where it has one. ``accepts`` lists the model
names the map is for; ``models`` holds what differs between them (digits, nominal values) by that same prefix.

Everything scaled comes down to one number, SI units per count: ``value = counts * per_count``.
"""

import struct
import tomllib
from collections.abc import Callable, Mapping
from enum import StrEnum
from importlib import resources
from pathlib import Path
from typing import Annotated, Literal, Self

from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

Raw = int | float | str
Constant = Callable[[str], float]


class MapError(ValueError):
    """A register map that cannot be used: the file, the field, what is wrong with it."""


class Space(StrEnum):
    """The four address spaces of Modbus, each with registers of its own."""

    COIL = "coil"
    DISCRETE = "discrete"
    INPUT = "input"
    HOLDING = "holding"


class Table(BaseModel):
    """A table of the file: unknown keys are errors, values do not change."""

    model_config = ConfigDict(frozen=True, extra="forbid")


class Unscaled(Table):
    """Counts are the value."""

    kind: Literal["none"] = "none"

    def per_count(self, _constant: Constant) -> float:
        """One."""
        return 1.0


class Fraction(Table):
    """``full_scale`` counts are 100 % of a nominal value that the device tells."""

    kind: Literal["fraction"]
    of: str
    full_scale: int

    def per_count(self, constant: Constant) -> float:
        """Nominal value over full scale."""
        return constant(self.of) / self.full_scale


class Decimals(Table):
    """Fixed point with 10**-digits per count; ``digits`` may name a constant of the model."""

    kind: Literal["decimals"]
    digits: int | str

    def per_count(self, constant: Constant) -> float:
        """10**-digits."""
        digits = constant(self.digits) if isinstance(self.digits, str) else self.digits
        return float(10.0**-digits)


class DecimalsRegister(Table):
    """Fixed point whose digits stand in ``(of >> shift) & mask``, ``of`` a register."""

    kind: Literal["decimals_register"]
    of: str
    shift: int = 0
    mask: int = 0xF

    def per_count(self, constant: Constant) -> float:
        """10**-digits, digits read from the device."""
        return float(10.0 ** -((int(constant(self.of)) >> self.shift) & self.mask))


Scaling = Annotated[Unscaled | Fraction | Decimals | DecimalsRegister, Field(discriminator="kind")]
FORMATS = {"bool": ">H", "u16": ">H", "i16": ">h", "u32": ">I", "i32": ">i", "f32": ">f"}


class Register(Table):
    """One named register (or run of registers) of an instrument."""

    name: str
    space: Space = Space.HOLDING
    address: int = Field(ge=0, le=0xFFFF)
    type: Literal["bool", "u16", "i16", "u32", "i32", "f32", "text"] = "u16"
    words: int = Field(default=0, ge=0, le=125)  # of a text; other types know their size
    word_order: Literal["high_first", "low_first"] = "high_first"
    unit: str = ""
    access: Literal["r", "w", "rw"] = "r"
    scaling: Scaling = Unscaled()
    range: tuple[int, int] | None = None  # counts that may be written
    lowest: str = ""  # names of what limits the value: a register, or a constant of the model
    highest: str = ""
    overrange: int | None = None  # this count, and above, means "too large to show"
    requires: tuple[str, ...] = ()  # flags that must stand before the instrument takes a write
    read_back: str = "self"  # "self", another register, "flag.NAME", or "none"

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        if (self.type == "text") != (self.words > 0):
            raise ValueError("words is given for a text, and for nothing else")
        if self.space in (Space.COIL, Space.DISCRETE) and self.type != "bool":
            raise ValueError(f"a {self.space} holds a bool, not {self.type}")
        if "w" in self.access and self.space in (Space.DISCRETE, Space.INPUT):
            raise ValueError(f"a register of space {self.space} cannot be written")
        if self.access == "w" and self.read_back == "self":
            raise ValueError("a register that cannot be read needs another read_back, or 'none'")
        return self

    @property
    def count(self) -> int:
        """How many registers (or bits) it takes on the wire."""
        return self.words or struct.calcsize(FORMATS[self.type]) // 2

    @property
    def names_needed(self) -> list[str]:
        """Registers, or constants of the model, that this one refers to."""
        names = [self.lowest, self.highest]
        match self.scaling:
            case Fraction(of=name) | DecimalsRegister(of=name) | Decimals(digits=str(name)):
                names.append(name)
        if self.read_back not in ("self", "none") and not self.read_back.startswith("flag."):
            names.append(self.read_back)
        return [name for name in names if name]

    @property
    def flags_needed(self) -> list[str]:
        """Flags that this one refers to."""
        back = self.read_back
        return [*self.requires, *([back.removeprefix("flag.")] if back.startswith("flag.") else [])]

    def encode(self, raw: Raw) -> list[int]:
        """The words on the wire; ``struct.error`` when the type cannot hold ``raw``."""
        if self.type == "text":
            data = str(raw).encode("ascii").ljust(2 * self.words, b"\0")
        else:
            data = struct.pack(FORMATS[self.type], raw)
        words = list(struct.unpack(f">{len(data) // 2}H", data))
        return words if self.word_order == "high_first" else words[::-1]

    def decode(self, words: list[int]) -> Raw:
        """What the words mean, not yet scaled."""
        ordered = words if self.word_order == "high_first" else words[::-1]
        data = struct.pack(f">{len(ordered)}H", *ordered)
        if self.type == "text":
            return data.split(b"\0", 1)[0].decode("ascii", "replace").strip()
        raw: int | float = struct.unpack(FORMATS[self.type], data)[0]
        return raw


class Flag(Table):
    """Stands when the bits ``mask`` of register ``of`` equal ``equals`` (the whole mask, unless given)."""

    of: str
    mask: int = 0xFFFF
    equals: int | None = None
    latched: bool = False  # stays until it is acknowledged, though its cause is gone
    summary: bool = False  # "some alarm": told only when no alarm with a name stands

    def stands(self, raws: Mapping[str, Raw]) -> bool:
        """Whether it stands in these raw register values."""
        bits = int(raws[self.of]) & self.mask
        return bits == (self.mask if self.equals is None else self.equals)


class Modes(Table):
    """Which regulation mode the instrument is in: a bit field of a register, and a name per value."""

    of: str
    shift: int = 0
    mask: int
    names: tuple[str, ...]

    @model_validator(mode="after")
    def _every_value_has_a_name(self) -> Self:
        if len(self.names) <= self.mask:
            raise ValueError(f"a field with mask {self.mask} needs {self.mask + 1} names")
        return self


class IdentityRegisters(Table):
    """Registers that say who answers; an empty name: the instrument does not tell."""

    maker: str = ""
    model: str
    serial: str = ""
    firmware: str = ""
    accepts: tuple[str, ...]  # the model must begin with one of these
    resync: str  # read after a disturbed exchange; the same answer as ever means that the link is in step

    @property
    def names_needed(self) -> list[str]:
        """Registers that this refers to."""
        return [name for name in (self.maker, self.model, self.serial, self.firmware, self.resync) if name]


class Watchdog(Table):
    """The instrument switches itself off when nobody speaks to it for this long."""

    sets: str  # the register that takes the time
    timeout_s: float


class ModbusMap(Table):
    """One instrument model's registers; see the module's docstring."""

    maker: str
    series: str
    kind: Literal["supply", "load"]
    unit: int = 1  # as delivered
    units: tuple[int, int] = (1, 247)  # ids that may be configured, first and last
    identity: IdentityRegisters
    registers: dict[str, Register]
    flags: dict[str, Flag]
    modes: Modes
    alarms: dict[str, Flag]
    exceptions: dict[int, str] = {}  # the maker's own exception codes
    models: dict[str, dict[str, float]] = {}
    watchdog: Watchdog | None = None

    @model_validator(mode="before")
    @classmethod
    def _name_registers(cls, data: dict[str, object]) -> dict[str, object]:
        registers = data.get("registers")
        if not isinstance(registers, dict):
            return data
        return {**data, "registers": {name: {**table, "name": name} for name, table in registers.items()}}

    @model_validator(mode="after")
    def _references_resolve(self) -> Self:
        registers = self.registers.values()
        flags = {flag for r in registers for flag in r.flags_needed} - set(self.flags)
        if flags:
            raise ValueError(f"requires or read_back name flags that do not exist: {sorted(flags)}")
        names = {name for r in registers for name in r.names_needed}
        names.update(self.identity.names_needed, self.state_registers)
        names.update([self.watchdog.sets] if self.watchdog else [])
        for name in set(names):  # a constant counts if every model has it
            if self.models and all(name in constants for constants in self.models.values()):
                names.discard(name)
        missing = names - set(self.registers)
        if missing:
            raise ValueError(f"names that are neither a register nor a model's constant: {sorted(missing)}")
        return self

    @property
    def state_registers(self) -> tuple[str, ...]:
        """The registers that flags, modes and alarms are read from, each once, in order of address."""
        names = {flag.of for flag in (*self.flags.values(), *self.alarms.values())}
        names.add(self.modes.of)
        return tuple(sorted(names, key=lambda n: self.registers[n].address if n in self.registers else -1))


def _maps_there_are() -> str:
    """The maps in ``drivers/maps`` by what they are for; those of analyzers hold no registers."""
    names: dict[str, list[str]] = {"supply": [], "load": []}
    for file in sorted((resources.files("drivers") / "maps").iterdir(), key=lambda file: file.name):
        kind = tomllib.loads(file.read_text("utf-8")).get("kind") if file.name.endswith(".toml") else ""
        if kind in names:
            names[kind].append(file.name.removesuffix(".toml"))
    return "; ".join(f"{', '.join(known)} for a {kind}" for kind, known in names.items())


def load_map(name_or_path: str | Path) -> ModbusMap:
    """Read a map by its name in ``drivers/maps`` ("ea_psi9000") or a path to a TOML file.

    Raises ``MapError``, which names the file and each wrong field.
    """
    path = Path(name_or_path)
    folder = resources.files("drivers") / "maps"
    source = path if path.suffix == ".toml" else folder / f"{name_or_path}.toml"
    if not source.is_file():
        said = f"no register map {str(name_or_path)!r}; there are {_maps_there_are()}"
        raise MapError(f"{said}. Name one of them, or give a path to a .toml file")
    try:
        return ModbusMap.model_validate(tomllib.loads(source.read_text("utf-8")))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise MapError(f"{source}: not a TOML file: {error}") from error
    except ValidationError as error:
        faults = [f"{'.'.join(map(str, e['loc'])) or 'map'}: {e['msg']}" for e in error.errors()]
        raise MapError(f"{source}: " + "; ".join(faults)) from error
