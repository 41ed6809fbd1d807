"""The figure of a comparison: differences of predictive density, and out-of-sample errors by output."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from fitball.inference.comparison.results import Comparison
from fitball.report.compare.rows import published_rms, schemes, scored_outputs
from fitball.report.figures.canvas import log_scale, new_figure, verbatim
from fitball.report.figures.measured import output_label
from fitball.report.figures.style import own_style
from fitball.report.form.display_units import output_scale
from fitball.report.form.palette import GUIDE, MODEL, series_style

PUBLISHED_MARK = "x"
# Longest name of a model beside the axis; longer ones break before their closures.
NAME_WIDTH = 20
# Width of an entry of the legend [in].
LEGEND_ENTRY = 2.4


@own_style()
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
    figure.suptitle(verbatim(f"Models on {comparison.table.name}: predictions of impacts left out"))
    return figure


def _draw_differences(axis: Axes, comparison: Comparison) -> None:
    best = comparison.models[0].name
    gaps = [comparison.elpd_difference(scored.name, best) for scored in comparison.models]
    axis.axvline(0.0, color="0.3", linewidth=0.8)
    axis.errorbar(
        [gap.value for gap in gaps], np.arange(len(gaps)), xerr=[gap.se for gap in gaps], fmt="o", color=MODEL,
        capsize=3, markersize=5, linewidth=1.2,
    )  # fmt: skip
    axis.set_xlabel("elpd less that of\nthe best, with se")


def _draw_errors(axis: Axes, comparison: Comparison, output: str) -> None:
    scale = output_scale(output)
    for k, way in enumerate(schemes(comparison)):
        rms = [scored.out_of_sample(way).get(output, np.nan) for scored in comparison.models]
        colour, marker = series_style(k)
        axis.plot(
            np.array(rms) * scale.factor, np.arange(len(rms)), marker, color=colour,
            markersize=6 if k == 0 else 4.5, markerfacecolor=colour if k == 0 else "none",
            label=f"left out: {way}",
        )  # fmt: skip
    if comparison.published:
        rms = [published_rms(published).get(output, np.nan) for published in comparison.published]
        rows = len(comparison.models) + np.arange(len(rms))
        axis.plot(np.array(rms) * scale.factor, rows, PUBLISHED_MARK, color=GUIDE, markersize=6, label="as published")
    axis.set_xscale("log")
    log_scale(axis, *axis.get_xlim())
    axis.tick_params(axis="x", labelsize=8)
    axis.set_xlabel(f"rms error of\n{output_label(output)}")


def broken(name: str) -> str:
    """The name of a model over two lines where it is long."""
    if len(name) <= NAME_WIDTH:
        return name
    for mark in ("+", ": "):
        first, separator, rest = name.partition(mark)
        if separator:
            return f"{first}\n{separator.strip(' :')}{rest}" if mark == "+" else f"{first}:\n{rest}"
    return name
