"""Parameters as figures show them: their draws, and an axis with symbol and unit, logarithmic or not."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fitball.errors import ResultFolderError
from fitball.inference.problem.parameters import Parameter
from fitball.inference.results.results import Fit, Posterior
from fitball.models.specs import ParameterSpec
from fitball.report.figures.measured import axis_label
from fitball.report.form.display_units import handy
from fitball.values import FloatArray
from fitball.wording import option

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
