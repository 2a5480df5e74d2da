"""What differs between power analyzers, as data: one TOML file per model in ``drivers/maps``."""

import re
import tomllib
from collections.abc import Collection, Iterable, Mapping, Sequence
from importlib import resources
from typing import Literal, Self

from pydantic import BaseModel, ConfigDict, ValidationError, model_validator

from drivers.errors import IdentityError, LimitError

Quantity = Literal["U", "I", "P"]
Ranged = Literal["U", "I"]
Kind = Literal["dc", "ac"]
_CHANNEL = re.compile(r"^([UIP])([1-9])$")


class _Table(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class Function(_Table):
    """How one quantity is asked for, at a dc port and in the ac link, and the unit it comes in."""

    dc: str
    ac: str
    unit: str


class RangeCommand(_Table):
    """The headers that set a measuring range and switch automatic ranging; ``{element}`` is filled in."""

    set: str
    auto: str
    unit: str


class Accuracy(_Table):
    """Limits of error as (fraction of the reading, fraction of the range)."""

    dc: tuple[float, float]
    ac: tuple[float, float] | None = None


class ConditionBit(_Table):
    """One bit of the condition register that spoils readings: those of ``element``, or all."""

    bit: int
    meaning: str
    element: int | None = None


class AnalyzerModel(_Table):
    """One family of power analyzers.

    ``setup`` are commands that bring it to where it is expected, ``scaling`` is the query whether elements multiply
    what they measure; None where it cannot be asked.
    """

    kind: Literal["analyzer"]
    maker: str
    name: str
    terminator: Literal["\n", "\r\n"]
    max_items: int
    rates_s: tuple[float, ...]
    voltage_ranges_V: tuple[float, ...]
    current_ranges_A: tuple[float, ...]
    setup: tuple[str, ...]
    scaling: str | None = None
    elements: dict[str, tuple[int, ...]]
    functions: dict[Quantity, Function]
    ranges: dict[Ranged, RangeCommand]
    accuracy: dict[Quantity, Accuracy]
    condition: tuple[ConditionBit, ...]

    @model_validator(mode="after")
    def _in_order(self) -> Self:
        for steps in (self.rates_s, self.voltage_ranges_V, self.current_ranges_A):
            if list(steps) != sorted(set(steps)) or steps[0] <= 0:
                raise ValueError(f"{steps}: steps are above 0, and rise")
        return self

    def fitted_elements(self, model_field: str) -> tuple[int, ...]:
        """The elements of the instrument of that model field; ``IdentityError`` for another family's."""
        for code, elements in self.elements.items():
            if model_field.startswith(code):
                return elements
        codes = ", ".join(self.elements)
        raise IdentityError(f"{model_field!r} is not a {self.name}: that would begin with one of {codes}")

    def steps(self, quantity: Ranged) -> tuple[float, ...]:
        """The ranges that exist, in V or A."""
        return self.voltage_ranges_V if quantity == "U" else self.current_ranges_A

    def range_command(self, quantity: Quantity) -> RangeCommand:
        """How the range of a quantity is set; power has none of its own."""
        if quantity == "P":
            raise LimitError("power has no range of its own: set those of U and I")
        return self.ranges[quantity]

    def problems(
        self,
        items: Sequence[str],
        update_s: float,
        ranges: Mapping[str, float],
        fitted: Collection[int],
    ) -> list[str]:
        """All that is wrong with a choice of items, update interval and ranges; empty when nothing is."""
        wrong = [
            f"item {item}: this {self.name} has the elements {_listed(fitted)}"
            for item in items
            if split_channel(item)[1] not in fitted
        ]
        if not 0 < len(items) <= self.max_items:
            wrong.append(f"{len(items)} items: 1 to {self.max_items} are possible")
        if len(set(items)) < len(items):
            wrong.append("an item stands twice")
        if update_s not in self.rates_s:
            wrong.append(f"update interval {update_s:g} s: the {self.name} has {_listed(self.rates_s)} s")
        return wrong + self.range_problems(ranges, fitted)

    def range_problems(self, ranges: Mapping[str, float], fitted: Collection[int]) -> list[str]:
        """All that is wrong with a choice of ranges."""
        wrong = []
        for channel, value in ranges.items():
            quantity, element = split_channel(channel)
            if quantity == "P":
                wrong.append(f"range {channel}: power has no range of its own, U and I have")
            elif element not in fitted:
                wrong.append(f"range {channel}: this {self.name} has the elements {_listed(fitted)}")
            elif value not in self.steps(quantity):
                wrong.append(f"range {channel} = {value:g}: there are {_listed(self.steps(quantity))}")
        return wrong

    def error_limit(self, quantity: Quantity, kind: Kind, reading: float, range_value: float) -> float:
        """Largest error of a reading, in its own unit; for P the range is that of U times that of I.

        Raises ``LookupError`` where the maker's figure for the ac link was not found.
        """
        limits = getattr(self.accuracy[quantity], kind)
        if limits is None:
            raise LookupError(f"{self.name} has no accuracy of {quantity} for {kind}")
        of_reading, of_range = limits
        return float(of_reading * abs(reading) + of_range * range_value)


def split_channel(channel: str) -> tuple[Quantity, int]:
    """Quantity and element of a channel name.

    >>> split_channel("U1")
    ('U', 1)
    """
    match = _CHANNEL.match(channel)
    if match is None:
        raise LimitError(f"{channel!r} is not a channel: U, I or P and an element, such as U1")
    return match[1], int(match[2])  # type: ignore[return-value]  # the pattern allows U, I and P only


def load_analyzer_model(name: str) -> AnalyzerModel:
    """The model in ``drivers/maps/<name>.toml``; a ``ValueError`` names the field or the models there are."""
    folder = resources.files("drivers") / "maps"
    file = folder / f"{name}.toml"
    if not re.fullmatch(r"\w+", name) or not file.is_file():
        raise ValueError(f"no analyzer model {name!r}: there are {', '.join(_model_names())}")
    try:
        return AnalyzerModel.model_validate(tomllib.loads(file.read_text(encoding="utf-8")))
    except ValidationError as error:
        raise ValueError(f"drivers/maps/{name}.toml is not an analyzer model: {error}") from error


def _listed(numbers: Iterable[float]) -> str:
    return ", ".join(f"{number:g}" for number in numbers)


def _model_names() -> list[str]:
    folder = resources.files("drivers") / "maps"
    files = (file for file in folder.iterdir() if file.name.endswith(".toml"))
    return sorted(
        file.name.removesuffix(".toml")
        for file in files
        if tomllib.loads(file.read_text(encoding="utf-8")).get("kind") == "analyzer"
    )
