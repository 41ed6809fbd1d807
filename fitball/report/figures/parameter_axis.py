"""The axis of a parameter: its symbol with the unit in which people read it, and whether it is logarithmic."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fitball.models.specs import ParameterSpec
from fitball.report.figures.measured import axis_label
from fitball.report.form.display_units import handy
from fitball.values import FloatArray


@dataclass(frozen=True)
class ParameterAxis:
    """`factor` turns SI into the unit of the `label`. Logarithmic is a matter of the parameter, not of the fit."""

    label: str
    factor: float
    logarithmic: bool

    def margins(self, low: float, high: float, share: float = 0.05) -> tuple[float, float]:
        """A little more than from `low` to `high`, in the unit of the axis."""
        if self.logarithmic:
            room = (high / low) ** share
            return low / room, high * room
        return low - share * (high - low), high + share * (high - low)

    def between(self, low: float, high: float, count: int) -> FloatArray:
        """`count` places from `low` to `high`, evenly spaced on the axis."""
        return np.geomspace(low, high, count) if self.logarithmic else np.linspace(low, high, count)


def parameter_axis(spec: ParameterSpec) -> ParameterAxis:
    """The axis on which every figure shows a parameter."""
    scale = handy(spec.name, spec.unit)
    return ParameterAxis(axis_label(spec.label, scale.unit), scale.factor, spec.logarithmic)
