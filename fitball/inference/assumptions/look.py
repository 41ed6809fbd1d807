"""A cheap look at what a fit rests on: each choice changed, fitted quickly, scored, and compared."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from fitball.inference.assumptions.alternatives import Change, alternatives
from fitball.inference.assumptions.importance_posterior import (
    DRAWN_ABOUT,
    WeightedDraws,
    equal_draws,
    importance_posterior,
)
from fitball.inference.identifiability.derived import quantities
from fitball.inference.likelihood.posterior import pointwise
from fitball.inference.point.maximum_posterior import distinct, maxima
from fitball.inference.prediction.court_pace import pace_by_surface
from fitball.inference.problem.noise import NoiseKind
from fitball.inference.problem.parameters import NOISE_SPECS
from fitball.inference.problem.problem import Problem
from fitball.inference.results.assumptions import Alternative, Assumptions, Span, Summary, span
from fitball.inference.results.results import PointFit, Posterior, thinned
from fitball.inference.results.score_difference import FEW, elpd_difference
from fitball.inference.sampling.importance import smoothed_elpd
from fitball.values import FloatArray

# Rows and free parameters up to which alternatives are looked at: every draw bounces every impact, and weighted draws
# in many dimensions are worth few.
ROWS, DIMENSIONS = 100, 16
# Draws of the fit's own posterior that are scored.
OWN_DRAWS = 2000
# Gain of log posterior below which a search for an optimum of an alternative ends: the draws about it tell the rest.
NEAR = 0.01
# Optima of the fit from which each alternative is searched, with these quantiles of the priors of parameters that
# only the alternative has.
FOLLOWED, NEW_STARTS = 2, (0.16, 0.5, 0.84)
# Coordinates at which it is seen whether a choice acts at all.
PROBES = 20
# Share of draws that must give a quantity for it to be compared.
COMPARED = 0.9
LEVELS = np.array([0.025, 0.5, 0.975])


@dataclass(frozen=True)
class _Fitted:
    """A problem with draws of its posterior."""

    problem: Problem
    draws: WeightedDraws

    def elpd(self) -> FloatArray:
        """Log density (impacts,) of each impact when it is left out."""
        columns = [observable.name for observable in self.problem.observables]
        whole, scored = pointwise(self.problem, self.draws.values, columns)
        return smoothed_elpd(whole, scored, 1.0, self.draws.log_weights)[0]

    def parameters(self, noise: NoiseKind) -> dict[str, Summary]:
        """Of every free parameter and what follows from them; of the noise's only where it is of the kind `noise`:
        the scale of another kind is another quantity.
        """
        columns = dict(zip(self.problem.free_names, self.draws.values.T, strict=True))
        columns |= {item.parameter.name: item.rule(self.draws.values) for item in quantities(self.problem)}
        alike = self.problem.noise.name == noise.name
        return {name: self._summary(column) for name, column in columns.items() if alike or name not in NOISE_SPECS}

    def court_pace(self) -> dict[str, Summary]:
        """Of the rating of each surface that can be rated."""
        rated = pace_by_surface(self.problem, self.draws.values)
        return {
            name: self._summary(rating)
            for name, rating in rated.items()
            if np.sum(np.exp(self.draws.log_weights[np.isfinite(rating)])) >= COMPARED
        }

    def _summary(self, column: FloatArray) -> Summary:
        low, median, high = map(float, self.draws.quantiles(column, LEVELS))
        return Summary(median, self.draws.sd(column), low, high)

    def centre(self) -> dict[str, float]:
        """All parameters by name at the mean in coordinates."""
        coordinates = self.problem.to_coordinates(self.draws.values)
        mean = np.average(coordinates, axis=0, weights=np.exp(self.draws.log_weights))
        values = self.problem.all_values(self.problem.to_values(mean[None, :]))
        return {name: float(column[0]) for name, column in values.items()}


def assumptions_generator(seed: int) -> np.random.Generator:
    """The generator of the draws of alternatives, a stream of its own beside those of a run."""
    return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(10,)))


def look(problem: Problem, point: PointFit, posterior: Posterior | None, rng: np.random.Generator) -> Assumptions:
    """What of a fit rests on which choice; why there is no look, where it would cost too much or mean nothing."""
    if reason := _out_of_reach(problem):
        return Assumptions((), {}, {}, reason)
    if posterior is None:
        optima = np.concatenate([_starts(problem, optimum) for optimum in point.optima[:DRAWN_ABOUT]])
        draws = importance_posterior(problem, problem.to_coordinates(optima), rng)
    else:
        draws = equal_draws(thinned(posterior, OWN_DRAWS))
    if not draws.settled:
        return Assumptions((), {}, {}, "a quick look at the fit itself did not settle")
    own = _Fitted(problem, draws)
    # What is told of the fit itself is what its estimates tell: of every draw, not of those that are scored.
    whole = own if posterior is None else _Fitted(problem, equal_draws(posterior.draws))
    probes = draws.values[np.linspace(0, len(draws.values) - 1, PROBES).astype(np.int64)]
    scored = own.elpd()
    found = tuple(
        _fitted(scored, problem.noise, point, change, rng)
        for change in alternatives(problem, problem.to_coordinates(probes))
    )
    return Assumptions(
        found,
        _spans(whole.parameters(problem.noise), [(item, item.parameters) for item in found]),
        _spans(whole.court_pace(), [(item, item.court_pace) for item in found]),
    )


def _out_of_reach(problem: Problem) -> str:
    """Why a problem is not looked at; empty where it is."""
    count = len(problem.impacts)
    if count < FEW:
        return f"with {count} impacts no score tells one assumption from another"
    if count > ROWS:
        return f"alternatives are looked at on tables of up to {ROWS} impacts"
    if problem.incident is not None:
        return "alternatives are looked at where the incident states count as exact"
    if problem.force is not None:
        return "alternatives are looked at without force records"
    if problem.dimension > DIMENSIONS:
        return f"alternatives are looked at in up to {DIMENSIONS} free parameters"
    return ""


def _fitted(
    scored: FloatArray, noise: NoiseKind, point: PointFit, change: Change, rng: np.random.Generator
) -> Alternative:
    """A single change, fitted, and scored beside a fit that scores so (impacts,)."""

    def without(reason: str) -> Alternative:
        return Alternative(change.name, change.instead_of, None, reason, {}, {}, {})

    if change.problem is None:
        return without(change.reason)
    optima = _optima(change.problem, point)
    if not len(optima):
        return without("no search led to parameters that the model can evaluate")
    draws = importance_posterior(change.problem, optima, rng)
    if not draws.settled:
        return without("a quick look at its posterior did not settle")
    fitted = _Fitted(change.problem, draws)
    return Alternative(
        change.name,
        change.instead_of,
        elpd_difference(fitted.elpd(), scored),
        "",
        fitted.centre(),
        fitted.parameters(noise),
        fitted.court_pace(),
    )


def _optima(problem: Problem, point: PointFit) -> FloatArray:
    """Coordinates (optima, free) of the best that searches from the optima of another problem lead to."""
    starts = np.concatenate([_starts(problem, optimum) for optimum in point.optima[:FOLLOWED]])
    reached = distinct(maxima(problem, starts, NEAR), problem.prior.width)
    return np.array([optimum.coordinates for optimum in reached[:DRAWN_ABOUT]]).reshape(-1, problem.dimension)


def _starts(problem: Problem, values: Mapping[str, float]) -> FloatArray:
    """Free values (starts, free): those known, and quantiles of the priors of the others."""
    new = any(parameter.name not in values for parameter in problem.free)
    levels = np.array(NEW_STARTS if new else NEW_STARTS[1:2])
    columns = [
        np.full(levels.size, values[parameter.name]) if parameter.name in values else parameter.prior.quantile(levels)
        for parameter in problem.free
    ]
    return np.stack(columns, axis=1)


def _spans(
    own: Mapping[str, Summary], others: Sequence[tuple[Alternative, Mapping[str, Summary]]]
) -> dict[str, Span]:
    """Every quantity of the fit over the alternatives that are as good and have it."""
    good = [(item, known) for item, known in others if item.as_good]
    return {
        name: span(summary, [(item.name, item.instead_of, known[name]) for item, known in good if name in known])
        for name, summary in own.items()
    }
