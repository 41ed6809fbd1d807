"""The figures of a comparison: scores and errors of the models; each quantity under each model."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from fitball.inference.comparison.results import Comparison
from fitball.inference.problem.parameters import NOISE_SPECS
from fitball.inference.results.assumptions import Quantity
from fitball.models.registry import parameter_spec
from fitball.report.compare.rows import published_rms, schemes, scored_outputs, summarised
from fitball.report.figures.canvas import log_scale, new_figure, own_style, verbatim
from fitball.report.figures.quantities import ParameterAxis, axis_label, output_label, parameter_axis
from fitball.report.form.numbers import handy, output_scale
from fitball.report.form.palette import FAINT, GUIDE, MODEL, series_style

PUBLISHED_MARK = "x"
# Longest name of a model beside the axis; longer ones break before their closures.
NAME_WIDTH = 20
# Width of an entry of the legend [in].
LEGEND_ENTRY = 2.4
STACKED = "stacked mixture"
PANELS, TICKS = 4, 4


def draw_all(comparison: Comparison) -> dict[str, Figure]:
    """The figures by name: `scores`, `ranking`, and `forest` where there is something to draw."""
    figures = {"scores": compare_figure(comparison, brief=True), "ranking": compare_figure(comparison)}
    if drawn_quantities(comparison.assumptions):
        title = f"{comparison.table.name}: median, sd and 95 % interval under each model"
        models = [scored.name for scored in comparison.models]
        figures["forest"] = forest_figure(comparison.assumptions, models, title)
    return figures


@own_style()
def compare_figure(comparison: Comparison, brief: bool = False) -> Figure:
    """Models from best (top) to worst; published sets below them, with errors only. A `brief` one has no published
    sets, two outputs and one way of leaving impacts out.
    """
    if brief:
        comparison = replace(comparison, published=())
    outputs = summarised(comparison) if brief else scored_outputs(comparison)
    labels = [broken(scored.name) for scored in comparison.models] + [
        broken(published.name) for published in comparison.published
    ]
    height = (1.0 if brief else 1.9) + 0.36 * len(labels)
    figure = new_figure(6.0 if brief else 4.2 + 1.6 * len(outputs), height)
    axes = figure.subplots(1, 1 + len(outputs), sharey=True, width_ratios=[1.3, *([1.0] * len(outputs))])
    _draw_differences(axes[0], comparison)
    for axis, output in zip(axes[1:], outputs, strict=True):
        _draw_errors(axis, comparison, output, schemes(comparison)[: 1 if brief else None])
    axes[0].set_yticks(np.arange(len(labels)), labels, fontsize=9)
    axes[0].set_ylim(len(labels) - 0.5, -0.5)
    for axis in axes:
        axis.grid(alpha=0.3)
        if comparison.published:
            axis.axhline(len(comparison.models) - 0.5, color="0.5", linewidth=0.8)
    if brief:
        return figure
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
    axis.set_xlabel("elpd minus that of\nthe best, with se")


def _draw_errors(axis: Axes, comparison: Comparison, output: str, ways: Sequence[str]) -> None:
    scale = output_scale(output)
    for k, way in enumerate(ways):
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


def drawn_quantities(quantities: Mapping[str, Quantity]) -> list[str]:
    """The quantities that have a panel: all but the noise."""
    return [name for name in quantities if name not in NOISE_SPECS]


@own_style()
def forest_figure(quantities: Mapping[str, Quantity], models: Sequence[str], title: str) -> Figure:
    """A panel a quantity; models from best (top) to worst, pale where they are significantly worse."""
    names = drawn_quantities(quantities)
    across = min(PANELS, len(names))
    down = -(-len(names) // across)
    figure = new_figure(2.2 + 2.5 * across, 1.2 + down * (0.7 + 0.27 * (len(models) + 1)))
    panels = figure.subplots(down, across, sharey=True, squeeze=False)
    labels = [*(broken(name) for name in models), STACKED]
    for panel, name in zip(panels.flat, names, strict=False):
        _draw(panel, name, quantities[name], models)
        panel.set_yticks(range(len(labels)), labels, fontsize=7)
        panel.set_ylim(len(models) + 0.6, -0.6)
    for panel in list(panels.flat)[len(names) :]:
        panel.set_axis_off()
    figure.suptitle(verbatim(title))
    return figure


def _draw(panel: Axes, name: str, quantity: Quantity, models: Sequence[str]) -> None:
    """Median, 68 % (to first order) and 95 % interval under each model that has the quantity, and in the mixture."""
    factor, count = handy(name, quantity.unit).factor, len(models)
    if quantity.span is not None:
        panel.axvspan(quantity.span.low * factor, quantity.span.high * factor, color="0.92", linewidth=0)
    ends: list[float] = []
    for row, model in enumerate([*models, STACKED]):
        item = quantity.stacked if row == count else quantity.by_model.get(model)
        if item is None:
            continue
        colour = MODEL if row == count or model in quantity.as_good else FAINT
        median, sd, low, high = (value * factor for value in (item.median, item.sd, item.q025, item.q975))
        panel.plot([low, high], [row, row], color=colour, linewidth=1.0)
        panel.plot([max(low, median - sd), min(high, median + sd)], [row, row], color=colour, linewidth=3.0)
        panel.plot(median, row, "D" if row == count else "o", color=colour, markersize=4.5)
        ends += [low, high]
    panel.axhline(count - 0.5, color="0.5", linewidth=0.8)
    panel.grid(alpha=0.3, axis="x")
    panel.tick_params(axis="x", labelsize=8)
    spec = parameter_spec(name)
    if spec is None:
        # The pace of one of several surfaces keeps its name.
        shown = ParameterAxis(axis_label(verbatim(name), handy(name, quantity.unit).unit), 1.0, False)
    else:
        shown = parameter_axis(spec)
    if shown.logarithmic:
        log_scale(panel, *shown.margins(min(ends), max(ends)))
    else:
        panel.xaxis.set_major_locator(MaxNLocator(TICKS))
    panel.set_xlabel(shown.label, fontsize=9)
