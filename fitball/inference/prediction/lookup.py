"""Rebounds on a grid of impacts, and how wrong multilinear interpolation between its points is."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import RegularGridInterpolator

from fitball.data.lines import Axis, grid_impacts
from fitball.data.units import DEFAULT_UNIT, Dimension
from fitball.errors import ParameterError
from fitball.inference.prediction.engine_fit import refuse_told
from fitball.inference.prediction.valid_range import ValidRange, total_rebound, valid_range
from fitball.inference.results.fitted_model import FittedModel
from fitball.models.types import OUTPUTS, STATUS_REASON, Status
from fitball.observables import OBSERVABLES
from fitball.values import FloatArray

# Points of the axes of a grid that nobody chose.
DEFAULT_COUNTS = {"v_1": 13, "theta_1": 13, "v_y1": 33, "omega_1": 9}
# Cell midpoints checked at most (evenly thinned beyond), random points besides, and their seed.
MIDPOINTS, RANDOM_POINTS, SEED = 20_000, 5_000, 1


@dataclass(frozen=True)
class InterpolationError:
    """One output in SI: largest and root mean square error of interpolation, and where the largest is.

    `place` holds the axes' values there (SI).
    """

    largest: float
    rms: float
    place: Mapping[str, float]


@dataclass(frozen=True)
class Lookup:
    """A grid: `axes` vary in order, the last fastest; outputs (points,) are NaN where the model has no rebound.

    `extrapolated` (points,) says which points lie outside of the range `valid`, where restitution and offset stay
    what they are at its nearer end. `checked` impacts were interpolated; `failed` counts grid points that could not
    be evaluated, by reason.
    """

    axes: tuple[Axis, ...]
    points: FloatArray
    outputs: Mapping[str, FloatArray]
    regime: NDArray[np.int64]
    errors: Mapping[str, InterpolationError]
    checked: int
    failed: Mapping[str, int]
    valid: ValidRange
    extrapolated: NDArray[np.bool_]


def default_axes(fitted: FittedModel) -> tuple[Axis, ...]:
    """The calibrated range, from the smallest to the largest speed, angle and spin."""
    given = fitted.impacts
    units = {"v_1": Dimension.SPEED, "theta_1": Dimension.ANGLE, "v_y1": Dimension.SPEED, "omega_1": Dimension.SPIN}
    columns = {"v_y1": given.v_y1}
    if fitted.tangential:
        columns = {
            "v_1": np.hypot(given.v_x1, given.v_y1),
            "theta_1": np.arctan2(given.v_y1, given.v_x1),
            "omega_1": given.omega_1,
        }
    axes = []
    for name, column in columns.items():
        low, high = float(column.min()), float(column.max())
        values = np.linspace(low, high, DEFAULT_COUNTS[name]) if high > low else np.array([low])
        axes.append(Axis(name, values, DEFAULT_UNIT[units[name]]))
    return tuple(axes)


def make_lookup(fitted: FittedModel, axes: tuple[Axis, ...]) -> Lookup:
    """Fill the grid at the point estimate and measure its interpolation.

    Outside of the valid range it is filled with the total bounce. Raises ModelError for a model that is told each
    impact's restitution, ParameterError when no grid point can be evaluated or a drop test is asked for tangential
    motion.
    """
    refuse_told(fitted)
    if not fitted.tangential and len(axes) > 1:
        raise ParameterError("this fit is of drop tests and knows vertical motion only: give v_y alone")
    grid = np.stack(np.meshgrid(*(axis.values for axis in axes), indexing="ij"), axis=-1)
    points = grid.reshape(-1, len(axes))
    valid = valid_range(fitted)
    rebound, extrapolated = total_rebound(fitted, valid, grid_impacts(axes, points))
    failed = {
        STATUS_REASON[Status(int(status))]: int(np.sum(rebound.status[0] == status))
        for status in np.unique(rebound.status[0][rebound.status[0] != Status.OK])
    }
    if sum(failed.values()) == len(points):
        raise ParameterError("the model cannot evaluate any point of this grid at the point estimate")
    names = [name for name in OUTPUTS if fitted.model.has_time or not OBSERVABLES[name].timed]
    outputs = {name: np.asarray(getattr(rebound, name)[0]) for name in names}
    errors, checked = _errors(fitted, valid, axes, outputs)
    return Lookup(axes, points, outputs, rebound.regime[0], errors, checked, failed, valid, extrapolated)


def _probes(axes: tuple[Axis, ...]) -> FloatArray:
    """Midpoints of cells and random points, (points, axes)."""
    middles = [0.5 * (a.values[1:] + a.values[:-1]) if a.values.size > 1 else a.values for a in axes]
    centres = np.stack(np.meshgrid(*middles, indexing="ij"), axis=-1).reshape(-1, len(axes))
    step = -(-len(centres) // MIDPOINTS)
    rng = np.random.default_rng(SEED)
    low, high = (np.array([axis.values[k] for axis in axes]) for k in (0, -1))
    return np.concatenate([centres[::step], low + (high - low) * rng.uniform(size=(RANDOM_POINTS, len(axes)))])


def _errors(
    fitted: FittedModel,
    valid: ValidRange,
    axes: tuple[Axis, ...],
    outputs: Mapping[str, FloatArray],
) -> tuple[dict[str, InterpolationError], int]:
    probes = _probes(axes)
    truth, _extrapolated = total_rebound(fitted, valid, grid_impacts(axes, probes))
    # An axis of one point is no direction to interpolate along.
    wide = [k for k, axis in enumerate(axes) if axis.values.size > 1]
    shape = tuple(axes[k].values.size for k in wide)
    guesses = {}
    for name, column in outputs.items():
        if wide:
            interpolator = RegularGridInterpolator([axes[k].values for k in wide], column.reshape(shape))
            guesses[name] = interpolator(probes[:, wide])
        else:
            guesses[name] = np.full(len(probes), column[0])
    usable = np.flatnonzero(
        (truth.status[0] == Status.OK) & np.all([np.isfinite(guess) for guess in guesses.values()], axis=0)
    )
    if usable.size == 0:
        return {}, 0
    errors = {}
    for name, guess in guesses.items():
        difference = (guess - getattr(truth, name)[0])[usable]
        worst = int(usable[np.argmax(np.abs(difference))])
        errors[name] = InterpolationError(
            largest=float(np.max(np.abs(difference))),
            rms=float(np.sqrt(np.mean(difference**2))),
            place={axis.name: float(probes[worst, k]) for k, axis in enumerate(axes)},
        )
    return errors, int(usable.size)
