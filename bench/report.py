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
from plotly.offline import get_plotlyjs

from bench import charts
from bench.bands import loaded_rows
from bench.html import environment
from bench.questions import diagnosis_actions
from bench.verdict_wording import unexplained_text, verdict_text
from bench.whole_file import write_whole
from bench.wording import (
    MODEL_NAMES,
    counted,
    effect_name,
    join,
    minus,
    per_cent,
    points_text,
    probable_causes,
    size_text,
    words,
)
from sim.effects.catalogue import effect

_SWITCH_OFF = "Switch the bench off by hand and check it: power-off was not confirmed."
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


def write_report(path: Path, data: ReportData) -> None:
    """Write the report; the file holds its own styles, scripts and data."""
    page = (
        environment(TEMPLATES)
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
    write_whole(path, page)


def actions(data: ReportData) -> list[str]:
    """What to do now, the most urgent first."""
    off = () if data.power_off.get("confirmed") else (_SWITCH_OFF,)
    return [*off, *diagnosis_actions(data.diagnosis)]


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
                minus(f"{gap.get('mean_loss_W', 0):+.1f} W of loss, mean"),
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
