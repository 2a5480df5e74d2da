"""What an effect is: something a converter or a bench may have that the baseline does not model.

An effect changes one stage only, by overriding that one method; every other method hands back what it got. One with a
threshold also overrides ``undecided``, which changes nothing: it tells which points may lie on either side.
Its OFF value leaves results bit-identical.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from sim.operating_points import Points
from sim.parameters import Converter, ParameterError
from sim.size import size

Array = NDArray[np.float64]
Values = Mapping[str, float]


@dataclass(frozen=True, slots=True, kw_only=True)
class EffectParameter:
    """One parameter of an effect.

    ``tolerance`` is the everyday spread (one sigma) that every bench has about ``off``; ``prior`` the scale
    (one sigma) of the values that deserve the effect's name; ``lower`` and ``upper`` bound both. ``scan``
    lists values to try of a parameter in which the effect is not smooth (a threshold), ``starts`` those
    from which a search should set out where the effect is far from a line. What is ``reciprocal`` acts by one over it.
    All of them are stated for the prototype; ``goes_by`` is what of a converter's :func:`sim.size.size` they go by,
    where they do.
    """

    name: str
    unit: str
    lower: float
    upper: float
    tolerance: float
    prior: float
    off: float = 0.0
    scan: tuple[float, ...] = ()
    starts: tuple[float, ...] = ()
    reciprocal: bool = False
    goes_by: str = ""

    def at(self, converter: Converter) -> Self:
        """The parameter as a converter of any size has it."""
        factor = size(self.goes_by, converter) if self.goes_by else 1.0
        if factor == 1.0:
            return self
        return replace(
            self,
            lower=factor * self.lower,
            upper=factor * self.upper,
            tolerance=factor * self.tolerance,
            prior=factor * self.prior,
            off=factor * self.off,
            scan=tuple(factor * value for value in self.scan),
            starts=tuple(factor * value for value in self.starts),
        )

    def acting(self, value: float) -> tuple[float, float]:
        """Distance of a value from off as it acts, in the unit at off, and its slope over the value.

        >>> head = EffectParameter(
        ...     name="L_H", unit="H", lower=1e-3, upper=1.0, tolerance=1e-3, prior=6e-3, off=0.01, reciprocal=True
        ... )
        >>> head.acting(0.02)  # half of the current is gone
        (0.005, 0.25)
        """
        if not self.reciprocal:
            return value - self.off, 1.0
        return self.off * (1.0 - self.off / value), (self.off / value) ** 2

    def inside(self, acting: float) -> tuple[float, float]:
        """The values, within the bounds, that act no further from off than that.

        >>> head = EffectParameter(
        ...     name="L_H", unit="H", lower=6e-3, upper=1.0, tolerance=1e-3, prior=6e-3, off=0.01, reciprocal=True
        ... )
        >>> head.inside(0.005)
        (0.006666666666666667, 0.02)
        """
        return max(self.value_of(-acting), self.lower), min(self.value_of(acting), self.upper)

    def value_of(self, acting: float) -> float:
        """The value that acts so far from off, in the unit at off, whatever its bounds.

        >>> head = EffectParameter(
        ...     name="L_H", unit="H", lower=6e-3, upper=1.0, tolerance=1e-3, prior=6e-3, off=0.01, reciprocal=True
        ... )
        >>> head.value_of(0.005)
        0.02
        """
        if not self.reciprocal:
            return self.off + acting
        return self.off / (1.0 - acting / self.off) if acting < self.off else np.inf


@dataclass(frozen=True, slots=True, kw_only=True)
class Effect:
    """An entry of the catalogue: a name, parameters (headline first), a sentence, a check on the bench.

    ``says`` what is wrong, and ``says_below`` where the headline comes out below off, if that is another sentence;
    ``below_off`` is what to check first there, where the effect itself does no such thing.
    ``law`` is how well the effect's own formula is known: the relative error, one sigma, of what it does. A value of v
    that is ``extrapolated`` from where readings lie to where it is stated is good to that times v beside. What
    ``of_eddies`` in windings is lost goes by how far their resistance flattens at high harmonics; what is lost in the
    core of ``core_of``, inductor or transformer, depends on that core's temperature as well.
    ``thermometer`` is the column that reads the part of which the effect changes a property, where that property may go
    by the part's temperature and the simulation takes it as constant.
    ``together`` says that the headline's tolerance moves all parts at once, beside the spread of each; ``over_time``
    that it follows the time since the campaign began; ``inside_limits`` that the tolerance is the sigma of what is
    uniform inside a maker's limits.
    """

    name: str
    stage: str
    parameters: tuple[EffectParameter, ...]
    says: str
    check_on_bench: str
    says_below: str = ""
    below_off: str = ""
    threshold: bool = False
    law: float = 0.02
    extrapolated: float = 0.0
    of_eddies: bool = False
    core_of: str = ""
    thermometer: str = ""
    together: bool = False
    over_time: bool = False
    inside_limits: bool = False

    @property
    def headline(self) -> EffectParameter:
        """The parameter that a single value means."""
        return self.parameters[0]

    def at(self, converter: Converter) -> Self:
        """The effect as a converter of any size has it; the very same object where nothing goes by size."""
        parameters = tuple(p.at(converter) for p in self.parameters)
        return self if parameters == self.parameters else replace(self, parameters=parameters)

    def about(self, values: Values) -> Self:
        """The effect beside a model that has it with these values already: off is what changes nothing of that.

        What is not given is off; the parameters beside the headline are no longer tried at other values.
        """
        head, *others = (replace(p, off=values.get(p.name, p.off)) for p in self.parameters)
        return replace(self, parameters=(head, *(replace(p, scan=()) for p in others)))

    def variants(self) -> list[dict[str, float]]:
        """The settings of the parameters beside the headline that a search must try, one dict each."""
        found: list[dict[str, float]] = [{}]
        for p in self.parameters[1:]:
            found = [{**chosen, p.name: value} for chosen in found for value in (p.scan or (p.off,))]
        return found

    def says_at(self, value: float) -> str:
        """What is wrong where the headline came out at a value."""
        return self.says_below if self.says_below and value < self.headline.off else self.says

    def check_at(self, value: float) -> str:
        """What to check on the bench where the headline came out at a value."""
        first = f"{self.below_off}; " if self.below_off and value < self.headline.off else ""
        return first + self.check_on_bench

    def off_values(self) -> dict[str, float]:
        """The values at which the effect does nothing."""
        return {p.name: p.off for p in self.parameters}

    def check(self, values: Values) -> None:
        """Raise ``ParameterError`` for an unknown parameter or a value outside its bounds."""
        known = {p.name: p for p in self.parameters}
        for name, value in values.items():
            if name not in known:
                raise ParameterError(f"{self.name} has no parameter {name!r}; it has: {', '.join(known)}")
            p = known[name]
            if not (np.isfinite(value) and p.lower <= value <= p.upper):
                raise ParameterError(
                    f"{self.name}.{name} is {value:g} {p.unit}; allowed: {p.lower:g} to {p.upper:g} {p.unit}"
                )

    def value(self, values: Values, name: str | None = None) -> float:
        """A parameter's value (the headline's by default), its OFF value where not given."""
        p = self.headline if name is None else next(p for p in self.parameters if p.name == name)
        return values.get(p.name, p.off)

    def spread_at(self, value: float, everyday: float, sigmas: float = 0.0) -> float:
        """How far the parts' spread, that moves the headline by ``everyday`` at off, moves it at a value, one sigma.

        As it is ``sigmas`` away from the value, below it where negative, by their number: a ratio is longer above.
        """
        return everyday

    def law_at(self, value: float) -> float:
        """How well exact readings tell a value: the relative error of its distance from off, one sigma."""
        return math.hypot(self.law, self.extrapolated * (value - self.headline.off))

    def near(self, threshold: str, state: Array, sigma: Array | float, values: Values) -> Array:
        """How little a state (N,), good to ``sigma``, tells on which side of that threshold it is, 0 to 1.

        One within the threshold's tolerance; beyond it as the root of what either side is likely to, where that is one
        for even odds.
        """
        p = next(p for p in self.parameters if p.name == threshold)
        beyond = np.maximum(np.abs(state - self.value(values, threshold)) - p.tolerance, 0.0)
        wrong = np.where(beyond > 0.0, ndtr(-beyond / np.maximum(sigma, 1e-12)), 0.5)
        return np.asarray(2.0 * np.sqrt(wrong * (1.0 - wrong)))

    def converter(self, converter: Converter, values: Values) -> Converter:
        """The converter's parameters as they really are."""
        return converter

    def set_points(self, points: Points, values: Values) -> Points:
        """The set points and surroundings as they really are."""
        return points

    def added_loss_W(self, points: Points, state: Mapping[str, Array], values: Values) -> Array | float:
        """A loss at the input that the circuit does not have, in W, (N,) or a float."""
        return 0.0

    def undecided(
        self, points: Points, state: Mapping[str, Array], sigma: Mapping[str, Array], values: Values
    ) -> Array:
        """How open it is on which side of a threshold points lie, (N,), 0 to 1; 0 of an effect without one.

        ``sigma`` is how far the simulated ``state`` may be off.
        """
        return np.zeros(len(points))

    def observe(self, points: Points, truth: dict[str, Array], values: Values) -> dict[str, Array]:
        """What the instruments show of the truth."""
        return truth
