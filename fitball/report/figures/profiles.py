"""The figure of profile likelihoods: one panel per parameter, with the levels that end its intervals."""

from __future__ import annotations

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from fitball.inference.identifiability.profile import DROP_68, DROP_95
from fitball.report.figures.canvas import Margins, heading, legend_below, log_scale, panels
from fitball.report.figures.drawable import Drawable
from fitball.report.figures.profile_arrays import LOWEST, ProfilePanel, profile_panels
from fitball.report.form.palette import GUIDE, MEASURED, MODEL

COLUMNS = 4
# Height of the posterior's interval, in log likelihood.
BAR = -2.35
LEVELS = (0.0, -DROP_68, -1.0, -DROP_95)
LEVEL_WORDS = ("0", f"-{DROP_68:g} (68 %)", "-1", f"-{DROP_95:.2f} (95 %)")
CELL = (2.3, 1.75)


def profiles_figure(fit: Drawable) -> Figure:
    """All profiles; with a posterior its 95 % intervals below them."""
    shown = profile_panels(fit)
    columns = min(COLUMNS, len(shown))
    rows = -(-len(shown) // columns)
    figure, grid = panels(rows, columns, CELL, Margins(left=1.15, down=0.75, bottom=1.05, top=0.75))
    axes = grid.ravel()
    scene = fit.problem.contact_time is not None
    words = "profile of the measurements and the scene's contact time" if scene else "profile of the measurements"
    for axis, panel in zip(axes, shown, strict=False):
        _draw(axis, panel, words)
    for row in grid:
        row[0].set_yticks(LEVELS, LEVEL_WORDS, fontsize=8)
        for axis in row[1:]:
            axis.set_yticks([])
    figure.supylabel("log likelihood below its maximum", fontsize=10, x=0.1 / figure.get_figwidth(), ha="left")
    for axis in axes[len(shown) :]:
        axis.set_visible(False)
    seen = {label: handle for axis in axes for handle, label in zip(*axis.get_legend_handles_labels(), strict=True)}
    legend_below(figure, list(seen.values()), list(seen), 1 if columns == 1 else 2 if columns < 4 else 3)
    head = f"{fit.problem.model.name} on {fit.problem.table.name}"
    heading(figure, f"{head}: profile likelihoods" if columns > 1 else f"{head}:\nprofile likelihoods")
    return figure


def _draw(axis: Axes, panel: ProfilePanel, words: str) -> None:
    for level in (DROP_68, DROP_95):
        axis.axhline(-level, color=GUIDE, linewidth=0.8, linestyle=":")
    axis.plot(*panel.curve, "-", color=MEASURED, linewidth=1.3, label=words)
    axis.plot(panel.values, panel.log_likelihood, "o", color=MEASURED, markersize=2.5)
    if panel.curve_alone.size:
        axis.plot(*panel.curve_alone, "--", color=GUIDE, linewidth=1.3, label="without the scene's contact time")
    if panel.posterior is not None:
        ends = (BAR, BAR)
        axis.plot(panel.posterior, ends, color=MODEL, linewidth=4, solid_capstyle="butt", label="posterior, 95 %")
    if panel.axis.logarithmic:
        log_scale(axis, *panel.span)
    else:
        axis.set_xlim(*panel.span)
        axis.locator_params(axis="x", nbins=4)
    axis.set_ylim(LOWEST, 0.15)
    axis.set_title(panel.name, fontsize=9, pad=3)
    axis.set_xlabel(panel.axis.label, labelpad=2)
    axis.tick_params(labelsize=8)
