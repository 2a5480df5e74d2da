"""The live pictures as Plotly figures: bounded in size, however many points a campaign has.

Points that fall into one cell of (D1, D2) are shown as one, at their mean place with their mean value; with few
points each has a cell of its own. Colours of text and grid are the page's (``dashboard.css``); colours of data are
those of the report, safe for colour-blind readers.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from bench.charts import DIFFERENCE, OKABE_ITO
from bench.dashboard.rows import Floats, Rows

CELLS = 40  # per axis
MOST = 1500  # points of a line or a cloud
BANDS = {"all loads": (0.0, np.inf), "light": (0.0, 0.4), "medium": (0.4, 0.7), "heavy": (0.7, np.inf)}

Figure = dict[str, Any]

CONFIG = {"displayModeBar": False, "responsive": True, "scrollZoom": False}


def loaded(rows: Rows, band: str, top_W: float) -> Rows:
    """Rows that carry power and were not rejected, in a band of load: shares of the campaign's largest, ``top_W``."""
    low, high = (share * top_W for share in BANDS[band])
    power_W = np.where(np.isfinite(rows.P_set_W), rows.P_set_W, np.nan_to_num(rows.P2_W))
    return rows.where(rows.counted & (low <= power_W) & (power_W < high))


def largest_W(planned: Rows) -> float:
    """The largest power of a campaign's set points; 1 W where there is none."""
    known = planned.P_set_W[np.isfinite(planned.P_set_W)]
    return float(known.max(initial=0.0)) or 1.0


def in_cells(D1: Floats, D2: Floats, value: Floats) -> tuple[Floats, Floats, Floats, Floats]:
    """Mean place and value per occupied cell, and how many points it holds: arrays (M,), M ≤ CELLS²."""
    known = np.isfinite(value)
    D1, D2, value = D1[known], D2[known], value[known]
    cell = np.minimum((D1 * CELLS).astype(int), CELLS - 1) * CELLS + np.minimum(
        (D2 * CELLS).astype(int), CELLS - 1
    )
    _, member, count = np.unique(cell, return_inverse=True, return_counts=True)
    mean = [
        np.bincount(member, weights=x, minlength=len(count)) / np.maximum(count, 1) for x in (D1, D2, value)
    ]
    return mean[0], mean[1], mean[2], count.astype(np.float64)


def colour_range(measured: Floats, simulated: Floats) -> tuple[float, float]:
    """Efficiencies, in per cent, between which colours are told apart; the same for both maps."""
    values = np.concatenate([measured, simulated])
    values = values[np.isfinite(values)]
    if not len(values):
        return 90.0, 100.0
    low, high = 100 * float(np.quantile(values, 0.05)), 100 * float(values.max())
    return (low, high) if high > low else (low - 0.5, high + 0.5)


def maps(rows: Rows, planned: Rows, band: str = "all loads") -> dict[str, Figure]:
    """Efficiency over (D1, D2): measured, simulated (planned points too), and their difference."""
    top_W = largest_W(planned)
    shown, ahead = loaded(rows, band, top_W), loaded(planned, band, top_W)
    measured, simulated, predicted = shown.efficiency, shown.predicted_efficiency, ahead.predicted_efficiency
    low, high = colour_range(measured, predicted)
    difference = 100 * (measured - simulated)
    known = np.abs(difference[np.isfinite(difference)])
    spread = float(np.quantile(known, 0.98)) if len(known) else 1.0
    efficiency = {"colorscale": "Cividis", "cmin": low, "cmax": high}
    diverging = {"colorscale": DIFFERENCE, "cmin": -max(spread, 1e-3), "cmax": max(spread, 1e-3)}
    box = _box(planned.D1[planned.counted], planned.D2[planned.counted])
    return {
        "measured": _map(in_cells(shown.D1, shown.D2, 100 * measured), efficiency, "%", box),
        "simulated": _map(in_cells(ahead.D1, ahead.D2, 100 * predicted), efficiency, "%", box),
        "difference": _map(in_cells(shown.D1, shown.D2, difference), diverging, "points", box),
    }


Box = tuple[list[float], list[float]]


def _map(
    cells: tuple[Floats, Floats, Floats, Floats], colours: Mapping[str, Any], unit: str, box: Box
) -> Figure:
    D1, D2, value, count = cells
    size = 11 if len(value) < 150 else 8
    trace = {
        "type": "scatter",
        "mode": "markers",
        "x": D1.round(4).tolist(),
        "y": D2.round(4).tolist(),
        "marker": {
            "color": value.round(4).tolist(),
            "size": size,
            "line": {"width": 0.8, "color": "rgba(140,150,160,.9)"},
            "colorbar": {
                "title": {"text": unit, "side": "top"},
                "thickness": 10,
                "outlinewidth": 0,
                "len": 1.0,
            },
            **colours,
        },
        "customdata": count.astype(int).tolist(),
        "hovertemplate": f"D1 %{{x:.3f}}, D2 %{{y:.3f}}<br>%{{marker.color:.3f}} {unit}, "
        "mean of %{customdata}<extra></extra>",
    }
    axes = {
        "xaxis": _axis("D1 (half periods)", range=box[0]),
        "yaxis": _axis("D2 (half periods)", range=box[1]),
    }
    return figure([trace], axes)


def _box(D1: Floats, D2: Floats) -> Box:
    """Ranges of D1 and D2 that hold all points of a campaign, with some air."""
    if not len(D1):
        return [-0.03, 1.03], [-0.03, 1.03]
    return [float(D1.min()) - 0.05, float(D1.max()) + 0.05], [float(D2.min()) - 0.05, float(D2.max()) + 0.05]


def difference_over_power(rows: Rows, planned: Rows, band: str = "all loads") -> Figure:
    """Measured less simulated efficiency of the last points over output power, with the reading's own 95 %."""
    shown = loaded(rows, band, largest_W(planned))
    difference = shown.efficiency - shown.predicted_efficiency
    known = np.flatnonzero(np.isfinite(shown.P2_W) & np.isfinite(difference))[-MOST:]
    power, value, u = shown.P2_W[known], 100 * difference[known], shown.u_efficiency[known]
    trace = {
        "type": "scatter",
        "mode": "markers",
        "x": power.round(1).tolist(),
        "y": value.round(4).tolist(),
        "error_y": {
            "type": "data",
            "array": np.nan_to_num(196 * u).round(4).tolist(),
            "thickness": 1,
            "width": 0,
            "color": "rgba(120,130,140,.55)",
            "visible": len(value) <= 300,
        },
        "marker": {"color": OKABE_ITO["vermillion"], "size": 7 if len(value) < 300 else 4},
        "hovertemplate": "%{x:.0f} W: %{y:+.3f} points<extra></extra>",
    }
    axes = {
        "xaxis": _axis("output power (W)", rangemode="tozero"),
        "yaxis": _axis("measured − simulated (points)", zeroline=True),
    }
    return figure([trace], axes)


def optimum(table: Sequence[Mapping[str, float | None]]) -> dict[str, Figure]:
    """D1 and D2, and predicted efficiency with its interval, over load."""
    power, D1, D2, predicted, low, high = (
        [row.get(name) for row in table]
        for name in ("P_W", "D1", "D2", "predicted", "predicted_low", "predicted_high")
    )
    duties = [
        _line(power, D1, "D1", "blue", "circle"),
        _line(power, D2, "D2", "orange", "square"),
    ]
    curve = [_line(power, _per_cent(predicted), "predicted", "green", "circle")]
    if all(value is not None for value in (*low, *high)):
        edge = {"type": "scatter", "mode": "lines", "x": power, "line": {"width": 0}, "hoverinfo": "skip"}
        curve = [
            edge | {"y": _per_cent(low), "showlegend": False},
            edge
            | {
                "y": _per_cent(high),
                "fill": "tonexty",
                "fillcolor": "rgba(0,158,115,.18)",
                "name": "95 % interval",
            },
            *curve,
        ]
    x = _axis("output power (W)")
    legend = {"legend": {"orientation": "h", "y": 1.12, "x": 0}, "showlegend": True}
    return {
        "modulation": figure(
            duties, {"xaxis": x, "yaxis": _axis("D1, D2 (half periods)", range=[-0.03, 1.05])}, legend
        ),
        "efficiency": figure(curve, {"xaxis": x, "yaxis": _axis("efficiency (%)")}, legend),
    }


def model_errors(models: Sequence[tuple[str, float]]) -> Figure:
    """Held-out error per model, in points, the newest at the bottom."""
    trace = {
        "type": "bar",
        "orientation": "h",
        "y": [name for name, _ in models],
        "x": [round(100 * error, 4) for _, error in models],
        "marker": {"color": OKABE_ITO["blue"]},
        "hovertemplate": "%{y}: %{x:.3f} points<extra></extra>",
    }
    axes = {
        "xaxis": _axis("held-out error (points)", rangemode="tozero"),
        "yaxis": {"automargin": True, "autorange": "reversed", "type": "category"},
    }
    return figure([trace], axes)


def compared(power_W: Sequence[float], difference: Sequence[float], u: Sequence[float]) -> Figure:
    """Efficiency of one campaign less that of another at the same set points."""
    trace = {
        "type": "scatter",
        "mode": "markers",
        "x": list(power_W),
        "y": [100 * value for value in difference],
        "error_y": {"type": "data", "array": [196 * value for value in u], "thickness": 1, "width": 0},
        "marker": {"color": OKABE_ITO["blue"], "size": 7},
        "hovertemplate": "%{x:.0f} W: %{y:+.3f} points<extra></extra>",
    }
    axes = {"xaxis": _axis("output power (W)"), "yaxis": _axis("second − first (points)", zeroline=True)}
    return figure([trace], axes)


def _line(x: Sequence[Any], y: Sequence[Any], name: str, colour: str, symbol: str) -> dict[str, Any]:
    return {
        "type": "scatter",
        "mode": "lines+markers",
        "x": list(x),
        "y": list(y),
        "name": name,
        "line": {"color": OKABE_ITO[colour], "width": 2},
        "marker": {"symbol": symbol, "size": 7},
    }


def _per_cent(values: Sequence[float | None]) -> list[float | None]:
    return [None if value is None else 100 * value for value in values]


def _axis(title: str, **more: Any) -> dict[str, Any]:
    zero = {"zeroline": False}
    return {"title": {"text": title, "standoff": 8}, "automargin": True, "showline": True, **zero, **more}


def figure(
    data: list[dict[str, Any]], axes: Mapping[str, Any], more: Mapping[str, Any] | None = None
) -> Figure:
    """A figure without colours of its own for page and text."""
    layout = {
        "margin": {"l": 8, "r": 8, "t": 8, "b": 8},
        "paper_bgcolor": "rgba(0,0,0,0)",
        "plot_bgcolor": "rgba(0,0,0,0)",
        "showlegend": False,
        "hovermode": "closest",
        "font": {"size": 12, "family": "inherit"},
        "uirevision": "same",  # a person's zoom stays when points come in
        **axes,
        **(more or {}),
    }
    return {"data": data, "layout": layout, "config": CONFIG}
