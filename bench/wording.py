"""How numbers and verdicts are said to people: one place for units, rounding and plain words."""

import math
import re
from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any, TypeGuard

_UNITS = {
    "Ohm": "Ω", "W": "W", "V": "V", "A": "A", "H": "H", "s": "s", "C": "°C", "K": "K",
    "F": "F", "J": "J", "Hz": "Hz", "K_per_h": "K/h",
}  # fmt: skip
_HOUR_S = 3600.0
_NUMBER = re.compile(r"(?<![A-Za-z0-9.])\d+(\.\d+)?")  # of its own, not that of a name like D1
_PREFIXED = ("Ω", "H", "s", "F", "J")  # units that bench people say with a prefix
_PREFIXES = ((1.0, ""), (1e-3, "m"), (1e-6, "µ"), (1e-9, "n"), (1e-12, "p"))

_QUANTITIES = {
    "V1_V": "input voltage",
    "I1_A": "input current",
    "P1_W": "input power",
    "V2_V": "output voltage",
    "I2_A": "output current",
    "P2_W": "output power",
    "I_L_rms_A": "rms link current",
    "I_L_peak_A": "peak link current",
    "P_link1_W": "link power (element 3)",
    "P_link2_W": "link power (element 4)",
    "T_heatsink_C": "heatsink",
    "T_transformer_C": "transformer winding",
    "T_inductor_C": "inductor winding",
    "T_ambient_C": "ambient",
}

_EFFECTS = {
    "link_resistance": "ac-link resistance",
    "gate_delay_skew": "gate-delay skew",
    "igbt_saturation_voltage": "IGBT saturation voltage",
    "sic_on_resistance": "FET on-resistance",
    "clamp_diode_drop": "clamp-diode forward voltage",
    "turn_off_energy_primary": "primary turn-off energy",
    "turn_off_energy_secondary": "secondary turn-off energy",
    "output_capacitance": "switch output capacitance",
    "core_loss_transformer": "transformer core loss",
    "core_loss_inductor": "inductor core loss",
    "cable_resistance_input": "input cable resistance",
    "cable_resistance_output": "output cable resistance",
    "thermal_resistance": "heatsink thermal resistance",
    "fan_step": "fan power step",
    "warm_up_drift": "warm-up drift",
    "ambient_drift": "ambient temperature drift",
    "analyzer_gain": "analyzer gain error",
    "analyzer_offset": "analyzer current offset",
    "analyzer_range_step": "analyzer range-change error",
    "duty_offset": "duty-ratio offset",
    "dc_link_esr": "dc-link capacitor ESR",
    "output_capacitor_esr": "output capacitor ESR",
}  # what engineers call them, where it is not the name in words

MODEL_NAMES = {
    "simulation_only": "Simulation only",
    "experiment_only": "Experiment only",
    "d2ea": "D²EA (two-stage trees)",
    "simulator_first_stage": "Simulator as first stage",
    "calibrated": "Calibrated physics",
}

SHOWN = 0.01  # the probability from which a cause is shown to people


def effect_name(name: str) -> str:
    """What engineers call an effect; the words of its name where they have no other term.

    >>> effect_name("turn_off_energy_primary"), effect_name("dead_time")
    ('primary turn-off energy', 'dead time')
    """
    return _EFFECTS.get(name, words(name))


def words(name: str) -> str:
    """A name as words: a loss part, a step.

    >>> words("secondary_conduction")
    'secondary conduction'
    """
    return name.replace("_", " ")


def channel_name(column: str) -> str:
    """A measured quantity as people call it; its column where it has no other name.

    >>> channel_name("P1_W"), channel_name("D0")
    ('input power', 'D0')
    """
    return _QUANTITIES.get(column, column)


def action_text(action: str) -> str:
    """What is to be measured, as words; a sentence keeps the names of columns that it holds.

    >>> action_text("no_load"), action_text("measure T_transformer_C too")
    ('no load', 'measure T_transformer_C too')
    """
    return action if " " in action else words(action)


def step_text(step: Mapping[str, Any]) -> str:
    """A next step as words, with how often it is to be taken.

    >>> step_text({"action": "no_load", "repeats": 3}), step_text({"action": "standby"})
    ('no load, 3 times', 'standby')
    """
    repeats = f", {step['repeats']} times" if step.get("repeats", 1) > 1 else ""
    return action_text(str(step["action"])) + repeats


def points_text(fraction: float | None, digits: int = 3) -> str:
    """An efficiency difference as points: 0.0121 is 1.210 points.

    >>> points_text(0.0121), points_text(-0.0002)
    ('1.210', '−0.020')
    """
    return minus(f"{100 * fraction:.{digits}f}") if _known(fraction) else "–"


def per_cent(fraction: float | None, digits: int = 1) -> str:
    """A share or efficiency as per cent.

    >>> per_cent(0.9845, 2)
    '98.45 %'
    """
    return f"{100 * fraction:.{digits}f} %" if _known(fraction) else "–"


def probability_text(probability: float) -> str:
    """A probability as per cent; near its ends it is said on which side of them it is.

    >>> [probability_text(p) for p in (0.99998, 0.9534, 0.0001, 0.0)]
    ['over 99.9 %', '95.3 %', 'under 0.1 %', '0.0 %']
    """
    if probability > 0.9995:
        return "over 99.9 %"
    return "under 0.1 %" if 0 < probability < 0.0005 else per_cent(probability)


def fixed(value: float | None, digits: int = 1) -> str:
    """A number to so many decimals.

    >>> fixed(8.23), fixed(-0.04), fixed(None)
    ('8.2', '0.0', '–')
    """
    return f"{round(value, digits) + 0.0:.{digits}f}" if _known(value) else "–"  # + 0.0: never "-0.0"


def added_power(added_W: object) -> str:
    """What a cause adds to the input power, as the answer has it in W: mean, and below it the range.

    >>> added_power({"mean": -2.314, "lowest": -4.6, "highest": -0.42}).splitlines(), added_power(None)
    (['−2.31', '−4.60 to −0.42'], '–')
    """
    if not isinstance(added_W, Mapping):
        return "–"  # an answer of an earlier version
    mean, low, high = (fixed(added_W[key], 2) for key in ("mean", "lowest", "highest"))
    return minus(f"{mean}\n{low} to {high}")


def duration(seconds: float | None) -> str:
    """A time as people say it.

    >>> [duration(s) for s in (0.42, 12.3, 114.7, 4000)]
    ['0.42 s', '12.3 s', '1 min 55 s', '1 h 6 min']
    """
    if not _known(seconds):
        return "–"
    if seconds < 60:
        return f"{seconds:.3g} s"
    minutes, rest = divmod(round(seconds), 60)
    return f"{minutes} min {rest} s" if minutes < 60 else f"{minutes // 60} h {minutes % 60} min"


def unit_of(column: str) -> str:
    """The unit that a name ends in; empty for a dimensionless one.

    >>> unit_of("T_heatsink_C"), unit_of("I_L_rms_A"), unit_of("D0")
    ('°C', 'A', '')
    """
    return next((text for end, text in _UNITS.items() if column.endswith("_" + end)), "")


def difference_unit(column: str) -> str:
    """The unit of a difference in a column: K of temperatures, half periods of what has no unit.

    >>> difference_unit("T_heatsink_C"), difference_unit("I_L_rms_A"), difference_unit("D0")
    ('K', 'A', 'half periods')
    """
    return "points" if column == "efficiency" else unit_of(column).replace("°C", "K") or "half periods"


def minus(text: str) -> str:
    """Numbers with the sign that stands before them, or between them, in print.

    >>> minus("-1.61 W - 2 W * D1 of turn-off loss")
    '−1.61 W − 2 W * D1 of turn-off loss'
    """
    return re.sub(r"(?<![\w)])-(?= ?\d)", "\N{MINUS SIGN}", text)


def unbroken(text: str) -> str:
    """Text whose numbers stay beside their units at the end of a line.

    >>> unbroken("126 mΩ (95 %: 113 to 139)").split(" ")
    ['126\xa0mΩ', '(95\xa0%:', '113', 'to', '139)']
    """
    return re.sub(r"(?<=\d) (?=%|[pnµm]?[ΩHsFJWVAK°])", "\N{NO-BREAK SPACE}", text)


def parameter_text(parameter: Mapping[str, Any]) -> str:
    """A fitted parameter with its unit and 95 % interval.

    >>> parameter_text({"name": "resistance_Ohm", "value": 0.071, "ci95": [0.066, 0.077], "off": 0.0})
    'resistance 71 mΩ (95 %: 66 to 77)'
    >>> parameter_text({"name": "relative_error", "value": -0.4, "ci95": [-0.45, 0.05]})
    'relative error −40 % (95 %: −45 to +5)'
    >>> parameter_text({"name": "resistance_Ohm", "value": 0.0571, "ci95": [0.0443, 0.07]})
    'resistance 57 mΩ (95 %: 44 to 70)'
    >>> parameter_text({"name": "resistance_Ohm", "value": 0.15, "ci95": [0.14, 0.16], "off": 0.05})
    'resistance 150 mΩ (95 %: 140 to 160; the model has 50 mΩ)'
    >>> parameter_text({"name": "inductance_H", "value": 0.97e-3, "ci95": [0.89e-3, 1.05e-3], "off": 1.5e-3})
    'inductance 970 µH (95 %: 890 to 1050; the model has 1500 µH)'
    """
    name, value = str(parameter["name"]), float(parameter["value"])
    label = next((name.removesuffix("_" + end) for end in _UNITS if name.endswith("_" + end)), name)
    bounds = [float(x) for x in parameter.get("ci95") or ()]
    scale, sign, unit = _scaled(name, value if value else max(map(abs, bounds), default=0.0))
    form = f"{sign}.{_decimals(scale * (bounds[1] - bounds[0]))}f" if len(bounds) == 2 else f"{sign}.3g"
    said = f"{label.replace('_', ' ')} {value * scale:{form}}{unit}"
    if len(bounds) != 2:
        return minus(said)
    low, high = (f"{bound * scale:{form}}" for bound in bounds)
    off = float(parameter.get("off", 0.0))
    has = f"; the model has {_three(off * scale):{sign}g}{unit}" if off else ""
    return minus(f"{said} (95 %: {low} to {high}{has})")


def _decimals(width: float) -> int:
    """How many decimals a value with an interval of that width is worth: the interval's first two digits.

    >>> _decimals(25.7), _decimals(2.31), _decimals(0.0)
    (0, 1, 3)
    """
    return max(0, 1 - math.floor(math.log10(width))) if width > 0 else 3


def size_text(name: str, value: float) -> str:
    """How large a parameter of an effect is, without its name.

    >>> size_text("resistance_Ohm", 0.0899), size_text("relative_error", 0.312), size_text("time_constant_s", 18000.0)
    ('89.9 mΩ', '31.2 %', '5 h')
    """
    scale, _, unit = _scaled(name, value)
    return f"{_three(value * scale):g}{unit}"


def _three(value: float) -> float:
    """A value to three digits: as text without the exponent that a format of three digits has from a thousand on.

    >>> f"{_three(1499.6):g}"
    '1500'
    """
    return float(f"{value:.3g}")


def counted(count: int, thing: str, things: str = "") -> str:
    """A number of things.

    >>> counted(1, "row"), counted(3, "row"), counted(2, "entry", "entries")
    ('1 row', '3 rows', '2 entries')
    """
    return f"{count} {thing}" if count == 1 else f"{count} {things or thing + 's'}"


def none_of_its_rows(campaign: Mapping[str, Any], kind: str) -> str:
    """Why a campaign has no rows of a kind, and what there is instead.

    >>> seen = {"id": 3, "shown": "done", "planned": 5, "accepted": 0, "rejected": 5}
    >>> none_of_its_rows(seen, "rejected")
    'it is done, and of its 5 rows 0 are accepted and 5 rejected'
    >>> none_of_its_rows(seen, "accepted").partition("; ")[2]
    'd2ea export 3 --rejected --out FILE.csv writes those, with the reason of each'
    """
    said = f"it is {campaign['shown']}, and of its {campaign['planned']} rows {campaign['accepted']} are accepted and "
    said += f"{campaign['rejected']} rejected"
    if campaign["rejected"] and kind == "accepted":
        said += (
            f"; d2ea export {campaign['id']} --rejected --out FILE.csv writes those, with the reason of each"
        )
    return said


def alike(reasons: Mapping[str, int]) -> Counter[str]:
    """Counts of reasons, those that differ in a number only as one.

    >>> alike({"D1 and D2 carry less than 150 W": 2, "D1 and D2 carry less than 90.5 W": 1, "no steady state found": 1})
    Counter({'D1 and D2 carry less than … W': 3, 'no steady state found': 1})
    """
    found: Counter[str] = Counter()
    for reason, count in reasons.items():
        found[_NUMBER.sub("…", reason)] += count
    return found


def join(words: Sequence[str], last: str = "and") -> str:
    """A list in a sentence.

    >>> join(["a", "b", "c"])
    'a, b and c'
    """
    return f" {last} ".join([", ".join(words[:-1]), words[-1]] if len(words) > 1 else list(words))


def told_by(effects: Sequence[str]) -> str:
    """What a step tells, by the effects that one explanation has and another one has not.

    >>> told_by(["auxiliary_power"])
    'whether auxiliary power is a cause'
    >>> told_by(["link_resistance", "sic_on_resistance"])
    'ac-link resistance and FET on-resistance apart'
    """
    names = join([effect_name(effect) for effect in effects])
    return f"{names} apart" if len(effects) > 1 else f"whether {names} is a cause"


def probable_causes(diagnosis: Mapping[str, Any], least: float = SHOWN) -> list[Mapping[str, Any]]:
    """The causes of at least this probability, the most probable first."""
    causes = [cause for cause in diagnosis.get("causes") or () if float(cause["probability"]) >= least]
    return sorted(causes, key=lambda cause: -float(cause["probability"]))


def _scaled(name: str, value: float) -> tuple[float, str, str]:
    """Factor, sign and unit that a parameter of that name and size is said with."""
    unit = unit_of(name)
    if not unit:
        return (100.0, "+", " %") if name.startswith(("relative", "extra")) else (1.0, "", "")
    if unit == "s" and abs(value) >= _HOUR_S:
        return 1 / _HOUR_S, "", " h"
    scale, prefix = _prefix(value, unit)
    return scale, "", f" {prefix}{unit}"


def _prefix(value: float, unit: str) -> tuple[float, str]:
    if unit not in _PREFIXED or value == 0:
        return 1.0, ""
    size, prefix = next(((s, p) for s, p in _PREFIXES if abs(value) >= 0.999 * s), _PREFIXES[-1])
    return 1 / size, prefix


def _known(value: object) -> TypeGuard[float]:
    """Whether there is a number to say; a key that a summary lacks is none."""
    return isinstance(value, int | float) and math.isfinite(value)
