"""A switching period as a picture for a paper and as a table of samples."""

import numpy as np
import pandas as pd
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from bench.charts import OKABE_ITO
from bench.paper_figures import MM, ONE_COLUMN, panels
from sim.stepping import Trace

PICTURES = (".png", ".pdf", ".svg")


def oscillogram_table(trace: Trace) -> pd.DataFrame:
    """Samples of the first point: time in s, voltages in V, currents in A.

    A step of a voltage has two rows of one time, before and after it.
    """
    return pd.DataFrame(
        {
            "time_s": trace.time_s[:, 0],
            "vp_V": trace.vp_V[:, 0],
            "vs_V": trace.vs_V[:, 0],
            "iL_A": trace.current_A[:, 0],
            "im_A": trace.magnetizing_A[:, 0],
        }
    )


def oscillogram_figure(trace: Trace, title: str) -> Figure:
    """Voltages of both bridges above the currents of the link and of the magnetizing inductance."""
    samples = oscillogram_table(trace)
    figure, ((upper,), (lower,)) = panels(2, 1, ONE_COLUMN, 85 * MM)
    FigureCanvasAgg(figure)
    at_us = 1e6 * samples["time_s"]
    for axes, lines in (
        (upper, (("vp_V", "vp", "blue", "-"), ("vs_V", "vs", "orange", "-"))),
        (lower, (("iL_A", "iL", "vermillion", "-"), ("im_A", "magnetizing", "grey", "--"))),
    ):
        for column, label, colour, style in lines:
            axes.plot(at_us, samples[column], style, color=OKABE_ITO[colour], lw=1.0, label=label)
        axes.margins(x=0)
        top = float(np.abs(samples[[line[0] for line in lines]].to_numpy()).max())
        axes.set_ylim(-1.15 * top, 1.45 * top)
        axes.legend(fontsize=7, frameon=False, ncols=2, loc="upper right")
    figure.suptitle(title, fontsize=8)
    upper.set_ylabel("bridge voltage (V)", fontsize=8)
    lower.set_ylabel("current (A)", fontsize=8)
    lower.set_xlabel("time since the primary's rising edge (µs)", fontsize=8)
    return figure
