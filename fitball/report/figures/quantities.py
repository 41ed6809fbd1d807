"""The quantities of figures, with symbols and units: outputs as measured and predicted, parameters and their axes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fitball.errors import ResultFolderError
from fitball.inference.problem.observables import Observable
from fitball.inference.problem.parameters import Parameter
from fitball.inference.results.results import Fit, ObservablePrediction, Posterior
from fitball.models.specs import ParameterSpec
from fitball.observables import OBSERVABLES
from fitball.report.form.numbers import handy, output_scale
from fitball.values import FloatArray
from fitball.wording import option


@dataclass(frozen=True)
class Measured:
    """Measured values of one output and the sd of their noise, in the unit in which people read it, at the impacts
    `rows` of the table.
    """

    rows: NDArray[np.int64]
    values: FloatArray
    sd: FloatArray


def axis_label(symbol: str, unit: str) -> str:
    """A symbol with its unit in brackets."""
    return f"{symbol} [{unit}]" if unit else symbol


def output_label(name: str) -> str:
    """Symbol and unit of a column of a rebound."""
    return axis_label(OBSERVABLES[name].symbol, output_scale(name).unit)


def group_of(fit: Fit) -> tuple[str, ...]:
    """The group of each impact, empty where the table has none."""
    labels = fit.problem.groups
    return labels if labels is not None else ("",) * len(fit.problem.table)


def prediction_of(fit: Fit, observable: Observable) -> ObservablePrediction | None:
    """The posterior prediction of a column; None for a point fit."""
    if fit.predictive is None:
        return None
    return next(item for item in fit.predictive.observables if item.name == observable.name)


def prediction(fit: Fit, observable: Observable) -> FloatArray:
    """The prediction of a column (impacts,): the posterior median without noise, or the point estimate."""
    found = prediction_of(fit, observable)
    return observable.predict(fit.point.rebound)[0] if found is None else found.median


def bias(fit: Fit, observable: Observable) -> FloatArray:
    """The bias of each impact's group at `measured_rows`: the posterior median, or at the point estimate; zero
    without biases.
    """
    if fit.problem.group_bias is None:
        return np.zeros(1)
    columns = {item.name: np.array([item.point if item.median is None else item.median]) for item in fit.estimates}
    return measured_part(observable, fit.problem.group_bias.offset(columns, observable.name)[0])


def measured_rows(observable: Observable) -> NDArray[np.int64]:
    """Impacts of the table at which the column was measured, one for each of its entries that is a number."""
    entries = np.flatnonzero(np.isfinite(observable.observed))
    return entries if observable.rows is None else np.asarray(observable.rows[entries])


def measured_part(observable: Observable, array: FloatArray) -> FloatArray:
    """Of an array (..., entries) of the column, or (..., impacts) of the table, what belongs to `measured_rows`."""
    entries = np.flatnonzero(np.isfinite(observable.observed))
    if observable.rows is not None and array.shape[-1] != observable.observed.size:
        return np.asarray(array[..., observable.rows[entries]])
    return np.asarray(array[..., entries])


def noise_sd(fit: Fit, observable: Observable) -> FloatArray:
    """Standard deviation of the noise at `measured_rows`: the posterior's median, or at the point estimate."""
    found = prediction_of(fit, observable)
    if found is not None:
        return measured_part(observable, found.sd)
    spread = observable.sds(fit.point.values, fit.point.rebound)
    return measured_part(observable, np.broadcast_to(spread, (1, observable.observed.size))[0])


def measured_outputs(fit: Fit) -> Mapping[str, Measured]:
    """Outputs as measured; speed and angle follow from components, with their noise, where they were not."""
    raw = {
        item.name: Measured(measured_rows(item), measured_part(item, item.observed), noise_sd(fit, item))
        for item in fit.problem.observables
    }
    if {"v_x2", "v_y2"} <= raw.keys():
        raw = {**_from_components(raw["v_x2"], raw["v_y2"]), **raw}
    scaled = {}
    for name in (name for name in OBSERVABLES if name in raw):
        item, factor = raw[name], output_scale(name).factor
        scaled[name] = Measured(item.rows, item.values * factor, item.sd * factor)
    return scaled


def _from_components(along: Measured, up: Measured) -> dict[str, Measured]:
    """Speed and angle, with the noise of the components along and across the flight."""
    rows, mine, other = np.intersect1d(along.rows, up.rows, return_indices=True)
    v_x, v_y, x_sd, y_sd = along.values[mine], up.values[other], along.sd[mine], up.sd[other]
    speed = np.hypot(v_x, v_y)
    return {
        "v_2": Measured(rows, speed, np.hypot(x_sd * v_x, y_sd * v_y) / speed),
        "theta_2": Measured(rows, np.arctan2(v_y, v_x), np.hypot(x_sd * v_y, y_sd * v_x) / speed**2),
    }


# Signs of a label, as a formula is written, from which on it is long.
LONG = 34


@dataclass(frozen=True)
class ParameterAxis:
    """`factor` turns SI into the unit of the `label`. Logarithmic is a matter of the parameter, not of the fit."""

    label: str
    factor: float
    logarithmic: bool

    def letters(self, most: float) -> float:
        """Size of the letters of the label: smaller where names of the user's make it long."""
        return most if len(self.label) <= LONG else 0.7 * most

    def margins(self, low: float, high: float, share: float = 0.05) -> tuple[float, float]:
        """A little more than from `low` to `high`, in the unit of the axis."""
        if self.logarithmic:
            room = (high / low) ** share
            return low / room, high * room
        return low - share * (high - low), high + share * (high - low)

    def between(self, low: float, high: float, count: int) -> FloatArray:
        """`count` places from `low` to `high`, evenly spaced on the axis."""
        return np.geomspace(low, high, count) if self.logarithmic else np.linspace(low, high, count)

    def lengths(self, values: FloatArray) -> FloatArray:
        """Places on the axis, as lengths."""
        return np.log(values) if self.logarithmic else values

    def middles(self, edges: FloatArray) -> FloatArray:
        """The places halfway between neighbouring `edges`."""
        return np.sqrt(edges[1:] * edges[:-1]) if self.logarithmic else 0.5 * (edges[1:] + edges[:-1])


def parameter_axis(spec: ParameterSpec) -> ParameterAxis:
    """The axis on which every figure shows a parameter."""
    scale = handy(spec.name, spec.unit)
    return ParameterAxis(axis_label(spec.label, scale.unit), scale.factor, spec.logarithmic)


def parameter(fit: Fit, name: str) -> Parameter:
    """The parameter called `name`."""
    return next(item for item in fit.problem.parameters if item.name == name)


def drawn(fit: Fit) -> Posterior:
    """The draws of a fit. Raises ResultFolderError for a point fit."""
    if fit.posterior is None:
        raise ResultFolderError(f"this figure needs a posterior; run calibrate without {option('point_only')}")
    return fit.posterior
