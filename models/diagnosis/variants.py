"""What is simulated of a baseline: itself, every effect at a small step, every part at one sigma, other inputs."""

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from numpy.typing import NDArray

from models.diagnosis.lines import Lines, key_of
from models.diagnosis.near_limit import LINK_INDUCTANCE
from models.diagnosis.observations import Observations
from models.diagnosis.predictions import Variant
from sim.effects.base import Effect
from sim.effects.catalogue import CATALOGUE
from sim.effects.parameter_effect import ParameterEffect
from sim.model import Model
from sim.operating_points import Points
from sim.parameters import Converter, ParameterError
from sim.simulate import Case, Result
from sim.spread import Spread, everyday_spread

Array = NDArray[np.float64]

_VOLTAGE_GAIN = 5e-4 / 3**0.5  # of a dc voltage: 0.05 % of reading, uniform
P2_NOISE = 1e-4  # of reading, one averaged reading
# Assumption: what a supply, a load and a room may be off from nominal where nobody read them, one sigma
_VOLTAGE_UNREAD, _ROOM_K = 0.015, 5.0
# of the steps that are simulated
UNREAD = {
    "V1_V": _VOLTAGE_UNREAD / _VOLTAGE_GAIN,
    "V2_V": _VOLTAGE_UNREAD / _VOLTAGE_GAIN,
    "T_ambient_C": 1.0,
}
INPUTS = 5  # variants of inputs that are always asked for
APART = 0.03  # of the power: steps over which D0 has to be nearly straight
# of the effect's prior scale: small enough to be nearly linear, large against the solver's tolerance
_STEP = 0.2


@dataclass(frozen=True, slots=True, kw_only=True)
class Asked:
    """An effect with the values beside its headline's."""

    entry: Effect
    other: dict[str, float]

    def of(self, baseline: Model) -> Model:
        """The baseline with the effect at its step."""
        entry = self.entry
        values = {entry.headline.name: entry.headline.off + step_of(entry), **self.other}
        return baseline.with_effect(entry.name, **values)


@dataclass(frozen=True, slots=True, kw_only=True)
class Moved:
    """What readings are in each variant, (.., M): with effects, with parts off, and with other inputs.

    ``limit`` are those with the link inductance off to the other side, where efficiency is alone.
    """

    effects: Array
    spreads: Array
    limit: Array
    inputs: Array


@dataclass(frozen=True, slots=True, kw_only=True)
class Variants:
    """The effects and parts of a baseline, and all that is simulated, by key: the baseline first, the inputs last.

    ``conditions`` are those of which it is asked what they would change.
    """

    effects: tuple[Asked, ...]
    spreads: tuple[Spread, ...]
    limit: tuple[int, ...]
    cases: Mapping[Variant, Case]
    conditions: tuple[str, ...] = ()

    @classmethod
    def of(cls, observations: Observations, baseline: Model, among: Collection[str] | None) -> Self:
        """At the rows with readings; of effects those ``among``, all by default, and what has an everyday tolerance."""
        at, spreads = observations.points.take(np.unique(observations.row)), _spreads(baseline)
        effects = tuple(
            Asked(entry=entry, other=other)
            for entry in _entries(baseline)
            if among is None or entry.name in among or is_everyday(entry, spreads)
            for other in entry.variants()
        )
        alone = observations.efficiency_alone
        limit = tuple(k for k, s in enumerate(spreads) if s.path == LINK_INDUCTANCE and alone)
        cases: dict[Variant, Case] = {("baseline",): (baseline, at)}
        cases |= {(a.entry.name, *a.other.items()): (a.of(baseline), at) for a in effects}
        for s, sigmas in (*((s, 1.0) for s in spreads), *((spreads[k], -1.0) for k in limit)):
            shifted = Model(converter=s.shifted(baseline.converter, sigmas), effects=baseline.effects)
            cases["spread", s.path, sigmas] = shifted, at
        conditions = tuple(UNREAD) if among is None and not alone else ()
        moved = [*_inputs(at), *(_in_another_room(at) if conditions else ())]
        cases |= {("input", k): (baseline, there) for k, there in enumerate(moved)}
        return cls(effects=effects, spreads=spreads, limit=limit, cases=cases, conditions=conditions)

    def moved(self, readings: Sequence[Array]) -> Moved:
        """Readings (M,) of all cases but the baseline, in their order."""
        ends = np.cumsum([len(self.effects), len(self.spreads), len(self.limit)])
        effects, spreads, limit, inputs = np.split(np.stack(readings), ends)
        return Moved(effects=effects, spreads=spreads, limit=limit, inputs=inputs)

    def lines(self, results: Sequence[Result]) -> Lines:
        """How the unknowns move, from simulations of the cases in their order."""
        base, *moved = (r.state for r in results[: 1 + len(self.effects) + len(self.spreads)])
        effects = {
            key_of(a.entry.name, a.other): (there - base) / step_of(a.entry)
            for a, there in zip(self.effects, moved[: len(self.effects)], strict=True)
        }
        return Lines.of(base, np.stack(moved[len(self.effects) :]) - base, effects)

    def usual(self) -> list[float]:
        """Of the baseline's everyday state: how many steps of each effect, then how many sigmas of each part."""
        steps = [
            a.entry.headline.tolerance / step_of(a.entry) * is_everyday(a.entry, self.spreads, a.other)
            for a in self.effects
        ]
        return [*steps, *(1.0 for _ in self.spreads)]


def step_of(entry: Effect) -> float:
    """A step of the headline value that stays inside its bounds."""
    step = _STEP * entry.headline.prior
    return step if entry.headline.off + step <= entry.headline.upper else -step


def sigma_unread(column: str, nominal: float) -> float:
    """What a condition that nobody read may be off from nominal, one sigma: in V or K."""
    return _ROOM_K if column == "T_ambient_C" else _VOLTAGE_UNREAD * nominal


def is_everyday(entry: Effect, spreads: tuple[Spread, ...], other: Mapping[str, float] | None = None) -> bool:
    """Whether every bench has a little of an effect, beside the spreads of the converter's parameters.

    ``other`` are the values beside its headline's: of several variants it is the one with all of them at off.
    """
    off = entry.off_values()
    if any(value != off[name] for name, value in (other or {}).items()):
        return False
    paths = entry.paths if isinstance(entry, ParameterEffect) else ()
    own = entry.together or {spread.path for spread in spreads}.isdisjoint(paths)
    return own and not entry.threshold and entry.headline.tolerance > 0


def _entries(baseline: Model) -> Iterator[Effect]:
    """The catalogue as the baseline has it: of its converter's size, about the effects that it has already."""
    for name, entry in CATALOGUE.items():
        sized, there = entry.at(baseline.converter), baseline.effects.get(name)
        about = sized if there is None else sized.about(there)
        if _applies(about, baseline.converter):
            yield about


def _applies(entry: Effect, converter: Converter) -> bool:
    """Whether a converter has the parts that an effect changes."""
    try:
        entry.converter(converter, {entry.headline.name: entry.headline.off + step_of(entry)})
    except ParameterError:
        return False
    return True


def _spreads(baseline: Model) -> tuple[Spread, ...]:
    """The everyday spreads of the baseline's parts; one that an effect of it replaced has none."""
    entries = map(CATALOGUE.__getitem__, baseline.effects)
    replaced = {path for e in entries if isinstance(e, ParameterEffect) for path in e.replaces}
    return tuple(spread for spread in everyday_spread(baseline.converter) if spread.path not in replaced)


def _in_another_room(p: Points) -> list[Points]:
    """The points in a warmer room: one sigma of one that nobody read."""
    return [replace(p, ambient_C=np.asarray(p.ambient_C) + _ROOM_K)]


def _inputs(p: Points) -> list[Points]:
    """The points with errors of V1, V2 and P2, and with more and less power."""
    return [
        replace(p, V1_V=p.V1_V * (1 + _VOLTAGE_GAIN)),
        replace(p, V2_V=p.V2_V * (1 + _VOLTAGE_GAIN)),
        replace(p, power_W=p.power_W * (1 + P2_NOISE)),
        replace(p, power_W=p.power_W * (1 + APART)),
        replace(p, power_W=p.power_W * (1 - APART)),
    ]
