"""What a diagnosis asks its reader to make sure of, and to do, the most urgent first."""

from collections.abc import Mapping
from typing import Any

from bench.verdict_wording import CONDITIONS, doubted_conditions, parts_text, possible, told_text
from bench.wording import (
    SHOWN,
    channel_name,
    counted,
    duration,
    effect_name,
    join,
    parameter_text,
    points_text,
    probable_causes,
    size_text,
    step_text,
    told_by,
)

_WORSE = 1.2  # times as far off: a cause that shows in other channels leaves efficiency nearly as it was
_BEHIND = {
    "input": "what comes before the ac link: supply wiring, dc link, primary bridge, the analyzer's input element",
    "ac link": "what carries the ac link's current: inductor, transformer, their contacts",
    "output": "what comes behind the transformer: secondary bridge, output capacitors, wiring, the output element",
    "timing": "the gates: D1 as applied, dead times, delays between the bridges",
    "ac elements": "the probes and wiring of the analyzer's elements 3 and 4",
    "over time": "what changed in the course of the campaign: room, supply, instruments",
    "gain over time": "what changes the analyzer's gain in the course of the campaign: its room, its warm-up",
}  # a leftover's place: what of the bench is there
# what else moves as a sensor's gain does
_OTHERWISE = {
    "T_inductor_C": "; and how the winding is cooled, which the model may have otherwise",
    "T_transformer_C": "; and how the winding is cooled, which the model may have otherwise",
    "V2_V": "; and the turns ratio of the model, of which all moves as of V2_V",
}
_NOT_YET = "Change nothing yet: the tolerances of parts and instruments may still explain what the simulation misses."
_AGREES = "Nothing needs changing: the tolerances of parts and instruments may explain all that the simulation misses."
_PROVIDED = (
    "If it was that, nothing needs changing: the tolerances of parts and instruments may explain all else."
)
_VOLTAGES = ("V1_V", "V2_V")
_STEPS_SHOWN = 3  # of what to measure next, among what to do
_ASKED_AFTER = 0.05  # probability from which a cause is worth a check on the bench
_LIKELY = 0.5  # from which a cause's value is doubted where it is as large as is searched, and a leftover looked for


def first_questions(diagnosis: Mapping[str, Any]) -> list[str]:
    """What to make sure of before any cause is checked."""
    asked = (
        _question_of_a_sensor(diagnosis),
        _question_over_temperature(diagnosis),
        _question_of_conditions(diagnosis),
        _question_of_an_onset(diagnosis),
        _question_of_columns(diagnosis),
        _question_of_the_model(diagnosis),
        _only_with_spreads(diagnosis),
        _question_of_parts(diagnosis),
        _question_of_laws(diagnosis),
        _question_of_rows(diagnosis),
        _where_to_look(diagnosis),
    )
    return [question for question in asked if question]


def _question_of_conditions(diagnosis: Mapping[str, Any]) -> str:
    r"""What to read on the bench that the table lacks, where that may be what is found; else empty.

    >>> doubted = {"column": "V1_V", "taken": 300.0, "value": 304.12, "ci95": [303.6, 304.6]}
    >>> said = _question_of_conditions({"conditions": [doubted]})
    >>> print(said.replace(". ", ".\n"))
    Read V1_V, write what it was into the table and diagnose again.
    All readings together fit V1 304.1 V (95 %: 303.6 to 304.6; the model has 300 V).
    """
    if doubted := doubted_conditions(diagnosis):
        said = join([parameter_text({"name": c["column"], "off": c["taken"], **c}) for c in doubted])
        return (
            f"Read {join([c['column'] for c in doubted])}, write what it was into the table and diagnose again. "
            f"All readings together fit {said}."
        )
    taken = [c for c in diagnosis.get("conditions") or () if c["column"] in _VOLTAGES]
    agrees = diagnosis.get("verdict") == "consistent" and not possible(diagnosis)
    if not taken or diagnosis.get("channels") != ["efficiency"] or agrees:
        return ""
    said = join([f"{c['column']} was {size_text(c['column'], c['taken'])}" for c in taken])
    return (
        f"Make sure first that {said}: the table does not say, so that was taken, and to efficiency alone a per "
        "cent more or less may look like a cause."
    )


def _question_of_a_sensor(diagnosis: Mapping[str, Any]) -> str:
    """Which sensor to check before anything is made of what it shows; empty where none is likely off.

    >>> heatsink = {"column": "T_heatsink_C", "kind": "offset", "value": 6.0, "unit": "degC"}
    >>> _question_of_a_sensor({"unknown": {"probability": 1.0, "sensor": heatsink}})
    "Check what reads the heatsink (T_heatsink_C): its ratio, its wiring, the column's unit; then diagnose again."
    """
    unknown = diagnosis.get("unknown") or {}
    if not (sensor := unknown.get("sensor")) or float(unknown["probability"]) < _LIKELY:
        return ""
    of = f"{channel_name(str(sensor['column']))} ({sensor['column']})"
    otherwise = _OTHERWISE.get(str(sensor["column"]), "") if sensor["kind"] == "gain" else ""
    return f"Check what reads the {of}: its ratio, its wiring, the column's unit{otherwise}; then diagnose again."


def _question_over_temperature(diagnosis: Mapping[str, Any]) -> str:
    """What to measure where a property seems to go by temperature; empty where none does.

    >>> change = {"effect": "leakage_inductance", "column": "T_inductor_C", "check": "measure the series inductance"}
    >>> print(_question_over_temperature({"unknown": {"probability": 1.0, "over_temperature": change}})[:99])
    Measure one set point soon after a cold start and again when all is warm: if leakage inductance goe
    """
    unknown = diagnosis.get("unknown") or {}
    if not (change := unknown.get("over_temperature")) or float(unknown["probability"]) < _LIKELY:
        return ""
    part = f"{channel_name(change['column'])} ({change['column']})"
    return (
        "Measure one set point soon after a cold start and again when all is warm: if "
        f"{effect_name(change['effect'])} goes by the temperature of the {part}, the two differ. If they do, "
        f"{change['check']}, cold and warm."
    )


def _question_of_an_onset(diagnosis: Mapping[str, Any]) -> str:
    """What to do where a cause is not there all the time; empty where none is.

    >>> onset = {"between_rows": [58, 59], "after_s": 10440.0, "check": "tighten the terminals"}
    >>> _question_of_an_onset({"unknown": {"probability": 1.0, "onset": onset}})[:81]
    'Find out what changed after 2 h 54 min (tighten the terminals), and diagnose what'
    >>> agree = {"name": "before", "rows": 58, "refused": None, "answer": {"verdict": "consistent"}}
    >>> few = {"name": "after", "rows": 7, "refused": "7 usable rows", "answer": None}
    >>> _question_of_an_onset({"unknown": {"probability": 1.0, "onset": onset | {"stretches": [agree, few]}}})[63:]
    ' all rows together are of no single converter.'
    """
    unknown = diagnosis.get("unknown") or {}
    if not (onset := unknown.get("onset")) or float(unknown["probability"]) < _LIKELY:
        return ""
    hint = f" ({check})" if (check := _check_of_a_change(onset)) else ""
    changed = f"Find out what changed after {duration(onset['after_s'])}{hint}"
    if onset.get("stretches"):
        return f"{changed}: all rows together are of no single converter."
    before, row = onset["between_rows"]
    return (
        f"{changed}, and diagnose what was measured up to row {before} and from row {row} on each on its own: all rows "
        "together are of no single converter."
    )


def _check_of_a_change(onset: Mapping[str, Any]) -> str:
    """What to look at; empty where the place tells none.

    >>> _check_of_a_change({"check": None, "sensor": None, "place": "V1_V"})
    'V1_V: read it, and write it into the table'
    >>> _check_of_a_change({"check": None, "sensor": None, "place": "output, straight"})[:24]
    'what comes behind the tr'
    """
    if onset.get("check"):
        return str(onset["check"])
    if sensor := onset.get("sensor"):
        return (
            f"what reads the {channel_name(str(sensor['column']))}: where it is fixed, its range, its wiring"
        )
    if onset.get("place") in CONDITIONS:
        return f"{onset['place']}: read it, and write it into the table"
    return _BEHIND.get(str(onset.get("place")).split(", ")[0], "")


def _question_of_columns(diagnosis: Mapping[str, Any]) -> str:
    """Which columns to put right; empty where none was left out.

    >>> _question_of_columns({"rejected_columns": [{"column": "T_inductor_C", "reason": "looks like kelvin"}]})
    'Put right T_inductor_C, which was left out, and diagnose again: without it less can be told.'
    """
    columns = [str(entry["column"]) for entry in diagnosis.get("rejected_columns") or ()]
    were, them = ("was", "it") if len(columns) == 1 else ("were", "them")
    said = f"Put right {join(columns)}, which {were} left out, and diagnose again: without {them} less can be told."
    return said if columns else ""


def _question_of_the_model(diagnosis: Mapping[str, Any]) -> str:
    """What to ask first where nothing known explains the gap, or a cause does so badly; else empty.

    A model file of another converter, or a column in another unit, does either.
    """
    reasons = [
        f"{effect_name(cause['effect'])} is as far off as is searched ({parameter_text(cause['parameters'][0])})"
        for cause in probable_causes(diagnosis, _LIKELY)
        if cause.get("parameters") and cause["parameters"][0].get("at_bound")
    ]
    if (worse := extension_worse(diagnosis)) and not spreads_make_good(diagnosis):
        reasons.append(f"{worse}, so the extended model is not to be used")
    left = float((diagnosis.get("unknown") or {}).get("probability", 1.0)) >= SHOWN
    nameless = left and not _alike(diagnosis) and not told_text(diagnosis)
    if not reasons and diagnosis.get("verdict") == "unknown" and nameless:
        reasons = ["no known cause explains all of the gap"]
    if not reasons:
        return ""
    return (
        "Make sure first that the model describes the converter that was measured, and that every column is in its "
        f"unit: {join(reasons)}."
    )


def extension_worse(diagnosis: Mapping[str, Any]) -> str:
    """That the named causes surely predict held-out rows worse than the simulation did without them; else empty."""
    gain = diagnosis.get("gain")
    if not gain or gain["ci95"][1] >= 0 or gain["after"] < _WORSE * gain["before"]:
        return ""
    least, most = sorted(-bound for bound in gain["ci95"])
    return (
        f"held-out rows are {points_text(gain['after'])} points off with what is named, "
        f"{points_text(gain['before'])} without ({points_text(least)} to {points_text(most)} points worse, 95 %)"
    )


def _no_better(diagnosis: Mapping[str, Any]) -> str:
    """That held-out efficiency is no nearer with what is named, where that is so: causes show in other channels too."""
    gain = diagnosis.get("gain")
    if not gain or gain["after"] <= gain["before"]:
        return ""
    return (
        f" Efficiency of held-out rows is no nearer for it: {points_text(gain['after'])} points off with what is "
        f"named, {points_text(gain['before'])} without."
    )


def spreads_make_good(diagnosis: Mapping[str, Any]) -> bool:
    """Whether what is named predicts held-out rows better once everyday spreads are fitted beside it, and no leftover
    has to be there for that: a leftover would hide the error of a wrong name as well."""
    gain, unknown = diagnosis.get("gain"), diagnosis.get("unknown") or {}
    surely_better = float((gain or {}).get("calibrated_ci95", (0.0, 0.0))[0]) > 0
    return surely_better and float(unknown.get("probability", 0.0)) < _LIKELY


def _only_with_spreads(diagnosis: Mapping[str, Any]) -> str:
    """That the extended model lacks what a named cause is right beside; empty where it predicts no worse."""
    worse = extension_worse(diagnosis)
    if not worse or not spreads_make_good(diagnosis):
        return ""
    fitted = points_text(diagnosis["gain"]["calibrated"])
    return (
        f"Do not predict efficiency with the extended model: {worse}, but {fitted} with the everyday spreads of parts "
        "and instruments fitted beside it. In efficiency those spreads cancel what is named, which this does not speak "
        "against; d2ea train keeps a calibrated model, which holds both."
    )


def _question_of_parts(diagnosis: Mapping[str, Any]) -> str:
    """What to ask where what is found needs a part, or an instrument, as far off as no ordinary one is; else empty."""
    said = parts_text(diagnosis)
    return f"More may be wrong than is said: what is found needs {said}." if said else ""


def _question_of_laws(diagnosis: Mapping[str, Any]) -> str:
    """What to measure where only laws that are off would explain efficiency alone; else empty."""
    if not (diagnosis.get("unknown") or {}).get("strained"):
        return ""
    return (
        "Measure more than efficiency: D0, temperatures, or the powers at both ends of the ac link tell a cause from a "
        "loss law that is off, and from what the catalogue does not have."
    )


def _question_of_rows(diagnosis: Mapping[str, Any]) -> str:
    """What to ask where some rows stand out that are no outliers; else empty."""
    rows = _alike(diagnosis)
    if not rows:
        return ""
    said = join([f"row {row['row']} ({row['watts']:+.2f} W)" for row in rows[:_STEPS_SHOWN]])
    more = f" and {counted(len(rows) - _STEPS_SHOWN, 'more row')}" if len(rows) > _STEPS_SHOWN else ""
    return (
        f"Measure again what stands out: {said}{more}. The powers at the input and before the link miss the same "
        "there, which noise does not do. If it repeats, the converter does it; if not, something else had changed."
    )


def _where_to_look(diagnosis: Mapping[str, Any]) -> str:
    """Which parts of the bench can lose what no cause explains; empty where the channels do not tell the place."""
    unknown = diagnosis.get("unknown") or {}
    places = _BEHIND.get(str(unknown.get("location", "")).split(", ")[0], "")
    told = {"P_link1_W", "D0"} & set(diagnosis.get("channels") or ())
    if not (places and told) or unknown.get("probability", 0.0) < _LIKELY:
        return ""
    return f"Look for what no cause explains in {places}."


def _alike(diagnosis: Mapping[str, Any]) -> list[Mapping[str, Any]]:
    return list((diagnosis.get("unknown") or {}).get("rows") or ())


def _values_kept(diagnosis: Mapping[str, Any]) -> str:
    """Which values the extended model holds, which need not be the most probable ones; empty where it says none.

    >>> head = {"name": "resistance_Ohm", "value": 0.098, "ci95": [0.07, 0.126], "in_model": 0.126}
    >>> link = {"effect": "link_resistance", "probability": 1.0, "parameters": [head]}
    >>> print(_values_kept({"named": ["link_resistance"], "causes": [link]})[:99])
     It holds ac-link resistance 126 mΩ (98 mΩ is likeliest, 126 mΩ the end of its interval): of the va
    """
    kept = [
        _kept(str(cause["effect"]), head)
        for cause in probable_causes(diagnosis)
        if cause["effect"] in (diagnosis.get("named") or ())
        and (head := (cause.get("parameters") or [{}])[0]).get("in_model") is not None
    ]
    return (
        f" It holds {join(kept)}: of the values inside the interval, what predicts the measured efficiencies best, "
        "with all other parts nominal."
        if kept
        else ""
    )


def _kept(effect: str, head: Mapping[str, Any]) -> str:
    """The value that the extended model holds, and the likeliest one; whether it is as far from that as it may be."""
    name, kept = str(head["name"]), float(head["in_model"])
    size, likeliest = size_text(name, kept), size_text(name, float(head["value"]))
    if size == likeliest:
        return f"{effect_name(effect)} {size}"
    ends = [size_text(name, float(end)) for end in head.get("ci95") or ()]
    end = f", {size} the end of its interval" if size in ends else ""
    return f"{effect_name(effect)} {size} ({likeliest} is likeliest{end})"


def _expected(cause: Mapping[str, Any]) -> str:
    """What a check should bring out; empty where the cause's value is not told."""
    (head, *_) = cause.get("parameters") or [{}]
    return f"; expected, against the simulation: {parameter_text(head)}" if head.get("ci95") else ""


def diagnosis_actions(diagnosis: Mapping[str, Any]) -> list[str]:
    """What a diagnosis asks for, the most urgent first."""
    todo = first_questions(diagnosis)
    todo += [
        f"Check {effect_name(cause['effect'])}: {check}{_expected(cause)}."
        for cause in probable_causes(diagnosis, _ASKED_AFTER)
        if (check := cause.get("check"))
    ]
    for step in list(diagnosis.get("next") or ())[:_STEPS_SHOWN]:
        told = told_by(step["separates"]) if step.get("separates") else ""
        minutes = f" (about {step['minutes']:.3g} min)" if step.get("minutes") is not None else ""
        todo.append(
            f"Measure next: {step_text(step).removeprefix('measure ')}{minutes}"
            + (f", to tell {told}." if told else ".")
        )
    if diagnosis.get("model") and diagnosis.get("verdict") == "named" and not extension_worse(diagnosis):
        todo.append(
            f"Simulate with the extended model from now on: {diagnosis['model']}.{_values_kept(diagnosis)}"
            f"{_no_better(diagnosis)}"
        )
    if diagnosis.get("verdict") != "consistent":
        return todo
    if doubted_conditions(diagnosis) and not possible(diagnosis):
        return [todo[0], _PROVIDED, *todo[1:]]
    if diagnosis.get("parts") and not possible(diagnosis):
        return todo
    first = _NOT_YET if possible(diagnosis) else _AGREES
    return [f"{first} What follows would make sure." if todo else first, *todo]
