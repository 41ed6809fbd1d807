"""What the figure of residuals shows, computed before anything is drawn."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fitball.report.figures.drawable import Drawable
from fitball.report.figures.measured import measured_part, measured_rows, noise_sd, prediction_of
from fitball.values import FloatArray

WITHIN = 1.959963984540054
# A quantity whose values lie as near to each other as this share of the largest does not differ.
ALIKE = 1e-3


@dataclass(frozen=True)
class Residuals:
    """Standardised residuals of one output, (measured - predicted)/sd, at the impacts `rows` of the table."""

    name: str
    rows: NDArray[np.int64]
    values: FloatArray


@dataclass(frozen=True)
class Incident:
    """One quantity of the incident state with its label, (impacts,) in the unit in which people read it."""

    label: str
    values: FloatArray


@dataclass(frozen=True)
class Trend:
    """Means of residuals over bins of equal count, with half of their 95 % intervals, all (bins,)."""

    along: FloatArray
    mean: FloatArray
    half: FloatArray


def residual_data(fit: Drawable) -> tuple[Residuals, ...]:
    """Residuals of every observable at the posterior median, or the point estimate."""
    found = []
    for item in fit.problem.observables:
        prediction = prediction_of(fit, item)
        centre = item.predict(fit.point.rebound)[0] if prediction is None else prediction.median
        gap = measured_part(item, item.observed) - measured_part(item, centre)
        found.append(Residuals(item.name, measured_rows(item), gap / noise_sd(fit, item)))
    return tuple(found)


def incident_quantities(fit: Drawable) -> Mapping[str, Incident]:
    """Components, speed, angle and spin by name, those that differ between impacts."""
    impacts = fit.problem.impacts
    everything = {
        "v_x1": Incident(r"$v_{x1}$ [m/s]", impacts.v_x1),
        "v_y1": Incident(r"$v_{y1}$ [m/s]", impacts.v_y1),
        "v_1": Incident(r"speed $v_1$ [m/s]", np.hypot(impacts.v_x1, impacts.v_y1)),
        "theta_1": Incident(r"angle $\theta_1$ [deg]", np.degrees(np.arctan2(impacts.v_y1, impacts.v_x1))),
        "omega_1": Incident(r"spin $\omega_1$ [rad/s]", impacts.omega_1),
    }
    if not fit.problem.table.has_tangential:
        everything = {name: everything[name] for name in ("v_y1", "omega_1")}
    return {
        name: item
        for name, item in everything.items()
        if np.ptp(item.values) > ALIKE * float(np.max(np.abs(item.values)))
    }


def trend(along: FloatArray, values: FloatArray, bins: int) -> Trend:
    """Means over `bins` of equal count along a quantity; equal values of it stay together."""
    order = np.argsort(along, kind="stable")
    first = np.searchsorted(along[order], along[order[np.arange(1, bins) * order.size // bins]])
    parts = [part for part in np.split(order, np.unique(first)) if part.size > 1]
    means = [float(values[part].mean()) for part in parts]
    halves = [WITHIN * float(values[part].std(ddof=1)) / float(np.sqrt(part.size)) for part in parts]
    return Trend(np.array([np.median(along[part]) for part in parts]), np.array(means), np.array(halves))
