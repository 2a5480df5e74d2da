"""What the controller's messages contain: types, payloads, modes, fault bits, reasons to refuse.

``docs/controller-protocol.md`` is the description for firmware; both sides of the mock bench use this file,
and a test holds it to the bytes in that document. All numbers are little endian.
"""

import struct
from dataclasses import dataclass
from enum import IntEnum

REPLY = 0x80
MODES = ("hybrid", "sps", "dps", "eps", "tps")
TABLE_ROWS = 64

FAULTS = (  # by bit of the fault word
    "heartbeat_lost",
    "heatsink_overtemperature",
    "winding_overtemperature",
    "output_overvoltage",
    "output_undervoltage",
    "input_undervoltage",
    "overcurrent",
    "gate_driver",
    "other",
)


class Request(IntEnum):
    """Message types from the host; a reply's type has bit 7 set."""

    IDENTIFY = 0x01
    SET_MODULATION = 0x02
    ARM = 0x03
    ENABLE = 0x04
    DISABLE = 0x05
    HEARTBEAT = 0x06
    LOAD_TABLE = 0x07
    READ_TABLE = 0x08
    USE_TABLE = 0x09
    DISARM = 0x0A


NACK = 0xFF


class Reason(IntEnum):
    """Why the controller refuses a request."""

    UNKNOWN_TYPE = 1
    WRONG_LENGTH = 2
    OUT_OF_ORDER = 3
    OUT_OF_RANGE = 4
    PULSE_TOO_SHORT = 5
    UNKNOWN_MODE = 6
    NOT_ARMED = 7
    PWM_IS_ON = 8
    FAULT_STANDS = 9
    NO_SET_POINT = 10
    BAD_TABLE = 11


OF_THE_SET_POINT = (Reason.OUT_OF_RANGE, Reason.PULSE_TOO_SHORT)  # another one may be taken

SET_MODULATION = struct.Struct("<Bff")  # mode, D1, D2
APPLIED = struct.Struct("<BHH")  # mode, counts of D1, of D2
ARM = struct.Struct("<I")  # heartbeat period in ms
SWITCH = struct.Struct("<B")
REFUSAL = struct.Struct("<BB")  # type refused, reason
IDENTITY = struct.Struct("<HB")  # counts per half period, rows of the table; then text
TABLE = struct.Struct("<BB")  # mode, rows
ROW = struct.Struct("<fff")  # power in W, D1, D2
TELEMETRY = struct.Struct("<BHHH6f")  # flags, faults, counts of D1, of D2, then:
# D0, V2 in V, temperatures of heatsink, transformer, inductor and ambient in °C

PWM_ON, ARMED, TABLE_IN_USE = 1, 2, 4  # flags


@dataclass(frozen=True, slots=True, kw_only=True)
class TableRow:
    """One row of the table: D1 and D2, in half periods, at an output power in W."""

    power_W: float
    D1: float
    D2: float


def pack_table(mode: int, rows: tuple[TableRow, ...]) -> bytes:
    """The payload that carries a table."""
    return TABLE.pack(mode, len(rows)) + b"".join(ROW.pack(row.power_W, row.D1, row.D2) for row in rows)


def unpack_table(payload: bytes) -> tuple[int, tuple[TableRow, ...]]:
    """Mode and rows; ``struct.error`` when the payload has another length than it says."""
    mode, count = TABLE.unpack_from(payload)
    if len(payload) != TABLE.size + count * ROW.size:
        raise struct.error(f"a table of {count} rows in {len(payload)} bytes")
    rows = ROW.iter_unpack(payload[TABLE.size :])
    return mode, tuple(TableRow(power_W=power_W, D1=D1, D2=D2) for power_W, D1, D2 in rows)


def fault_word(faults: tuple[str, ...]) -> int:
    """One bit per fault; a name that has no bit of its own sets the last."""
    return sum({1 << (FAULTS.index(name) if name in FAULTS else len(FAULTS) - 1) for name in faults})


def fault_names(word: int) -> tuple[str, ...]:
    """The faults in a fault word; bits without a name are ``bit_<n>``."""
    return tuple(FAULTS[bit] if bit < len(FAULTS) else f"bit_{bit}" for bit in range(16) if word >> bit & 1)
