"""What the figures show, computed before anything is drawn."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from fitball.inference.results.results import ObservablePrediction, Posterior
from fitball.observables import OBSERVABLES
from fitball.report.figures.drawable import Drawable, drawn, parameter
from fitball.report.form.display_units import handy, output_scale
from fitball.values import FloatArray

CORNER_DRAWS = 12_000
TRACE_WALKERS = 4
TRACE_STEPS = 400
# Quantile range of the posterior a corner axis spans.
SPAN = (0.002, 0.998)
HISTOGRAM_BINS = 32


@dataclass(frozen=True)
class CornerData:
    """Draws (draws, parameters) in handy units, axis `labels` with units, `ranges`, the point estimate, and for
    each parameter the prior's histogram density over the bins of its axis.
    """

    draws: FloatArray
    labels: tuple[str, ...]
    ranges: tuple[tuple[float, float], ...]
    point: FloatArray
    prior: tuple[tuple[FloatArray, FloatArray], ...]


@dataclass(frozen=True)
class TraceData:
    """One parameter: steps (shown,) and values (ensembles, walkers, shown) in a handy unit."""

    label: str
    steps: FloatArray
    values: FloatArray


@dataclass(frozen=True)
class ResidualData:
    """Standardised residuals of one observable at the posterior median, along `along`, with each impact's group."""

    name: str
    along: FloatArray
    values: FloatArray
    groups: tuple[str, ...]


def axis_label(symbol: str, unit: str) -> str:
    """A symbol with its unit in brackets."""
    return f"{symbol} [{unit}]" if unit else symbol


def _labels_and_factors(fit: Drawable, posterior: Posterior) -> tuple[list[str], FloatArray]:
    specs = [parameter(fit, name).spec for name in posterior.names]
    scales = [handy(spec.name, spec.unit) for spec in specs]
    labels = [axis_label(spec.label, scale.unit) for spec, scale in zip(specs, scales, strict=True)]
    return labels, np.array([scale.factor for scale in scales])


def corner_data(fit: Drawable) -> CornerData:
    """Everything the corner plot shows."""
    posterior = drawn(fit)
    labels, factors = _labels_and_factors(fit, posterior)
    draws = posterior.draws
    rows = np.linspace(0, draws.shape[0] - 1, min(CORNER_DRAWS, draws.shape[0])).astype(int)
    thin = draws[rows] * factors
    ends = np.quantile(thin, SPAN, axis=0)
    point = np.array([fit.point.values[name] for name in posterior.names]) * factors
    # The point estimate is part of the picture even where it lies at the edge of the draws.
    low, high = np.minimum(ends[0], point), np.maximum(ends[1], point)
    margin = 0.03 * (high - low)
    ranges = tuple(zip((low - margin).tolist(), (high + margin).tolist(), strict=True))
    prior = []
    for k, (start, stop) in enumerate(ranges):
        edges = np.linspace(start, stop, HISTOGRAM_BINS + 1)
        prior.append((edges, _prior_density(fit, posterior.names[k], edges / factors[k]) / factors[k]))
    return CornerData(thin, tuple(labels), ranges, point, tuple(prior))


def _prior_density(fit: Drawable, name: str, edges: FloatArray) -> FloatArray:
    """Mean density of the prior itself between `edges` [per SI unit], (bins,)."""
    prior = next(item.prior for item in fit.problem.free if item.name == name)
    low, high = prior.quantile(np.array([0.0, 1.0]))
    middle = 0.5 * (edges[1:] + edges[:-1])
    inside = (middle > low) & (middle < high)
    safe = np.where(inside, middle, 0.5 * (low + high))
    density = np.exp(prior.log_density(prior.coordinate(safe)))
    # From the density of ln x to that of x.
    per_value = density / safe if prior.log else density
    result: FloatArray = np.where(inside, per_value, 0.0)
    return result


def trace_data(fit: Drawable) -> tuple[TraceData, ...]:
    """A few walkers of each ensemble, thinned."""
    posterior = drawn(fit)
    labels, factors = _labels_and_factors(fit, posterior)
    _, steps, walkers, _ = posterior.values.shape
    shown = np.unique(np.linspace(0, steps - 1, min(TRACE_STEPS, steps)).astype(int))
    some = np.unique(np.linspace(0, walkers - 1, TRACE_WALKERS).astype(int))
    at = shown.astype(np.float64)
    if fit.diagnostics is not None:
        at = fit.diagnostics.warm_up + shown * ((fit.diagnostics.steps - fit.diagnostics.warm_up) / steps)
    result = []
    for k, label in enumerate(labels):
        values = posterior.values[:, shown][:, :, some, k] * factors[k]
        result.append(TraceData(label, at, values.transpose(0, 2, 1)))
    return tuple(result)


def incidence(fit: Drawable) -> tuple[str, FloatArray]:
    """What impacts are drawn along: incidence angle [deg], or vertical speed for a drop test."""
    impacts = fit.problem.impacts
    if fit.problem.table.has_tangential:
        return "incidence angle [deg]", np.degrees(np.arctan2(impacts.v_y1, impacts.v_x1))
    return "vertical incident speed [m/s]", impacts.v_y1


def group_of(fit: Drawable) -> tuple[str, ...]:
    """The group of each impact, empty where the table has none."""
    labels = fit.problem.groups
    return labels if labels is not None else ("",) * len(fit.problem.table)


def residual_data(fit: Drawable) -> tuple[ResidualData, ...]:
    """Standardised residuals of every observable: (measured - predicted)/sd, NaN where nothing was measured."""
    along = incidence(fit)[1]
    groups = group_of(fit)
    result = []
    for observable in fit.problem.observables:
        predicted, sd = _median_and_sd(fit, observable.name)
        observed = observable.everywhere(len(along)).observed
        result.append(ResidualData(observable.name, along, (observed - predicted) / sd, groups))
    return tuple(result)


def _median_and_sd(fit: Drawable, name: str) -> tuple[FloatArray, FloatArray]:
    if fit.predictive is not None:
        prediction: ObservablePrediction = next(
            prediction for prediction in fit.predictive.observables if prediction.name == name
        )
        return prediction.median, prediction.sd
    count = len(fit.problem.table)
    observable = next(item for item in fit.problem.observables if item.name == name).everywhere(count)
    spread = np.broadcast_to(observable.sds(fit.point.values, fit.point.rebound), (1, count))[0]
    return observable.predict(fit.point.rebound)[0], spread


@dataclass(frozen=True)
class MeasuredPoints:
    """Measured values of one output with error bars, in a handy unit, along `along`; None when not measured."""

    along: FloatArray
    values: FloatArray
    sd: FloatArray
    groups: tuple[str, ...]


def measured_points(fit: Drawable) -> Mapping[str, MeasuredPoints]:
    """Outputs as measured, NaN where they were not; the angle follows from components with their noise."""
    along = incidence(fit)[1]
    groups = group_of(fit)
    raw = {item.name: item.everywhere(len(along)).observed for item in fit.problem.observables}
    spread = {observable.name: _median_and_sd(fit, observable.name)[1] for observable in fit.problem.observables}
    if "theta_2" not in raw and {"v_x2", "v_y2"} <= raw.keys():
        v_x, v_y = raw["v_x2"], raw["v_y2"]
        raw["theta_2"] = np.arctan2(v_y, v_x)
        across = np.hypot(spread["v_x2"] * v_y, spread["v_y2"] * v_x)
        spread["theta_2"] = across / (v_x**2 + v_y**2)
    points: dict[str, MeasuredPoints] = {}
    for name in OBSERVABLES:
        if name in raw:
            factor = output_scale(name).factor
            points[name] = MeasuredPoints(along, raw[name] * factor, spread[name] * factor, groups)
    return points
