"""What the figure of walkers shows, computed before anything is drawn."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fitball.report.figures.drawable import Drawable, drawn, parameter
from fitball.report.figures.parameter_axis import ParameterAxis, parameter_axis
from fitball.values import FloatArray

TRACE_WALKERS = 3
TRACE_STEPS = 300
MARGINAL_BINS, MARGINAL_SPAN = 40, (0.001, 0.999)


@dataclass(frozen=True)
class TraceData:
    """One parameter in the unit of its axis: steps (shown,), values (ensembles, walkers, shown), and each ensemble's
    marginal as edges (bins + 1,) and heights (bins,), the highest of them 1.
    """

    axis: ParameterAxis
    steps: FloatArray
    values: FloatArray
    marginals: tuple[tuple[FloatArray, FloatArray], ...]


def trace_data(fit: Drawable) -> tuple[TraceData, ...]:
    """A few walkers of each ensemble, thinned, and all draws of each as a histogram."""
    posterior = drawn(fit)
    ensembles, steps, walkers, _ = posterior.values.shape
    shown = np.unique(np.linspace(0, steps - 1, min(TRACE_STEPS, steps)).astype(int))
    some = np.unique(np.linspace(0, walkers - 1, TRACE_WALKERS).astype(int))
    at = shown.astype(np.float64)
    if fit.diagnostics is not None:
        at = fit.diagnostics.warm_up + shown * ((fit.diagnostics.steps - fit.diagnostics.warm_up) / steps)
    result = []
    for k, name in enumerate(posterior.names):
        axis = parameter_axis(parameter(fit, name).spec)
        values = posterior.values[:, shown][:, :, some, k] * axis.factor
        marginals = tuple(_marginal(axis, posterior.values[one, :, :, k].ravel()) for one in range(ensembles))
        result.append(TraceData(axis, at, values.transpose(0, 2, 1), marginals))
    return tuple(result)


def _marginal(axis: ParameterAxis, draws: FloatArray) -> tuple[FloatArray, FloatArray]:
    low, high = (float(end) for end in np.quantile(draws * axis.factor, MARGINAL_SPAN))
    edges = axis.between(low, high, MARGINAL_BINS + 1)
    counts = np.histogram(draws * axis.factor, edges)[0]
    return edges, counts / counts.max()
