"""The figure of a comparison: differences of predictive density, and out-of-sample errors by output."""

from __future__ import annotations

import math

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, NullFormatter, StrMethodFormatter

from fitball.inference.comparison.results import Comparison
from fitball.observables import OBSERVABLES
from fitball.report.compare.rows import published_rms, schemes, scored_outputs
from fitball.report.figures.arrays import axis_label
from fitball.report.figures.predictive import COLOURS, MARKERS, new_figure
from fitball.report.form.display_units import output_scale

PUBLISHED_MARK = "x"
# Longest name of a model beside the axis; longer ones break before their closures.
NAME_WIDTH = 20
# Width of an entry of the legend [in].
LEGEND_ENTRY = 2.4


def compare_figure(comparison: Comparison) -> Figure:
    """Models from best (top) to worst; published sets below them, with errors only."""
    outputs = scored_outputs(comparison)
    labels = [broken(scored.name) for scored in comparison.models] + [
        broken(published.name) for published in comparison.published
    ]
    height = 1.9 + 0.36 * len(labels)
    figure = new_figure(4.2 + 1.6 * len(outputs), height)
    axes = figure.subplots(1, 1 + len(outputs), sharey=True, width_ratios=[1.3, *([1.0] * len(outputs))])
    _draw_differences(axes[0], comparison)
    for axis, output in zip(axes[1:], outputs, strict=True):
        _draw_errors(axis, comparison, output)
    axes[0].set_yticks(np.arange(len(labels)), labels, fontsize=9)
    axes[0].set_ylim(len(labels) - 0.5, -0.5)
    for axis in axes:
        axis.grid(alpha=0.3)
        if comparison.published:
            axis.axhline(len(comparison.models) - 0.5, color="0.5", linewidth=0.8)
    handles, names = axes[1].get_legend_handles_labels()
    columns = max(1, int(figure.get_figwidth() / LEGEND_ENTRY))
    figure.legend(handles, names, loc="outside lower center", ncols=min(columns, len(names)), frameon=False)
    figure.suptitle(f"Models on {comparison.table.name}: predictions of impacts left out")
    return figure


def _draw_differences(axis: Axes, comparison: Comparison) -> None:
    best = comparison.models[0].name
    gaps = [comparison.elpd_difference(scored.name, best) for scored in comparison.models]
    axis.axvline(0.0, color="0.3", linewidth=0.8)
    axis.errorbar(
        [gap.value for gap in gaps], np.arange(len(gaps)), xerr=[gap.se for gap in gaps], fmt="o", color=COLOURS[0],
        capsize=3, markersize=5, linewidth=1.2,
    )  # fmt: skip
    axis.set_xlabel("elpd less that of\nthe best, with se")


def _draw_errors(axis: Axes, comparison: Comparison, output: str) -> None:
    scale = output_scale(output)
    for k, way in enumerate(schemes(comparison)):
        rms = [scored.out_of_sample(way).get(output, np.nan) for scored in comparison.models]
        axis.plot(
            np.array(rms) * scale.factor, np.arange(len(rms)), MARKERS[k], color=COLOURS[k % len(COLOURS)],
            markersize=6 if k == 0 else 4.5, markerfacecolor=COLOURS[k % len(COLOURS)] if k == 0 else "none",
            label=f"left out: {way}",
        )  # fmt: skip
    if comparison.published:
        rms = [published_rms(published).get(output, np.nan) for published in comparison.published]
        rows = len(comparison.models) + np.arange(len(rms))
        axis.plot(np.array(rms) * scale.factor, rows, PUBLISHED_MARK, color="0.3", markersize=6, label="as published")
    axis.set_xscale("log")
    axis.xaxis.set_major_locator(FixedLocator(_ticks(*axis.get_xlim())))
    axis.xaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
    axis.xaxis.set_minor_formatter(NullFormatter())
    axis.tick_params(axis="x", labelsize=8)
    symbol = OBSERVABLES[output].symbol
    axis.set_xlabel(f"rms error of\n{axis_label(symbol, scale.unit)}")


def _ticks(low: float, high: float) -> list[float]:
    """Round numbers between two positive ones: 1, 2, 5 of every decade, or more of them where that leaves few."""
    decades = range(math.floor(math.log10(low)), math.ceil(math.log10(high)) + 1)
    for digits in ((1.0, 2.0, 5.0), (1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 7.0)):
        inside = [
            digit * 10.0**decade for decade in decades for digit in digits if low <= digit * 10.0**decade <= high
        ]
        if len(inside) >= 2:
            return inside
    return [low, high]


def broken(name: str) -> str:
    """The name of a model over two lines where it is long."""
    if len(name) <= NAME_WIDTH:
        return name
    for mark in ("+", ": "):
        first, separator, rest = name.partition(mark)
        if separator:
            return f"{first}\n{separator.strip(' :')}{rest}" if mark == "+" else f"{first}:\n{rest}"
    return name
