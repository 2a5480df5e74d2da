"""Power analyzer over SCPI: which values to measure, and each update of them exactly once.

A reading is of an update that ended after it was asked for: the event register is cleared, the instrument
itself waits for the end of the next update, and only then are the values read. A record that is
bit-identical to the one before is the same update, whatever the instrument says, and is asked for again.
"""

import math
from collections.abc import Collection, Mapping, Sequence

from drivers.analyzer_model import AnalyzerModel, load_analyzer_model, split_channel
from drivers.clock import Clock, WallClock
from drivers.errors import IdentityError, LimitError, ReadbackError, ReplyError
from drivers.health import Health
from drivers.identity import Identity
from drivers.reading import Quality, Reading
from drivers.scpi import (
    Number,
    ScpiLink,
    parse_any_switch,
    parse_floats,
    parse_identity,
    parse_measured,
    parse_register,
    parse_setting,
)
from drivers.transport import USUAL, ByteLink, Patience

__all__ = ["Analyzer", "AnalyzerModel", "load_analyzer_model"]

HOLD_OFF = ":NUMERIC:HOLD OFF"
START = (
    ":COMMUNICATE:HEADER OFF",
    ":COMMUNICATE:VERBOSE OFF",
    HOLD_OFF,  # a run that crashed may have left it on, and every value frozen
    ":STATUS:FILTER1 FALL",  # event bit 0: an update has ended
)
VALUES = ":NUMERIC:NORMAL:VALUE?"
STALE_RETRIES = 2
SCALED = (
    "scaling is on and was expected off: its elements multiply by a sensor's ratio or a factor; switch it off at the "
    "instrument, or say scaled = true where the sensors need it"
)
NOT_SCALED = (
    "scaling is off and was expected on: set the sensors' ratios at the instrument and switch it on, or leave scaled "
    "out"
)


class Analyzer:
    """A power analyzer of one model.

    Parameters
    ----------
    link : the open byte link.
    model : what is particular to the instrument.
    clock : the bench's clock; it stamps the readings.
    speed : how many of the clock's seconds pass in a real one (1 on a real bench).
    patience : with an immediate reply; waiting for an update comes on top.
    binary : read the values as FLOAT blocks instead of text: shorter on a slow line.
    """

    def __init__(
        self,
        link: ByteLink,
        model: AnalyzerModel,
        *,
        clock: Clock | None = None,
        speed: float = 1.0,
        patience: Patience = USUAL,
        binary: bool = False,
    ) -> None:
        self.model = model
        self._link = link
        self._clock = clock or WallClock()
        self._speed = speed
        self._patience = patience
        self._binary = binary
        self._scpi = ScpiLink(
            link,
            timeout_s=patience.timeout_s,
            lateness_s=patience.lateness_s,
            terminator=model.terminator.encode(),
        )
        self._items: tuple[str, ...] = ()
        self._elements: tuple[int, ...] = tuple(sorted({e for es in model.elements.values() for e in es}))
        self._update_s = 0.0
        self._scaled: bool | None = None  # None: not known
        self._last: bytes | str | None = None

    def identify(self) -> Identity:
        """Bring the link into step, make sure who answers, and make its replies plain.

        Raises
        ------
        IdentityError : something else than an instrument of this model answered.
        """
        with self._scpi.lock:
            self._scpi.resynchronise()
            maker, model, serial, firmware = self._scpi.query("*IDN?", parse_identity)
            if maker.upper() != self.model.maker:
                raise IdentityError(
                    f"{maker} {model} answered; {self.model.maker} {self.model.name} was expected",
                    resource=self._link.resource,
                )
            self._elements = self.model.fitted_elements(model)
            for command in START:
                self._scpi.command(command)
            if self.model.scaling is not None:
                self._scaled = self._scpi.query(self.model.scaling, parse_any_switch)
        return Identity(maker=maker, model=model, serial="" if serial == "0" else serial, firmware=firmware)

    def configure(
        self,
        items: Sequence[str],
        update_s: float,
        ranges: Mapping[str, float] | None = None,
        *,
        ac_elements: Collection[int] = (3, 4),
        scaled: bool = False,
    ) -> None:
        """Choose what is measured, how often, and on which ranges; everything is read back.

        Parameters
        ----------
        items : channels, quantity and element: ``["U1", "I1", "P1", "U2", ...]``.
        update_s : update interval in seconds, one that the model has.
        ranges : fixed ranges in V or A, by channel; the others range automatically.
        ac_elements : elements that are wired to the ac link: measured by rms, not by mean.
        scaled : whether elements are meant to multiply what they measure, by the ratio of a sensor, say.

        Raises
        ------
        LimitError : an item, interval or range that the instrument has not; nothing was sent.
        InstrumentRefused, ReadbackError : the instrument did not take it.
        """
        fixed = dict(ranges or {})
        if wrong := self.problems(items, update_s, fixed, scaled=scaled):
            raise LimitError("; ".join(wrong))
        with self._scpi.lock:
            for command in (*START, *self.model.setup, *self._item_commands(items, ac_elements)):
                self._scpi.command(command)
            self._scpi.command(f":RATE {_interval(update_s)}")
            self._check("update interval", ":RATE?", update_s)
            self._check("number of items", ":NUMERIC:NORMAL:NUMBER?", len(items))
            self._items, self._update_s = tuple(items), update_s
            self._scpi.lateness_s = self._patience.lateness_s + update_s / self._speed
            for channel in self._range_channels():
                if channel not in fixed:
                    self._scpi.command(f"{self._range_headers(channel)[1]} ON")
            self.set_ranges(fixed)

    def problems(
        self, items: Sequence[str], update_s: float, ranges: Mapping[str, float], *, scaled: bool = False
    ) -> list[str]:
        """All that :meth:`configure` would refuse before anything is sent; empty when nothing is wrong."""
        wrong = self.model.problems(items, update_s, ranges, self._elements)
        if self._scaled is not None and self._scaled != scaled:
            wrong.append(SCALED if self._scaled else NOT_SCALED)
        return wrong

    def set_ranges(self, ranges: Mapping[str, float]) -> None:
        """Set fixed ranges in V or A, by channel (``{"U1": 300, "I1": 10}``), and read them back."""
        if wrong := self.model.range_problems(ranges, self._elements):
            raise LimitError("; ".join(wrong))
        with self._scpi.lock:
            for channel, value in ranges.items():
                header, automatic, unit = self._range_headers(channel)
                self._scpi.command(f"{automatic} OFF")
                self._scpi.command(f"{header} {value:g}{unit}")
            for channel, value in ranges.items():  # after all are set: some models share one range
                self._check(f"range {channel}", f"{self._range_headers(channel)[0]}?", value)

    def ranges(self) -> dict[str, float]:
        """The ranges in use, in V and A, read from the instrument: of the configured elements, or of all."""
        with self._scpi.lock:
            return {
                channel: self._scpi.query(f"{self._range_headers(channel)[0]}?", parse_setting)
                for channel in self._range_channels()
            }

    def read(self) -> dict[str, Reading]:
        """One fresh update, by channel; takes up to two update intervals.

        A value that the instrument does not vouch for comes with the quality that says why; all of them are
        ``STALE`` when the instrument repeats one update although it was asked for the next.
        """
        if not self._items:
            raise ReplyError("the analyzer has no items yet: configure() comes before read()")
        with self._scpi.lock:
            for attempt in range(1 + STALE_RETRIES):
                if attempt == STALE_RETRIES:
                    self._scpi.command(HOLD_OFF)  # has somebody frozen the display?
                record, numbers = self._fresh_record()
                stale = record == self._last and _tells(numbers)
                self._last = record
                if not stale:
                    break
            spoiled = self._spoiled_elements()
        time_s = self._clock.now()
        return {
            item: self._reading(item, number, time_s, stale=stale, spoiled=spoiled)
            for item, number in zip(self._items, numbers, strict=True)
        }

    @property
    def health(self) -> Health:
        """How well its link does."""
        return self._link.health

    @property
    def resource(self) -> str:
        """Where it is reached."""
        return self._link.resource

    def close(self) -> None:
        """Close the link."""
        self._link.close()

    def _fresh_record(self) -> tuple[bytes | str, list[Number]]:
        """The values of the next update, as they came and as numbers."""
        timeout_s = 2.0 * self._update_s / self._speed + self._patience.timeout_s
        self._scpi.query(":STATUS:EESR?", parse_register)
        self._scpi.write(":COMMUNICATE:WAIT 1")
        if self._binary:
            return self._scpi.query_block(
                VALUES, lambda block: (block, self._counted(parse_floats(block))), timeout_s
            )
        return self._scpi.query(VALUES, lambda text: (text, self._counted(parse_measured(text))), timeout_s)

    def _counted(self, numbers: list[Number]) -> list[Number]:
        if len(numbers) != len(self._items):
            raise ReplyError(f"{len(numbers)} values came; {len(self._items)} items were configured")
        return numbers

    def _spoiled_elements(self) -> set[int]:
        """Elements whose readings the condition register declares over range."""
        register = self._scpi.query(":STATUS:CONDITION?", parse_register)
        spoiled: set[int] = set()
        for condition in self.model.condition:
            if register >> condition.bit & 1:
                spoiled |= {condition.element} if condition.element is not None else set(self._elements)
        return spoiled

    def _reading(
        self, item: str, number: Number, time_s: float, *, stale: bool, spoiled: set[int]
    ) -> Reading:
        quantity, element = split_channel(item)
        quality = number.quality
        if quality is Quality.GOOD and element in spoiled:
            quality = Quality.OVERRANGE
        if quality is Quality.GOOD and stale:
            quality = Quality.STALE
        unit = self.model.functions[quantity].unit
        return Reading(value=number.value, unit=unit, time_s=time_s, quality=quality)

    def _item_commands(self, items: Sequence[str], ac_elements: Collection[int]) -> list[str]:
        commands = [f":NUMERIC:FORMAT {'FLOAT' if self._binary else 'ASCII'}"]
        commands.append(f":NUMERIC:NORMAL:NUMBER {len(items)}")
        for position, item in enumerate(items, start=1):
            quantity, element = split_channel(item)
            function = self.model.functions[quantity]
            word = function.ac if element in ac_elements else function.dc
            commands.append(f":NUMERIC:NORMAL:ITEM{position} {word},{element}")
        return commands

    def _range_channels(self) -> list[str]:
        elements = sorted({split_channel(item)[1] for item in self._items}) or self._elements
        return [f"{quantity}{element}" for element in elements for quantity in "UI"]

    def _range_headers(self, channel: str) -> tuple[str, str, str]:
        """The headers of a range and of its automatic choice, and its unit."""
        quantity, element = split_channel(channel)
        command = self.model.range_command(quantity)
        return command.set.format(element=element), command.auto.format(element=element), command.unit

    def _check(self, what: str, query: str, expected: float) -> None:
        actual = self._scpi.query(query, parse_setting)
        if not math.isclose(actual, expected, rel_tol=1e-3):  # settings come back with four digits
            raise ReadbackError(
                f"the analyzer's {what} is {actual:g} after it was set to {expected:g}",
                command=query,
                resource=self._link.resource,
            )


def _tells(numbers: list[Number]) -> bool:
    """Whether two equal records of these values mean one update: zeros and missing values may repeat."""
    return any(number.quality is Quality.GOOD and number.value != 0.0 for number in numbers)


def _interval(update_s: float) -> str:
    return f"{update_s:g}S" if update_s >= 1.0 else f"{update_s * 1000:g}MS"
