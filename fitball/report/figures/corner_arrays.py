"""What the corner plot shows, computed before anything is drawn."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from fitball.report.figures.drawable import Drawable, drawn, parameter
from fitball.report.figures.parameter_axis import ParameterAxis, parameter_axis
from fitball.values import FloatArray

CORNER_DRAWS = 12_000
# Quantile range of the posterior a corner axis spans.
SPAN = (0.002, 0.998)
HISTOGRAM_BINS = 32
# Shares of the draws within the contours: one and two standard deviations of a normal distribution of two dimensions.
LEVELS = (0.393, 0.865)


@dataclass(frozen=True)
class CornerData:
    """The point estimate in the units of its `axes`; the `edges` (bins + 1,) of each axis, evenly spaced on it; the
    `bins` of some draws (parameters, draws), HISTOGRAM_BINS where one lies beyond; and the densities (bins,) of
    posterior and prior per length of the axis: per value, or on a logarithmic axis per natural logarithm.
    """

    axes: tuple[ParameterAxis, ...]
    point: FloatArray
    edges: tuple[FloatArray, ...]
    bins: NDArray[np.int64]
    posterior: tuple[FloatArray, ...]
    prior: tuple[FloatArray, ...]

    def middles(self, k: int) -> FloatArray:
        """The middles of the bins of an axis (bins,)."""
        return _middles(self.axes[k], self.edges[k])


def corner_data(fit: Drawable) -> CornerData:
    """Everything the corner plot shows."""
    axes, every, point = in_units(fit)
    rows = np.linspace(0, every.shape[0] - 1, min(CORNER_DRAWS, every.shape[0])).astype(int)
    draws = every[rows]
    ends = np.quantile(draws, SPAN, axis=0)
    # The point estimate is part of the picture even where it lies at the edge of the draws.
    low, high = np.minimum(ends[0], point), np.maximum(ends[1], point)
    edges = tuple(
        axis.between(*axis.margins(float(low[k]), float(high[k]), 0.03), HISTOGRAM_BINS + 1)
        for k, axis in enumerate(axes)
    )
    along = tuple(zip(axes, edges, strict=True))
    bins = np.stack([_bins(axis, draws[:, k], edges[k]) for k, axis in enumerate(axes)])
    densities = tuple(_density(axis, bins[k], edges[k]) for k, axis in enumerate(axes))
    prior = tuple(_prior_density(fit, name, *on) for name, on in zip(drawn(fit).names, along, strict=True))
    return CornerData(axes, point, edges, bins, densities, prior)


def in_units(fit: Drawable) -> tuple[tuple[ParameterAxis, ...], FloatArray, FloatArray]:
    """The axis of each free parameter, all draws (draws, parameters) and the point estimate in their units."""
    posterior = drawn(fit)
    axes = tuple(parameter_axis(parameter(fit, name).spec) for name in posterior.names)
    factors = np.array([axis.factor for axis in axes])
    point = np.array([fit.point.values[name] for name in posterior.names])
    return axes, posterior.draws * factors, point * factors


def _along(axis: ParameterAxis, values: FloatArray) -> FloatArray:
    """Places on the axis, as lengths."""
    return np.log(values) if axis.logarithmic else values


def _middles(axis: ParameterAxis, edges: FloatArray) -> FloatArray:
    return np.sqrt(edges[1:] * edges[:-1]) if axis.logarithmic else 0.5 * (edges[1:] + edges[:-1])


def _bins(axis: ParameterAxis, draws: FloatArray, edges: FloatArray) -> NDArray[np.int64]:
    """The bin of each draw: the edges are evenly spaced, so that nothing is searched."""
    low, high = (float(_along(axis, edges[k])) for k in (0, -1))
    share = (_along(axis, draws) - low) / (high - low)
    return np.where((share >= 0.0) & (share < 1.0), (share * HISTOGRAM_BINS).astype(np.int64), HISTOGRAM_BINS)


def _density(axis: ParameterAxis, bins: NDArray[np.int64], edges: FloatArray) -> FloatArray:
    counts = np.bincount(bins, minlength=HISTOGRAM_BINS + 1)[:HISTOGRAM_BINS]
    return np.asarray(counts / (bins.size * np.diff(_along(axis, edges))))


def _prior_density(fit: Drawable, name: str, axis: ParameterAxis, edges: FloatArray) -> FloatArray:
    """Mean density of the prior itself between `edges`, (bins,)."""
    prior = next(item.prior for item in fit.problem.free if item.name == name)
    low, high = prior.quantile(np.array([0.0, 1.0])) * axis.factor
    middle = _middles(axis, edges)
    inside = (middle > low) & (middle < high)
    safe = np.where(inside, middle, 0.5 * (low + high)) / axis.factor
    density = np.exp(prior.log_density(prior.coordinate(safe)))
    # From the density of ln x to that of x, and from that of x to that of the axis.
    per_value = density / safe if prior.log else density
    per_length = per_value * safe if axis.logarithmic else per_value / axis.factor
    return np.where(inside, per_length, 0.0)


def pair_density(data: CornerData, across: int, up: int) -> tuple[FloatArray, FloatArray]:
    """Smoothed density of two parameters on their axes (bins, bins), rows upwards, and its values at the contours,
    lowest first.
    """
    # One row and column more for the draws beyond, which are left out.
    side = HISTOGRAM_BINS + 1
    counts = np.bincount(data.bins[up] * side + data.bins[across], minlength=side * side).reshape(side, side)
    density = gaussian_filter(counts[:-1, :-1].astype(np.float64), 1.0)
    order = np.sort(density.ravel())[::-1]
    shares = np.cumsum(order) / order.sum()
    return density, np.array([order[np.searchsorted(shares, level)] for level in LEVELS[::-1]])
