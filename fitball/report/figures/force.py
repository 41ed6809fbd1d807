"""The figure of force records against the posterior prediction."""

from __future__ import annotations

from matplotlib.figure import Figure

from fitball.report.figures.canvas import Margins, heading, legend_below, panels
from fitball.report.figures.drawable import Drawable
from fitball.report.figures.force_arrays import force_panels
from fitball.report.form.palette import MEASURED, MODEL, NOISE

COLUMNS = 3
CELL = (2.9, 2.1)


def force_figure(fit: Drawable) -> Figure:
    """Measured means with the sensor's noise, the model's force, and what a record is expected to show."""
    shown = force_panels(fit)
    columns = min(COLUMNS, len(shown))
    rows = -(-len(shown) // columns)
    figure, axes = panels(rows, columns, CELL, Margins(across=0.6, down=0.75, top=0.75, bottom=1.15))
    for axis, panel in zip(axes.ravel(), shown, strict=False):
        axis.fill_between(
            panel.times, *panel.expected, color=NOISE, alpha=0.45, linewidth=0, label="95 % of a record, with noise"
        )
        axis.fill_between(panel.along, panel.course[0], panel.course[2], color=MODEL, alpha=0.4, linewidth=0)
        axis.plot(panel.along, panel.course[1], color=MODEL, linewidth=1.2, label="model's force, 95 % band")
        axis.errorbar(
            panel.times, panel.means, panel.sd, fmt="o", color=MEASURED, markersize=2.5, linewidth=0.8,
            label="measured (means of samples)",
        )  # fmt: skip
        axis.set_title(panel.title, fontsize=10)
        axis.set_xlabel("time after landing [ms]")
        axis.grid(alpha=0.3)
        axis.tick_params(labelsize=8)
    for axis in axes.ravel()[len(shown) :]:
        axis.set_visible(False)
    for axis in axes[:, 0]:
        axis.set_ylabel("force on the court [N]")
    handles, labels = axes[0, 0].get_legend_handles_labels()
    legend_below(figure, handles, labels, min(3, columns))
    head = f"{fit.problem.model.name} on {fit.problem.table.name}:"
    heading(figure, f"{head} force records" if columns > 1 else f"{head}\nforce records")
    return figure
