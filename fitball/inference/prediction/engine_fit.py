"""The best a ball of restitution and friction alone can do: what game and robot engines would predict.

Their sphere is rigid: a normal impulse `M (1 + e) v_y1`, and friction that stops the slip or slides at `mu`. That is
Brody's ball with constant restitution, and it is solved as that.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import RegularGridInterpolator
from scipy.optimize import minimize_scalar

from fitball.data.lines import Axis, grid_impacts
from fitball.data.units import DEFAULT_UNIT, Dimension
from fitball.errors import ParameterError
from fitball.inference.prediction.outputs import difference
from fitball.inference.prediction.reach import ValidRange, total_rebound, valid_range
from fitball.inference.prediction.simulate import refuse_told
from fitball.inference.results.fitted_model import FittedModel
from fitball.models.registry import model
from fitball.models.types import OUTPUTS, STATUS_REASON, Rebound, Status
from fitball.observables import COMPARED, OBSERVABLES
from fitball.values import Ball, FloatArray, Impacts

# Mixtures of three calibrated impacts each, on which errors across the range are averaged, and their seed.
RANGE_POINTS, RANGE_SEED = 500, 1
# Frictions tried before the best of them is refined; the error has kinks where impacts begin to grip.
MU_GRID = np.linspace(0.0, 2.0, 201)


@dataclass(frozen=True)
class EngineSettings:
    """Restitution `e` and friction `mu` (None for a drop test), and what they lose, by output (SI, angles in rad).

    `mu_from` is not None where the engine's ball grips at the operating point: any friction from there on predicts
    the same there. `errors` are engine minus fitted ball at the operating point, `rms` over the calibrated range.
    """

    e: float
    mu: float | None
    mu_from: float | None
    errors: Mapping[str, float]
    rms: Mapping[str, float]


@dataclass(frozen=True)
class EngineFit:
    """Settings best `at_point` and best `over_range`; rebounds of the operating point by output.

    `extrapolated`: the operating point lies outside of the range `valid`; its rebound is that of the total bounce.
    `unsolved` mixtures of the calibrated impacts have no rebound and are left out of the range.
    """

    point: Impacts
    inertia_ratio: float
    fitted: Mapping[str, float]
    engine: Mapping[str, float]
    contact_time: float | None
    at_point: EngineSettings
    over_range: EngineSettings
    valid: ValidRange
    extrapolated: bool
    unsolved: int


def middle_impact(fitted: FittedModel) -> Impacts:
    """The middle of the calibrated range, between the smallest and the largest of each component."""
    columns = (fitted.impacts.v_x1, fitted.impacts.v_y1, fitted.impacts.omega_1)
    return Impacts(*(np.array([0.5 * (column.min() + column.max())]) for column in columns))


def calibrated_mixtures(fitted: FittedModel, count: int, seed: int) -> Impacts:
    """Impacts spread over the convex hull of the calibrated ones: those themselves, and mixtures of three."""
    rng = np.random.default_rng(seed)
    known = np.stack([fitted.impacts.v_x1, fitted.impacts.v_y1, fitted.impacts.omega_1], axis=1)
    chosen = known[rng.integers(len(known), size=(count, 3))]
    mixed = np.einsum("ij,ijk->ik", rng.dirichlet(np.ones(3), size=count), chosen)
    return Impacts(*np.concatenate([known, mixed]).T)


def fit_engine(fitted: FittedModel, point: Impacts, inertia_ratio: float) -> EngineFit:
    """Restitution and friction of a sphere with `I = inertia_ratio M R^2` that come nearest to a fitted ball.

    Nearest: least kinetic energy of the difference, `dv_x^2 + dv_y^2 + I/M domega^2` with the fitted ball's own `I`.
    `point` is one impact. Raises ParameterError when it cannot be evaluated or `inertia_ratio` is impossible,
    ModelError for a model that takes each impact's restitution as an input.
    """
    if not 0.0 < inertia_ratio <= 1.0:
        raise ParameterError(f"inertia of the engine's sphere {inertia_ratio:g} M R^2: expected above 0, at most 1")
    refuse_told(fitted)
    valid = valid_range(fitted)
    there, extrapolated = total_rebound(fitted, valid, point)
    status = Status(int(there.status[0, 0]))
    if status is not Status.OK:
        raise ParameterError(f"the model cannot be evaluated at the operating point: {STATUS_REASON[status]}")
    spread = calibrated_mixtures(fitted, RANGE_POINTS, RANGE_SEED)
    everywhere = fitted.rebound(spread)
    solved = np.flatnonzero(everywhere.status[0] == Status.OK)
    if solved.size == 0:
        raise ParameterError("the model cannot be evaluated in its calibrated range, at the point estimate")
    sphere = _Sphere(fitted, inertia_ratio)
    near = _Target(point, there)
    far = _Target(spread.take(solved), everywhere.take(solved))
    e_near = float(near.truth["v_y2"][0] / point.v_y1[0])
    e_far = float(np.sum(far.truth["v_y2"] * far.impacts.v_y1) / np.sum(far.impacts.v_y1**2))
    mu_near = grips = mu_far = None
    if fitted.tangential:
        mu_near, grips = _best_at_point(sphere, e_near, near, far)
        mu_far = _best_friction(sphere, e_far, far, 0.0)
    at_point = _settings(sphere, e_near, mu_near, grips, near, far)
    time = float(there.contact_time[0, 0])
    engine = sphere.outputs(e_near, mu_near or 0.0, point)
    return EngineFit(
        point=point,
        inertia_ratio=inertia_ratio,
        fitted={name: float(near.truth[name][0]) for name in COMPARED},
        engine={name: float(engine[name][0]) for name in COMPARED},
        contact_time=None if np.isnan(time) else time,
        at_point=at_point,
        over_range=_settings(sphere, e_far, mu_far, None, near, far),
        valid=valid,
        extrapolated=bool(extrapolated[0]),
        unsolved=len(spread) - solved.size,
    )


def _outputs(rebound: Rebound) -> dict[str, FloatArray]:
    return {name: OBSERVABLES[name].predict(rebound)[0] for name in COMPARED}


class _Target:
    """Impacts and what the fitted ball makes of them."""

    def __init__(self, impacts: Impacts, rebound: Rebound) -> None:
        self.impacts, self.truth = impacts, _outputs(rebound)


class _Sphere:
    """The engine's ball."""

    def __init__(self, fitted: FittedModel, inertia_ratio: float) -> None:
        ball = fitted.ball
        made = Ball(ball.mass, ball.radius, inertia_ratio * ball.mass * ball.radius**2)
        self.model = model("brody", ball=made)
        self.radius, self.ratio = ball.radius, inertia_ratio
        self.spin_weight = ball.inertia / ball.mass

    def outputs(self, e: float, mu: float, impacts: Impacts) -> dict[str, FloatArray]:
        return _outputs(self.model.evaluate(("mu", "cor_10", "cor_slope"), np.array([[mu, e, 0.0]]), impacts))

    def cost(self, e: float, mu: float, target: _Target) -> float:
        outputs, truth = self.outputs(e, mu, target.impacts), target.truth
        along, spin = (outputs[name] - truth[name] for name in ("v_x2", "omega_2"))
        return float(np.mean(along**2 + self.spin_weight * spin**2))

    def grip_friction(self, e: float, impacts: Impacts) -> float:
        """Friction from which the slip of the first impact stops."""
        slip = abs(float(impacts.v_x1[0] - self.radius * impacts.omega_1[0]))
        return slip / ((1.0 + 1.0 / self.ratio) * (1.0 + e) * float(impacts.v_y1[0]))


def _best_at_point(sphere: _Sphere, e: float, near: _Target, far: _Target) -> tuple[float, float | None]:
    """Friction best at the operating point, and from where on it makes no difference there, if it grips."""
    limit = sphere.grip_friction(e, near.impacts)
    minimum = minimize_scalar(lambda mu: sphere.cost(e, mu, near), bounds=(0.0, max(limit, 1e-9)), method="bounded")
    # Within the sliding range the error is a parabola in mu: at its upper end the ball grips.
    if sphere.cost(e, limit, near) <= float(minimum.fun):
        return _best_friction(sphere, e, far, limit), limit
    return float(minimum.x), None


def _best_friction(sphere: _Sphere, e: float, target: _Target, least: float) -> float:
    """Friction of least error over `target`, not below `least`."""
    grid = np.append(least, MU_GRID[least < MU_GRID])
    costs = [sphere.cost(e, float(mu), target) for mu in grid]
    best = int(np.argmin(costs))
    low, high = float(grid[max(best - 1, 0)]), float(grid[min(best + 1, grid.size - 1)])
    if high <= low:
        return low
    minimum = minimize_scalar(lambda mu: sphere.cost(e, mu, target), bounds=(low, high), method="bounded")
    return float(minimum.x) if minimum.fun < costs[best] else float(grid[best])


def _settings(
    sphere: _Sphere, e: float, mu: float | None, grips: float | None, near: _Target, far: _Target
) -> EngineSettings:
    here, there = (sphere.outputs(e, mu or 0.0, target.impacts) for target in (near, far))
    return EngineSettings(
        e=e,
        mu=mu,
        mu_from=grips,
        errors={name: float(difference(name, here[name], near.truth[name])[0]) for name in COMPARED},
        rms={name: float(np.sqrt(np.mean(difference(name, there[name], far.truth[name]) ** 2))) for name in COMPARED},
    )


# Rebounds on a grid of impacts, and how wrong multilinear interpolation between its points is.

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

    `extrapolated` (points,) marks points outside of the range `valid`, where restitution and offset keep their values
    at its nearer end. `checked` impacts were interpolated; `failed` counts grid points that could not be evaluated,
    by reason.
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
            "v_1": given.speed,
            "theta_1": given.angle,
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

    Outside of the valid range it is filled with the total bounce. Raises ModelError for a model that takes each
    impact's restitution as an input, ParameterError when no grid point can be evaluated or a drop test is asked for
    tangential motion.
    """
    refuse_told(fitted)
    if not fitted.tangential and len(axes) > 1:
        raise ParameterError("this fit is of drop tests, with vertical motion only: give v_y alone")
    grid = np.stack(np.meshgrid(*(axis.values for axis in axes), indexing="ij"), axis=-1)
    points = grid.reshape(-1, len(axes))
    valid = valid_range(fitted)
    rebound, extrapolated = total_rebound(fitted, valid, grid_impacts(axes, points))
    failed = {
        STATUS_REASON[Status(int(status))]: int(np.sum(rebound.status[0] == status))
        for status in np.unique(rebound.status[0][rebound.status[0] != Status.OK])
    }
    if sum(failed.values()) == len(points):
        raise ParameterError("the model cannot be evaluated at any point of this grid, at the point estimate")
    known = (name for name in OUTPUTS if fitted.model.gives(OBSERVABLES[name]))
    names = [name for name in known if not OBSERVABLES[name].gap]
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
