"""Blind trials in pictures: what effects are taken for, how far they must stand out, how far to believe an answer."""

from collections import Counter
from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray
from scipy.stats import norm

from experiments.blind.answer import NO_ANSWER
from experiments.blind.calibration import LISTED, intervals
from experiments.blind.scoring import Scored, judged, share
from experiments.harness.result import Picture, Table
from experiments.study.pictures import (
    COLOURS,
    MAP,
    MARKERS,
    SOFT,
    TEXT,
    canvas,
    dress,
    legend,
    panels,
    picture,
)
from sim.effects.catalogue import CATALOGUE

Array = NDArray[np.float64]

_NAMELESS = ("consistent", "unknown", NO_ANSWER)
_DARK = 60.0  # per cent: on a darker cell a number is white
_BANDS = (5.0, 6.0, 7.0, 8.5, 10.0, 15.0, 30.0, 100.0, np.inf)  # sigma
_TICKS = (5, 10, 20, 50, 100, 200)
_HALF_95 = float(norm.ppf(0.975))  # standard deviations in half a 95 % interval
_FURTHEST = 4.0  # standard deviations that are drawn: what is further off is counted there


def confusion(scored: Sequence[Scored]) -> Picture:
    """Single hidden effects against what was said first, in per cent of the trials of each."""
    seen = judged(scored)
    of_each = Counter(s.trial.names[0] for s in seen)
    hidden, said, shares = _shares(seen)
    figure = canvas(8.4, 7.0)
    axes = figure.subplots()
    mesh = axes.imshow(np.where(shares > 0, shares, np.nan), cmap=MAP, vmin=0.0, vmax=100.0, aspect="auto")
    dress(axes, "What one hidden effect is taken for", "said first", "hidden (trials)")
    axes.grid(visible=False)
    axes.set_xticks(range(len(said)), said, rotation=90, fontsize=7)
    axes.set_yticks(range(len(hidden)), [f"{h} ({of_each[h]})" for h in hidden], fontsize=7)
    axes.axvline(len(said) - len(_NAMELESS) - 0.5, color=SOFT, linewidth=1.0)
    for row, column in np.argwhere((shares > 0) & (shares < 100)):
        colour = "white" if shares[row, column] < _DARK else TEXT
        number = f"{shares[row, column]:.0f}"
        axes.text(column, row, number, ha="center", va="center", fontsize=6, color=colour)
    bar = figure.colorbar(mesh, ax=axes, fraction=0.03)
    bar.set_label("share of its trials, %", fontsize=9, color=TEXT)
    bar.ax.tick_params(labelsize=8, colors=TEXT)
    caption = f"{len(seen)} labs with one hidden effect. Right of the line: verdicts without a name."
    return picture(figure, "confusion", caption)


def _shares(seen: Sequence[Scored]) -> tuple[list[str], list[str], Array]:
    """What was hidden (H) and what was said first (S), each in the catalogue's order, and per cent of it, (H, S)."""
    taken = Counter((s.trial.names[0], _first(s)) for s in seen)
    hidden = [name for name in CATALOGUE if any(h == name for h, _ in taken)]
    named = [name for name in CATALOGUE if any(name in pair for pair in taken)]
    counts = np.array([[taken[h, k] for k in (*named, *_NAMELESS)] for h in hidden], dtype=float)
    return hidden, [*named, *_NAMELESS], 100.0 * counts / np.sum(counts, axis=1, keepdims=True)


def by_isolability(kinds: Mapping[str, Sequence[Scored]]) -> Picture:
    """How often a hidden effect is in what is stated, over how far the truth lets it stand out."""
    figure, (axes,) = panels(1, 1)
    for (name, scored), colour, marker in zip(kinds.items(), COLOURS, MARKERS, strict=False):
        sigma = np.array([s.isolability for s in judged(scored)], dtype=float)
        band = np.digitize(sigma, _BANDS)
        for number in np.unique(band):
            own = [s for s, k in zip(judged(scored), band, strict=True) if k == number]
            found = share(own, lambda s: s.stated)
            low, high = found.interval()
            axes.errorbar(
                np.exp(np.mean(np.log(sigma[band == number]))), found.per_cent,
                [[found.per_cent - low], [high - found.per_cent]],
                color=colour, marker=marker, markersize=5, capsize=2, linewidth=1.0,
                label=f"{name}, {len(judged(scored))} labs" if number == band.min() else None,
            )  # fmt: skip
    axes.set_xscale("log")
    axes.xaxis.set_major_formatter("{x:g}")
    axes.set_xticks(_TICKS)
    axes.set_xticks([], minor=True)
    dress(axes, "How far an effect must stand out", "isolability, sigma", "in what is stated, %")
    legend(axes)
    caption = (
        "Labs with one hidden effect, by how many sigma of it stand out of all that could be mistaken for it, which is "
        "worked out from the truth. Bars: 95 % intervals of Clopper and Pearson."
    )
    return picture(figure, "isolability", caption)


def credibility(scored: Sequence[Scored], reliability: Table) -> Picture:
    """Stated probabilities against how often they were right, and values against their intervals.

    ``reliability`` is the table of :func:`experiments.blind.calibration.reliability`.
    """
    figure, (left, right) = panels(1, 2, width_in=8.4, height_in=3.8)
    _probabilities(left, reliability)
    off = _deviations(scored)
    edges = np.linspace(-_FURTHEST, _FURTHEST, 33)
    inside = np.clip(off, -_FURTHEST, _FURTHEST)
    right.hist(inside, edges.tolist(), density=True, color=COLOURS[5], label=f"{off.size} values")
    fine = np.linspace(-_FURTHEST, _FURTHEST, 201)
    right.plot(fine, norm.pdf(fine), color=TEXT, linewidth=1.2, label="normal")
    right.axvspan(-_HALF_95, _HALF_95, color=SOFT, alpha=0.08, linewidth=0)
    dress(right, "Values", "value less truth, standard deviations", "density")
    legend(right)
    outside = 100.0 - intervals(scored).per_cent
    caption = (
        "Labs with effects drawn from the prior, and as many with none. Left: causes by their stated probability, and "
        "how many of them were there; bars are 99 % intervals, numbers count statements. Right: values of causes with "
        "half the probability or more, less the hidden ones, in standard deviations as their 95 % intervals have them "
        f"on that side; {outside:.1f} % lie outside the shaded 95 %."
    )
    return picture(figure, "credibility", caption)


def _probabilities(axes: Axes, reliability: Table) -> None:
    axes.plot([0, 100], [0, 100], color=SOFT, linewidth=1.0, linestyle="--")
    for _, count, *per_cent, _ in reliability.rows:
        if not count:
            continue
        stated, observed, low, high = (float(x) for x in per_cent if x is not None)
        axes.errorbar(
            stated, observed, [[observed - low], [high - observed]],
            color=COLOURS[0], marker=MARKERS[0], markersize=5, capsize=2, linewidth=1.0,
        )  # fmt: skip
        axes.annotate(str(count), (stated, observed), xytext=(5, -9), textcoords="offset points", fontsize=7)
    dress(axes, "Probabilities", "stated, %", "observed, %")


def _deviations(scored: Sequence[Scored]) -> Array:
    """How far stated values are from the hidden ones, in standard deviations of their intervals' sides, (N,)."""
    found = []
    for s in judged(scored):
        for name, truth in s.trial.headlines.items():
            cause = s.said.cause(name)
            if cause is None or cause.probability < LISTED:
                continue
            side = cause.value - cause.low if truth < cause.value else cause.high - cause.value
            found.append(_HALF_95 * (cause.value - truth) / max(side, 1e-300))
    return np.array(found)


def _first(s: Scored) -> str:
    """The first name that was stated, else the verdict."""
    return (s.said.first if s.said.stated else None) or s.said.verdict
