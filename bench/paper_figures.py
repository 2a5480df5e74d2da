"""The report's figures as PNG files for a paper: the same data, one file each, 300 dots per inch.

Widths are those of one and two columns of a journal page (88 and 181 mm). Every axis carries its unit, colours are
those of the report, safe for colour-blind readers, and a virtual lab says so in the figure itself.
"""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.cm import ScalarMappable
from matplotlib.figure import Figure

from bench.bands import loaded_rows, power_bands, residual_channels, shown_range
from bench.charts import OKABE_ITO, STAGES, gain_rows, loss_parts, two_lines
from bench.figures import DIVERGING
from bench.report import ReportData
from bench.whole_file import replacing
from bench.wording import MODEL_NAMES, channel_name, difference_unit, words

MM = 1 / 25.4  # inches
ONE_COLUMN, TWO_COLUMNS = 88 * MM, 181 * MM
DPI = 300
HATCHES = ("", "///", "...", "xxx", "\\\\\\", "++", "||")


def write_figures(folder: Path, data: ReportData) -> list[Path]:
    """Write every figure that the data allow; returns the files."""
    folder.mkdir(parents=True, exist_ok=True)
    drawn: Mapping[str, Callable[[ReportData], Figure | None]] = {
        "maps": efficiency_maps,
        "model_errors": model_errors,
        "optimum": optimum_over_load,
        "residuals": channel_residuals,
        "losses": loss_breakdown,
        "gain": gain_bars,
    }
    files = []
    for name, draw in drawn.items():
        if (figure := draw(data)) is not None:
            FigureCanvasAgg(figure)
            if data.virtual:
                figure.text(0.005, 0.005, "virtual lab", fontsize=6, ha="left", va="bottom", color="#59636e")
            files.append(folder / f"{name}.png")
            with replacing(files[-1]) as file:
                figure.savefig(file, dpi=DPI, format="png")
    return files


def efficiency_maps(data: ReportData) -> Figure | None:
    """Simulated and measured efficiency and their difference over (D1, D2), a column per band of power."""
    if not len(data.simulation):
        return None
    bands = power_bands(data.simulation, data.measurements)
    low, high = (100 * value for value in shown_range(data.simulation, data.measurements))
    residuals = np.concatenate([band.residual_points.abs().to_numpy() for band in bands])
    spread = float(np.nanquantile(residuals, 0.98)) if np.isfinite(residuals).any() else 1.0
    figure, axes = panels(3, len(bands), TWO_COLUMNS, 150 * MM)
    last: dict[str, ScalarMappable] = {}
    for column, band in enumerate(bands):
        table = band.simulated.pivot_table(index="D2", columns="D1", values="efficiency", dropna=False)
        last["efficiency (%)"] = axes[0][column].pcolormesh(
            table.columns,
            table.index,
            100 * table.to_numpy(),
            cmap="cividis",
            vmin=low,
            vmax=high,
            shading="nearest",
        )
        place = (band.measured["D1"], band.measured["D2"])
        shown: dict[str, Any] = {"s": 8, "edgecolors": "#808080", "linewidths": 0.3}
        measured = 100 * band.measured["efficiency"]
        axes[1][column].scatter(*place, c=measured, cmap="cividis", vmin=low, vmax=high, **shown)
        last["difference (points)"] = axes[2][column].scatter(
            *place, c=band.residual_points, cmap=DIVERGING, vmin=-spread, vmax=spread, **shown
        )
        axes[0][column].set_title(f"simulated, {band.power_W:.0f} W", fontsize=8)
        axes[1][column].set_title(f"measured, {band.label}", fontsize=8)
        axes[2][column].set_title("measured − simulated", fontsize=8)
    for row in axes:
        for one in row:
            one.set(xlim=(-0.02, 1.02), ylim=(-0.02, 1.02))
        row[0].set_ylabel("D2 (half periods)", fontsize=8)
    for one in axes[2]:
        one.set_xlabel("D1 (half periods)", fontsize=8)
    for (label, drawn), rows in zip(last.items(), (axes[:2], axes[2:]), strict=True):
        bar = figure.colorbar(drawn, ax=[one for row in rows for one in row], pad=0.02, aspect=30)
        bar.set_label(label, fontsize=8)
        bar.ax.tick_params(labelsize=7)
    return figure


def model_errors(data: ReportData) -> Figure | None:
    """Mean absolute error of every model on points that were not fitted; logarithmic."""
    error = {name: value for name, value in (data.summary.get("error") or {}).items() if value}
    if not error:
        return None
    figure, axes = _one(ONE_COLUMN, 55 * MM)
    names, values = [MODEL_NAMES.get(n, n) for n in error], [100 * float(v) for v in error.values()]
    # dots: a logarithmic axis has no zero for bars
    axes.plot(values, names, "o", color=OKABE_ITO["blue"], ms=5)
    for name, value in zip(names, values, strict=True):
        axes.annotate(
            f"{value:.3g}", (value, name), xytext=(6, 0), textcoords="offset points", va="center", fontsize=7
        )
    axes.set(xscale="log", xlim=(min(values) / 2, max(values) * 3))
    axes.margins(y=0.15)
    axes.invert_yaxis()
    axes.set_xlabel("mean absolute error (points)", fontsize=8)
    return figure


def optimum_over_load(data: ReportData) -> Figure | None:
    """D1 and D2 over load, above predicted and measured efficiency there."""
    optimum = data.optimum
    if not len(optimum):
        return None
    figure, axes = panels(2, 1, ONE_COLUMN, 90 * MM)
    lines = (
        (0, "D1", "blue", "-o", 1.0), (0, "D2", "orange", "-s", 1.0),
        (1, "predicted", "grey", "--o", 100.0), (1, "measured", "vermillion", "-D", 100.0),
    )  # fmt: skip
    for row, name, colour, style, scale in lines:
        if optimum[name].notna().any():
            value = scale * optimum[name]
            axes[row][0].plot(optimum["P_W"], value, style, color=OKABE_ITO[colour], ms=3, lw=1, label=name)
    for one, label in zip(axes, ("D1, D2 (half periods)", "efficiency (%)"), strict=True):
        one[0].set_ylabel(label, fontsize=8)
        one[0].legend(fontsize=7, frameon=False)
    axes[1][0].set_xlabel("output power (W)", fontsize=8)
    return figure


def channel_residuals(data: ReportData) -> Figure | None:
    """Measured less simulated of every channel over output power; colour is D1."""
    rows = loaded_rows(data.measurements)
    channels = residual_channels(rows)
    if not channels:
        return None
    columns = min(3, len(channels))
    lines = -(-len(channels) // columns)
    figure, axes = panels(lines, columns, TWO_COLUMNS, 45 * lines * MM)
    flat = [one for row in axes for one in row]
    for one, (channel, residual) in zip(flat, channels.items(), strict=False):
        unit = difference_unit(channel)
        value = (100.0 if channel == "efficiency" else 1.0) * residual
        drawn = one.scatter(rows["P2_W"], value, c=rows["D1"], cmap="viridis", vmin=0, vmax=1, s=6)
        one.set_title(channel_name(channel), fontsize=8)
        one.set_ylabel(f"meas. − sim. ({unit})", fontsize=7)
        one.axhline(0.0, color="#8b949e", lw=0.6)
    for one in flat[len(channels) :]:
        one.set_axis_off()
    for one in flat[max(0, len(channels) - columns) : len(channels)]:
        one.set_xlabel("output power (W)", fontsize=8)
    figure.colorbar(drawn, ax=flat, pad=0.02, aspect=40).set_label("D1 (half periods)", fontsize=8)
    return figure


def loss_breakdown(data: ReportData) -> Figure | None:
    """Simulated loss by part at the optimum, stacked over load; colour is the stage, hatch the part."""
    losses = data.losses
    parts = loss_parts(losses)
    if not parts:
        return None
    figure, axes = _one(TWO_COLUMNS, 85 * MM)
    power = losses["P_set_W"].to_numpy(dtype=float)
    width = 0.8 * float(np.min(np.diff(power))) if len(power) > 1 else 50.0
    bottom, used = np.zeros(len(losses)), dict.fromkeys(OKABE_ITO, 0)
    for part in parts:
        colour = next((colour for stage, colour in STAGES if part.startswith(stage)), "grey")
        value = losses[f"loss_{part}_W"].to_numpy(dtype=float)
        hatch = HATCHES[used[colour] % len(HATCHES)]
        shown: dict[str, Any] = {
            "color": OKABE_ITO[colour],
            "hatch": hatch,
            "edgecolor": "white",
            "linewidth": 0.3,
        }
        axes.bar(power, value, width, bottom=bottom, label=words(part), **shown)
        used[colour] += 1
        bottom = bottom + value
    axes.set_xlabel("output power (W)", fontsize=8)
    axes.set_ylabel("loss (W)", fontsize=8)
    axes.legend(fontsize=6, frameon=False, loc="center left", bbox_to_anchor=(1.0, 0.5))
    return figure


def gain_bars(data: ReportData) -> Figure | None:
    """Error on blocks that were not fitted: before, after, and what rivals of the diagnosis reach."""
    known = gain_rows(data.diagnosis.get("gain") or {})
    if not known:
        return None
    figure, axes = _one(ONE_COLUMN, 55 * MM)
    bars = axes.barh(
        [two_lines(label, "\n") for label, *_ in known],
        [value for _, value, *_ in known],
        xerr=np.transpose([reach for *_, reach in known]),
        color=[OKABE_ITO[colour] for _, _, colour, _ in known],
        height=0.6,
        error_kw={"lw": 0.8, "capsize": 2, "ecolor": "#333333"},
    )
    axes.bar_label(bars, fmt="%.3f", fontsize=7, padding=2)
    axes.set_xlim(0, 1.25 * max(value + above for _, value, _, (_, above) in known))
    axes.invert_yaxis()
    axes.set_xlabel("mean error held out, 95 % (points)", fontsize=8)
    return figure


def _one(width: float, height: float) -> tuple[Figure, Axes]:
    figure, axes = panels(1, 1, width, height)
    return figure, axes[0][0]


def panels(rows: int, columns: int, width: float, height: float) -> tuple[Figure, list[list[Axes]]]:
    """A figure of so many inches with axes in the style of all of them."""
    figure = Figure(figsize=(width, height), layout="constrained")
    axes = figure.subplots(rows, columns, squeeze=False)
    for one in axes.ravel():
        one.tick_params(labelsize=7)
        one.grid(color="#e4e7eb", lw=0.5)
        one.set_axisbelow(True)
        one.spines[["top", "right"]].set_visible(False)
    return figure, [list(row) for row in axes]
