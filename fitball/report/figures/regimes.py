"""The figure of regimes: for each impact the posterior probability of every phase sequence."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.figure import Figure

from fitball.inference.results.results import Fit, Predictive
from fitball.report.figures.canvas import drawn_handles, fit_heading, legend_below, new_figure, verbatim
from fitball.report.figures.quantities import group_of
from fitball.report.form.palette import FAINT, REGIMES
from fitball.values import FloatArray
from fitball.wording import option, short

# Inches: the figure, one bar, what surrounds them in all, below them, and left of them besides their labels.
WIDTH, ROW, ROUND, BELOW, LEFT = 8.5, 0.27, 1.6, 1.05, 0.5
# Bars that one picture has room for at least, and can show at most.
FEWEST = 6
MOST_BARS = 40
# Sequences with less than this at every impact are shown as one.
RARE = 0.02
OTHERS = "others"
# Sequences that most tables show, in the order of their colours.
USUAL = ("slide", "slide-grip-slide back", "slide-grip-slide", "grip", "slide-grip")


@dataclass(frozen=True)
class RegimeBars:
    """Impacts by group and rising angle: their `labels`, the `regimes`, and `shares` (impacts, regimes)."""

    labels: tuple[str, ...]
    regimes: tuple[str, ...]
    shares: FloatArray


def regime_bars(fit: Fit, predictive: Predictive) -> RegimeBars:
    """What the figure shows; of many impacts MOST_BARS, evenly spread."""
    impacts = fit.problem.impacts
    angle = np.degrees(impacts.angle)
    groups = group_of(fit)
    along = angle if fit.problem.table.has_tangential else impacts.v_y1
    place = {group: k for k, group in enumerate(dict.fromkeys(groups))}
    order = sorted(range(len(impacts)), key=lambda k: (place[groups[k]], float(along[k])))
    if len(order) > MOST_BARS:
        order = [order[k] for k in np.linspace(0, len(order) - 1, MOST_BARS).round().astype(int)]
    peaks: dict[str, float] = {}
    for k in order:
        for name, share in predictive.regimes[k].items():
            peaks[name] = max(peaks.get(name, 0.0), share)
    named = [name for name in sorted(peaks, key=lambda name: (-peaks[name], name)) if peaks[name] >= RARE]
    # Beyond the colours there are, the rest shares one.
    named = named[: len(REGIMES) - 1] if len(named) > len(REGIMES) - 1 else named
    columns = [[predictive.regimes[k].get(name, 0.0) for k in order] for name in named]
    shares = np.array(columns).T.reshape(len(order), len(named))
    rest = 1.0 - shares.sum(axis=1)
    if np.any(rest > 1e-9):
        named, shares = [*named, OTHERS], np.column_stack([shares, np.maximum(rest, 0.0)])
    labels = tuple(
        "  ".join(filter(None, (fit.problem.table.ids[k], short(groups[k]), f"{impacts.v_y1[k]:.1f} m/s")))
        + (f", {angle[k]:.0f}°" if fit.problem.table.has_tangential else "")
        for k in order
    )
    return RegimeBars(labels, tuple(named), shares)


def regime_colours(regimes: Sequence[str]) -> list[str]:
    """A colour for each sequence; the usual ones keep theirs from figure to figure."""
    spare = [colour for k, colour in enumerate(REGIMES) if k >= len(USUAL) or USUAL[k] not in regimes]
    colours = []
    for name in regimes:
        if name == OTHERS:
            colours.append(FAINT)
        else:
            colours.append(REGIMES[USUAL.index(name)] if name in USUAL else spare.pop(0))
    return colours


def figure(fit: Fit) -> Figure:
    """One bar per impact, one colour per phase sequence."""
    assert fit.predictive is not None
    data = regime_bars(fit, fit.predictive)
    high = ROUND + ROW * max(FEWEST, len(data.labels))
    figure = new_figure(WIDTH, high, layout=None)
    axis = figure.add_axes((0.0, BELOW / high, 1.0, 1.0 - ROUND / high))
    places = np.arange(len(data.labels))
    left = np.zeros(len(data.labels))
    colours = regime_colours(data.regimes)
    for k, name in enumerate(data.regimes):
        axis.barh(places, data.shares[:, k], left=left, color=colours[k], height=0.8, label=name)
        left = left + data.shares[:, k]
    axis.set_yticks(places, [*map(verbatim, data.labels)], fontsize=8)
    axis.set_ylim(len(data.labels) - 0.4, -0.6)
    axis.set_xlim(0.0, 1.0)
    axis.set_xlabel("posterior probability of the phase sequence")
    group = f", {fit.problem.grouped_by}" if fit.problem.grouped_by else ""
    speed = "normal speed, incidence" if fit.problem.table.has_tangential else "speed"
    axis.set_ylabel(verbatim(f"impact{group}, {speed}"))
    # Identifiers are the user's: as wide as they are.
    widest = max(float(label.get_window_extent().width) for label in axis.get_yticklabels()) / figure.dpi
    room = min(widest + LEFT, 0.6 * WIDTH)
    axis.set_position((room / WIDTH, BELOW / high, 1.0 - (room + 0.2) / WIDTH, 1.0 - ROUND / high))
    legend_below(figure, drawn_handles(axis), 3)
    fit_heading(figure, fit, "regimes")
    return figure


def missing(fit: Fit) -> str:
    """Why a fit has no such figure, "" where it has."""
    if fit.predictive is None:
        return f"the probability of regimes needs a posterior; run calibrate without {option('point_only')}"
    return "" if fit.problem.table.has_tangential else "no motion along the court was measured: there are no regimes"


# A sequence less probable than this may be another one.
SURE = 0.95


def words(fit: Fit) -> str:
    """The figure in words and numbers, for who does not see it."""
    if fit.predictive is None:
        return ""
    first = [next(iter(shares.items())) for shares in fit.predictive.regimes]
    counts = Counter(name for name, _share in first).most_common()
    doubtful = sum(share < SURE for _name, share in first)
    parts = ", ".join(f"{name} at {count}" for name, count in counts)
    sure = "all of them certain" if doubtful == 0 else f"{doubtful} of them below {100.0 * SURE:.0f} % probability"
    return f"Most probable sequence of slip and grip of {len(first)} impacts: {parts}; {sure}."
