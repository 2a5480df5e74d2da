"""An effect that scales, adds to or replaces named parameters of the converter, as far as it has room for."""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from operator import attrgetter
from typing import Any, Self

import numpy as np
from scipy.optimize import bisect

from sim.effects.base import Effect, Values
from sim.parameters import Converter, ParameterError


def scaled(old: Any, value: float) -> Any:
    """A share more."""
    return old * (1.0 + value)


def added(old: Any, value: float) -> Any:
    """So much more."""
    return old + value


def shortened_to_nothing_at_most(old: Any, value: float) -> Any:
    """So much more, or as much less as there is."""
    return np.maximum(old + value, 0.0)


def replaced(old: Any, value: float) -> Any:
    """Another value."""
    return value


_OF_WHAT_THERE_IS = (
    0.7  # may be missing, or of the room above: a part at three sigmas of its tolerance has as much
)


@dataclass(frozen=True, slots=True, kw_only=True)
class ParameterEffect(Effect):
    """Changes the parameters at ``paths`` (dotted) by ``change(old, value)``; a converter need not have all of them.

    ``junction`` narrows paths of devices in conduction: to those that drop a voltage at any current (IGBTs and diodes)
    where true, to those that do not (FETs) where false.
    """

    paths: tuple[str, ...]
    change: Callable[[Any, float], Any]
    junction: bool | None = None

    def at(self, converter: Converter) -> Self:
        """The effect as a converter has it: nothing is searched that it has no room for.

        That is what would take more of a parameter than there is, or make it more than it may be: a dead time is a
        share of the half period at most.
        """
        sized = Effect.at(self, converter)  # super() does not know a class that slots have made anew
        if self.change in (scaled, replaced) or not (there := self.present(converter)):
            return sized
        head = sized.headline
        lower, upper = head.lower, head.upper
        if self.change is added and lower < 0.0 and not sized._possible(converter, lower):
            least = min(float(attrgetter(path)(converter)) for path in there)
            lower = max(lower, 0.0 - _OF_WHAT_THERE_IS * least)
        if not sized._possible(converter, upper):
            most = bisect(lambda value: 0.5 - sized._possible(converter, value), head.off, upper)
            upper = head.off + _OF_WHAT_THERE_IS * (float(most) - head.off)
        if (lower, upper) == (head.lower, head.upper):
            return sized
        return replace(sized, parameters=(replace(head, lower=lower, upper=upper), *sized.parameters[1:]))

    def _possible(self, converter: Converter, value: float) -> bool:
        """Whether a converter can have the headline at a value."""
        try:
            self.converter(converter, {self.headline.name: value})
        except ParameterError:
            return False
        return True

    def present(self, converter: Converter) -> list[str]:
        """The paths that a converter has."""
        there = [path for path in self.paths if _has(converter, path.split("."))]
        return there if self.junction is None else [p for p in there if _drops(converter, p) == self.junction]

    @property
    def replaces(self) -> tuple[str, ...]:
        """The paths of which nothing is left where the effect is there."""
        return self.paths if self.change is replaced else ()

    def spread_at(self, value: float, everyday: float, sigmas: float = 0.0) -> float:
        """A scaled part's spread is a ratio to all there is; a part that was replaced has its value and no spread."""
        if self.replaces:
            return 0.0
        if self.change is not scaled:
            return everyday
        ratio = everyday / (1.0 + self.headline.off)
        away = sigmas * ratio
        return (1.0 + value) * ratio * (math.expm1(away) / away if away else 1.0)

    def converter(self, converter: Converter, values: Values) -> Converter:
        """The converter with the named parameters changed; the very same object at the OFF value."""
        value = self.value(values)
        if value == self.headline.off:
            return converter
        there = self.present(converter)
        if not there:
            raise ParameterError(
                f"{self.name} does not apply: {converter.name!r} has no {' or '.join(self.paths)}"
            )
        for path in there:
            converter = _replace_at(converter, path.split("."), self.change, value)
        return converter


def _has(owner: Any, path: list[str]) -> bool:
    return not path or (hasattr(owner, path[0]) and _has(getattr(owner, path[0]), path[1:]))


def _drops(converter: Converter, path: str) -> bool:
    """Whether the device whose conduction a path is a parameter of drops a voltage at any current."""
    return bool(np.any(np.asarray(attrgetter(path.rpartition(".")[0])(converter).threshold_V) != 0.0))


def _replace_at(owner: Any, path: list[str], change: Callable[[Any, float], Any], value: float) -> Any:
    name, *rest = path
    old = getattr(owner, name)
    new = _replace_at(old, rest, change, value) if rest else change(old, value)
    return replace(owner, **{name: new})
