"""The figure of walkers: a few of each ensemble after warm-up, and the marginal of each ensemble."""

from __future__ import annotations

from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator

from fitball.report.figures.canvas import Margins, heading, legend_below, log_scale, panels
from fitball.report.figures.drawable import Drawable
from fitball.report.figures.trace_arrays import trace_data
from fitball.report.form.palette import SERIES


def trace_figure(fit: Drawable) -> Figure:
    """A row for each free parameter."""
    data = trace_data(fit)
    figure, grid = panels(len(data), 2, (4.8, 1.25), Margins(left=1.0, bottom=0.85, down=0.12), widths=(4, 1))
    colours = [SERIES[k % len(SERIES)] for k in range(len(data[0].values))]
    for place, (row, item) in enumerate(zip(grid, data, strict=True)):
        # Ensembles in turn, so that none hides the others; without smoothed edges the file is a third as large.
        for walkers in item.values.swapaxes(0, 1):
            for colour, walker in zip(colours, walkers, strict=True):
                row[0].plot(item.steps, walker, color=colour, linewidth=0.5, antialiased=False)
        for colour, (edges, heights) in zip(colours, item.marginals, strict=True):
            row[1].stairs(heights, edges, orientation="horizontal", color=colour)
        seen = [float(item.values.min()), float(item.values.max())]
        seen += [float(edges[k]) for edges, _heights in item.marginals for k in (0, -1)]
        for axis in row:
            if item.axis.logarithmic:
                log_scale(axis, *item.axis.margins(min(seen), max(seen)), "y")
            else:
                axis.set_ylim(*item.axis.margins(min(seen), max(seen)))
                axis.yaxis.set_major_locator(MaxNLocator(4))
            axis.tick_params(labelsize=8, labelbottom=place == len(data) - 1)
        row[0].set_xlim(float(item.steps[0]), float(item.steps[-1]))
        row[0].set_ylabel(item.axis.label, fontsize=9)
        row[1].tick_params(which="both", labelleft=False, labelbottom=False)
    grid[-1][0].set_xlabel("step")
    grid[-1][1].set_xlabel("marginal")
    figure.align_ylabels(grid[:, 0])
    handles = [Line2D([], [], color=colour) for colour in colours]
    legend_below(figure, handles, [f"ensemble {k + 1}" for k in range(len(colours))], 6)
    heading(figure, f"{fit.problem.model.name} on {fit.problem.table.name}: walkers after warm-up")
    return figure
