"""Weighted least squares: searched from many starts, settled by lmfit, each parameter with a standard error or the
reason why it has none.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from fitball.environment import heavy_later
from fitball.errors import FitError
from fitball.inference.likelihood.residuals import (
    Weighting,
    default_noise,
    differentiable,
    named_values,
    residual_slopes,
    residuals,
    root_mean_squares,
)
from fitball.inference.point.gauss_newton import SAME_OPTIMUM, Searches, apart, descend
from fitball.inference.point.surface import Surface
from fitball.inference.problem.parameters import NOISE_SPECS
from fitball.inference.problem.problem import Problem
from fitball.inference.problem.subsample import PART, whole_of_parts
from fitball.inference.results.results import LeastSquares
from fitball.models.model import LinearConstraint
from fitball.values import FloatArray

with heavy_later():
    import lmfit

# Share of a chi-square by which a minimum must be lower to be another one and not the same, settled differently.
DEEPER = 1e-6
# Gain of half a chi-square, for each measurement, below which searches leave the rest to lmfit.
PROMISED = 1e-10
# Minima that are told, and how far above the best (in half a chi-square) a search that creeps is worth its rounds.
KEPT, WORTH_TELLING = 5, 30.0
# Distance from a bound or a wall, in widths of the prior, at which a value lies on it.
ON_BOUND = 1e-6
# Share of its prior's median below which a positive parameter has vanished: nothing that is measured still depends on
# it, and left alone it would go on to where the value is exactly zero and has no logarithm.
VANISHED = 1e-12
# Cube root of the rounding error: the step, in widths of the priors, at which central differences lose as much to it
# as to curvature.
DIFFERENCE = 6e-6
# Change of all residuals together, in sds, over the width of a prior below which the table leaves a direction open;
# and the part in such a direction from which a parameter has no error.
OPEN, INVOLVED = 1e-2, 0.05


def least_squares(problem: Problem, starts: FloatArray) -> LeastSquares:
    """Weighted least squares from every start (starts, free); the best minimum, the others, and honest standard
    errors.

    Raises FitError when no start leads to parameters the model can evaluate.
    """
    measured = sum(observable.observed.size for observable in problem.observables)
    surface = Surface(problem, promised=PROMISED * measured, squares=True)
    x = surface.from_values(starts)
    given = surface.free(x)
    reached = descend(surface, Searches(x, np.full(len(x), -1), given), rivals=WORTH_TELLING)
    ranked = [k for k in np.argsort(reached.cost, kind="stable") if np.isfinite(reached.cost[k])]
    # What still creeps, above one that is lower, is no minimum.
    worthy = [k for place, k in enumerate(ranked) if place == 0 or reached.settled[k]]
    chosen = np.array(apart(reached.x / surface.width, worthy, SAME_OPTIMUM)[:KEPT], dtype=np.int64)
    if not chosen.size:
        raise FitError(f"model {problem.model.name}: least squares found no parameters the model can evaluate")
    optima = surface.values(reached.x[chosen], given.take(chosen))
    weighting = Weighting(default_noise(problem), penalised=False)
    others = [float(np.sum(residuals(problem, values[None, :], weighting) ** 2)) for values in optima[1:]]
    settling = Settling(problem, weighting, optima[0])
    optima[0], chi_square, evaluations, jacobian = settling.settled()
    covariance, missing = _covariance(settling, jacobian)
    errors = iter(np.sqrt(np.diagonal(covariance)).tolist())
    measured += problem.contact_time is not None
    if problem.force is not None:
        # The start of contact of each record is a residual, and fitted.
        measured += int(problem.force.mask.sum())
    return LeastSquares(
        values=named_values(problem, optima[0]),
        stderr={item.name: None if item.name in missing else next(errors) for item in problem.parameters},
        missing=missing,
        chi_square=chi_square,
        degrees_of_freedom=measured - len(settling.fitted),
        rms=root_mean_squares(problem, optima[0]),
        starts=len(starts),
        optima=tuple(named_values(problem, values) for values in optima),
        optima_chi_square=(chi_square, *others),
        evaluations=evaluations,
        covariance=covariance,
    )


@dataclass(frozen=True)
class Settling:
    """A problem at the free values `at` (free,) that a search has led to, as lmfit is given it: parameters in SI by
    name, the noise as it is weighted by. Held are those on a bound and those beside whose value the model ends; on a
    wall that moves with other parameters (`LinearConstraint.lower_bound_of`) one goes with it.
    """

    problem: Problem
    weighting: Weighting
    at: FloatArray

    @cached_property
    def fitted(self) -> list[int]:
        """Places of the parameters that are not noise among the free ones."""
        return [k for k, name in enumerate(self.problem.free_names) if name not in NOISE_SPECS]

    @cached_property
    def width(self) -> FloatArray:
        """Widths (free,) of the priors in SI."""
        return np.asarray(self.problem.prior.width * self.problem.prior.rates(self.at[None, :])[0])

    @cached_property
    def ends(self) -> tuple[FloatArray, FloatArray]:
        """Bounds (free,) in SI; of what may vanish the value at which it has."""
        low = [
            max(prior.lower, VANISHED * float(prior.quantile(np.array([0.5]))[0])) if prior.log else prior.lower
            for prior in self.problem.prior.priors
        ]
        return np.array(low), np.array([prior.upper for prior in self.problem.prior.priors])

    @cached_property
    def bounded(self) -> NDArray[np.bool_]:
        """Which free parameters lie on a bound, (free,)."""
        room = np.minimum(*(np.abs(self.at - end) for end in self.ends))
        return np.asarray(room < ON_BOUND * self.width)

    @cached_property
    def wall(self) -> LinearConstraint | None:
        """The wall that the values lie on, if there is one."""
        names = self.problem.free_names
        for wall in self.problem.linear_constraints:
            if wall.lower_bound_of in names:
                k = names.index(wall.lower_bound_of)
                named = {name: column[0] for name, column in self.problem.all_values(self.at[None, :]).items()}
                room = wall.bound - sum(factor * named[name] for name, factor in wall.coefficients.items())
                if room < ON_BOUND * self.width[k]:
                    return wall
        return None

    @cached_property
    def follows(self) -> FloatArray:
        """Derivatives (free, free) of all free values with respect to each: the identity but for the wall."""
        made = np.eye(self.problem.dimension)
        if self.wall is not None:
            place = self.problem.free_names.index(self.wall.lower_bound_of)
            made[place] = [self.wall.coefficients.get(name, 0.0) for name in self.problem.free_names]
            made[place, place] = 0.0
        return made

    @cached_property
    def ended(self) -> frozenset[int]:
        """Places of the fitted parameters beside whose value, a difference step away, the model ends."""
        # One at a time: of long tables each is large.
        return frozenset(
            k
            for k in self.fitted
            if any(self.problem.rebound(self._moved(k, sign)[None, :]).status.any() for sign in (1.0, -1.0))
        )

    def _moved(self, k: int, sign: float) -> FloatArray:
        """The values (free,) with one moved by a difference step within its bounds."""
        low, high = self.ends
        move = np.clip(self.at[k] + sign * DIFFERENCE * self.width[k], low[k], high[k]) - self.at[k]
        return np.asarray(self.at + move * self.follows[:, k])

    @cached_property
    def varied(self) -> list[int]:
        """Places of the free parameters that lmfit varies."""
        walled = None if self.wall is None else self.problem.free_names.index(self.wall.lower_bound_of)
        return [k for k in self.fitted if k != walled and not self.bounded[k] and k not in self.ended]

    @property
    def parameters(self) -> lmfit.Parameters:
        """All parameters at the values, by names that lmfit takes: mu_place[clay] is mu_place_clay_."""
        made, (low, high), names = lmfit.Parameters(), self.ends, self.problem.free_names
        for name, column in self.problem.all_values(self.at[None, :]).items():
            made.add(_plain(name), value=float(column[0]), vary=False)
        for k in self.varied:
            made[_plain(names[k])].set(vary=True, min=low[k], max=high[k])
        if self.wall is not None:
            # Of coefficient -1, so that the others and the bound are its value.
            others = [
                f"{factor!r} * {_plain(name)}"
                for name, factor in self.wall.coefficients.items()
                if name != self.wall.lower_bound_of
            ]
            bound = self.wall.margin - self.wall.bound
            made[_plain(self.wall.lower_bound_of)].set(expr=" + ".join([*others, repr(bound)]))
        return made

    def _values(self, parameters: lmfit.Parameters) -> FloatArray:
        return np.array([[parameters[_plain(name)].value for name in self.problem.free_names]])

    def _slopes(self, values: FloatArray, part: Problem) -> FloatArray:
        """Exact derivatives (residuals, varied) in SI at free values (1, free)."""
        rows = residual_slopes(part, part.to_coordinates(values), self.weighting)[0] / part.prior.rates(values)
        return np.asarray(rows @ self.follows[:, self.varied])

    def _differences(self, values: FloatArray) -> FloatArray:
        """The same by central differences, all in one batch."""
        here = replace(self, at=values[0])
        ends = np.array([[here._moved(k, sign) for k in self.varied] for sign in (1.0, -1.0)])
        up, down = np.split(residuals(self.problem, np.concatenate(ends), self.weighting), 2)
        moves = np.diagonal((ends[0] - ends[1])[:, self.varied])
        return np.asarray((up - down).T / moves)

    def settled(self) -> tuple[FloatArray, float, int, FloatArray]:
        """Free values (free,), chi-square, evaluations and derivatives (residuals, varied) where lmfit's least
        squares end, reflected at the bounds (scipy's trf): the best fit often lies on one.

        Of a table too long for its derivatives to be kept lmfit is given what is left of them: the triangle
        (varied + 1, varied + 1) of residuals and derivatives, by which any combination of them is as long as by all
        rows (Golub 1965). So near to its minimum the problem is straight.
        """
        begun, exact = self.at[None, :], differentiable(self.problem)
        start = self.at[self.varied]
        if not self.varied:
            rows = residuals(self.problem, begun, self.weighting)[0]
            return self.at, float(rows @ rows), 1, np.zeros((rows.size, 0))
        straight: FloatArray | None = None
        if exact and len(self.problem.impacts) > PART:

            def both(part: Problem) -> FloatArray:
                rows = residuals(part, begun, self.weighting).T
                return np.concatenate([self._slopes(begun, part), rows], axis=1)

            straight = np.asarray(np.linalg.qr(whole_of_parts(self.problem, both), mode="r"))

        def residual(parameters: lmfit.Parameters) -> FloatArray:
            values = self._values(parameters)
            if straight is None:
                return np.asarray(residuals(self.problem, values, self.weighting)[0])
            return np.asarray(straight[:, :-1] @ (values[0, self.varied] - start) + straight[:, -1])

        def jacobian(parameters: lmfit.Parameters) -> FloatArray:
            if straight is not None:
                return straight[:, :-1]
            values = self._values(parameters)
            return self._slopes(values, self.problem) if exact else self._differences(values)

        # The covariance that lmfit derives on the way has no root where a direction is flat.
        with np.errstate(invalid="ignore", divide="ignore"):
            found = lmfit.Minimizer(residual, self.parameters, scale_covar=False).least_squares(
                Dfun=jacobian, x_scale=self.width[self.varied], ftol=1e-9, xtol=1e-7, gtol=None, max_nfev=100
            )
        return self._values(found.params)[0], float(found.chisqr), int(found.nfev), np.asarray(found.jac)


def _plain(name: str) -> str:
    """A name as lmfit takes it: a Python identifier."""
    return re.sub(r"\W", lambda found: "_" if found[0].isascii() else f"_{ord(found[0])}_", name)


def deeper(problem: Problem, known: LeastSquares, starts: Sequence[Mapping[str, float]]) -> LeastSquares:
    """The known minimum, or a deeper one if a search from `starts` (all parameters by name) finds it."""
    values = problem.free_rows(starts)
    try:
        tried = least_squares(problem, values)
    except FitError:
        return known
    if not tried.chi_square < (1.0 - DEEPER) * known.chi_square:
        return known
    # Minima that are known are searched again only here, where it shows which of them are told beside the deeper one.
    again = least_squares(problem, np.concatenate([values, problem.free_rows(known.optima)]))
    return replace(again, starts=known.starts, evaluations=known.evaluations + tried.evaluations + again.evaluations)


def _covariance(fit: Settling, jacobian: FloatArray) -> tuple[FloatArray, dict[str, str]]:
    """Covariance in SI, at the stated noise, of the parameters that have a standard error, and why the others have
    none.
    """
    names = fit.problem.free_names
    missing: dict[str, str] = {}
    for parameter in fit.problem.parameters:
        if not parameter.free:
            missing[parameter.name] = f"held at its value: {parameter.fixed_because}"
        elif parameter.name in NOISE_SPECS:
            missing[parameter.name] = "least squares assumes the noise; the posterior estimates it"
    if fit.wall is not None:
        words = fit.wall.words.replace(">=", "=")
        missing[fit.wall.lower_bound_of] = (
            f"the best value lies on the limit {words}, where no symmetric error exists"
        )
    for k in fit.fitted:
        if fit.bounded[k]:
            missing.setdefault(names[k], "the best value lies on a bound, where no symmetric error exists")
        elif k in fit.ended:
            missing.setdefault(names[k], "the model ends next to the best value, where no symmetric error exists")
    if len(jacobian) < len(fit.varied):
        for k in fit.varied:
            missing[names[k]] = f"{len(jacobian)} measurements cannot determine {len(fit.varied)} parameters"
    if all(names[k] in missing for k in fit.varied):
        return np.zeros((0, 0)), missing
    width = fit.width[fit.varied]
    _u, singular, directions = np.linalg.svd(jacobian * width, full_matrices=False)
    known = singular >= max(OPEN, 1e-10 * singular[0])
    left_open = directions[~known]
    for position, k in enumerate(fit.varied):
        if np.max(np.abs(left_open[:, position]), initial=0.0) > INVOLVED:
            ranked = [names[fit.varied[j]] for j in np.argsort(-np.abs(left_open[0])) if j != position]
            missing[names[k]] = f"the residuals do not determine it separately from {', '.join(ranked[:2])}"
    told = [position for position, k in enumerate(fit.varied) if names[k] not in missing]
    roots = (directions[known] / singular[known, None] * width)[:, told]
    return np.asarray(roots.T @ roots), missing
