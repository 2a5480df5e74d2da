"""Drawing in one style: Matplotlib without a display, colours that colour-blind readers can tell apart."""

import io
from collections.abc import Sequence

from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.cm import ScalarMappable
from matplotlib.figure import Figure

from bench.charts import OKABE_ITO
from experiments.harness.result import Picture

TEXT, SOFT, GRID = "#1b1f24", "#59636e", "#e4e7eb"
COLOURS = tuple(
    OKABE_ITO[name] for name in ("blue", "vermillion", "green", "orange", "purple", "sky", "grey")
)
MARKERS = ("o", "s", "D", "^", "v", "P", "X")
MAP = "cividis"
DPI = 170
LABEL = "virtual lab"


def canvas(width_in: float = 7.2, height_in: float = 4.2) -> Figure:
    """An empty figure that lays itself out."""
    figure = Figure(figsize=(width_in, height_in), dpi=DPI, facecolor="white", layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def panels(
    rows: int, columns: int, *, width_in: float = 7.2, height_in: float = 4.2
) -> tuple[Figure, list[Axes]]:
    """A figure with its axes, row by row."""
    figure = canvas(width_in, height_in)
    axes = figure.subplots(rows, columns, squeeze=False)
    return figure, [one for row in axes for one in row]


def dress(axes: Axes, title: str, x: str, y: str) -> None:
    """Title, labels with units, a light grid."""
    axes.set_title(title, fontsize=10, fontweight="bold", color=TEXT, loc="left")
    axes.set_xlabel(x, fontsize=9, color=TEXT)
    axes.set_ylabel(y, fontsize=9, color=TEXT)
    axes.tick_params(labelsize=8, colors=TEXT)
    axes.grid(color=GRID, linewidth=0.7)
    axes.set_axisbelow(True)
    axes.spines[["top", "right"]].set_visible(False)


def legend(axes: Axes, *, columns: int = 1) -> None:
    """A small legend without a frame, where it hides least."""
    axes.legend(fontsize=8, frameon=False, ncols=columns, loc="best", labelcolor=TEXT)


def legend_below(figure: Figure, axes: Axes, *, columns: int = 4) -> None:
    """One legend under all axes, where it hides nothing."""
    entries = axes.get_legend_handles_labels()
    figure.legend(
        *entries, fontsize=8, frameon=False, ncols=columns, loc="outside lower center", labelcolor=TEXT
    )


def colour_bar(figure: Figure, mesh: ScalarMappable, axes: Sequence[Axes], label: str) -> None:
    """A bar beside axes that share one scale of colours; it goes on below its range."""
    bar = figure.colorbar(mesh, ax=list(axes), extend="min")
    bar.set_label(label, fontsize=9, color=TEXT)
    bar.ax.tick_params(labelsize=8, colors=TEXT)


def rotated(axes: Axes, labels: Sequence[str], *, start: int = 0) -> None:
    """Names under bars, slanted so that they do not meet."""
    axes.set_xticks(range(start, start + len(labels)), labels, rotation=25, ha="right", fontsize=8)


def picture(figure: Figure, name: str, caption: str, *, virtual: bool = True) -> Picture:
    """The figure as a PNG; what comes from a virtual lab says so in itself."""
    if virtual:
        figure.text(0.995, 0.995, LABEL, fontsize=7, color=SOFT, ha="right", va="top", style="italic")
    made = io.BytesIO()
    figure.savefig(made, format="png")
    return Picture(name=name, caption=caption, png=made.getvalue())
