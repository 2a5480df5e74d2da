"""Charts of a diagnosis: residual maps, residuals over time, causes by probability, what cannot be named."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd
import plotly.graph_objects as go
from plotly.subplots import make_subplots

from bench.charts import DIFFERENCE, MARGIN, OKABE_ITO
from bench.wording import channel_name, difference_unit, effect_name, minus, probability_text

_COLUMNS = 3  # side by side on a narrow screen
_OF_INPUT = "residual_P1_W"  # the column whose course over time is shown
_QUANTILE = 0.98  # of the absolute residuals: what the colours of a map span


def residual_columns(residuals: pd.DataFrame) -> dict[str, str]:
    """Channel and column of every residual that has values."""
    found = [str(c) for c in residuals if str(c).startswith("residual_") and residuals[c].notna().any()]
    return {name.removeprefix("residual_"): name for name in found}


def readings_that_count(residuals: pd.DataFrame, rejected: Sequence[Mapping[str, Any]]) -> pd.DataFrame:
    """The residuals without those of ``rejected`` readings (of the JSON answer): NaN in their place."""
    counted = residuals.copy()
    for reading in rejected:
        name = f"residual_{reading['column']}"
        if name in counted:
            counted.loc[counted["row"] == reading["row"], name] = np.nan
    return counted


def residual_maps(residuals: pd.DataFrame) -> go.Figure | None:
    """Measured less simulated over (D1, D2), a panel for each channel, each coloured over its own range."""
    channels = residual_columns(residuals)
    loaded = residuals[residuals["P2_W"] > 0]
    if not channels or not len(loaded):
        return None
    loaded = loaded.assign(size=5 + 9 * loaded["P2_W"] / loaded["P2_W"].max())  # pixels
    across = min(_COLUMNS, len(channels))
    down = -(-len(channels) // across)
    spans = {c: float(np.nanquantile(np.abs(loaded[column]), _QUANTILE)) for c, column in channels.items()}
    figure = make_subplots(
        rows=down,
        cols=across,
        subplot_titles=[f"{channel_name(c)}<br>±{_amount(spans[c], c)}" for c in channels],
        horizontal_spacing=0.07,
        vertical_spacing=0.3 / down,
    )
    for number, (channel, column) in enumerate(channels.items()):
        place = {"row": number // across + 1, "col": number % across + 1}
        used = loaded[column].notna()
        if not used.all():
            figure.add_trace(_unused(loaded[~used]), **place)
        figure.add_trace(_map(loaded[used], column, channel, spans[channel]), **place)
        if number + across >= len(channels):
            figure.update_xaxes(title_text="D1 (half periods)", **place)
        if place["col"] == 1:
            figure.update_yaxes(title_text="D2 (half periods)", **place)
    figure.update_annotations(font_size=13)
    bar = {"thickness": 14, "title": {"text": "measured −<br>simulated"}, "tickvals": [-1, 0, 1]}
    bar["ticktext"] = ["− range", "0", "+ range"]
    figure.update_layout(
        height=134 + 310 * down,
        margin=MARGIN | {"t": 80},  # the buttons of the figure stand above the first panels' names
        showlegend=False,
        coloraxis={"colorscale": DIFFERENCE, "cmin": -1.0, "cmax": 1.0, "colorbar": bar},
    )
    return figure


def _map(rows: pd.DataFrame, column: str, channel: str, span: float) -> go.Scatter:
    return go.Scatter(
        x=rows["D1"],
        y=rows["D2"],
        mode="markers",
        marker={
            "color": rows[column] / (span or 1.0), "coloraxis": "coloraxis",
            "size": rows["size"], "line": {"width": 0.6, "color": "#808080"},
        },
        customdata=np.stack([rows["P2_W"], rows[column]], axis=1),
        hovertemplate="D1 %{x:.3f}, D2 %{y:.3f}, %{customdata[0]:.0f} W<br>%{customdata[1]:.4g} "
        + difference_unit(channel)
        + "<extra></extra>",
    )  # fmt: skip


def _unused(rows: pd.DataFrame) -> go.Scatter:
    """Rows whose reading of this channel was not used, as rings."""
    return go.Scatter(
        x=rows["D1"],
        y=rows["D2"],
        mode="markers",
        marker={"symbol": "circle-open", "color": OKABE_ITO["grey"], "size": rows["size"]},
        customdata=rows["P2_W"],
        hovertemplate="D1 %{x:.3f}, D2 %{y:.3f}, %{customdata:.0f} W<br>not used<extra></extra>",
    )


def _amount(value: float, channel: str) -> str:
    return f"{value:.2g} {difference_unit(channel)}"


def residual_over_time(residuals: pd.DataFrame, counted: pd.DataFrame) -> go.Figure | None:
    """The gap in input power since the campaign's start: since when, and whether it drifts.

    ``counted`` holds the readings that count; the axis spans those, and others that lie beyond stand at its edge.
    """
    if "time_s" not in residuals or _OF_INPUT not in residuals:
        return None
    rows = residuals.dropna(subset=[_OF_INPUT, "time_s"])
    counts = counted.loc[rows.index, _OF_INPUT].notna()
    if not counts.any():
        return None
    figure = go.Figure()
    colours = dict(zip(("load", "reference", "no_load", "standby"), OKABE_ITO.values(), strict=False))
    for kind, group in rows[counts].groupby("kind"):
        marker = {"size": 7, "color": colours.get(str(kind), OKABE_ITO["grey"])}
        label = str(kind).replace("_", " ")
        figure.add_trace(
            go.Scatter(
                x=group["time_s"] / 3600, y=group[_OF_INPUT], mode="markers", marker=marker, name=label
            )
        )
    figure.update_xaxes(title_text="time since the campaign's start (h)")
    figure.update_yaxes(title_text="input power, meas. − sim. (W)", zeroline=True)
    figure.update_layout(height=330, margin=MARGIN, legend={"orientation": "h", "y": 1.12})
    if not counts.all():
        span = _widened(rows.loc[counts, _OF_INPUT])
        figure.add_trace(_counts_for_nothing(rows.loc[~counts, "time_s"], rows.loc[~counts, _OF_INPUT], span))
        figure.update_yaxes(range=span)
    return figure


def _widened(values: pd.Series) -> tuple[float, float]:
    """A span that holds zero and all values, with some room."""
    low, high = min(float(values.min()), 0.0), max(float(values.max()), 0.0)
    room = 0.15 * (high - low) or 1.0
    return low - room, high + room


def _counts_for_nothing(time_s: pd.Series, off_W: pd.Series, span: tuple[float, float]) -> go.Scatter:
    low, high = span
    at_W = off_W.clip(0.95 * low + 0.05 * high, 0.05 * low + 0.95 * high)
    beyond = at_W != off_W
    return go.Scatter(
        x=time_s / 3600,
        y=at_W,
        mode="markers+text",
        text=np.where(beyond, [minus(f"{value:+.3g} W") for value in off_W], ""),
        textposition="middle right",
        marker={
            "symbol": np.where(~beyond, "x", np.where(off_W > 0, "triangle-up", "triangle-down")),
            "color": OKABE_ITO["grey"], "size": 10,
        },
        customdata=off_W,
        hovertemplate="%{customdata:+.4g} W<extra></extra>",
        name="counts for nothing",
    )  # fmt: skip


def cause_bars(causes: Sequence[Mapping[str, Any]], unknown: float, consistent: float) -> go.Figure:
    """Probability of every cause, of something outside the catalogue, and of nothing."""
    bars = [(effect_name(str(c["effect"])), float(c["probability"]), "blue") for c in causes[:10]]
    bars += [("something else besides", unknown, "orange"), ("nothing wrong", consistent, "grey")]
    figure = go.Figure(
        go.Bar(
            x=[p for _, p, _ in bars], y=[name for name, _, _ in bars], orientation="h",
            marker_color=[OKABE_ITO[colour] for *_, colour in bars],
            text=[probability_text(p) for _, p, _ in bars], textposition="auto", cliponaxis=False,
            hovertemplate="%{y}: %{x:.4f}<extra></extra>",
        )
    )  # fmt: skip
    figure.update_xaxes(title_text="probability", range=[0, 1.02])
    figure.update_yaxes(autorange="reversed", automargin=True)
    figure.update_layout(height=110 + 30 * len(bars), margin=MARGIN | {"t": 24}, showlegend=False)
    return figure


def leftover_map(residuals: pd.DataFrame) -> go.Figure | None:
    """What no cause explains, in watts at the input, over output power; colour is D2."""
    if "leftover_W" not in residuals or not residuals["leftover_W"].fillna(0.0).any():
        return None
    rows = residuals.dropna(subset=["leftover_W"])
    marker = {
        "color": rows["D2"], "colorscale": "Viridis", "size": 8, "showscale": True,
        "colorbar": {"title": {"text": "D2<br>(half periods)"}, "thickness": 14},
    }  # fmt: skip
    figure = go.Figure(
        go.Scatter(
            x=rows["P2_W"], y=rows["leftover_W"], mode="markers", marker=marker,
            hovertemplate="%{x:.0f} W: %{y:.3f} W<extra></extra>",
        )
    )  # fmt: skip
    figure.update_xaxes(title_text="output power (W)")
    figure.update_yaxes(title_text="unexplained loss at the input (W)", zeroline=True)
    figure.update_layout(height=340, margin=MARGIN, showlegend=False)
    return figure
