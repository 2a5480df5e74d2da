"""The verdict of a diagnosis in words: its headline, what is suspected, and what no cause explains."""

import re
from collections.abc import Mapping
from typing import Any, NamedTuple

from bench.wording import (
    SHOWN,
    channel_name,
    counted,
    difference_unit,
    duration,
    effect_name,
    fixed,
    join,
    minus,
    parameter_text,
    per_cent,
    probability_text,
    probable_causes,
    size_text,
)

_TELLING = 0.2  # of a leftover: a formula that holds less says nothing
# probabilities from which a cause that nothing states is spoken of
_SURE, _SUSPECTED, _POSSIBLE = 0.95, 0.5, 0.2
_PLACES = {
    "input": "at the input",
    "ac link": "in the ac link",
    "output": "at the output",
    "timing": "in the timing",
    "ac elements": "in the ac elements' readings",
    "gain over time": "as a gain of the analyzer that wanders",
    "level": "the same at all set points",
    "straight": "in straight lines",
}  # of a leftover, as words; the others are words already

# what a sensor's gain may be as well: everything then moves as if it were off
_OTHERWISE = {
    "T_inductor_C": ", or a winding is cooled otherwise",
    "T_transformer_C": ", or a winding is cooled otherwise",
    "V2_V": ", or the model's turns ratio",
}
CONDITIONS = ("V1_V", "V2_V", "T_ambient_C")  # of a bench: places where nobody read them

VERDICTS = {
    "consistent": "Simulation and measurement agree",
    "named": "Cause named",
    "group": "One cause of a tied group",
    "unknown": "Something is wrong that no known cause explains",
}


def suspected(diagnosis: Mapping[str, Any], least: float = _SUSPECTED) -> list[str]:
    """Causes of at least this probability, half by default, with their probabilities, the most probable first.

    >>> suspected({"causes": [{"effect": "dead_time", "probability": 0.7}]})
    ['dead time (70.0 %)']
    """
    return [
        f"{effect_name(str(cause['effect']))} ({probability_text(float(cause['probability']))})"
        for cause in probable_causes(diagnosis, least)
    ]


def possible(diagnosis: Mapping[str, Any]) -> list[str]:
    """The same of causes that are probable enough to keep anybody from saying that all agrees."""
    return suspected(diagnosis, _POSSIBLE)


def doubted_conditions(diagnosis: Mapping[str, Any]) -> list[Mapping[str, Any]]:
    """Conditions that nobody read, where readings say that they were others than were taken."""
    return [c for c in diagnosis.get("conditions") or () if c["value"] is not None]


def _part_name(path: str) -> str:
    """A part's quantity, how two parts differ in one, or an instrument's error, by the name that its spread has.

    >>> _part_name("secondary.switch.resistance_Ohm"), _part_name("analyzer port 2 gain")
    ('secondary switch resistance', 'analyzer port 2 gain')
    >>> _part_name("secondary.switch.capacitance_F beside primary.outer.capacitance_F")
    'secondary switch capacitance against primary outer capacitance'
    >>> _part_name("heatsink_K_per_W"), _part_name("inductor.thermal_K_per_W")
    ('heatsink thermal resistance', 'inductor thermal resistance')
    """
    bare = re.sub(r"[._](thermal_)?K_per_W\b", " thermal resistance", path)
    bare = re.sub(r"_(Ohm|H|F|s|V|A|C|W|K|J|per_K2?)\b", "", bare).replace(" beside ", " against ")
    return bare.replace("_", " ").replace(".", " ")


def parts_text(diagnosis: Mapping[str, Any]) -> str:
    """Which parts and instruments have to be further off than any ordinary one is; empty where none has to.

    >>> parts_text({"parts": [{"part": "dead_time_s", "sigma": -9.52}]})
    'dead time 9.5 times its everyday spread off'
    """
    parts = diagnosis.get("parts") or ()
    said = join([f"{_part_name(part['part'])} {abs(part['sigma']):.1f} times" for part in parts])
    return f"{said} its everyday spread off" if said else ""


def verdict_class(diagnosis: Mapping[str, Any]) -> str:
    """What colours the box of a verdict: a suspect is no agreement, nor is what needs a condition, or a part, far off.

    >>> verdict_class({"verdict": "consistent", "causes": [{"effect": "dead_time", "probability": 0.7}]})
    'suspected'
    """
    verdict = str(diagnosis.get("verdict", ""))
    open_ = possible(diagnosis) or doubted_conditions(diagnosis) or diagnosis.get("parts")
    return "suspected" if verdict == "consistent" and open_ else verdict


def onset_text(diagnosis: Mapping[str, Any]) -> str:
    """What changes in the course of a campaign, and when; empty where what is left over is no such change.

    >>> resistance = {"name": "resistance_Ohm", "value": 0.0606, "off": 0.0}
    >>> moment = {"sets_in": True, "between_rows": [58, 59], "after_s": 10440.0, "place": None, "sensor": None}
    >>> loose = moment | {"effect": "link_resistance", "parameter": resistance}
    >>> onset_text({"unknown": {"onset": loose}})
    'ac-link resistance sets in between rows 58 and 59, after 2 h 54 min (60.6 mΩ then, 0 Ω before)'
    >>> onset_text({"unknown": {"onset": moment | {"effect": None, "place": "output, straight"}}})
    'something changes between rows 58 and 59, after 2 h 54 min: at the output, and no cause of the catalogue'
    >>> heatsink = {"column": "T_heatsink_C", "kind": "offset", "value": -5.96, "unit": "degC"}
    >>> onset_text({"unknown": {"onset": moment | {"effect": None, "sensor": heatsink}}})
    'heatsink reads 5.96 K low from row 59 on, after 2 h 54 min'
    >>> onset_text({"unknown": {"onset": moment | {"effect": None, "sensor": heatsink, "sets_in": False}}})
    'heatsink reads 5.96 K low up to row 58, for 2 h 54 min'
    >>> onset_text({"unknown": {"onset": moment | {"effect": None, "place": "V1_V"}}})
    'V1_V, which nobody read, seems to change between rows 58 and 59, after 2 h 54 min'
    """
    onset = (diagnosis.get("unknown") or {}).get("onset")
    if not onset:
        return ""
    before, row = onset["between_rows"]
    when = f"between rows {before} and {row}, after {duration(onset['after_s'])}"
    if onset["effect"]:
        p = onset["parameter"]
        there, aside = (size_text(p["name"], p[of]) for of in ("value", "off"))
        then, earlier = (there, aside) if onset["sets_in"] else (aside, there)
        does = "sets in" if onset["sets_in"] else "goes away"
        return f"{effect_name(onset['effect'])} {does} {when} ({then} then, {earlier} before)"
    if onset["sensor"]:
        passed = duration(onset["after_s"])
        where = f"from row {row} on, after" if onset["sets_in"] else f"up to row {before}, for"
        return f"{_reads(onset['sensor'])} {where} {passed}"
    if onset["place"] in CONDITIONS:
        return f"{onset['place']}, which nobody read, seems to change {when}"
    place = str(onset["place"]).split(", ")[0]
    return f"something changes {when}: {_PLACES.get(place, place)}, and no cause of the catalogue"


class StretchText(NamedTuple):
    """A stretch of a campaign in words: its name, the rows that it has, its own verdict, and whether it has one."""

    name: str
    rows: str
    said: str
    is_diagnosed: bool


def stretch_texts(diagnosis: Mapping[str, Any]) -> list[StretchText]:
    """What is said of the stretches before and after something changed on the way, each on its own.

    >>> agree = {"name": "before", "rows": 58, "refused": None, "answer": {"verdict": "consistent"}}
    >>> few = {"name": "after", "rows": 7, "refused": "7 usable rows", "answer": None}
    >>> for each in stretch_texts({"unknown": {"onset": {"stretches": [agree, few]}}}):
    ...     print(f"{each.rows}: {each.said}")
    before the change, 58 rows: Simulation and measurement agree
    after the change, 7 rows: not diagnosed, 7 usable rows
    """
    onset = (diagnosis.get("unknown") or {}).get("onset") or {}
    return [
        StretchText(
            name=each["name"],
            rows=f"{each['name']} the change, {counted(each['rows'], 'row')}",
            said=_with_values(each["answer"]) if each["answer"] else f"not diagnosed, {each['refused']}",
            is_diagnosed=each["answer"] is not None,
        )
        for each in onset.get("stretches") or ()
    ]


def _with_values(diagnosis: Mapping[str, Any]) -> str:
    """The headline, with the values of what it states.

    >>> error = {"name": "error_s", "unit": "s", "value": 8e-8, "ci95": [7e-8, 9e-8], "off": 0.0}
    >>> dead_time = {"effect": "dead_time", "probability": 1.0, "parameters": [error]}
    >>> _with_values({"verdict": "named", "named": ["dead_time"], "causes": [dead_time]})
    'Cause named: dead time, error 80 ns (95 %: 70 to 90)'
    """
    stated = {*(diagnosis.get("named") or ()), *(n for group in diagnosis.get("groups") or () for n in group)}
    values = [
        parameter_text(c["parameters"][0]) for c in diagnosis.get("causes") or () if c["effect"] in stated
    ]
    return ", ".join([verdict_text(diagnosis), *values])


def sensor_text(diagnosis: Mapping[str, Any]) -> str:
    """Which sensor is off where no cause explains its readings, or what else it may be; empty where it is no sensor.

    >>> current = {"column": "I_L_rms_A", "kind": "gain", "value": 0.0291, "unit": "1"}
    >>> sensor_text({"unknown": {"sensor": current}})
    'a sensor is off: rms link current reads 2.91 % high'
    >>> heatsink = {"column": "T_heatsink_C", "kind": "offset", "value": -5.96, "unit": "degC"}
    >>> sensor_text({"unknown": {"sensor": heatsink}})
    'a sensor is off: heatsink reads 5.96 K low'
    >>> winding = {"column": "T_inductor_C", "kind": "gain", "value": 0.3, "unit": "1"}
    >>> sensor_text({"unknown": {"sensor": winding}})
    'a sensor is off, or a winding is cooled otherwise: inductor winding reads 30 % high'
    """
    sensor = (diagnosis.get("unknown") or {}).get("sensor")
    if not sensor:
        return ""
    otherwise = _OTHERWISE.get(sensor["column"], "") if sensor["kind"] == "gain" else ""
    return f"a sensor is off{otherwise}: {_reads(sensor)}"


def over_temperature_text(diagnosis: Mapping[str, Any]) -> str:
    """Which property goes by its part's temperature, where that is what no cause explains; empty where none does.

    >>> change = {"effect": "leakage_inductance", "parameter": "relative_error", "per_K": -0.00102}
    >>> over_temperature_text({"unknown": {"over_temperature": change | {"column": "T_inductor_C"}}})
    'leakage inductance goes by the temperature of the inductor winding: −1.02 % in 10 K'
    """
    change = (diagnosis.get("unknown") or {}).get("over_temperature")
    if not change:
        return ""
    of = f"{effect_name(change['effect'])} goes by the temperature of the {channel_name(change['column'])}"
    return minus(f"{of}: {size_text(change['parameter'], 10.0 * change['per_K'])} in 10 K")


def _reads(sensor: Mapping[str, Any]) -> str:
    """By how much a sensor reads high or low."""
    size = abs(float(sensor["value"]))
    of = (
        f"{100 * size:.3g} %"
        if sensor["kind"] == "gain"
        else f"{size:.3g} {difference_unit(sensor['column'])}"
    )
    return f"{channel_name(sensor['column'])} reads {of} {'high' if sensor['value'] > 0 else 'low'}"


# what a leftover may be known as, and what a cause beside it is said to be beside
_TOLD = (
    (sensor_text, "a sensor that is off"),
    (over_temperature_text, "a property that goes by temperature"),
    (onset_text, "a change on the way"),
)


def told_text(diagnosis: Mapping[str, Any]) -> str:
    """What it is that no cause explains, where that is known; empty where it is not."""
    return next((said for text, _ in _TOLD if (said := text(diagnosis))), "")


def unexplained_text(diagnosis: Mapping[str, Any]) -> str:
    """What no cause of the catalogue explains: how probable, how large, where; empty where there is hardly anything.

    >>> law = {"formula": "2 W * P/kW", "formula_explains": 0.9}
    >>> print(unexplained_text({"unknown": law | {"probability": 0.8, "rms_W": 1.2, "location": "input"}}))
    80.0 % probable that something outside the catalogue shows: 1.20 W rms at the input, about 2 W * P/kW (90 % of it)
    >>> law["formula_explains"] = 0.01
    >>> place = {"probability": 0.8, "rms_W": 1.2, "location": "input, straight"}
    >>> print(unexplained_text({"unknown": law | place}))
    80.0 % probable that something outside the catalogue shows: 1.20 W rms at the input, in straight lines
    >>> unexplained_text({"unknown": law | place | {"at_place": 0.5}}).partition(": ")[2]
    '1.20 W rms at the input, in straight lines (there: 50.0 %)'
    """
    unknown = diagnosis.get("unknown") or {}
    if unknown.get("strained"):
        return (
            "efficiency is explained only with loss laws of the simulation off by all that is feared of them: either "
            "they are, or something outside the catalogue shows"
        )
    if unknown.get("probability", 0.0) < 0.01:
        return ""
    if told := sensor_text(diagnosis) or over_temperature_text(diagnosis):
        return f"{probability_text(unknown.get('at_place', unknown['probability']))} probable that {told}"
    if onset := onset_text(diagnosis):
        return (
            f"{probability_text(unknown['probability'])} probable that something changed on the way: {onset}"
        )
    said = f"{probability_text(unknown['probability'])} probable that something outside the catalogue shows"
    if "location" not in unknown:
        return said
    where = ", ".join(_PLACES.get(part, part) for part in unknown["location"].split(", "))
    if unknown.get("at_place", unknown["probability"]) < _SURE * unknown["probability"]:
        where = f"{where} (there: {probability_text(unknown['at_place'])})"
    if not unknown.get("formula") or fixed(unknown["rms_W"], 2) == "0.00":
        return f"{said}, {where}"
    said = f"{said}: {fixed(unknown['rms_W'], 2)} W rms {where}"
    if unknown["formula_explains"] < _TELLING:
        return said
    return minus(f"{said}, about {unknown['formula']} ({per_cent(unknown['formula_explains'], 0)} of it)")


def verdict_text(diagnosis: Mapping[str, Any]) -> str:
    """The verdict as one headline.

    >>> verdict_text({"verdict": "named"})
    'Cause named'
    >>> verdict_text({"verdict": "group", "groups": [["fan_step", "auxiliary_power"]]})
    'fan power step or auxiliary power: these data cannot tell which'
    >>> verdict_text({"verdict": "named", "named": ["dead_time"], "unknown": {"probability": 0.8}})
    'Cause named beside something unknown (80.0 %): dead time'
    >>> suspected = {"verdict": "consistent", "consistent": {"probability": 0.25}}
    >>> verdict_text(suspected | {"causes": [{"effect": "dead_time", "probability": 0.7}]})
    'Not sure: dead time (70.0 %) is suspected, or nothing is wrong (25.0 %)'
    >>> verdict_text(suspected | {"causes": [{"effect": "dead_time", "probability": 0.4}]})
    'No fault proven: nothing is wrong (25.0 %), or dead time (40.0 %)'
    >>> verdict_text({"verdict": "consistent", "conditions": [{"column": "V1_V", "taken": 300.0, "value": 304.0}]})
    'Simulation and measurement agree if V1_V was not 300 V'
    >>> verdict_text({"verdict": "consistent", "parts": [{"part": "dead_time_s", "sigma": 9.52}]})
    'Simulation and measurement agree, with dead time 9.5 times its everyday spread off'
    >>> left_over = {"verdict": "unknown", "unknown": {"probability": 0.4}}
    >>> verdict_text(left_over | {"causes": [{"effect": "dead_time", "probability": 0.6}]})
    'Something is wrong: dead time (60.0 %), or what no known cause explains'
    >>> nothing_left = left_over | {"unknown": {"probability": 0.0}}
    >>> verdict_text(nothing_left | {"causes": [{"effect": "dead_time", "probability": 0.6}]})
    'Something is wrong: dead time (60.0 %) is suspected, but may be no further off than parts are'
    >>> current = {"column": "I_L_rms_A", "kind": "gain", "value": 0.0291, "unit": "1"}
    >>> verdict_text({"verdict": "unknown", "unknown": {"probability": 1.0, "sensor": current}})
    'A sensor is off: rms link current reads 2.91 % high'
    >>> beside = {"verdict": "unknown", "unknown": {"probability": 1.0, "sensor": current}}
    >>> verdict_text(beside | {"causes": [{"effect": "dead_time", "probability": 0.98}]})
    'A sensor is off: rms link current reads 2.91 % high; dead time may be a part of it'
    >>> loose = {"effect": "link_resistance", "sets_in": True, "between_rows": [58, 59], "after_s": 10440.0}
    >>> loose["parameter"] = {"name": "resistance_Ohm", "value": 0.0606, "off": 0.0}
    >>> verdict_text({"verdict": "unknown", "unknown": {"probability": 1.0, "onset": loose}})
    'Ac-link resistance sets in between rows 58 and 59, after 2 h 54 min (60.6 mΩ then, 0 Ω before)'
    >>> change = {"effect": "leakage_inductance", "parameter": "relative_error", "per_K": -0.00102}
    >>> warm = {"probability": 1.0, "over_temperature": change | {"column": "T_inductor_C"}}
    >>> verdict_text({"verdict": "unknown", "unknown": warm})
    'Leakage inductance goes by the temperature of the inductor winding: −1.02 % in 10 K'
    >>> strained = {"verdict": "unknown", "unknown": {"probability": 1.0, "strained": True}}
    >>> verdict_text(strained | {"causes": [{"effect": "dead_time", "probability": 0.98}]})
    'Something is wrong that efficiency alone does not tell; dead time would need loss laws that are off as well'
    """
    verdict = str(diagnosis.get("verdict", "unknown"))
    told = {"named": _of_names, "group": _of_names, "consistent": _of_agreement, "unknown": _of_the_unknown}
    return told[verdict](diagnosis) if verdict in told else verdict


def _of_names(diagnosis: Mapping[str, Any]) -> str:
    """What is named, and what is tied."""
    named, groups = diagnosis.get("named") or (), diagnosis.get("groups") or ()
    tied = ", and ".join(join([effect_name(name) for name in group], "or") for group in groups)
    leftover = float((diagnosis.get("unknown") or {}).get("probability", 0.0))
    what = next((said for text, said in _TOLD if text(diagnosis)), "something unknown")
    unknown = f"{what} ({probability_text(leftover)})" if leftover >= _SUSPECTED else ""
    if not (named or groups):
        return VERDICTS[str(diagnosis["verdict"])]
    if not named:
        return f"{f'Beside {unknown}, ' if unknown else ''}{tied}: these data cannot tell which"
    first_said = "Cause named" if len(named) == 1 else "Causes named"
    beside = f" beside {unknown}" if unknown else ""
    also = f"; and {tied}: these data cannot tell which" if groups else ""
    return f"{first_said}{beside}: {join([effect_name(name) for name in named])}{also}"


def _of_agreement(diagnosis: Mapping[str, Any]) -> str:
    """That nothing is beyond an ordinary bench, as far as that is so."""
    suspects, all_possible = suspected(diagnosis), possible(diagnosis)
    nothing = probability_text(float((diagnosis.get("consistent") or {}).get("probability", 0.0)))
    if suspects:
        are = "is" if len(suspects) == 1 else "are"
        return f"Not sure: {join(suspects)} {are} suspected, or nothing is wrong ({nothing})"
    if all_possible:
        return f"No fault proven: nothing is wrong ({nothing}), or {join(all_possible, 'or')}"
    provided = [
        f"{c['column']} was not {size_text(c['column'], c['taken'])}" for c in doubted_conditions(diagnosis)
    ]
    parts = parts_text(diagnosis)
    return (
        VERDICTS["consistent"]
        + (f" if {join(provided)}" if provided else "")
        + (f", with {parts}" if parts else "")
    )


def _of_the_unknown(diagnosis: Mapping[str, Any]) -> str:
    """What may be there, where no cause explains all."""
    unknown = diagnosis.get("unknown") or {}
    likeliest = next(iter(suspected(diagnosis)), "")
    if likeliest and float(unknown.get("probability", 1.0)) < _SUSPECTED:
        if float(unknown.get("probability", 0.0)) < SHOWN:
            return f"Something is wrong: {likeliest} is suspected, but may be no further off than parts are"
        return f"Something is wrong: {likeliest}, or what no known cause explains"
    causes = [effect_name(str(cause["effect"])) for cause in probable_causes(diagnosis, _SURE)]
    sure, told = join(causes), told_text(diagnosis)
    if unknown.get("strained"):
        open_ = "Something is wrong that efficiency alone does not tell"
        return f"{open_}; {sure} would need loss laws that are off as well" if sure else open_
    if not sure:
        return f"{told[0].upper()}{told[1:]}" if told else VERDICTS["unknown"]
    rest = told or "no known cause explains all that is missed"
    return f"{rest[0].upper()}{rest[1:]}; {sure} may be a part of it"
