"""How far every part of a converter is off on any ordinary day: one sigma of each parameter.

Devices bring theirs from their data files; the rest is listed here, where the converter's own file states no other. A
diagnosis that does not know of these spreads calls every one of them a fault.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, fields, replace
from typing import Any, Self

from sim.parameters import Converter, Diode, Switch
from sim.size import size


@dataclass(frozen=True, slots=True, kw_only=True)
class Spread:
    """One sigma of the parameter at a dotted path: relative to its value, or in its own unit.

    ``lower`` is where it ends: a cable has no negative resistance. ``goes_by`` is what of a
    converter's :func:`sim.size.size` a sigma goes by that is stated for the prototype.
    """

    path: str
    sigma: float
    relative: bool = True
    lower: float = float("-inf")
    goes_by: str = ""

    def at(self, converter: Converter) -> Self:
        """The spread as a converter of any size has it, or as its file states it."""
        if (stated := converter.tolerances.get(self.path)) is not None:
            return replace(self, sigma=stated, relative=True, goes_by="")
        return replace(self, sigma=self.sigma * size(self.goes_by, converter)) if self.goes_by else self

    def shifted(self, converter: Converter, sigmas: float) -> Converter:
        """The converter with this parameter off by so many sigmas."""
        return shifted_together(converter, [(self, sigmas)])

    def moved(self, old: float, sigmas: float) -> float:
        """The parameter's value off by so many sigmas."""
        step = sigmas * self.sigma
        return max(old * (1 + step) if self.relative else old + step, self.lower)


def shifted_together(converter: Converter, state: Iterable[tuple[Spread, float]]) -> Converter:
    """The converter with many parameters off, each by its own number of sigmas."""
    tree: dict[str, Any] = {}
    for spread, sigmas in state:
        *owners, name = spread.path.split(".")
        branch = tree
        for owner in owners:
            branch = branch.setdefault(owner, {})
        branch[name] = (spread, sigmas)
    return _changed(converter, tree)  # type: ignore[no-any-return]


def _changed(owner: Any, tree: dict[str, Any]) -> Any:
    def new(name: str, change: Any) -> Any:
        old = getattr(owner, name)
        return _changed(old, change) if isinstance(change, dict) else change[0].moved(old, change[1])

    return replace(owner, **{name: new(name, change) for name, change in tree.items()}) if tree else owner


# Assumption: everyday spreads of wound parts, wiring, timing and cooling.
_REST = (
    Spread(path="inductor.inductance_H", sigma=0.01),
    Spread(path="inductor.winding.resistance_Ohm", sigma=0.03),
    Spread(path="inductor.winding.ac_extra", sigma=0.2),
    Spread(path="inductor.core.k", sigma=0.07),
    Spread(path="inductor.thermal_K_per_W", sigma=0.05),
    Spread(path="transformer.magnetizing_H", sigma=0.1),
    Spread(path="transformer.winding.resistance_Ohm", sigma=0.03),
    Spread(path="transformer.winding.ac_extra", sigma=0.2),
    Spread(path="transformer.core.k", sigma=0.07),
    Spread(path="transformer.thermal_K_per_W", sigma=0.05),
    Spread(path="link_resistance_Ohm", sigma=0.002, relative=False, lower=0.0, goes_by="input_resistance"),
    Spread(path="dead_time_s", sigma=8e-9, relative=False, lower=0.0),
    Spread(path="secondary_delay_s", sigma=8e-9, relative=False),
    Spread(path="auxiliary_power_W", sigma=0.05, relative=False, lower=0.0, goes_by="power"),
    Spread(path="input_cable_Ohm", sigma=0.002, relative=False, lower=0.0, goes_by="input_resistance"),
    Spread(path="output_cable_Ohm", sigma=0.0005, relative=False, lower=0.0, goes_by="output_resistance"),
    Spread(path="heatsink_K_per_W", sigma=0.06),
)

TOLERANCED = frozenset(spread.path for spread in _REST)  # what a converter's file may state a tolerance of

# Assumption: a device's resistance bends off the line through 25 and 125 degC as UF3C065030K4S's does, whose datasheet
# says 1.32 at 125 and 1.59 at 175 degC, or the other way: by 4 % at 75 and 11 % at 175 degC. Its own data may say more.
_BEND_PER_K2 = 1.5e-5


def everyday_spread(converter: Converter) -> tuple[Spread, ...]:
    """The spreads of a converter's parameters, each independent of the others; how resistances bend comes last."""
    found = {
        spread.path: spread
        for bridge in ("primary", "secondary")
        for place in fields(getattr(converter, bridge))
        for spread in _of_device(f"{bridge}.{place.name}", getattr(getattr(converter, bridge), place.name))
    }
    bends = {bend.path: found.pop(bend.path, bend) for bend in _bends(sorted(found))}
    return (*found.values(), *(spread.at(converter) for spread in _REST), *bends.values())


def _bends(paths: Iterable[str]) -> Iterator[Spread]:
    """How devices' resistances bend, where their data give those a tolerance and none to the bend itself."""
    for path in paths:
        if path.endswith(".on.resistance_Ohm"):
            bend = path.replace("resistance_Ohm", "resistance_bend_per_K2")
            yield Spread(path=bend, sigma=_BEND_PER_K2, relative=False)


def _of_device(place: str, device: Switch | Diode) -> Iterator[Spread]:
    for name, tolerance in device.tolerances.items():
        path = f"{place}.{'thermal_K_per_W' if name == 'thermal.resistance_K_per_W' else name}"
        if tolerance > 0:
            yield Spread(path=path, sigma=tolerance)
