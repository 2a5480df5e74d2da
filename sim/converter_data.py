"""A converter as plain data (what a TOML file holds), and back, with everything that is wrong with it listed.

The keys are those of the parameter objects (:mod:`sim.parameters`). A bridge with ``outer``, ``inner`` and ``clamp`` is
three-level, one with ``switch`` two-level. A device is the name of a part in ``sim/devices`` or a table like one of
those files. A value of a device, or one whose spread is listed in :mod:`sim.spread`, may be a bare number or
``{ value, tolerance, source }``.
"""

from collections.abc import Mapping
from dataclasses import MISSING, dataclass, field, fields, is_dataclass, replace
from difflib import get_close_matches
from functools import reduce
from operator import getitem
from typing import Any, TypeVar

import numpy as np

from sim.datasheet import load_diode, load_switch
from sim.parameters import (
    Capacitance,
    Conduction,
    Converter,
    Core,
    Diode,
    FullBridge,
    Inductor,
    NpcBridge,
    ParameterError,
    Recovery,
    Switch,
    SwitchingEnergy,
    Transformer,
    Winding,
)
from sim.size import size
from sim.spread import TOLERANCED

T = TypeVar("T")
Plain = dict[str, Any]
_SECTIONS: dict[type, dict[str, type]] = {
    Switch: {
        "on": Conduction, "reverse": Conduction, "turn_off": SwitchingEnergy, "turn_on": SwitchingEnergy,
        "recovery": Recovery, "capacitance": Capacitance,
    },
    Diode: {"on": Conduction, "recovery": Recovery, "capacitance": Capacitance},
    Inductor: {"winding": Winding, "core": Core},
    Transformer: {"winding": Winding, "core": Core},
    Converter: {"inductor": Inductor, "transformer": Transformer},
}  # fmt: skip
_USUALLY = {  # where a file may be silent
    "secondary_delay_s": 0.0, "auxiliary_power_W": 0.0, "input_cable_Ohm": 0.0, "output_cable_Ohm": 0.0,
    "link_resistance_Ohm": 0.0,
}  # fmt: skip
_MOST_RATED = 250.0  # n V1 V2 / (8 fs L) over the rated power, which then needs a phase of 0.001 half periods
_TEXTS = {"part", "name", "modulation"}


@dataclass(frozen=True, slots=True, kw_only=True)
class Wrong:
    """One thing that is wrong: the keys that lead to it, the value, what is allowed."""

    keys: tuple[str, ...]
    value: object
    allowed: str


class ConverterDataError(ParameterError):
    """Plain data that describe no converter; ``wrong`` lists why."""

    def __init__(self, wrong: list[Wrong]) -> None:
        lines = (f"{'.'.join(w.keys) or 'converter'} = {w.value!r}: {w.allowed}" for w in wrong)
        super().__init__("; ".join(lines))
        self.wrong = tuple(wrong)


def converter_from_plain(data: Mapping[str, Any], modulation: str | None = None) -> Converter:
    """The converter that plain data describe, driven by ``modulation`` or by its primary's usual one.

    Raises
    ------
    ConverterDataError
        With every unknown, missing, mistyped or contradictory key.
    """
    reader = _Reader()
    converter = reader.converter(data, modulation)
    if reader.wrong or converter is None:
        raise ConverterDataError(reader.wrong)
    return converter


def ideal_most_W(converter: Converter) -> float:
    """What a converter carries at most without losses, with full pulses a quarter period apart: n V1 V2 / (8 fs L)."""
    per_Hz = converter.transformer.turns_ratio * converter.V1_V * converter.V2_V
    return float(np.mean(per_Hz / (8 * converter.frequency_Hz * converter.inductor.inductance_H)))


def _saturating_by_its_size(converter: Converter) -> Converter:
    """With the current of an inductor's saturation as large against the input's as the prototype's."""
    inductor = converter.inductor
    sized_A = inductor.saturation_A * size("input_current", converter)
    return replace(converter, inductor=replace(inductor, saturation_A=sized_A))


def converter_to_plain(converter: Converter) -> Plain:
    """Plain data of a converter; a device that is as its data file says is named only."""
    plain = _plain(converter)
    del plain["modulation"]
    for path, tolerance in plain.pop("tolerances").items():
        *owners, name = path.split(".")
        table = reduce(getitem, owners, plain)
        table[name] = {"value": table[name], "tolerance": tolerance}
    for bridge in ("primary", "secondary"):
        devices = getattr(converter, bridge)
        plain[bridge] = {f.name: _device_plain(getattr(devices, f.name)) for f in fields(devices)}
    return plain


def _plain(owner: Any) -> Plain:
    values = {f.name: getattr(owner, f.name) for f in fields(owner)}
    return {k: _plain(v) if is_dataclass(v) else v for k, v in values.items()}


def _device_plain(device: Switch | Diode) -> str | Plain:
    try:
        known = load_switch(device.part) if isinstance(device, Switch) else load_diode(device.part)
        if known == device:
            return device.part
    except (ParameterError, KeyError):
        pass  # no part of ours: written out
    plain, tolerances = _plain(device), device.tolerances
    del plain["tolerances"]
    plain["thermal"] = {"resistance_K_per_W": plain.pop("thermal_K_per_W")}
    for section, values in plain.items():
        if isinstance(values, dict):
            plain[section] = {
                name: {"value": value, "tolerance": tolerances[f"{section}.{name}"]}
                if f"{section}.{name}" in tolerances
                else value
                for name, value in values.items()
            }
    return plain


@dataclass(slots=True)
class _Reader:
    """Builds parameter objects and collects what is wrong."""

    wrong: list[Wrong] = field(default_factory=list)

    def converter(self, data: Mapping[str, Any], modulation: str | None) -> Converter | None:
        tolerances: dict[str, float] = {}
        found = {**_USUALLY, **self._numbers(Converter, data, (), tolerances)}
        for name, section in (("inductor", Inductor), ("transformer", Transformer)):
            found[name] = self._table(section, found.get(name), (name,))
        found["primary"] = self._bridge(found.get("primary"), "primary")
        found["secondary"] = self._bridge(found.get("secondary"), "secondary")
        usual = "" if found["primary"] is None else found["primary"].modulations[0]
        self._no_tolerances(found, ())
        found |= {"modulation": modulation or usual, "tolerances": tolerances}
        converter = self._object(Converter, found, ())
        if converter is None:
            return None
        self._contradictions(converter, data["inductor"])
        return converter if "saturation_A" in data["inductor"] else _saturating_by_its_size(converter)

    def _contradictions(self, converter: Converter, inductor: Mapping[str, Any]) -> None:
        if converter.inductor.saturates and "saturation_A" not in inductor:
            self._add(
                ("inductor", "saturation_A"), None, "is missing: the current at which saturation is stated"
            )
        rated_W, most_W = converter.rated_power_W, ideal_most_W(converter)
        if rated_W > most_W:
            allowed = (
                f"n V1 V2 / (8 fs L) is {most_W:.3g} W: these values carry no more, whatever the phase; check it, "
                f"frequency_Hz, the voltages, and inductor.inductance_H = {converter.inductor.inductance_H:g}"
            )
            self._add(("rated_power_W",), rated_W, allowed)
        if most_W > _MOST_RATED * rated_W:
            allowed = (
                f"is in Hz; with it n V1 V2 / (8 fs L) is {most_W:.3g} W, {most_W / rated_W:.0f} times the rated "
                f"power, and may be {_MOST_RATED:.0f} times: check it, the voltages, and inductor.inductance_H = "
                f"{converter.inductor.inductance_H:g}"
            )
            self._add(("frequency_Hz",), converter.frequency_Hz, allowed)

    def _bridge(self, data: Any, name: str) -> NpcBridge | FullBridge | None:
        if not isinstance(data, Mapping):
            self._add((name,), data, "a table: outer, inner, clamp (three-level) or switch (two-level)")
            return None
        kind = NpcBridge if "switch" not in data and name == "primary" else FullBridge
        loaders = {f.name: self._diode if f.name == "clamp" else self._switch for f in fields(kind)}
        found = dict(data)
        for key, load in loaders.items():
            if key in found:
                found[key] = load(found[key], (name, key))
        return self._object(kind, found, (name,))  # type: ignore[return-value]

    def _switch(self, data: Any, keys: tuple[str, ...]) -> Switch | None:
        return self._device(Switch, data, keys)

    def _diode(self, data: Any, keys: tuple[str, ...]) -> Diode | None:
        return self._device(Diode, data, keys)

    def _device(self, kind: type[T], data: Any, keys: tuple[str, ...]) -> T | None:
        if isinstance(data, str):
            try:
                return load_switch(data) if kind is Switch else load_diode(data)  # type: ignore[return-value]
            except (ParameterError, KeyError) as error:
                self._add(keys, data, str(error))
                return None
        if not isinstance(data, Mapping):
            self._add(keys, data, "the name of a part, or a table with its values")
            return None
        tolerances: dict[str, float] = {}
        found = {k: v for k, v in data.items() if k != "kind"}
        for section, values in found.items():
            if isinstance(values, Mapping):
                found[section] = {
                    name: self._value(value, (*keys, section, name), tolerances)
                    for name, value in values.items()
                }
        thermal = found.pop("thermal", {})
        if isinstance(thermal, Mapping) and "resistance_K_per_W" in thermal:
            found["thermal_K_per_W"] = thermal["resistance_K_per_W"]
        elif "thermal_K_per_W" not in found:
            self._add((*keys, "thermal", "resistance_K_per_W"), None, "is missing: from junction to heatsink")
            found["thermal_K_per_W"] = None
        self._no_tolerances(found, keys)
        return self._table(kind, {**found, "tolerances": tolerances}, keys)

    def _no_tolerances(self, found: Mapping[str, Any], keys: tuple[str, ...]) -> None:
        if "tolerances" in found:
            self._add(
                (*keys, "tolerances"), found["tolerances"], "belongs to each value: { value, tolerance }"
            )

    def _numbers(
        self, kind: type, data: Mapping[str, Any], keys: tuple[str, ...], tolerances: dict[str, float]
    ) -> Plain:
        """A table without the tolerances that its values are stated with, and those by dotted path; no device."""
        found, sections = dict(data), _SECTIONS.get(kind, {})
        for name, entry in data.items():
            path = (*keys, name)
            if name in sections and isinstance(entry, Mapping):
                found[name] = self._numbers(sections[name], entry, path, tolerances)
            elif ".".join(path) in TOLERANCED and isinstance(entry, Mapping):
                own: dict[str, float] = {}
                found[name] = self._value(entry, path, own)
                stated = own.get(".".join(path[-2:]))
                if stated == 0.0 and "tolerance" in entry:
                    self._add(
                        (*path, "tolerance"), stated, "above 0; what is left out has its usual tolerance"
                    )
                elif stated and found[name] == 0.0:
                    self._add((*path, "tolerance"), stated, "a share of the value, which is 0")
                elif stated:
                    tolerances[".".join(path)] = stated
        return found

    def _value(self, entry: Any, keys: tuple[str, ...], tolerances: dict[str, float]) -> Any:
        """A number, and its tolerance if it has one."""
        if not isinstance(entry, Mapping):
            return entry
        unknown = set(entry) - {"value", "tolerance", "source"}
        if unknown or "value" not in entry:
            self._add(keys, dict(entry), "a number, or a table of value, tolerance and source")
            return None
        tolerance = entry.get("tolerance", 0.0)
        if type(tolerance) not in (int, float) or not 0.0 <= tolerance < 1.0:
            self._add(
                (*keys, "tolerance"), tolerance, "one sigma, a share of the value: 0 or more, and below 1"
            )
            return None
        tolerances[".".join(keys[-2:])] = float(tolerance)
        return entry["value"]

    def _table(self, kind: type[T], data: Any, keys: tuple[str, ...]) -> T | None:
        """An object whose sections are objects too."""
        if not isinstance(data, Mapping):
            self._add(keys, data, f"a table with {', '.join(_names(kind))}")
            return None
        found = dict(data)
        for name, section in _SECTIONS.get(kind, {}).items():
            if name in found:
                found[name] = self._table(section, found[name], (*keys, name))
        return self._object(kind, found, keys)

    def _object(self, kind: type[T], found: Mapping[str, Any], keys: tuple[str, ...]) -> T | None:
        known = _names(kind)
        before = len(self.wrong)
        for name in found:
            if name not in known:
                near = get_close_matches(name, known, n=1)
                hint = f"did you mean {near[0]!r}? " if near else ""
                self._add((*keys, name), None, f"unknown key; {hint}known here: {', '.join(_written(kind))}")
        required = {f.name for f in fields(kind) if f.default is MISSING and f.default_factory is MISSING}  # type: ignore[arg-type]
        for name in sorted(required - set(found)):
            self._add((*keys, name), None, "is missing")
        for name, value in found.items():
            if name in known and not self._fits(name, value):
                none = ", and states no tolerance" if isinstance(value, Mapping) else ""
                self._add((*keys, name), value, "text" if name in _TEXTS else f"a number{none}")
        if len(self.wrong) > before or any(found[name] is None for name in found):
            return None
        try:
            return kind(**found)
        except ParameterError as error:
            self._add(keys, None, str(error))
            return None

    @staticmethod
    def _fits(name: str, value: Any) -> bool:
        if value is None or is_dataclass(value) or name == "tolerances":
            return True
        if name == "synchronous":
            return isinstance(value, bool)
        return isinstance(value, str) if name in _TEXTS else type(value) in (int, float)

    def _add(self, keys: tuple[str, ...], value: object, allowed: str) -> None:
        self.wrong.append(Wrong(keys=keys, value=value, allowed=allowed))


def _names(kind: type) -> list[str]:
    return [f.name for f in fields(kind)]


def _written(kind: type) -> list[str]:
    """The keys of a table as a file has them."""
    device = {"thermal_K_per_W": "thermal"} if kind in (Switch, Diode) else {}
    return [device.get(name, name) for name in _names(kind) if name != "tolerances"]
