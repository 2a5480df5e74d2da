"""The diagnosis as a page that a person reads from top to bottom, and knows what to do on Monday."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pandas as pd
import plotly.graph_objects as go
from plotly.offline import get_plotlyjs

from bench import charts, diagnosis_charts
from bench.html import environment
from bench.questions import diagnosis_actions
from bench.report import TEMPLATES, rows_left_out
from bench.so_far import so_far_text
from bench.verdict_wording import stretch_texts, unexplained_text, verdict_text
from bench.whole_file import write_whole
from bench.wording import (
    channel_name,
    counted,
    difference_unit,
    effect_name,
    minus,
    points_text,
    probable_causes,
    size_text,
)
from models.diagnosis.noise import LEAST_DIFFERENCES

PAGE = "diagnosis.html"  # what it is called, in a folder of its own for each stretch of a campaign
_KURTOSIS, _AUTOCORRELATION = 3.0, 0.3  # above which the noise is said to have tails, or a memory
# What normal noise reaches of either at two sigma, times the root of the differences' number
_BY_CHANCE = (20.0, 4.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class DiagnosisPage:
    """All that the page shows: ``diagnosis`` is the JSON answer, ``residuals`` its residual table."""

    source: str
    virtual: bool
    created: str
    diagnosis: Mapping[str, Any]
    residuals: pd.DataFrame


def write_diagnosis_page(path: Path, page: DiagnosisPage) -> None:
    """Write the page; the file holds its own styles, scripts and data."""
    d = page.diagnosis
    text = (
        environment(TEMPLATES)
        .get_template("diagnosis.html")
        .render(
            data=page,
            causes=probable_causes(d),
            headline=verdict_text(d),
            so_far=so_far_text(d),
            unexplained=unexplained_text(d),
            stretches=stretch_texts(d),
            of_a_stretch=PAGE,
            actions=diagnosis_actions(d),
            tiles=tiles(d),
            noise=noise_rows(d),
            unseen=unseen(d),
            ties=ties(d),
            charts=_charts(page),
            plotly=get_plotlyjs(),
        )
    )
    write_whole(path, text)


def tiles(diagnosis: Mapping[str, Any]) -> list[tuple[str, str, str]]:
    """Key numbers: (what, value, remark)."""
    gap, gain = diagnosis["gap"], diagnosis.get("gain")
    worst, left_out = gap["worst"], rows_left_out(diagnosis)
    where = f"at D1 {worst['D1']:.3f}, D2 {worst['D2']:.3f}, {worst['P2_W']:.0f} W: {worst['loss_W']:+.2f} W of loss"
    out = [
        ("Measured rows", str(diagnosis["points"]), left_out or "all used"),
        (
            "Gap of efficiency",
            f"{points_text(gap['mean_abs_efficiency'])} points",
            f"{gap['mean_loss_W']:+.2f} W of loss, mean",
        ),
        ("Worst row", f"{points_text(worst['efficiency'])} points", where),
    ]
    if gain:
        left = f"{points_text(gain['calibrated'])} with parts calibrated"
        out.append(("Gap left, held out", f"{points_text(gain['after'])} points", left))
    return [(what, minus(value), minus(remark)) for what, value, remark in out]


def noise_rows(diagnosis: Mapping[str, Any]) -> list[tuple[str, str, str, str]]:
    """(channel, one sigma, where from, what is unusual)."""
    rows = []
    for channel, n in diagnosis["noise"].items():
        sigma = (
            f"{100 * n['sigma']:.3g} % of the {'current' if channel == 'I_L_rms_A' else 'output power'}"
            if n["relative"]
            else f"{n['sigma']:.3g} {difference_unit(channel)}"
        )
        count = int(n["from_replicates"])
        source = f"{counted(count, 'difference')} of replicates" if count else "no replicates"
        source = source if count >= LEAST_DIFFERENCES else f"assumed: {source}"
        said = []
        tails, memory = (chance / max(count, 1) ** 0.5 for chance in _BY_CHANCE)
        if count and n["excess_kurtosis"] > max(_KURTOSIS, tails):
            said.append("heavy tails")
        if count and n["autocorrelation"] > max(_AUTOCORRELATION, memory):
            said.append("remembers: drift or slow settling")
        rows.append((channel_name(channel), sigma, source, ", ".join(said) or "–"))
    return rows


@dataclass(frozen=True, slots=True, kw_only=True)
class Unseen:
    """Effects that these set points and channels cannot see at an ordinary size: ``larger`` ones would be seen, each
    from where it is so far off; ``never`` those that would not be at any size that is searched."""

    larger: tuple[tuple[str, str], ...]
    never: tuple[str, ...]


def unseen(diagnosis: Mapping[str, Any]) -> Unseen:
    """What a diagnosis of these rows is blind to."""
    blind = [s for s in diagnosis["sight"] if not s["visible"]]
    return Unseen(
        larger=tuple(
            (effect_name(s["effect"]), size_text(s["parameter"], s["smallest"]))
            for s in blind
            if s["searched"]
        ),
        never=tuple(effect_name(s["effect"]) for s in blind if not s["searched"]),
    )


def ties(diagnosis: Mapping[str, Any]) -> list[tuple[str, list[str]]]:
    """Effects that the design alone cannot tell apart, each with those it ties with; no two of them twice."""
    found, said = list[tuple[str, list[str]]](), set[frozenset[str]]()
    for s in diagnosis["sight"]:
        others = [name for name in s["tied_with"] if frozenset((s["effect"], name)) not in said]
        said |= {frozenset((s["effect"], name)) for name in others}
        if others:
            found.append((effect_name(s["effect"]), [effect_name(name) for name in others]))
    return found


def _charts(page: DiagnosisPage) -> dict[str, str]:
    d = page.diagnosis
    counted = diagnosis_charts.readings_that_count(page.residuals, d["rejected_rows"])
    figures: dict[str, go.Figure | None] = {
        "residuals": diagnosis_charts.residual_maps(counted),
        "time": diagnosis_charts.residual_over_time(page.residuals, counted),
        "causes": diagnosis_charts.cause_bars(
            probable_causes(d), d["unknown"]["probability"], d["consistent"]["probability"]
        ),
        "leftover": diagnosis_charts.leftover_map(page.residuals),
        "gain": charts.gain_bars(d["gain"]) if d.get("gain") else None,
    }
    return {name: charts.to_json(figure) for name, figure in figures.items() if figure is not None}
