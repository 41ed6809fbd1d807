"""The columns of a rebound: each with its name, units, noise and formula.

Names, units and noises of `data`, predictions and derivatives of `inference`, words and units of `report` all come
from `OBSERVABLES`. A model's own outputs (`models.types.OUTPUTS`) are predicted as they are; other columns are
functions of the rebound velocity, given with their gradients.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from fitball.values import FloatArray


@dataclass(frozen=True)
class ColumnNoise:
    """The noise parameter of a column: name, bounds and typical size (as a prior writes it) in the unit of
    the column. `source` is in words, the symbol in mathtext.
    """

    name: str
    lower: float
    upper: float
    typical: str
    source: str
    symbol: str


@dataclass(frozen=True)
class OfVelocity:
    """A function of the rebound velocity `(v_x2, v_y2)`, and its derivatives with respect to these."""

    value: Callable[[FloatArray, FloatArray], FloatArray]
    gradient: Callable[[FloatArray, FloatArray], tuple[FloatArray, FloatArray]]


@dataclass(frozen=True)
class ReboundColumn:
    """A column of a rebound.

    `unit` is SI, angles in radians; `handy` the unit of reports, with the factor from SI. `title` and `symbol`
    (mathtext) head figures. `positive` is the convention of a column that has no sign. `tangential` columns need
    motion along the court, `timed` ones a model with a time axis. Those with `restitution` are not predicted by a
    model that takes the measured one. `velocity`: a component, the speed or the angle, of which at most two count
    (`data.kinematics`) and which may share one noise. `gap`: of the flights before and after, over the contact.
    `function` is None for what a model gives itself.
    """

    name: str
    unit: str
    title: str
    symbol: str
    noise: ColumnNoise
    handy: tuple[str, float] | None = None
    positive: str = ""
    tangential: bool = False
    timed: bool = False
    restitution: bool = False
    velocity: bool = False
    gap: bool = False
    function: OfVelocity | None = None

    @property
    def angle(self) -> bool:
        """Whether differences go by the short way round; a turn counts whole ones."""
        return self.unit == "rad" and not self.gap

    @property
    def along(self) -> bool:
        """Whether motion along the court enters it: a drop test has no such column but its speed."""
        return self.tangential or self.function is not None

    def predict(self, rebound: Any) -> FloatArray:
        """The column of rebounds (`models.types.Rebound`, of which the velocity may do), of the shape of theirs."""
        if self.function is None:
            own: FloatArray = getattr(rebound, self.name)
            return own
        return self.function.value(rebound.v_x2, rebound.v_y2)

    def slopes(self, rebound: Any, slopes: Mapping[str, FloatArray]) -> FloatArray:
        """Its derivatives (..., inputs) from those of the model's outputs by name, (..., inputs) each."""
        if self.function is None:
            return slopes[self.name]
        along, up = self.function.gradient(rebound.v_x2, rebound.v_y2)
        return np.asarray(along[..., None] * slopes["v_x2"] + up[..., None] * slopes["v_y2"])


def _speed_gradient(v_x: FloatArray, v_y: FloatArray) -> tuple[FloatArray, FloatArray]:
    speed = np.hypot(v_x, v_y)
    return v_x / speed, v_y / speed


def _angle_gradient(v_x: FloatArray, v_y: FloatArray) -> tuple[FloatArray, FloatArray]:
    square = np.hypot(v_x, v_y) ** 2
    return -v_y / square, v_x / square


_ALL = (
    ReboundColumn(
        "v_x2", "m/s", "horizontal rebound velocity", r"$v_{x2}$",
        ColumnNoise("v_x_sd", 1e-4, 10.0, "0.25", "v_x2", r"$\sigma_{v_x}$"),
        tangential=True, velocity=True,
    ),
    ReboundColumn(
        "v_y2", "m/s", "vertical rebound velocity", r"$v_{y2}$",
        ColumnNoise("v_y_sd", 1e-4, 10.0, "0.25", "v_y2", r"$\sigma_{v_y}$"),
        positive="a positive speed away from the court", restitution=True, velocity=True,
    ),
    ReboundColumn(
        "v_2", "m/s", "rebound speed", r"$v_2$",
        ColumnNoise("speed_sd", 1e-4, 10.0, "0.25", "v_2", r"$\sigma_{|v|}$"),
        positive="a positive speed", restitution=True, velocity=True,
        function=OfVelocity(np.hypot, _speed_gradient),
    ),
    ReboundColumn(
        "theta_2", "rad", "rebound angle", r"$\theta_2$",
        ColumnNoise("angle_sd", 1e-5, 1.6, "0.025", "theta_2", r"$\sigma_\theta$"),
        handy=("deg", 180.0 / np.pi), tangential=True, velocity=True,
        function=OfVelocity(lambda v_x, v_y: np.arctan2(v_y, v_x), _angle_gradient),
    ),
    ReboundColumn(
        "omega_2", "rad/s", "rebound spin", r"$\omega_2$",
        ColumnNoise("spin_sd", 1e-2, 1e3, "10", "the spin", r"$\sigma_\omega$"),
        tangential=True,
    ),
    ReboundColumn(
        "contact_time", "s", "contact time", r"$t_c$",
        # The resolution of a film of 5,000 frames a second.
        ColumnNoise("contact_time_sd", 1e-6, 1e-2, "2e-4", "the contact time", r"$\sigma_t$"),
        handy=("ms", 1e3), positive="a positive time", timed=True,
    ),
    # By the gap that flights of 1 mm and 2 deg a frame leave, ten frames long.
    ReboundColumn(
        "gap_time", "s", "time between the flights", r"$T$",
        ColumnNoise("gap_time_sd", 1e-6, 1e-2, "1e-4", "gap_time", r"$\sigma_T$"),
        handy=("ms", 1e3), positive="a positive time", timed=True, gap=True,
    ),
    ReboundColumn(
        "gap_path", "m", "path between the flights", r"$P$",
        ColumnNoise("gap_path_sd", 1e-6, 0.2, "1e-3", "gap_path", r"$\sigma_P$"),
        handy=("mm", 1e3), tangential=True, timed=True, gap=True,
    ),
    ReboundColumn(
        "gap_turn", "rad", "turn between the flights", r"$Q$",
        ColumnNoise("gap_turn_sd", 1e-5, 6.0, "0.04", "gap_turn", r"$\sigma_Q$"),
        handy=("deg", 180.0 / np.pi), tangential=True, timed=True, gap=True,
    ),
)  # fmt: skip
# The noise of a velocity component, which all columns of the velocity may share.
SHARED_NOISE = ColumnNoise(
    "velocity_sd", 1e-4, 10.0, "0.25", "velocity, of each component, where they share one", r"$\sigma_v$"
)
SHARED_SD = SHARED_NOISE.name
OBSERVABLES: Mapping[str, ReboundColumn] = {item.name: item for item in _ALL}
# The noise parameter of each column, one standard deviation common to all rows that state none of their own.
NOISE_OF: Mapping[str, str] = {item.name: item.noise.name for item in _ALL}
# SI units of the incident state, and of every column that an impact may have.
INCIDENT_UNITS: Mapping[str, str] = {"v_x1": "m/s", "v_y1": "m/s", "omega_1": "rad/s"}
SI_UNITS: Mapping[str, str] = {**INCIDENT_UNITS, **{item.name: item.unit for item in _ALL}}
VELOCITIES = tuple(item.name for item in _ALL if item.velocity)
# The columns by which models without a time axis are compared, in this order.
COMPARED = ("v_x2", "v_y2", "omega_2", "theta_2")
