"""One picture of a run for people who look before they read: four panels, as a PNG."""

import textwrap
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullFormatter

from bench.bands import loaded_rows
from bench.charts import DIFFERENCE, OKABE_ITO
from bench.report import ReportData
from bench.verdict_wording import verdict_text
from bench.whole_file import replacing
from bench.wording import MODEL_NAMES, effect_name, parameter_text, probability_text, probable_causes

TEXT, SOFT = "#1b1f24", "#59636e"
DIVERGING = LinearSegmentedColormap.from_list("difference", DIFFERENCE)


def overview_png(path: Path, data: ReportData) -> None:
    """Write the overview, 1600 x 900 pixels."""
    figure = Figure(figsize=(16, 9), dpi=100, facecolor="white")
    FigureCanvasAgg(figure)
    grid = figure.add_gridspec(
        2,
        2,
        width_ratios=[1.0, 1.1],
        left=0.055,
        right=0.98,
        top=0.865,
        bottom=0.075,
        wspace=0.16,
        hspace=0.36,
    )
    lower = grid[1, 0].subgridspec(2, 1, hspace=0.12)
    residual_panel(figure.add_subplot(grid[0, 0]), figure, loaded_rows(data.measurements))
    cause_panel(figure.add_subplot(grid[0, 1]), data.diagnosis)
    upper = figure.add_subplot(lower[0])
    optimum_panel(upper, figure.add_subplot(lower[1], sharex=upper), data.optimum)
    extended = (data.diagnosis.get("gain") or {}).get("after")
    error_panel(figure.add_subplot(grid[1, 1]), data.summary.get("error") or {}, extended)
    figure.text(0.055, 0.955, data.title, fontsize=19, fontweight="bold", color=TEXT, va="center")
    if data.virtual:
        label = "VIRTUAL LAB: mock instruments, nothing measured on hardware"
        box = {"boxstyle": "round,pad=0.45", "facecolor": "#ffd83d", "edgecolor": TEXT}
        figure.text(
            0.975, 0.955, label, fontsize=12, color=TEXT, ha="right", va="center", bbox=box, fontweight="bold"
        )
    with replacing(path) as file:
        figure.savefig(file, format="png")


def residual_panel(axes: Axes, figure: Figure, rows: pd.DataFrame) -> None:
    """Measured less simulated efficiency of every point over output power and D1."""
    residual = 100 * (rows["efficiency"] - rows["sim_efficiency"])
    spread = float(np.nanquantile(residual.abs(), 0.98)) if residual.notna().any() else 1.0
    _style(axes, "Where the simulation is wrong", "output power (W)", "D1 (half periods)")
    points = axes.scatter(
        rows["P2_W"], rows["D1"], c=residual, cmap=DIVERGING, vmin=-spread, vmax=spread, s=46,
        edgecolors="#555555", linewidths=0.5, zorder=3,
    )  # fmt: skip
    axes.set_ylim(-0.03, 1.05)
    bar = figure.colorbar(points, ax=axes, pad=0.02, fraction=0.05)
    bar.set_label("measured − simulated efficiency (points)", fontsize=11, color=TEXT)
    bar.ax.tick_params(labelsize=10, colors=TEXT)


def cause_panel(axes: Axes, diagnosis: Mapping[str, Any]) -> None:
    """The verdict, and the most probable causes with their fitted values."""
    headline = textwrap.shorten(verdict_text(diagnosis), 110, placeholder=" …")
    _style(axes, textwrap.fill(headline[:1].upper() + headline[1:], 66), "probability", "")
    causes = [
        Bar(f"{effect_name(c['effect'])}: {_values(c)}", float(c["probability"]), "vermillion")
        for c in probable_causes(diagnosis, 0.0)[:3]
    ]
    unknown = float((diagnosis.get("unknown") or {}).get("probability") or 0.0)
    _bars(axes, [*causes, Bar("something outside the catalogue", unknown, "grey")], probability_text)
    axes.set_xlim(0, 1.12)
    axes.set_xticks(np.linspace(0, 1, 6))


def optimum_panel(upper: Axes, lower: Axes, optimum: pd.DataFrame) -> None:
    """Predicted and measured efficiency at the best modulation, above D1 and D2."""
    _style(upper, "Best modulation over load", "", "efficiency (%)")
    _style(lower, "", "output power (W)", "half periods")
    lines = (
        (upper, "predicted", "grey", "--", "o", 100.0),
        (upper, "measured", "vermillion", "-", "D", 100.0),
        (lower, "D1", "blue", "-", "o", 1.0),
        (lower, "D2", "orange", "-", "s", 1.0),
    )
    for axes, column, colour, style, marker, scale in lines:
        value = scale * optimum[column].astype(float)
        if value.notna().any():
            axes.plot(
                optimum["P_W"],
                value,
                style,
                color=OKABE_ITO[colour],
                marker=marker,
                ms=5,
                lw=1.8,
                label=column,
            )
    lower.set_ylim(-0.05, 1.08)
    if optimum.empty:
        _absent(upper)
    upper.tick_params(labelbottom=False)
    for axes in (upper, lower):
        if axes.lines:
            axes.legend(fontsize=11, frameon=False, ncols=2, loc="best")


def error_panel(axes: Axes, error: Mapping[str, float | None], extended: float | None) -> None:
    """Mean absolute error of each model on points that were not fitted; logarithmic."""
    bars = [Bar(MODEL_NAMES.get(name, name), 100 * value, "blue") for name, value in error.items() if value]
    if extended:
        bars.append(Bar("Simulation extended by the diagnosis (on held-out blocks)", 100 * extended, "green"))
    _style(
        axes,
        "Error on points that were not fitted",
        "mean absolute error of efficiency (points, logarithmic)",
        "",
    )
    if not bars:
        _absent(axes)
        return
    axes.set_xscale("log")
    _bars(axes, bars, "{:.3g}".format)
    axes.set_xlim(min(bar.length for bar in bars) / 3, max(bar.length for bar in bars) * 1.8)
    axes.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axes.xaxis.set_major_formatter("{x:g}")
    axes.xaxis.set_minor_formatter(NullFormatter())


@dataclass(frozen=True, slots=True)
class Bar:
    """One horizontal bar with its label above it."""

    label: str
    length: float
    colour: str


def _bars(axes: Axes, bars: Sequence[Bar], say: Callable[[float], str]) -> None:
    height = 0.4
    for place, bar in enumerate(bars):
        axes.barh(place, bar.length, color=OKABE_ITO[bar.colour], height=height, zorder=3)
        label = textwrap.shorten(bar.label.rstrip(": "), 88, placeholder=" …")
        axes.annotate(
            label,
            (0, place - 0.33),
            xycoords=axes.get_yaxis_transform(),
            fontsize=12,
            color=TEXT,
            va="center",
            xytext=(4, 0),
            textcoords="offset points",
        )
        axes.annotate(
            say(bar.length),
            (bar.length, place),
            fontsize=11.5,
            color=SOFT,
            va="center",
            xytext=(6, 0),
            textcoords="offset points",
        )
    axes.set_ylim(max(len(bars), 3) - 0.6, -0.6)
    axes.set_yticks([])


def _absent(axes: Axes) -> None:
    axes.text(
        0.5, 0.5, "not computed in this run", transform=axes.transAxes, fontsize=13, color=SOFT, ha="center"
    )
    axes.set_xticks([])
    axes.set_yticks([])


def _values(cause: Mapping[str, Any]) -> str:
    return "; ".join(parameter_text(parameter) for parameter in cause.get("parameters") or ())


def _style(axes: Axes, title: str, x: str, y: str) -> None:
    axes.set_title(title, fontsize=14, fontweight="bold", color=TEXT, loc="left", pad=10)
    axes.set_xlabel(x, fontsize=12, color=TEXT)
    axes.set_ylabel(y, fontsize=12, color=TEXT)
    axes.tick_params(labelsize=11, colors=TEXT)
    axes.grid(color="#e4e7eb", zorder=0)
    axes.set_axisbelow(True)
    axes.spines[["top", "right"]].set_visible(False)
