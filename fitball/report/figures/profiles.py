"""The figure of profile likelihoods: one panel per parameter, with the levels that end its intervals."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullFormatter, StrMethodFormatter

from fitball.inference.identifiability.profile import DROP_68, DROP_95
from fitball.report.figures.drawable import Drawable
from fitball.report.figures.predictive import COLOURS, new_figure
from fitball.report.figures.profile_arrays import LOWEST, ProfilePanel, profile_panels

COLUMNS = 4
# Height of the posterior's interval, in log likelihood.
BAR = -2.35
# Ratio of the ends of a logarithmic axis up to which there is room for ticks at 1, 2 and 5 of each decade.
FEW_DECADES = 50.0


def profiles_figure(fit: Drawable) -> Figure:
    """All profiles; with a posterior its 95 % intervals below them."""
    panels = profile_panels(fit)
    columns = min(COLUMNS, len(panels))
    rows = -(-len(panels) // columns)
    figure = new_figure(2.5 * columns + 1.0, 2.35 * rows + 1.0)
    axes = np.atleast_1d(figure.subplots(rows, columns, sharey=True)).ravel()
    scene = fit.problem.contact_time is not None
    words = "profile of the measurements and the scene's contact time" if scene else "profile of the measurements"
    for axis, panel in zip(axes, panels, strict=False):
        _draw(axis, panel, words)
    axes[0].set_yticks(
        (0.0, -DROP_68, -1.0, -DROP_95), ("0", f"-{DROP_68:g} (68 %)", "-1", f"-{DROP_95:.2f} (95 %)"), fontsize=8
    )
    figure.supylabel("log likelihood below its maximum", fontsize=10)
    for axis in axes[len(panels) :]:
        axis.set_visible(False)
    seen = {label: handle for axis in axes for handle, label in zip(*axis.get_legend_handles_labels(), strict=True)}
    figure.legend(seen.values(), seen.keys(), loc="outside lower center", ncols=3, frameon=False, fontsize=9)
    figure.suptitle(f"{fit.problem.model.name} on {fit.problem.table.name}: profile likelihoods")
    return figure


def _draw(axis: Axes, panel: ProfilePanel, words: str) -> None:
    for level in (DROP_68, DROP_95):
        axis.axhline(-level, color="0.6", linewidth=0.8, linestyle=":")
    axis.plot(*panel.curve, "-", color=COLOURS[0], linewidth=1.3, label=words)
    axis.plot(panel.values, panel.log_likelihood, "o", color=COLOURS[0], markersize=2.5)
    if panel.curve_alone.size:
        axis.plot(*panel.curve_alone, "--", color=COLOURS[1], linewidth=1.3, label="without the scene's contact time")
    if panel.posterior is not None:
        ends = (BAR, BAR)
        axis.plot(panel.posterior, ends, color="0.25", linewidth=3, solid_capstyle="butt", label="posterior, 95 %")
    if panel.logarithmic:
        axis.set_xscale("log")
        few = panel.span[1] < FEW_DECADES * panel.span[0]
        axis.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0) if few else (1.0,), numticks=5))
        axis.xaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
        axis.xaxis.set_minor_formatter(NullFormatter())
    else:
        axis.locator_params(axis="x", nbins=4)
    axis.set_xlim(*panel.span)
    axis.set_ylim(LOWEST, 0.15)
    axis.set_xlabel(panel.label)
    axis.tick_params(labelsize=8)
