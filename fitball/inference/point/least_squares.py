"""Weighted least squares from many starts, with a standard error for each parameter or the reason why not."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from fitball.errors import FitError
from fitball.inference.likelihood.residuals import (
    Weighting,
    default_noise,
    named_values,
    root_mean_squares,
)
from fitball.inference.point.gauss_newton import Searches, descend
from fitball.inference.point.lmfit_minimiser import SAME_OPTIMUM, Minimiser, minima
from fitball.inference.point.surface import SEARCHED, Surface
from fitball.inference.problem.parameters import NOISE_SPECS
from fitball.inference.problem.problem import Problem
from fitball.inference.results.results import LeastSquares
from fitball.values import FloatArray

# Share of a chi-square by which a minimum must be lower to be another one and not the same, settled differently.
DEEPER = 1e-6
# Gain of log likelihood below which searches leave the rest to the minimiser.
PROMISED = 1e-5
# Minima that are told, and how far above the best (in half a chi-square) a search that creeps is worth its rounds.
KEPT, WORTH_TELLING = 5, 30.0


def least_squares(problem: Problem, starts: FloatArray) -> LeastSquares:
    """Weighted least squares from every start; the best minimum, the others, and honest standard errors.

    Raises FitError when no start leads to parameters the model can evaluate.
    """
    weighting = Weighting(default_noise(problem), penalised=False)
    # With errors of the incident state spreads depend on all parameters: the surface of a likelihood is not that of
    # squares then. Of a long table few places are searched, which are near already.
    together = problem.incident is None and len(problem.impacts) <= SEARCHED
    begun = _descended(problem, starts, weighting.noise) if together else starts
    distinct, evaluations = minima(problem, weighting, begun)
    if not distinct:
        raise FitError(f"model {problem.model.name}: least squares found no parameters the model can evaluate")
    minimiser = Minimiser(problem, weighting)
    values = minimiser.values(distinct[0].at[None, :])[0]
    stderr, missing = _standard_errors(problem, minimiser, distinct[0].at)
    measured = sum(observable.observed.size for observable in problem.observables) + (
        problem.contact_time is not None
    )
    if problem.force is not None:
        # The start of contact of each record is a residual, and fitted.
        measured += int(problem.force.mask.sum())
    return LeastSquares(
        values=named_values(problem, values),
        stderr=stderr,
        missing=missing,
        chi_square=distinct[0].chi_square,
        degrees_of_freedom=measured - len(minimiser.columns),
        rms=root_mean_squares(problem, values),
        starts=len(starts),
        optima=tuple(named_values(problem, minimiser.values(minimum.at[None, :])[0]) for minimum in distinct[:KEPT]),
        optima_chi_square=tuple(minimum.chi_square for minimum in distinct[:KEPT]),
        evaluations=evaluations,
    )


def _descended(problem: Problem, starts: FloatArray, noise: Mapping[str, float]) -> FloatArray:
    """The lowest free values (found, free) that searches from `starts` (starts, free), advanced together at the given
    noise, lead to: from these the minimiser has only to settle.
    """
    surface = Surface(problem, promised=PROMISED)
    x = surface.from_values(starts)
    held = [problem.free[k].prior.coordinate(np.array(noise[problem.free_names[k]])) for k in surface.noise_columns]
    given = replace(surface.free(x), noise=np.tile(np.array(held, dtype=np.float64), (len(x), 1)))
    reached = descend(surface, Searches(x, np.full(len(x), -1), given), rivals=WORTH_TELLING)
    chosen: list[int] = []
    for k in np.argsort(reached.cost, kind="stable"):
        apart = np.max(np.abs(reached.x[chosen] - reached.x[k]) / surface.width, axis=1, initial=0.0)
        # What still creeps, above one that is lower, is no minimum.
        worthy = np.isfinite(reached.cost[k]) and (reached.settled[k] or not chosen)
        if worthy and len(chosen) < KEPT and np.all(apart > SAME_OPTIMUM):
            chosen.append(int(k))
    return surface.values(reached.x[chosen], given.take(np.array(chosen))) if chosen else starts


def deeper(problem: Problem, known: LeastSquares, starts: Sequence[Mapping[str, float]]) -> LeastSquares:
    """The known minimum, or a deeper one if a search from `starts` (all parameters by name) finds it."""
    values = _rows(problem, starts)
    try:
        tried = least_squares(problem, values)
    except FitError:
        return known
    if not tried.chi_square < (1.0 - DEEPER) * known.chi_square:
        return known
    # Minima that are known are searched again only here, where it shows which of them are told beside the deeper one.
    again = least_squares(problem, np.concatenate([values, _rows(problem, known.optima)]))
    return replace(again, starts=known.starts, evaluations=known.evaluations + tried.evaluations + again.evaluations)


def _rows(problem: Problem, optima: Sequence[Mapping[str, float]]) -> FloatArray:
    return np.array([[optimum[name] for name in problem.free_names] for optimum in optima])


def _standard_errors(
    problem: Problem, minimiser: Minimiser, at: FloatArray
) -> tuple[dict[str, float | None], dict[str, str]]:
    """Linear standard errors in SI at the stated noise, and for each one that does not exist the cause."""
    parameters = minimiser.parameters(at)
    jacobian = minimiser.jacobian(parameters) * minimiser.scale()
    names = minimiser.names
    stderr: dict[str, float | None] = {parameter.name: None for parameter in problem.parameters}
    missing: dict[str, str] = {}
    for parameter in problem.parameters:
        if not parameter.free:
            missing[parameter.name] = f"held at its value: {parameter.fixed_because}"
        elif parameter.name in NOISE_SPECS:
            missing[parameter.name] = "least squares takes the noise as given; the posterior fits it"
    at_bound = [
        name
        for name, parameter in zip(names, parameters.values(), strict=True)
        if min(parameter.value - parameter.min, parameter.max - parameter.value)
        < 1e-6 * max(1e-2, abs(parameter.value))
    ]
    for name in at_bound:
        missing[name] = (
            f"the best value lies on the wall {minimiser.wall_words}, where no symmetric error exists"
            if minimiser.walled is not None and name == problem.free_names[minimiser.walled]
            else "the best value lies on a bound, where no symmetric error exists"
        )
    for name in (names[k] for k in np.flatnonzero(minimiser.beside_the_end(at))):
        missing.setdefault(name, "the model ends next to the best value, where no symmetric error exists")
    inside = [k for k, name in enumerate(names) if name not in missing]
    if not inside:
        return stderr, missing
    _u, singular, directions = np.linalg.svd(jacobian[:, inside], full_matrices=False)
    # Directions that change no residual by a hundredth of its sd over the whole scale of the prior.
    open_directions = directions[singular < max(1e-2, 1e-10 * singular[0])]
    if jacobian.shape[0] < len(inside):
        for k in inside:
            missing[names[k]] = f"{jacobian.shape[0]} measurements cannot determine {len(inside)} parameters"
        return stderr, missing
    for position, k in enumerate(inside):
        weight = np.max(np.abs(open_directions[:, position])) if open_directions.size else 0.0
        if weight > 0.05:
            others = [names[inside[j]] for j in np.argsort(-np.abs(open_directions[0])) if j != position][:2]
            missing[names[k]] = f"the residuals leave it open: it can move together with {', '.join(others)}"
            continue
        keep = singular >= max(1e-2, 1e-10 * singular[0])
        variance = float(np.sum((directions[keep, position] / singular[keep]) ** 2))
        sd = math.sqrt(variance) * minimiser.scale()[k]
        column = minimiser.columns[k]
        if column == minimiser.walled:
            values = minimiser.values(at[None, :])
            sd *= float(minimiser.highest - minimiser.wall(values)[0])
        stderr[names[k]] = sd * (math.exp(at[k]) if problem.free[column].prior.log else 1.0)
    return stderr, missing
