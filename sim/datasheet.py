"""Reads the device data files: every value with its source and its everyday tolerance."""

import tomllib
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from typing import Any

from sim.parameters import Capacitance, Conduction, Diode, ParameterError, Recovery, Switch, SwitchingEnergy


@dataclass(frozen=True, slots=True, kw_only=True)
class DatasheetValue:
    """One number of a data file; ``tolerance`` is relative, one sigma."""

    value: float
    tolerance: float
    source: str


@cache
def _document(part: str) -> dict[str, Any]:
    path = files("sim.devices") / f"{part}.toml"
    if not path.is_file():
        known = sorted(
            p.name.removesuffix(".toml") for p in files("sim.devices").iterdir() if p.name.endswith("toml")
        )
        raise ParameterError(f"no data file for the part {part!r}; known parts: {', '.join(known)}")
    return tomllib.loads(path.read_text(encoding="utf-8"))


def datasheet(part: str) -> dict[str, DatasheetValue]:
    """Every value of a part's data file by ``section.name``.

    >>> datasheet("UF3C065030K4S")["on.resistance_Ohm"].value
    0.027
    """
    return {
        f"{section}.{name}": DatasheetValue(**entry)
        for section, entries in _document(part).items()
        if isinstance(entries, dict)
        for name, entry in entries.items()
    }


def _section(part: str, section: str) -> dict[str, float]:
    prefix = f"{section}."
    return {
        name.removeprefix(prefix): entry.value
        for name, entry in datasheet(part).items()
        if name.startswith(prefix)
    }


def _tolerances(part: str) -> dict[str, float]:
    return {name: entry.tolerance for name, entry in datasheet(part).items()}


def _thermal(part: str) -> float:
    return datasheet(part)["thermal.resistance_K_per_W"].value


def load_switch(part: str) -> Switch:
    """A switch from its data file, fresh at each call."""
    return Switch(
        part=part,
        synchronous=_document(part)["synchronous"],
        on=Conduction(**_section(part, "on")),
        reverse=Conduction(**_section(part, "reverse")),
        turn_off=SwitchingEnergy(**_section(part, "turn_off")),
        turn_on=SwitchingEnergy(**_section(part, "turn_on")),
        recovery=Recovery(**_section(part, "recovery")),
        capacitance=Capacitance(**_section(part, "capacitance")),
        thermal_K_per_W=_thermal(part),
        tolerances=_tolerances(part),
    )


def load_diode(part: str) -> Diode:
    """A diode from its data file, fresh at each call."""
    return Diode(
        part=part,
        on=Conduction(**_section(part, "on")),
        recovery=Recovery(**_section(part, "recovery")),
        capacitance=Capacitance(**_section(part, "capacitance")),
        thermal_K_per_W=_thermal(part),
        tolerances=_tolerances(part),
    )
