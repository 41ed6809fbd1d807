"""Regions of a pair of parameters that hold a share of their draws."""

from typing import Annotated, TypeAlias

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import to_rgba

from fitball.base.values import FloatArray
from fitball.report.style import MODEL_COLOUR

# The ends of an axis.
Ends: TypeAlias = tuple[float, float]

# Shares of the draws that regions hold, the larger region first.
SHARES = (0.95, 0.68)
# How dense the colours of both are.
_ALPHAS = (0.35, 0.75)
# Bins across an axis, and the sd in bins by which counts are smoothed.
_BINS = 40
_SMOOTHING = 1.8
# Share of an axis within which a region that reaches its end is closed.
_CLOSING = 1e-6


def draw_regions(axes: Axes, x: FloatArray, y: FloatArray, ends_x: Ends, ends_y: Ends) -> None:
    """Draw the regions that hold SHARES of draws `x` and `y` (draws,): where their smoothed density
    is higher than at all but that share of the draws. Nothing is drawn beyond the ends, which are
    those of the axes, or hard bounds before them.
    """
    at_x, at_y, density = _smoothed_density(x, y, ends_x, ends_y)
    at_draws = _interpolated(at_x, at_y, density, x, y)
    levels = np.quantile(at_draws, [1.0 - share for share in SHARES])
    highest = float(density.max())
    if not 0.0 < levels[0] < levels[1] < highest:
        # Draws that are all the same have no region.
        return
    grid = (at_x, at_y, density.T)
    colours = [to_rgba(MODEL_COLOUR, alpha) for alpha in _ALPHAS]
    axes.contourf(*grid, levels=[*levels, 2.0 * highest], colors=colours)
    axes.contour(*grid, levels=levels, colors=[MODEL_COLOUR], linewidths=0.8)


def _smoothed_density(
    x: FloatArray,
    y: FloatArray,
    ends_x: Ends,
    ends_y: Ends,
) -> tuple[
    Annotated[FloatArray, "nodes"],
    Annotated[FloatArray, "nodes"],
    Annotated[FloatArray, "nodes nodes"],
]:
    """The smoothed counts of draws at nodes of a grid between the ends. At an end counts are
    reflected, so that smoothing takes none beyond it, and the outermost nodes are zero.
    """
    from scipy.ndimage import gaussian_filter

    counts, edges_x, edges_y = np.histogram2d(x, y, _BINS, (ends_x, ends_y))
    smooth = gaussian_filter(counts, _SMOOTHING, mode="reflect")
    density = np.pad(np.pad(smooth, 1, mode="edge"), 1)
    return _nodes(edges_x), _nodes(edges_y), density


def _nodes(edges: FloatArray) -> FloatArray:
    """The nodes of an axis: the middles of bins, both ends, and a place next to each end."""
    low, high = edges[0], edges[-1]
    closing = _CLOSING * (high - low)
    middles = 0.5 * (edges[:-1] + edges[1:])
    return np.concatenate([[low, low + closing], middles, [high - closing, high]])


def _interpolated(
    at_x: FloatArray,
    at_y: FloatArray,
    density: FloatArray,
    x: FloatArray,
    y: FloatArray,
) -> FloatArray:
    """The density (draws,) at draws, zero beyond the grid."""
    from scipy.interpolate import RegularGridInterpolator

    density_at = RegularGridInterpolator((at_x, at_y), density, bounds_error=False, fill_value=0.0)
    return np.asarray(density_at(np.column_stack([x, y])))
