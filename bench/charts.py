"""The report's interactive charts: Plotly figures without colours of page or text, which the theme sets.

Colours of data are safe for colour-blind readers: cividis for efficiency, Okabe and Ito's set for parts and
lines, blue to vermillion through grey for a difference.
"""

import textwrap
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd
import plotly.graph_objects as go
from plotly.subplots import make_subplots

from bench.bands import Band, power_bands, residual_channels, shown_range
from bench.wording import MODEL_NAMES, channel_name, difference_unit, words

OKABE_ITO = {
    "blue": "#0072B2",
    "orange": "#E69F00",
    "green": "#009E73",
    "vermillion": "#D55E00",
    "sky": "#56B4E9",
    "purple": "#CC79A7",
    "grey": "#8A8A8A",
}
DIFFERENCE = [(0.0, "#0072B2"), (0.5, "#D9D9D9"), (1.0, "#D55E00")]
STAGES = (("primary", "blue"), ("inductor", "orange"), ("transformer", "green"), ("secondary", "vermillion"))
LOG_TICKS = [step * 10.0**power for power in range(-5, 2) for step in (1, 2, 5)]
PATTERNS = ("", "/", ".", "x", "\\", "+", "|")
_LONG_LABEL = 24  # characters beside a bar: more is broken into two lines
MARGIN = {"l": 64, "r": 24, "t": 56, "b": 56}


def to_json(figure: go.Figure) -> str:
    """A figure as JSON that may stand inside a script element: Plotly escapes <, > and /."""
    return str(figure.to_json())


def efficiency_maps(simulation: pd.DataFrame, measurements: pd.DataFrame) -> go.Figure:
    """Simulated and measured efficiency and their difference over (D1, D2), a column per band of power."""
    bands = power_bands(simulation, measurements)
    titles = [
        f"{kind}<br>{band.label}" for kind in ("Simulated at", "Measured,", "Difference,") for band in bands
    ]
    for column, band in enumerate(bands):
        titles[column] = f"Simulated at {band.power_W:.0f} W"
    figure = make_subplots(
        rows=3, cols=len(bands), subplot_titles=titles, horizontal_spacing=0.07, vertical_spacing=0.09
    )
    for column, band in enumerate(bands, start=1):
        figure.add_trace(_simulated(band), row=1, col=column)
        figure.add_trace(
            _scatter(band.measured, 100 * band.measured["efficiency"], "coloraxis"), row=2, col=column
        )
        figure.add_trace(_scatter(band.measured, band.residual_points, "coloraxis2"), row=3, col=column)
    low, high = shown_range(simulation, measurements)
    spread = max(
        (float(np.quantile(np.abs(b.residual_points), 0.98)) for b in bands if len(b.measured)), default=1.0
    )
    figure.update_xaxes(range=[-0.02, 1.02])
    figure.update_yaxes(range=[-0.02, 1.02])
    for column in range(1, len(bands) + 1):
        figure.update_xaxes(title_text="D1 (half periods)", row=3, col=column)
    for row in (1, 2, 3):
        figure.update_yaxes(title_text="D2 (half periods)", row=row, col=1)
    bar = {"thickness": 14, "yanchor": "middle"}
    figure.update_layout(
        height=1020,
        showlegend=False,
        margin=MARGIN,
        coloraxis={
            "colorscale": "Cividis", "cmin": 100 * low, "cmax": 100 * high,
            "colorbar": bar | {"title": {"text": "efficiency<br>(%)"}, "len": 0.6, "y": 0.69},
        },
        coloraxis2={
            "colorscale": DIFFERENCE, "cmin": -spread, "cmax": spread,
            "colorbar": bar
            | {"title": {"text": "measured −<br>simulated<br>(points)"}, "len": 0.3, "y": 0.13},
        },
    )  # fmt: skip
    return figure


def _simulated(band: Band) -> go.Heatmap:
    table = band.simulated.pivot_table(index="D2", columns="D1", values="efficiency", dropna=False)
    return go.Heatmap(
        x=table.columns.to_numpy(),
        y=table.index.to_numpy(),
        z=100 * table.to_numpy(),
        coloraxis="coloraxis",
        hovertemplate="D1 %{x:.3f}, D2 %{y:.3f}<br>%{z:.2f} %<extra>simulated</extra>",
    )


def _scatter(rows: pd.DataFrame, colour: pd.Series, axis: str) -> go.Scatter:
    unit = " %" if axis == "coloraxis" else " points"
    return go.Scatter(
        x=rows["D1"],
        y=rows["D2"],
        mode="markers",
        marker={"color": colour, "coloraxis": axis, "size": 9, "line": {"width": 0.8, "color": "#808080"}},
        customdata=np.stack([rows["P2_W"], colour], axis=1),
        hovertemplate="D1 %{x:.3f}, D2 %{y:.3f}, %{customdata[0]:.0f} W<br>%{customdata[1]:.3f}"
        + unit
        + "<extra></extra>",
    )


def model_errors(error: Mapping[str, float | None]) -> go.Figure:
    """Mean absolute error of every model: dots, since a logarithmic axis has no zero for a bar to begin at."""
    known = {name: value for name, value in error.items() if value}
    names = [MODEL_NAMES.get(name, name) for name in known]
    values = [100 * float(value) for value in known.values()]
    figure = go.Figure(
        go.Scatter(
            x=values, y=names, mode="markers+text", marker={"color": OKABE_ITO["blue"], "size": 12},
            text=[f"{value:.3g}" for value in values], textposition="middle right", cliponaxis=False,
            hovertemplate="%{y}: %{x:.3f} points<extra></extra>",
        )
    )  # fmt: skip
    figure.update_xaxes(
        type="log", title_text="mean absolute error of efficiency (points, logarithmic)", tickvals=LOG_TICKS,
        range=[np.log10(min(values, default=0.1) / 3), np.log10(max(values, default=1.0) * 2)],
    )  # fmt: skip
    figure.update_yaxes(autorange="reversed", automargin=True)
    figure.update_layout(height=110 + 44 * max(len(names), 1), margin=MARGIN | {"t": 34}, showlegend=False)
    return figure


def optimum_over_load(optimum: pd.DataFrame) -> go.Figure:
    """D1 and D2 over load, above predicted and measured efficiency there."""
    figure = make_subplots(rows=2, cols=1, shared_xaxes=True, vertical_spacing=0.08)
    lines = (
        ("D1", "D1", "blue", "circle", 1, 1.0),
        ("D2", "D2", "orange", "square", 1, 1.0),
        ("predicted", "predicted", "grey", "circle-open", 2, 100.0),
        ("measured", "measured", "vermillion", "diamond", 2, 100.0),
    )
    for column, name, colour, symbol, row, scale in lines:
        if column not in optimum or optimum[column].isna().all():
            continue
        figure.add_trace(
            go.Scatter(
                x=optimum["P_W"],
                y=scale * optimum[column].astype(float),
                name=name,
                mode="lines+markers",
                line={"color": OKABE_ITO[colour], "dash": "dot" if column == "predicted" else "solid"},
                marker={"symbol": symbol, "size": 9},
            ),
            row=row,
            col=1,
        )
    figure.update_yaxes(title_text="D1, D2 (half periods)", range=[-0.03, 1.05], row=1, col=1)
    figure.update_yaxes(title_text="efficiency (%)", row=2, col=1)
    figure.update_xaxes(title_text="output power (W)", row=2, col=1)
    figure.update_layout(height=520, margin=MARGIN | {"t": 34}, legend={"orientation": "h", "y": 1.1})
    return figure


def channel_residuals(measurements: pd.DataFrame) -> go.Figure | None:
    """Measured less simulated of every channel over output power; None when no channel has both."""
    channels = residual_channels(measurements)
    if not channels:
        return None
    columns = min(3, len(channels))
    rows = -(-len(channels) // columns)
    figure = make_subplots(
        rows=rows,
        cols=columns,
        subplot_titles=[channel_name(channel) for channel in channels],
        horizontal_spacing=0.1,
        vertical_spacing=0.3 / rows,
    )
    for number, (channel, residual) in enumerate(channels.items()):
        row, column = number // columns + 1, number % columns + 1
        unit = difference_unit(channel)
        scale = 100.0 if channel == "efficiency" else 1.0
        figure.add_trace(
            go.Scatter(
                x=measurements["P2_W"],
                y=scale * residual,
                mode="markers",
                marker={
                    "color": measurements["D1"], "colorscale": "Viridis", "cmin": 0.0, "cmax": 1.0, "size": 6,
                    "showscale": number == 0, "colorbar": {"title": {"text": "D1"}, "thickness": 14},
                },
                hovertemplate="%{x:.0f} W: %{y:.4g} " + unit + "<extra></extra>",
            ),
            row=row,
            col=column,
        )  # fmt: skip
        figure.update_yaxes(title_text=f"meas. − sim. ({unit})", zeroline=True, row=row, col=column)
        if number + columns >= len(channels):
            figure.update_xaxes(title_text="output power (W)", row=row, col=column)
    figure.update_layout(height=90 + 250 * rows, margin=MARGIN, showlegend=False)
    return figure


def loss_breakdown(losses: pd.DataFrame) -> go.Figure:
    """Simulated loss by part at the optimum, stacked over load; colour is the stage, pattern the part."""
    parts = loss_parts(losses)
    figure = go.Figure()
    used: dict[str, int] = {}
    for part in parts:
        colour = next((colour for stage, colour in STAGES if part.startswith(stage)), "grey")
        pattern = PATTERNS[used.get(colour, 0) % len(PATTERNS)]
        used[colour] = used.get(colour, 0) + 1
        figure.add_trace(
            go.Bar(
                x=losses["P_set_W"], y=losses[f"loss_{part}_W"], name=words(part),
                marker={
                    "color": OKABE_ITO[colour], "line": {"width": 0.5, "color": "#555555"},
                    "pattern": {"shape": pattern, "fgcolor": "#ffffff", "size": 6, "solidity": 0.3,
                                "fillmode": "overlay"},
                },
                hovertemplate="%{x:.0f} W: %{y:.2f} W<extra>" + words(part) + "</extra>",
            )
        )  # fmt: skip
    figure.update_xaxes(title_text="output power (W)")
    figure.update_yaxes(title_text="loss (W)")
    figure.update_layout(
        barmode="stack", height=460, margin=MARGIN | {"t": 34}, legend={"traceorder": "normal"}
    )
    return figure


def loss_parts(losses: pd.DataFrame) -> list[str]:
    """The parts that lose anything, in the order of the stages of the converter."""
    names = [str(c)[5:-2] for c in losses.columns if str(c).startswith("loss_") and str(c).endswith("_W")]
    some = [name for name in names if (losses[f"loss_{name}_W"].abs() > 1e-9).any()]
    stages = [stage for stage, _ in STAGES]
    return sorted(some, key=lambda name: next((k for k, s in enumerate(stages) if name.startswith(s)), 9))


def gain_rows(gain: Mapping[str, Any]) -> list[tuple[str, float, str, tuple[float, float]]]:
    """(label, error in points, colour, what 95 % reach below and above) of what was measured on held-out blocks."""
    rows: Sequence[tuple[str, str, str]] = (
        ("before", "Simulation as it was", "grey"),
        ("wrong_cause", "Best wrong cause", "orange"),
        ("leftover_only", "Smooth leftover only", "sky"),
        ("after", "Simulation extended with the cause", "green"),
        ("calibrated", "... and its parts and the analyzer calibrated", "blue"),
    )
    found = []
    for key, label, colour in rows:
        if gain.get(key) is not None:
            error = 100 * float(gain[key])
            of_it = (gain.get("intervals") or {}).get(key, (gain[key], gain[key]))  # kept ones may have none
            low, high = (100 * float(bound) for bound in of_it)
            found.append((label, error, colour, (max(0.0, error - low), max(0.0, high - error))))
    return found


def gain_bars(gain: Mapping[str, Any]) -> go.Figure:
    """Error on blocks that were not fitted: before, after, and what rivals of the diagnosis reach."""
    known = gain_rows(gain)
    figure = go.Figure(
        go.Bar(
            x=[value for _, value, *_ in known], y=[two_lines(label) for label, *_ in known], orientation="h",
            marker_color=[OKABE_ITO[colour] for _, _, colour, _ in known],
            error_x={
                "type": "data", "symmetric": False, "thickness": 1.2, "width": 4, "color": "#333333",
                "arrayminus": [below for *_, (below, _) in known], "array": [above for *_, (_, above) in known],
            },
            hovertemplate="%{y}: %{x:.4f} points<extra></extra>",
        )
    )  # fmt: skip
    figure.add_trace(  # beyond the intervals
        go.Scatter(
            x=[value + above for _, value, _, (_, above) in known], y=[two_lines(label) for label, *_ in known],
            mode="text", text=[f"  {value:.3f}" for _, value, *_ in known], textposition="middle right",
            cliponaxis=False, hoverinfo="skip",
        )
    )  # fmt: skip
    figure.update_xaxes(title_text="mean error, held out, with 95 % interval (points)", rangemode="tozero")
    figure.update_yaxes(autorange="reversed", automargin=True)
    figure.update_layout(height=110 + 40 * len(known), margin=MARGIN | {"t": 34}, showlegend=False)
    return figure


def two_lines(label: str, broken: str = "<br>") -> str:
    """A long label broken in its middle, so that a narrow screen or column holds all of it."""
    return broken.join(textwrap.wrap(label, 2 + len(label) // 2)) if len(label) > _LONG_LABEL else label
