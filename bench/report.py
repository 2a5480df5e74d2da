"""The report of a run: one HTML file that needs nothing else, read from top to bottom.

Order: what was found and what to do, the evidence for it, then the pictures behind the evidence, then what
the run cost and that the bench was left safe.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pandas as pd
import plotly.graph_objects as go
from jinja2 import ChainableUndefined, Environment, FileSystemLoader
from plotly.offline import get_plotlyjs

from bench import charts
from bench.bands import loaded_rows
from bench.wording import (
    MODEL_NAMES,
    SHOWN,
    action_text,
    added_power,
    channel_name,
    counted,
    duration,
    effect_name,
    fixed,
    join,
    minus,
    parameter_text,
    per_cent,
    points_text,
    probability_text,
    probable_causes,
    size_text,
    suspected,
    unbroken,
    unexplained_text,
    verdict_class,
    verdict_text,
    words,
)
from sim.effects.catalogue import effect

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
_SWITCH_OFF = "Switch the bench off by hand and check it: power-off was not confirmed."
NOT_YET = "Change nothing yet: the tolerances of parts and instruments may still explain what the simulation misses."
AGREES = "Nothing needs changing: the tolerances of parts and instruments may explain all that the simulation misses."
STEPS_SHOWN = 3  # of what to measure next, among what to do
ASKED_AFTER = 0.05  # probability from which a cause is worth a check on the bench
LIKELY = 0.5  # from which a cause's value is doubted where it is as large as is searched, and a leftover looked for
_NEAR_AN_END = 1e-3  # of the range that is searched
OPTIMUM = ["P_W", "D1", "D2", "predicted", "measured"]
TEMPLATES = Path(__file__).with_name("templates")


@dataclass(frozen=True, slots=True, kw_only=True)
class ReportData:
    """All that a report shows; nothing is computed from elsewhere.

    ``simulation`` is the simulation table (``D1 D2 P_set_W feasible efficiency`` at least, on a grid).
    ``measurements`` is the measurement table with a column ``sim_X`` beside each simulated channel ``X``
    (``sim_efficiency`` at least). ``losses`` holds ``P_set_W`` and ``loss_<part>_W`` at the optimum.
    ``summary`` and ``diagnosis`` are the contents of summary.json and of ``diagnose --json``; ``optimiser``
    is ``{"name", "evaluations", "regret"}``; ``power_off`` is
    ``{"confirmed": bool, "devices": {name: state}}``.
    """

    title: str
    bench: str
    virtual: bool
    created: str
    simulation: pd.DataFrame
    measurements: pd.DataFrame
    losses: pd.DataFrame
    summary: Mapping[str, Any]
    diagnosis: Mapping[str, Any]
    power_off: Mapping[str, Any]
    optimiser: Mapping[str, Any] = field(default_factory=dict)
    notes: tuple[str, ...] = ()

    @property
    def optimum(self) -> pd.DataFrame:
        """``summary["optimum"]`` as a frame; NaN where nothing was measured."""
        return pd.DataFrame(list(self.summary.get("optimum") or ()), columns=OPTIMUM).astype(float)


def environment() -> Environment:
    """Where the pages' templates come from, with the filters that they use."""
    made = Environment(
        loader=FileSystemLoader(TEMPLATES),
        autoescape=True,
        undefined=ChainableUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    made.filters |= {
        "points": points_text, "per_cent": per_cent, "duration": duration,
        "words": effect_name, "counted": counted, "fixed": fixed, "added_power": added_power,
        "parameter": lambda parameter: unbroken(parameter_text(parameter)),
        "action": action_text, "channel": channel_name, "probability": probability_text, "verdict_class": verdict_class,
    }  # fmt: skip
    return made


def write_report(path: Path, data: ReportData) -> None:
    """Write the report; the file holds its own styles, scripts and data."""
    page = (
        environment()
        .get_template("report.html")
        .render(
            data=data,
            headline=verdict_text(data.diagnosis),
            unexplained=unexplained_text(data.diagnosis),
            causes=probable_causes(data.diagnosis),
            actions=actions(data),
            tiles=tiles(data),
            errors=error_rows(data.summary),
            steps=step_rows(data.summary),
            revealed=revealed(data.summary),
            charts=_charts(data),
            plotly=get_plotlyjs(),
        )
    )
    path.write_text(page, encoding="utf-8")


def actions(data: ReportData) -> list[str]:
    """What to do now, the most urgent first."""
    off = () if data.power_off.get("confirmed") else (_SWITCH_OFF,)
    return [*off, *diagnosis_actions(data.diagnosis)]


def first_questions(diagnosis: Mapping[str, Any]) -> list[str]:
    """What to make sure of before any cause is checked."""
    asked = (
        _question_of_the_model(diagnosis),
        _only_with_spreads(diagnosis),
        _question_of_rows(diagnosis),
        _where_to_look(diagnosis),
    )
    return [question for question in asked if question]


def _question_of_the_model(diagnosis: Mapping[str, Any]) -> str:
    """What to ask first where nothing known explains the gap, or a cause does so badly; else empty.

    A model file of another converter, or a column in another unit, does either.
    """
    reasons = [
        f"{effect_name(cause['effect'])} is as far off as is searched ({parameter_text(cause['parameters'][0])})"
        for cause in probable_causes(diagnosis, LIKELY)
        if cause.get("parameters") and _at_an_end(cause["effect"], float(cause["parameters"][0]["value"]))
    ]
    if (worse := extension_worse(diagnosis)) and not spreads_make_good(diagnosis):
        reasons.append(f"{worse}, so the extended model is not to be used")
    left = float((diagnosis.get("unknown") or {}).get("probability", 1.0)) >= SHOWN
    if not reasons and diagnosis.get("verdict") == "unknown" and left and not _alike(diagnosis):
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


def spreads_make_good(diagnosis: Mapping[str, Any]) -> bool:
    """Whether what is named predicts held-out rows better once everyday spreads are fitted beside it, and no leftover
    has to be there for that: a leftover would hide the error of a wrong name as well."""
    gain, unknown = diagnosis.get("gain"), diagnosis.get("unknown") or {}
    surely_better = float((gain or {}).get("calibrated_ci95", (0.0, 0.0))[0]) > 0
    return surely_better and float(unknown.get("probability", 0.0)) < LIKELY


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


def _question_of_rows(diagnosis: Mapping[str, Any]) -> str:
    """What to ask where some rows stand out that are no outliers; else empty."""
    rows = _alike(diagnosis)
    if not rows:
        return ""
    said = join([f"row {row['row']} ({row['watts']:+.2f} W)" for row in rows[:STEPS_SHOWN]])
    more = f" and {counted(len(rows) - STEPS_SHOWN, 'more row')}" if len(rows) > STEPS_SHOWN else ""
    return (
        f"Measure again what stands out: {said}{more}. The powers at the input and before the link miss the same "
        "there, which noise does not do. If it repeats, the converter does it; if not, something else had changed."
    )


def _where_to_look(diagnosis: Mapping[str, Any]) -> str:
    """Which parts of the bench can lose what no cause explains; empty where the channels do not tell the place."""
    unknown = diagnosis.get("unknown") or {}
    places = _BEHIND.get(str(unknown.get("location", "")).split(", ")[0], "")
    told = {"P_link1_W", "D0"} & set(diagnosis.get("channels") or ())
    if not (places and told) or unknown.get("probability", 0.0) < LIKELY:
        return ""
    return f"Look for what no cause explains in {places}."


def _alike(diagnosis: Mapping[str, Any]) -> list[Mapping[str, Any]]:
    return list((diagnosis.get("unknown") or {}).get("rows") or ())


def _at_an_end(name: str, value: float) -> bool:
    """Whether an effect's value is where the search for it ends."""
    head = effect(name).headline
    near = _NEAR_AN_END * (head.upper - head.lower)
    return min(value - head.lower, head.upper - value) <= near


def diagnosis_actions(diagnosis: Mapping[str, Any]) -> list[str]:
    """What a diagnosis asks for, the most urgent first."""
    todo = first_questions(diagnosis)
    todo += [
        f"Check {effect_name(cause['effect'])}: {check}."
        for cause in probable_causes(diagnosis, ASKED_AFTER)
        if (check := cause.get("check"))
    ]
    for step in list(diagnosis.get("next") or ())[:STEPS_SHOWN]:
        told = join([effect_name(name) for name in step.get("separates") or ()])
        minutes = f" (about {step['minutes']:.3g} min)" if step.get("minutes") is not None else ""
        repeats = f", {step['repeats']} times" if step.get("repeats", 1) > 1 else ""
        todo.append(
            f"Measure next: {action_text(str(step['action'])).removeprefix('measure ')}{repeats}{minutes}"
            + (f", to settle {told}." if told else ".")
        )
    if diagnosis.get("model") and diagnosis.get("verdict") == "named" and not extension_worse(diagnosis):
        todo.append(f"Simulate with the extended model from now on: {diagnosis['model']}.")
    if diagnosis.get("verdict") == "consistent":
        first = NOT_YET if suspected(diagnosis) else AGREES
        todo.insert(0, f"{first} What follows would make sure." if todo else first)
    return todo


def rows_left_out(diagnosis: Mapping[str, Any]) -> str:
    """How many rows a diagnosis did not use, or not all of, or never got; empty where it used all."""
    rows = {row["row"] for row in diagnosis.get("rejected_rows") or ()}
    before = (diagnosis.get("left_out_by_import") or {}).get("rows") or ()
    said = [f"all or some readings of {counted(len(rows), 'row')} not used by the diagnosis"] if rows else []
    return "; ".join(said + ([f"{counted(len(before), 'row')} left out by the import"] if before else []))


def tiles(data: ReportData) -> list[tuple[str, str, str]]:
    """Key numbers: (what, value, remark)."""
    summary, gap, gain = data.summary, data.diagnosis.get("gap") or {}, data.diagnosis.get("gain") or {}
    rows = loaded_rows(data.measurements)
    out = [
        (
            "Measured points",
            f"{summary.get('points', len(rows))}",
            rows_left_out(data.diagnosis) or "all used by the diagnosis",
        )
    ]
    if summary.get("sim_points"):
        share = per_cent(summary["sim_feasible"] / summary["sim_points"], 0)
        out.append(
            (
                "Simulated points",
                f"{summary['sim_points']:,}",
                f"{summary['sim_feasible']:,} can carry their power ({share})",
            )
        )
    if gap.get("mean_abs_efficiency") is not None:
        out.append(
            (
                "Gap to the simulation",
                f"{points_text(gap['mean_abs_efficiency'], 2)} points",
                f"{gap.get('mean_loss_W', 0):.1f} W of loss, mean",
            )
        )
    if gain.get("after") is not None:
        out.append(
            (
                "Gap after the diagnosis",
                f"{points_text(gain['after'])} points",
                f"on held-out blocks ({gain.get('blocks', '')})",
            )
        )
    best = data.optimum.dropna(subset=["measured"])
    if len(best):
        top = best.iloc[int(best["measured"].astype(float).argmax())]
        out.append(
            (
                "Best measured",
                per_cent(top["measured"], 2),
                f"at {top['P_W']:.0f} W, D1 {top['D1']:.3f}, D2 {top['D2']:.3f}",
            )
        )
    return out


def error_rows(summary: Mapping[str, Any]) -> list[tuple[str, float | None, str]]:
    """(model, mean absolute error as a fraction, how it compares with simulation only)."""
    error = summary.get("error") or {}
    base = error.get("simulation_only")
    names = [
        *(name for name in MODEL_NAMES if name in error),
        *(name for name in error if name not in MODEL_NAMES),
    ]
    return [(MODEL_NAMES.get(name, words(name)), error[name], _against(base, error[name])) for name in names]


def step_rows(summary: Mapping[str, Any]) -> list[tuple[str, float, float]]:
    """(step, seconds, share of the total), the total last."""
    seconds = dict(summary.get("seconds") or {})
    if not seconds:
        return []
    total = float(seconds.pop("total", sum(seconds.values())))
    rows = [
        (words(name), float(value), float(value) / total if total else 0.0) for name, value in seconds.items()
    ]
    return [*rows, ("total", total, 1.0)]


def revealed(summary: Mapping[str, Any]) -> str:
    """What was hidden in a virtual lab and whether it was found; empty when there is nothing to reveal."""
    if "hidden" not in summary:
        return ""
    hidden = [hidden_text(name, summary["hidden_values"][name]) for name in summary["hidden"]]
    if not hidden:
        return "Nothing was hidden in this virtual lab."
    found = "found" if summary.get("found") else "not found"
    told = "Hidden in this virtual lab, and revealed only after the verdict was stored"
    return f"{told}: {join(hidden)} – {found}."


def hidden_text(name: str, value: float) -> str:
    """An effect that a virtual lab has, with its size.

    >>> hidden_text("fan_step", 4.2123)
    'fan power step 4.21 W'
    """
    return minus(f"{effect_name(name)} {size_text(effect(name).headline.name, value)}")


def _against(base: float | None, error: float | None) -> str:
    if base is None or not error or error == base:
        return "–"
    return f"{base / error:.3g} times smaller" if error < base else f"{error / base:.3g} times as large"


def _charts(data: ReportData) -> dict[str, str]:
    rows = loaded_rows(data.measurements)
    figures: dict[str, go.Figure | None] = {
        "maps": charts.efficiency_maps(data.simulation, data.measurements) if len(data.simulation) else None,
        "errors": charts.model_errors(data.summary.get("error") or {}) if data.summary.get("error") else None,
        "optimum": charts.optimum_over_load(data.optimum) if len(data.optimum) else None,
        "channels": charts.channel_residuals(rows),
        "losses": charts.loss_breakdown(data.losses) if charts.loss_parts(data.losses) else None,
        "gain": charts.gain_bars(data.diagnosis["gain"]) if data.diagnosis.get("gain") else None,
    }
    return {name: charts.to_json(figure) for name, figure in figures.items() if figure is not None}
