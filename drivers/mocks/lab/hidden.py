"""What a virtual lab can hide: each by the physics it has in the lab, not by the diagnosing model's entry.

``HIDDEN`` holds the effects that the simulator's catalogue has too; the others are in the package ``foreign``.

``--hide NAME=VALUE`` sets the headline value; without a value the seed draws one from ``drawn``.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from difflib import get_close_matches
from typing import Any

import numpy as np

from drivers.mocks.lab.foreign.families import FOREIGN
from sim.parameters import Converter


class UnknownEffect(ValueError):
    """A name that no lab can hide."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Quirks:
    """What is wrong around the converter: command, supply, time and instruments of the lab."""

    fan_W: float = 0.0
    fan_on_C: float = 40.0
    drift_share: float = 0.0
    ambient_K_per_h: float = 0.0
    input_gain: float = 0.0
    input_offset_A: float = 0.0
    low_range_step: float = 0.0
    low_range_A: float = 5.0
    duty_offset: float = 0.0
    choke_drop: float = 0.0
    warmer_K: float = 0.0


# Assumption: one sigma of any bench. D1 at the gates is good to 0.06 %, the room to 0.1 K an hour; losses creep
# by 0.8 % in the end, which is 0.5 % after six hours; the inductor gives 1 % at 15 A.
EVERYDAY = {"duty_offset": 6e-4, "ambient_K_per_h": 0.1, "drift_share": 8e-3, "choke_drop": 0.01}


@dataclass(frozen=True, slots=True, kw_only=True)
class Hidden:
    """How a lab gets one effect, and the range from which an unnamed value is drawn."""

    drawn: tuple[float, float]
    part: Callable[[Converter, float], Converter] | None = None
    quirk: str | None = None


def _changed(owner: Any, path: str, new: Callable[[Any], Any]) -> Any:
    name, _, rest = path.partition(".")
    old = getattr(owner, name)
    return replace(owner, **{name: _changed(old, rest, new) if rest else new(old)})


def _more(*paths: str) -> Callable[[Converter, float], Converter]:
    def change(converter: Converter, value: float) -> Converter:
        for path in paths:
            converter = _changed(converter, path, lambda old: old + value)
        return converter

    return change


def _times(*paths: str) -> Callable[[Converter, float], Converter]:
    def change(converter: Converter, value: float) -> Converter:
        for path in paths:
            converter = _changed(converter, path, lambda old: old * (1 + value))
        return converter

    return change


def _is(path: str) -> Callable[[Converter, float], Converter]:
    return lambda converter, value: _changed(converter, path, lambda old: value)


_OUTER, _INNER, _CLAMP, _LOW = "primary.outer", "primary.inner", "primary.clamp", "secondary.switch"

HIDDEN: dict[str, Hidden] = {
    "link_resistance": Hidden(drawn=(0.04, 0.15), part=_more("link_resistance_Ohm")),
    "skin_effect": Hidden(
        drawn=(0.5, 1.5), part=_more("inductor.winding.ac_extra", "transformer.winding.ac_extra")
    ),
    "leakage_inductance": Hidden(drawn=(0.05, 0.12), part=_times("inductor.inductance_H")),
    "inductor_saturation": Hidden(drawn=(0.08, 0.3), quirk="choke_drop"),
    "magnetizing_inductance": Hidden(drawn=(2.5e-3, 5e-3), part=_is("transformer.magnetizing_H")),
    "dead_time": Hidden(drawn=(60e-9, 200e-9), part=_more("dead_time_s")),
    "gate_delay_skew": Hidden(drawn=(50e-9, 150e-9), part=_more("secondary_delay_s")),
    "igbt_saturation_voltage": Hidden(drawn=(0.25, 0.7), part=_more(f"{_INNER}.on.threshold_V")),
    "sic_on_resistance": Hidden(
        drawn=(0.3, 0.8), part=_times(f"{_OUTER}.on.resistance_Ohm", f"{_LOW}.on.resistance_Ohm")
    ),
    "clamp_diode_drop": Hidden(
        drawn=(0.3, 0.8), part=_times(f"{_CLAMP}.on.threshold_V", f"{_CLAMP}.on.resistance_Ohm")
    ),
    "turn_off_energy_primary": Hidden(
        drawn=(0.6, 1.5), part=_times(f"{_OUTER}.turn_off.energy_J", f"{_INNER}.turn_off.energy_J")
    ),
    "turn_off_energy_secondary": Hidden(drawn=(3.0, 8.0), part=_times(f"{_LOW}.turn_off.energy_J")),
    "output_capacitance": Hidden(
        drawn=(0.5, 1.2), part=_times(f"{_OUTER}.capacitance.zero_bias_F", f"{_LOW}.capacitance.zero_bias_F")
    ),
    "reverse_recovery": Hidden(
        drawn=(2.0, 8.0),
        part=_times(
            f"{_CLAMP}.recovery.charge_C", f"{_OUTER}.recovery.charge_C", f"{_LOW}.recovery.charge_C"
        ),
    ),
    "core_loss_transformer": Hidden(drawn=(0.5, 1.5), part=_times("transformer.core.k")),
    "core_loss_inductor": Hidden(drawn=(1.5, 4.0), part=_times("inductor.core.k")),
    "auxiliary_power": Hidden(drawn=(2.0, 8.0), part=_more("auxiliary_power_W")),
    "cable_resistance_input": Hidden(drawn=(0.08, 0.25), part=_more("input_cable_Ohm")),
    "cable_resistance_output": Hidden(drawn=(0.015, 0.05), part=_more("output_cable_Ohm")),
    "thermal_resistance": Hidden(drawn=(0.5, 1.2), part=_times("heatsink_K_per_W")),
    "fan_step": Hidden(drawn=(2.5, 8.0), quirk="fan_W"),
    "warm_up_drift": Hidden(drawn=(0.08, 0.25), quirk="drift_share"),
    "ambient_drift": Hidden(drawn=(1.5, 4.0), quirk="ambient_K_per_h"),
    "analyzer_gain": Hidden(drawn=(0.003, 0.008), quirk="input_gain"),
    "analyzer_offset": Hidden(drawn=(0.012, 0.04), quirk="input_offset_A"),
    "analyzer_range_step": Hidden(drawn=(0.003, 0.008), quirk="low_range_step"),
    "duty_offset": Hidden(drawn=(0.008, 0.02), quirk="duty_offset"),
}


def hidden(name: str) -> Hidden:
    """The catalogue's entry of that name; ``UnknownEffect`` names the nearest where there is none."""
    if name not in HIDDEN:
        near = get_close_matches(name, [*HIDDEN, *FOREIGN], n=1)
        hint = f"did you mean {near[0]!r}? " if near else ""
        raise UnknownEffect(
            f"nothing called {name!r} can be hidden; {hint}known: "
            f"{', '.join(sorted(HIDDEN))}; foreign to the catalogue: {', '.join(sorted(FOREIGN))}"
        )
    return HIDDEN[name]


def everyday_quirks(rng: np.random.Generator) -> Quirks:
    """What is a little off around any converter; losses only creep up, and an inductor only saturates."""
    duty, room, creep, bend = rng.standard_normal(4)
    return Quirks(
        duty_offset=EVERYDAY["duty_offset"] * duty,
        ambient_K_per_h=EVERYDAY["ambient_K_per_h"] * room,
        drift_share=EVERYDAY["drift_share"] * abs(creep),
        choke_drop=EVERYDAY["choke_drop"] * abs(bend),
    )


def drawn_values(wanted: Mapping[str, float | None], rng: np.random.Generator) -> dict[str, float]:
    """The value of each effect to hide: as given, or drawn log-uniformly from its range."""
    values = {}
    for name, value in wanted.items():
        low, high = FOREIGN[name].drawn if name in FOREIGN else hidden(name).drawn
        drawn = float(np.exp(rng.uniform(np.log(low), np.log(high))))
        values[name] = drawn if value is None else float(value)
    return values


def hide(
    converter: Converter, values: Mapping[str, float], quirks: Quirks | None = None
) -> tuple[Converter, Quirks]:
    """The converter and its surroundings with everything hidden in them, on top of what they had."""
    quirks = quirks or Quirks()
    for name, value in values.items():
        entry = hidden(name)
        if entry.part is not None:
            converter = entry.part(converter, value)
        if entry.quirk is not None:
            quirks = replace(quirks, **{entry.quirk: getattr(quirks, entry.quirk) + value})
    return converter, quirks
