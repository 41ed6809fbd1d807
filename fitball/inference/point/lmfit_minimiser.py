"""One weighting of one problem as lmfit sees it; the only file that imports lmfit.

Coordinates are those of the priors. Jacobians are exact (`residual_slopes`), but for errors of the incident state and
force records, whose residuals have no exact derivative: there they are differences, all columns in one batch.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from fitball.environment import heavy_later
from fitball.inference.likelihood.residuals import IMPOSSIBLE, Weighting, differentiable, residual_slopes, residuals
from fitball.inference.problem.parameters import NOISE_SPECS
from fitball.inference.problem.problem import Problem
from fitball.inference.problem.subsample import PART, whole_of_parts
from fitball.models.model import HAIR
from fitball.values import FloatArray

# Times that a problem is straightened, and the length of a step, in sds, that ends it.
STRAIGHTENED, NEAR = 12, 0.01


@dataclass(frozen=True)
class Minimum:
    """A minimum: its chi-square, the fitted coordinates, (fitted,), and how many `residuals` there are."""

    chi_square: float
    at: FloatArray
    residuals: int

    @property
    def possible(self) -> bool:
        """Whether the model can evaluate it."""
        return self.chi_square < self.residuals * IMPOSSIBLE**2


def triangle(problem: Problem, of: Callable[[Problem], FloatArray]) -> FloatArray:
    """The triangle (columns, columns) of a matrix (rows, columns) that is the whole of those `of` parts: any
    combination of columns is as long by it as by all rows (Golub 1965).
    """
    whole = whole_of_parts(problem, of)
    made = np.zeros((whole.shape[1], whole.shape[1]))
    made[: len(whole)] = np.linalg.qr(whole, mode="r")
    return made


def straight_minimum(
    linear: Callable[[FloatArray], FloatArray], start: FloatArray, low: FloatArray, high: FloatArray
) -> tuple[float, FloatArray]:
    """Chi-square and place (fitted,) where steps from `start` (fitted,) end, each to the minimum between `low` and
    `high` of the straight problem there: `linear` gives the triangle of its derivatives and residuals.
    """
    # It is for long tables alone.
    from scipy.optimize import lsq_linear

    cost, at = math.inf, start
    following = start
    for _ in range(STRAIGHTENED):
        made = linear(following)
        here = float(made[:, -1] @ made[:, -1])
        if here >= cost:
            break
        cost, at = here, following
        step = lsq_linear(made[:, :-1], -made[:, -1], (low - at, high - at), tol=1e-14).x
        if np.linalg.norm(made[:, :-1] @ step) < NEAR:
            break
        following = np.clip(at + step, low, high)
    return cost, at


with heavy_later():
    import lmfit

# Share of its prior's median below which a positive parameter has vanished: nothing that is measured still depends on
# it, and left alone its logarithm would go on to where the value is exactly zero and has no logarithm.
VANISHED = 1e-12
# Two optima whose standardised parameters differ by less than this are one.
SAME_OPTIMUM = 1e-2
# Cube root of the rounding error: the step at which central differences lose as much to it as to curvature.
DIFFERENCE = 6e-6
# Rows above which Jacobians are one-sided, half the cost: their error of some 1e-6 only delays the last step, which
# then is not worth its cost either (`ftol`: a chi-square of 3e5 settles to 3e-3).
ONE_SIDED = 1000


class Minimiser:
    """One weighting of one problem in lmfit's terms, over the free parameters that are not noise.

    A model may demand that one parameter exceeds what others say (`LinearConstraint.lower_bound_of`): a wall that
    moves with them and on which the best fit often lies. That parameter is fitted as the fraction of the way from the
    wall to its upper bound, so that the wall is a bound lmfit knows.
    """

    def __init__(self, problem: Problem, weighting: Weighting) -> None:
        self.problem = problem
        self.weighting = weighting
        self.columns = [k for k, parameter in enumerate(problem.free) if parameter.name not in NOISE_SPECS]
        self.walls = [wall for wall in problem.linear_constraints if wall.lower_bound_of in problem.free_names]
        self.walled: int | None = None
        if self.walls:
            self.walled = problem.free_names.index(self.walls[0].lower_bound_of)
            parameter = problem.free[self.walled]
            # The parameter lies between the wall, or this if it is higher, and this.
            self.lowest, self.highest = parameter.spec.lower, parameter.spec.upper
        self.evaluations = 0
        # Of the derivatives of a long table only the triangle is kept.
        self.long = len(problem.impacts) > PART and differentiable(problem)

    def wall(self, values: FloatArray) -> FloatArray:
        """Lowest possible value (draws,) of the walled parameter, given the others in `values` (draws, free)."""
        # A hair above the wall, so that rounding does not put a point beyond it.
        wall: FloatArray = np.maximum(np.max(self._lines(values), axis=0) * (1.0 + HAIR), self.lowest)
        return wall

    def _lines(self, values: FloatArray) -> FloatArray:
        """What each constraint of the walled parameter asks of it, (walls, draws)."""
        columns = self.problem.all_values(values)
        lines = [
            sum(
                (factor * columns[name] for name, factor in wall.coefficients.items() if name != wall.lower_bound_of),
                np.full(values.shape[0], -wall.bound),
            )
            for wall in self.walls
        ]
        return np.array(lines)

    @property
    def wall_words(self) -> str:
        """What holds on the wall."""
        return self.walls[0].words.replace(">=", "=")

    def to_fitted(self, values: FloatArray) -> FloatArray:
        """Coordinates (draws, fitted) of free values (draws, free)."""
        coordinates = self.problem.to_coordinates(values)
        if self.walled is not None:
            wall = self.wall(values)
            room = np.maximum(self.highest - wall, 1e-6)
            coordinates[:, self.walled] = (values[:, self.walled] - wall) / room
        return coordinates[:, self.columns]

    def values(self, coordinates: FloatArray) -> FloatArray:
        """Free values (draws, free) for coordinates (draws, fitted) of the parameters fitted here."""
        full = np.empty((coordinates.shape[0], self.problem.dimension))
        full[:, self.columns] = coordinates
        for k, parameter in enumerate(self.problem.free):
            if k not in self.columns:
                full[:, k] = parameter.prior.coordinate(np.array([self.weighting.noise[parameter.name]]))
        values = self.problem.to_values(full)
        if self.walled is not None:
            wall = self.wall(values)
            values[:, self.walled] = wall + (self.highest - wall) * full[:, self.walled]
        return values

    def at(self, coordinates: FloatArray) -> FloatArray:
        """Residuals (draws, residuals)."""
        self.evaluations += coordinates.shape[0]
        return residuals(self.problem, self.values(coordinates), self.weighting)

    @property
    def names(self) -> list[str]:
        """Names of the fitted parameters."""
        return [self.problem.free_names[k] for k in self.columns]

    def parameters(self, start: FloatArray, low: FloatArray | None = None) -> lmfit.Parameters:
        """Lmfit's parameters at a start (fitted,) in coordinates; `low` replaces the lower limits."""
        made = lmfit.Parameters()
        least, most = self.limits()
        least = least if low is None else low
        for k, value, lowest, highest in zip(self.columns, start, least, most, strict=True):
            # Lmfit takes Python identifiers only; names such as mu_place[clay] are none.
            made.add(f"x{k}", value=float(value), min=lowest, max=highest)
        return made

    def residual(self, parameters: lmfit.Parameters) -> FloatArray:
        """What lmfit minimises."""
        row: FloatArray = self.at(np.array([[parameter.value for parameter in parameters.values()]]))[0]
        return row

    def jacobian(self, parameters: lmfit.Parameters) -> FloatArray:
        """Derivatives (residuals, fitted): exact; where there are none, differences, central but one-sided at a bound
        and on tables of many rows.
        """
        x = np.array([parameter.value for parameter in parameters.values()])
        if self.long:
            return self.linear(x)[:-1, :-1]
        if differentiable(self.problem):
            self.evaluations += 1
            coordinates, chain = self._with_chain(x)
            return np.asarray(residual_slopes(self.problem, coordinates, self.weighting)[0] @ chain)
        low = np.array([parameter.min for parameter in parameters.values()])
        high = np.array([parameter.max for parameter in parameters.values()])
        step = DIFFERENCE * np.maximum(np.abs(x), self.scale())
        up, down = np.minimum(x + step, high), np.maximum(x - step, low)
        if len(self.problem.impacts) > ONE_SIDED:
            up, down = np.where(up > x, up, down), x
            residuals = self.at(np.concatenate([x + np.diag(up - x), x[None, :]]))
            return np.asarray((residuals[:-1] - residuals[-1]) / (up - down)[:, None]).T
        batch = np.concatenate([x + np.diag(up - x), x - np.diag(x - down)])
        residuals = self.at(batch)
        slopes: FloatArray = (residuals[: x.size] - residuals[x.size :]) / (up - down)[:, None]
        return slopes.T

    def _with_chain(self, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Coordinates (1, free) of a point (fitted,), and their derivatives (free, fitted) with respect to it."""
        values = self.values(x[None, :])
        coordinates = self.problem.to_coordinates(values)
        chain = np.zeros((self.problem.dimension, x.size))
        chain[self.columns, np.arange(x.size)] = 1.0
        if self.walled is None:
            return coordinates, chain
        place = self.columns.index(self.walled)
        # The walled value is wall + (highest - wall) x; values are differentiated as coordinates are, by `rate`.
        rate = np.array(
            [values[0, k] if parameter.prior.log else 1.0 for k, parameter in enumerate(self.problem.free)]
        )
        chain[self.walled] = self._wall_slopes(values)[self.columns] * rate[self.columns] * (1.0 - x[place])
        chain[self.walled, place] = self.highest - self.wall(values)[0]
        chain[self.walled] /= rate[self.walled]
        return coordinates, chain

    def _wall_slopes(self, values: FloatArray) -> FloatArray:
        """Derivatives (free,) of the wall with respect to free values (1, free)."""
        lines = self._lines(values)[:, 0]
        active = self.walls[int(np.argmax(lines))]
        slopes = np.zeros(self.problem.dimension)
        if np.max(lines) * (1.0 + HAIR) > self.lowest:
            for k, name in enumerate(self.problem.free_names):
                slopes[k] = active.coefficients.get(name, 0.0) * (1.0 + HAIR)
        return slopes

    def beside_the_end(self, x: FloatArray) -> list[bool]:
        """Whether the model ends a difference step away from a point (fitted,), by fitted parameter."""
        steps = np.diag(DIFFERENCE * np.maximum(np.abs(x), self.scale()))
        low, high = self.limits()
        around = np.clip(np.concatenate([x + steps, x - steps]), low, high)
        # One at a time: of long tables each is large.
        ended = np.array([np.all(self.at(place[None, :]) == IMPOSSIBLE) for place in around])
        return [bool(above | below) for above, below in ended.reshape(2, -1).T]

    def limits(self) -> tuple[FloatArray, FloatArray]:
        """Bounds of the fitted coordinates, (fitted,) each."""
        ends = [self.problem.free[k].prior.ends for k in self.columns]
        low, high = np.array(
            [(0.0, 1.0) if k == self.walled else end for k, end in zip(self.columns, ends, strict=True)]
        ).T
        return low, high

    def scale(self) -> FloatArray:
        """A typical size of each coordinate, so that a value of zero has a step too."""
        scale = self.problem.prior.width[self.columns]
        if self.walled is not None:
            scale[self.columns.index(self.walled)] = 1.0
        return scale

    def floor(self) -> FloatArray:
        """Coordinates (fitted,) below which a positive parameter has vanished; -inf where there is no such place."""
        floors = []
        for k in self.columns:
            prior = self.problem.free[k].prior
            median = float(prior.quantile(np.array([0.5]))[0])
            open_below = prior.log and prior.lower <= 0.0 and k != self.walled
            floors.append(np.log(VANISHED * median) if open_below else -np.inf)
        return np.array(floors)

    def run(self, start: FloatArray) -> Minimum:
        """Gauss-Newton steps in a trust region from `start` (fitted,).

        A search that makes a parameter vanish ends at `floor`. The region is reflected at the bounds (scipy's trf):
        the best fit often lies on one, where the sine with which lmfit otherwise hides bounds has no slope and steps
        go astray.
        """
        low = self.limits()[0]
        run = self._run_straight if self.long else self._run
        minimum = run(start, low)
        floor = self.floor()
        if np.all(minimum.at >= floor):
            return minimum
        return run(np.maximum(minimum.at, floor), np.maximum(low, floor))

    def linear(self, x: FloatArray) -> FloatArray:
        """The triangle (fitted + 1, fitted + 1) of derivatives and residuals at a point (fitted,)."""
        self.evaluations += 1
        coordinates, chain = self._with_chain(x)
        values = self.values(x[None, :])

        def both(part: Problem) -> FloatArray:
            slopes = residual_slopes(part, coordinates, self.weighting)[0] @ chain
            return np.concatenate([slopes, residuals(part, values, self.weighting).T], axis=1)

        return triangle(self.problem, both)

    def _run_straight(self, start: FloatArray, low: FloatArray) -> Minimum:
        cost, at = straight_minimum(self.linear, start, low, self.limits()[1])
        return Minimum(cost, at, sum(item.observed.size for item in self.problem.observables))

    def _run(self, start: FloatArray, low: FloatArray) -> Minimum:
        many = len(self.problem.impacts) > ONE_SIDED
        # The covariance that lmfit derives on the way is not used, and has no root where a direction is flat.
        with np.errstate(invalid="ignore", divide="ignore"):
            result = lmfit.Minimizer(self.residual, self.parameters(start, low)).least_squares(
                method="trf",
                Dfun=self.jacobian,
                x_scale=self.scale(),
                ftol=1e-8 if many else 1e-9,
                xtol=1e-7,
                gtol=None,
                max_nfev=100,
            )
        at = np.array([parameter.value for parameter in result.params.values()])
        count = int(result.ndata)
        # Where no neighbour of the start can be evaluated a search leads nowhere.
        return Minimum(float(result.chisqr), at, count) if np.all(np.isfinite(at)) else Minimum(np.inf, start, count)


def minima(problem: Problem, weighting: Weighting, starts: FloatArray) -> tuple[list[Minimum], int]:
    """Minima reached from each start (starts, free), best first, equal ones once; and the evaluations spent."""
    minimiser = Minimiser(problem, weighting)
    low, high = minimiser.limits()
    fitted = np.minimum(np.maximum(minimiser.to_fitted(starts), low), high)
    reached = sorted((minimiser.run(start) for start in fitted), key=lambda minimum: minimum.chi_square)
    distinct: list[Minimum] = []
    for minimum in reached:
        apart = [np.max(np.abs(minimum.at - other.at) / minimiser.scale()) > SAME_OPTIMUM for other in distinct]
        if all(apart) and minimum.possible:
            distinct.append(minimum)
    return distinct, minimiser.evaluations


def simplex(cost: Callable[[FloatArray], float], dimension: int, size: float, tolerance: float) -> FloatArray:
    """Nelder and Mead's simplex from the origin: the lowest point found, (dimension,)."""
    parameters = lmfit.Parameters()
    for k in range(dimension):
        parameters.add(f"x{k}", value=0.0)
    corners = np.vstack([np.zeros(dimension), size * np.eye(dimension)])
    result = lmfit.Minimizer(
        lambda given: cost(np.array([parameter.value for parameter in given.values()])), parameters
    ).scalar_minimize(
        method="Nelder-Mead",
        options={
            "initial_simplex": corners,
            "adaptive": True,
            "maxfev": 1200,
            "xatol": 1.0,
            "fatol": tolerance,
        },
    )
    return np.array([parameter.value for parameter in result.params.values()])
