"""Modbus exception replies as typed errors: what the instrument said no to.

::

    InstrumentRefused
    └── ModbusRefused        any exception code; ``.code`` holds it
        ├── IllegalFunction  1   the instrument does not know this kind of request
        ├── IllegalAddress   2   there is no such register
        ├── IllegalValue     3   the register does not take this value
        ├── DeviceFailure    4   it tried and could not
        └── DeviceBusy       6   not now; nothing was read or done
"""

from collections.abc import Mapping

from drivers.errors import InstrumentRefused


class ModbusRefused(InstrumentRefused):
    """The instrument answered with an exception code."""

    code: int = 0
    says = "exception"

    def __init__(self, message: str, *, code: int, **context: object) -> None:
        super().__init__(message, **context)
        self.code = code


class IllegalFunction(ModbusRefused):
    """Code 1: the instrument does not know this kind of request."""

    says = "illegal function"


class IllegalAddress(ModbusRefused):
    """Code 2: there is no such register."""

    says = "illegal data address"


class IllegalValue(ModbusRefused):
    """Code 3: the register does not take this value."""

    says = "illegal data value"


class DeviceFailure(ModbusRefused):
    """Code 4: the instrument tried and could not."""

    says = "device failure"


class DeviceBusy(ModbusRefused):
    """Code 6: not now; nothing was read and nothing was done."""

    says = "device busy"


BY_CODE: dict[int, type[ModbusRefused]] = {
    1: IllegalFunction,
    2: IllegalAddress,
    3: IllegalValue,
    4: DeviceFailure,
    6: DeviceBusy,
}


def refused(code: int, own: Mapping[int, str] | None = None) -> ModbusRefused:
    """The error for an exception code; ``own`` names the maker's own codes."""
    kind = BY_CODE.get(code, ModbusRefused)
    says = (own or {}).get(code, kind.says)
    return kind(f"the instrument refused: {says} (exception code {code})", code=code)
