"""The corner plot as the package `corner` draws it: for those who go on with its panels, an Axes each."""

from __future__ import annotations

from corner import corner
from matplotlib.figure import Figure

from fitball.inference.results.results import Fit
from fitball.report.figures.canvas import new_figure
from fitball.report.figures.corner import in_units
from fitball.report.figures.style import own_style

# Inches: a panel, and what surrounds them.
PANEL, ROUND = 1.6, 1.2


@own_style()
def package_corner_figure(fit: Fit) -> Figure:
    """Draws and point estimate in the units of our own corner plot, on its axes; `corner.overplot_points` and the
    like take the figure.
    """
    axes, draws, point = in_units(fit)
    side = PANEL * len(axes) + ROUND
    made: Figure = corner(
        draws,
        labels=[axis.label for axis in axes],
        axes_scale=["log" if axis.logarithmic else "linear" for axis in axes],
        truths=point,
        max_n_ticks=3,
        labelpad=0.12,
        fig=new_figure(side, side, layout=None),
    )
    return made
