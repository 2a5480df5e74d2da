"""A simulation model: a baseline converter and effects with their values."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from sim.converter_data import converter_from_plain, converter_to_plain
from sim.effects.base import Effect
from sim.effects.catalogue import effect
from sim.operating_points import Points
from sim.parameters import Converter, ParameterError
from sim.prototype import prototype

Array = NDArray[np.float64]
Values = dict[str, float]


@dataclass(frozen=True, slots=True, kw_only=True)
class Model:
    """Baseline plus effects, ``{effect: {parameter: value}}``; an effect that is left out is off."""

    converter: Converter
    effects: Mapping[str, Values] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for entry, values in self._entries():
            entry.check(values)
        self.altered_converter()  # an effect that this converter cannot have is refused here

    @classmethod
    def baseline(cls, modulation: str = "hybrid") -> Self:
        """The prototype with nothing added."""
        return cls(converter=replace(prototype(), modulation=modulation))

    @classmethod
    def from_plain(cls, data: Mapping[str, Any]) -> Self:
        """What :meth:`as_plain` told; ParameterError or KeyError where it does not describe a model."""
        described, modulation = data["converter"], data["modulation"]
        if isinstance(described, str):
            if described != prototype().name:
                raise ParameterError(f"no converter is called {described!r}; allowed is {prototype().name!r}")
            return cls(converter=replace(prototype(), modulation=modulation), effects=data["effects"])
        return cls(converter=converter_from_plain(described, modulation), effects=data["effects"])

    def _entries(self) -> list[tuple[Effect, Values]]:
        """The effects as this converter has them, with their values."""
        return [(effect(name).at(self.converter), values) for name, values in self.effects.items()]

    def driven_by(self, modulation: str) -> Self:
        """This model under another modulation; ParameterError where its primary does not have it."""
        return replace(self, converter=replace(self.converter, modulation=modulation))

    def with_effect(self, name: str, **values: float) -> Self:
        """This model with one more effect, or with other values of it; the headline may be left unnamed."""
        return type(self)(converter=self.converter, effects={**self.effects, name: dict(values)})

    def altered_converter(self) -> Converter:
        """The converter as the effects leave it."""
        converter = self.converter
        for entry, values in self._entries():
            converter = entry.converter(converter, values)
        return converter

    def set_points(self, points: Points) -> Points:
        """The points as they are really applied."""
        points = points.with_voltages_of(self.converter)
        for entry, values in self._entries():
            points = entry.set_points(points, values)
        return points.behind(self.altered_converter().output_cable_Ohm) if np.any(points.held) else points

    def added_loss_W(self, points: Points, state: Mapping[str, Array]) -> Array:
        """Losses at the input that effects add to what the circuit has, (N,)."""
        total = np.zeros(len(points))
        for entry, values in self._entries():
            total = total + entry.added_loss_W(points, state, values)
        return total

    def observe(self, points: Points, truth: dict[str, Array]) -> dict[str, Array]:
        """What the instruments show of the truth."""
        for entry, values in self._entries():
            truth = entry.observe(points, truth, values)
        return truth

    def as_plain(self) -> dict[str, Any]:
        """Plain data: the converter (by name where it is the prototype), modulation, effects with their values."""
        known = self.converter == replace(prototype(), modulation=self.converter.modulation)
        return {
            "modulation": self.converter.modulation,
            "converter": self.converter.name if known else converter_to_plain(self.converter),
            "effects": {name: dict(values) for name, values in self.effects.items()},
        }
