"""A mock power analyzer: the plant's readings behind the command set of a WT3000.

It has the habits of the real one: headers and verbose replies until they are switched off, ``HOLD`` that
outlives a client, ``NAN`` after a range change until the next update, ``INF`` above the range, silence for
an option that is not fitted, and a ``WAIT`` that never ends when no event was asked for. Updates end at
whole multiples of the update interval on the plant's clock.
"""

import math
import re
import struct
from collections.abc import Mapping
from typing import Protocol

from drivers.clock import Clock
from drivers.mocks.scpi_server import (
    OUT_OF_RANGE,
    WRONG_PARAMETER,
    Call,
    CommandError,
    Method,
    ScpiServer,
    parse_quantity,
    parse_switch,
)

RATES_S = (0.05, 0.1, 0.25, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0)
RANGES = {
    "U": (15.0, 30.0, 60.0, 100.0, 150.0, 300.0, 600.0, 1000.0),
    "I": (0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 30.0),
}
FUNCTIONS = {"URMS": "U", "UMN": "U", "UDC": "U", "IRMS": "I", "IMN": "I", "IDC": "I", "P": "P"}
UNMEASURED = ("URMN", "UAC", "IRMN", "IAC", "S", "Q", "LAMBDA", "PHI", "FU", "FI", "ETA1", "NONE")
NOT_FITTED = (":HARMonics", ":FLICker", ":MOTor", ":CBCycle", ":HCOPy")
DEFAULT_ITEMS = 15
MOST_ITEMS = 255
OVER = 1.4  # of a range: above it, a reading is over range
HEADROOM = 1.1  # of a range: automatic ranging leaves it only above
UPDATE_EVENT = 1
NO_DATA, OVERRANGE = bytes.fromhex("7E951BEE"), bytes.fromhex("7E94F56A")

Values = dict[str, float]


class AnalyzerPlant(Protocol):
    """What the analyzer sees of the plant."""

    @property
    def clock(self) -> Clock: ...
    def analyzer(self, update: int, update_s: float, ranges: Mapping[str, float]) -> dict[str, float]: ...


class ScpiAnalyzer:
    """The analyzer's state; ``handle`` takes the client's bytes and returns the replies."""

    def __init__(
        self, plant: AnalyzerPlant, *, identity: str = "YOKOGAWA,760304-40-MV,0,F5.01", elements: int = 4
    ) -> None:
        self._plant = plant
        self._identity = identity
        self._elements = elements
        self._server = ScpiServer(self._table(), NOT_FITTED)
        self._hanging = False
        self._defaults()

    def handle(self, chunk: bytes) -> bytes | None:
        """Answer the client; nothing more, ever, once a WAIT hangs."""
        return None if self._hanging else self._server.handle(chunk)

    def _defaults(self) -> None:
        channels = range(1, self._elements + 1)
        self._items = [f"{word},{n}" for n in channels for word in ("URMS", "IRMS", "P")]
        self._items += ["NONE"] * (MOST_ITEMS - len(self._items))
        self._number = DEFAULT_ITEMS
        self._update_s = 0.5
        self._ranges = {f"{quantity}{n}": steps[-1] for quantity, steps in RANGES.items() for n in channels}
        self._automatic = dict.fromkeys(self._ranges, False)
        self._binary = False
        self._scaled = False
        self._held: Values | None = None
        self._event_on_update = False
        self._values: Values = {}
        self._cleared = self._update()
        self._unsettle()

    def _table(self) -> dict[str, Method]:
        return {
            "*IDN": lambda _: self._identity,
            "*RST": lambda _: self._defaults(),
            ":RATE": self._rate,
            ":NUMeric:FORMat": self._format,
            ":NUMeric:HOLD": self._hold,
            ":NUMeric[:NORMal]:NUMBer": self._item_count,
            ":NUMeric[:NORMal]:ITEM#": self._item,
            ":NUMeric[:NORMal]:VALue": self._value,
            ":STATus:CONDition": lambda _: str(self._condition()),
            ":STATus:EESR": lambda _: str(self._event()),
            ":STATus:FILTer#": self._filter,
            ":COMMunicate:WAIT": self._wait,
            ":MEASure:AVERaging:STATe": self._averaging,
            ":[INPut:]SCALing:STATe[:ALL]": self._scaling,
            ":[INPut:]VOLTage:RANGe:ELEMent#": lambda call: self._range("U", call),
            ":[INPut:]CURRent:RANGe:ELEMent#": lambda call: self._range("I", call),
            ":[INPut:]VOLTage:AUTO:ELEMent#": lambda call: self._auto("U", call),
            ":[INPut:]CURRent:AUTO:ELEMent#": lambda call: self._auto("I", call),
        }

    # --- updates and values -------------------------------------------------------------------------

    def _update(self) -> int:
        """Number of updates that have ended."""
        return math.floor(self._plant.clock.now() / self._update_s + 1e-9)

    def _unsettle(self) -> None:
        """What is measured has changed: no data before the update under way has ended."""
        self._settled = self._update() + 1
        self._read = -1

    def _current(self) -> Values:
        """The values on the display: of the last update, or those held; NaN is no data, infinite is over."""
        if self._held is not None:
            return self._held
        update = self._update()
        if update != self._read:
            self._values = self._measure(update)
            self._read = update
        return self._values

    def _measure(self, update: int) -> Values:
        if update < self._settled:
            return {}
        values = self._plant.analyzer(update, self._update_s, dict(self._ranges))
        unobserved = update > self._read + 1
        for _ in RANGES["U"]:
            if not self._range_automatically(values):
                break
            if not unobserved:  # it happens now
                self._settled = update + 1
                return {}
            values = self._plant.analyzer(update, self._update_s, dict(self._ranges))
        return self._over_range(values)

    def _range_automatically(self, values: Values) -> bool:
        before = dict(self._ranges)
        for channel in (channel for channel, automatic in self._automatic.items() if automatic):
            value, present, steps = abs(values[channel]), self._ranges[channel], RANGES[channel[0]]
            too_wide = any(value <= step < present for step in steps)
            if value > HEADROOM * present or too_wide:
                self._ranges[channel] = next((s for s in steps if value <= HEADROOM * s), steps[-1])
        return self._ranges != before

    def _over_range(self, values: Values) -> Values:
        """The values, infinite where a voltage or current is too large for its range; its power with it."""
        over = {channel for channel, span in self._ranges.items() if abs(values[channel]) > OVER * span}
        over |= {f"P{channel[1]}" for channel in over}
        return {channel: math.inf if channel in over else value for channel, value in values.items()}

    def _reading(self, item: str) -> float:
        word, _, element = item.partition(",")
        return self._current().get(f"{FUNCTIONS.get(word, word)}{element}", math.nan)

    # --- commands -----------------------------------------------------------------------------------

    def _value(self, call: Call) -> str | bytes | None:
        if not call.asks:
            raise CommandError(*WRONG_PARAMETER)
        items = self._items[: self._number]
        if call.arguments:
            items = [self._items[self._whole(call.argument, 1, MOST_ITEMS) - 1]]
        readings = [self._reading(item) for item in items]
        if self._binary:
            block = b"".join(_float(reading) for reading in readings)
            return b"#4%04d" % len(block) + block
        return ",".join(_text(reading) for reading in readings)

    def _item(self, call: Call) -> str | None:
        position = self._whole(str(call.number), 1, MOST_ITEMS) - 1
        if call.asks:
            return self._items[position]
        word = call.arguments[0] if call.arguments else ""
        if word not in FUNCTIONS and word not in UNMEASURED:
            raise CommandError(*WRONG_PARAMETER)
        if word == "NONE":
            self._items[position] = word
            return None
        element = self._whole(call.arguments[1] if len(call.arguments) > 1 else "1", 1, self._elements)
        self._items[position] = f"{word},{element}"
        return None

    def _item_count(self, call: Call) -> str | None:
        if call.asks:
            return str(self._number)
        self._number = self._whole(call.argument, 1, MOST_ITEMS)
        return None

    def _format(self, call: Call) -> str | None:
        if call.asks:
            return "FLOAT" if self._binary else "ASCII"
        if call.argument not in ("ASC", "ASCII", "FLO", "FLOAT"):
            raise CommandError(*WRONG_PARAMETER)
        self._binary = call.argument.startswith("FLO")
        return None

    def _hold(self, call: Call) -> str | None:
        if call.asks:
            return str(int(self._held is not None))
        held = dict(self._current())
        self._held = held if parse_switch(call.argument) else None
        return None

    def _rate(self, call: Call) -> str | None:
        if call.asks:
            return _setting(self._update_s)
        seconds = parse_quantity(call.argument, "S")
        if not any(math.isclose(seconds, rate_s) for rate_s in RATES_S):
            raise CommandError(*OUT_OF_RANGE)
        self._update_s = seconds
        self._cleared = self._update()
        self._unsettle()
        return None

    def _range(self, quantity: str, call: Call) -> str | None:
        channel = f"{quantity}{self._whole(str(call.number), 1, self._elements)}"
        if call.asks:
            return _setting(self._ranges[channel])
        span = parse_quantity(call.argument, "V" if quantity == "U" else "A")
        if span not in RANGES[quantity]:
            raise CommandError(*OUT_OF_RANGE)
        if span != self._ranges[channel]:
            self._ranges[channel] = span
            self._unsettle()
        return None

    def _auto(self, quantity: str, call: Call) -> str | None:
        channel = f"{quantity}{self._whole(str(call.number), 1, self._elements)}"
        if call.asks:
            return str(int(self._automatic[channel]))
        self._automatic[channel] = parse_switch(call.argument)
        return None

    def _averaging(self, call: Call) -> str | None:
        """Off, and that for good: there is none here."""
        if call.asks:
            return "0"
        if parse_switch(call.argument):
            raise CommandError(*OUT_OF_RANGE)
        return None

    def _scaling(self, call: Call) -> str | None:
        """Of all elements, whose ratios and factors are 1."""
        if call.asks:
            return ";".join([str(int(self._scaled))] * self._elements)
        self._scaled = parse_switch(call.argument)
        return None

    # --- status -------------------------------------------------------------------------------------

    def _condition(self) -> int:
        """Bit 8 for element 1 over range, bit 9 for element 2, and so on."""
        over = {int(channel[1]) for channel, value in self._current().items() if math.isinf(value)}
        return sum(1 << (7 + element) for element in over)

    def _event(self) -> int:
        """The extended event register, which reading clears."""
        happened = self._event_on_update and self._update() > self._cleared
        self._cleared = self._update()
        return UPDATE_EVENT if happened else 0

    def _filter(self, call: Call) -> str | None:
        bit = self._whole(str(call.number), 1, 16)
        if call.asks:
            return "FALL" if bit == 1 and self._event_on_update else "NEVER"
        if call.argument not in ("RISE", "FALL", "BOTH", "NEV", "NEVER"):
            raise CommandError(*WRONG_PARAMETER)
        if bit == 1:
            self._event_on_update = call.argument in ("RISE", "FALL", "BOTH")
            self._cleared = self._update()
        return None

    def _wait(self, call: Call) -> None:
        mask = self._whole(call.argument, 0, 0xFFFF)
        if not (mask & UPDATE_EVENT and self._event_on_update):
            self._hanging = True
            return
        clock = self._plant.clock
        while self._update() <= self._cleared:
            clock.sleep(max((self._cleared + 1) * self._update_s - clock.now(), 1e-6))

    def _whole(self, word: str, least: int, most: int) -> int:
        if not re.fullmatch(r"\d{1,5}", word):
            raise CommandError(*WRONG_PARAMETER)
        if not least <= int(word) <= most:
            raise CommandError(*OUT_OF_RANGE)
        return int(word)


def _text(reading: float) -> str:
    if math.isnan(reading):
        return "NAN"
    return "INF" if math.isinf(reading) else f"{reading:.5E}"


def _float(reading: float) -> bytes:
    if math.isnan(reading):
        return NO_DATA
    return OVERRANGE if math.isinf(reading) else struct.pack(">f", reading)


def _setting(value: float) -> str:
    """Engineering notation with four digits: ``500.0E-03``, ``300.0E+00``."""
    exponent = 3 * math.floor(math.log10(value) / 3)
    return f"{value / 10.0**exponent:.4g}E{exponent:+03d}"
