"""How results depend on model assumptions, quickly: each choice changed, fitted, scored and compared."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from fitball.errors import FitballError
from fitball.inference.identifiability.derived import quantities
from fitball.inference.identifiability.information import DRAWN_ABOUT, about
from fitball.inference.likelihood.posterior import log_posterior, pointwise
from fitball.inference.point.point_fit import distinct, maxima
from fitball.inference.prediction.court_pace import pace_by_surface
from fitball.inference.problem.build import build_problem, reduction
from fitball.inference.problem.noise import KINDS, NoiseKind
from fitball.inference.problem.parameters import NOISE_SPECS
from fitball.inference.problem.problem import Choices, Problem
from fitball.inference.problem.subsample import thinned_problem
from fitball.inference.results import sentences
from fitball.inference.results.assumptions import (
    FEW,
    Alternative,
    Assumptions,
    Span,
    Summary,
    elpd_difference,
    span,
    summary,
)
from fitball.inference.results.results import PointFit, Posterior, thinned
from fitball.inference.sampling.importance import (
    K_TRUSTED,
    WeightedDraws,
    equal_draws,
    importance_posterior,
    refitted,
    smoothed_elpd,
    within_bounds,
)
from fitball.inference.sampling.moves import StudentProposal
from fitball.models.model import Model
from fitball.models.registry import closure_options, model
from fitball.values import FloatArray

# The problems that differ from one in a single choice: another option of a closure, or another kind of noise.


@dataclass(frozen=True)
class Change:
    """A `problem` in which the choice `name` (such as `offset=grip`) stands `instead_of` another; None with the
    reason why where it cannot be posed.
    """

    name: str
    instead_of: str
    problem: Problem | None
    reason: str = ""


def alternatives(problem: Problem, probes: FloatArray) -> tuple[Change, ...]:
    """All single changes that make a difference at `probes` (draws, free), coordinates of the problem.

    A closure that these data cannot show (see `registry.Reduced`) stays as it is. So does the measured restitution as
    an input: a column that is an input cannot score a model. Models that are not compared keep their closures.
    """
    found = []
    for name, instead_of, changed in _changes(problem):
        given = problem.model
        try:
            there = model(given.name, ball=given.ball, tangential=given.tangential, **changed.closures)
            if there.needs_cor != given.needs_cor:
                continue
            posed = _posed(problem, changed, there)
        except FitballError as error:
            found.append(Change(name, instead_of, None, str(error)))
            continue
        # A choice that acts nowhere here: the same parameters are as probable to the last bit.
        alike = problem.free_names == posed.free_names
        if not (alike and np.array_equal(log_posterior(problem, probes), log_posterior(posed, probes))):
            found.append(Change(name, instead_of, posed))
    return tuple(found)


def _changes(problem: Problem) -> Iterator[tuple[str, str, Choices]]:
    """Name, what it replaces, and the choices of each single change."""
    chosen = replace(
        problem.choices, model=problem.model.name, closures=dict(problem.model.options), noise=problem.noise.name
    )
    reduced = reduction(problem.table, problem.model.name, problem.model.options)
    kept = set() if reduced is None else reduced.closures.keys()
    options = {} if problem.model.unranked else closure_options(problem.model.name)
    for closure, known in options.items():
        now = problem.model.options[closure]
        for option in known if closure not in kept else ():
            if option != now:
                closures = {**chosen.closures, closure: option}
                yield f"{closure}={option}", f"{closure}={now}", replace(chosen, closures=closures)
    for kind in KINDS:
        if kind != problem.noise.name:
            yield f"noise={kind}", f"noise={problem.noise.name}", replace(chosen, noise=kind)


def _posed(problem: Problem, choices: Choices, there: Model) -> Problem:
    """The problem of other choices, that is, of the model `there`; what is known of parameters that only the given
    problem has is left out.
    """
    gone = set(problem.model.parameter_names) - set(there.parameter_names)
    if choices.noise != problem.noise.name:
        gone |= {spec.name for spec in problem.noise.parameters}
    stated = {**problem.scene.priors, **choices.priors}
    silent = set(gone)
    # Of a ball that turns as one k_y may act nowhere, and is held unless a prior is stated: a repetition states all
    # those of the given model, defaults too.
    if "k_theta" in gone and "k_y" in stated and stated["k_y"] == there.specs["k_y"].prior:
        silent.add("k_y")
    scene = replace(
        problem.scene, priors=_without(problem.scene.priors, silent), fix=_without(problem.scene.fix, gone)
    )
    left = replace(choices, priors=_without(choices.priors, silent), fix=_without(choices.fix, gone))
    return replace(build_problem(problem.table, scene, left, problem.force), threads=problem.threads)


def _without(named: Mapping[str, Any], gone: Collection[str]) -> dict[str, Any]:
    return {name: value for name, value in named.items() if name not in gone}


# Rows and free parameters up to which posteriors are drawn: of more rows they are normal, and weighted draws in many
# dimensions are worth few. Beyond, and where draws do not settle, all is to first order about the maxima.
ROWS, DIMENSIONS = 100, 16
# Steps of the differences in that, in widths of the priors; and draws of the normal distribution.
STEP, NORMAL_DRAWS = 1e-4, 1000
# Rows of a longer table that are looked at.
LOOKED_AT = 1000
# Draws of the fit's own posterior that are scored.
OWN_DRAWS = 2000
# Effective draws of the posterior without an impact whose weights are not to be trusted: its log density is then
# known to a seventh, far below a difference that is sure.
REFIT_DRAWS = 200.0
# Gain of log posterior below which a search for an optimum of an alternative ends: the draws about it give the rest.
NEAR = 0.01
# Optima of the fit from which each alternative is searched, with these quantiles of the priors of parameters that
# only the alternative has.
FOLLOWED, NEW_STARTS = 2, (0.16, 0.5, 0.84)
# Coordinates at which it is seen whether a choice acts at all.
PROBES = 20
# Share of draws that must give a quantity for it to be compared.
COMPARED = 0.9


@dataclass(frozen=True)
class Fitted:
    """A problem with draws of its posterior, or, to first order, of the normal distribution `about` its maximum."""

    problem: Problem
    draws: WeightedDraws
    about: StudentProposal | None = None

    def elpd(self, rng: np.random.Generator) -> FloatArray:
        """Log density (impacts,) of each impact when it is left out, by a refit where its Pareto k is not to be
        trusted; NaN where that does not settle either. A record of the force of an impact that is left out stays.
        """
        columns = [observable.name for observable in self.problem.observables]
        if self.about is not None:
            return _linear_elpd(self.problem, self.about)
        whole, scored = pointwise(self.problem, self.draws.values, columns)
        elpd, pareto_k = smoothed_elpd(whole, scored, 1.0, self.draws.log_weights)
        for row in np.flatnonzero(~(pareto_k <= K_TRUSTED)).tolist():
            again = refitted(self.problem, self.draws, whole[:, row], row, columns, rng, REFIT_DRAWS)
            elpd[row] = np.nan if again is None else again.elpd
        return elpd

    def parameters(self, noise: NoiseKind) -> dict[str, Summary]:
        """Of every free parameter and what follows from them; of the noise's only where it is of the kind `noise`:
        the scale of another kind is another quantity.
        """
        columns = dict(zip(self.problem.free_names, self.draws.values.T, strict=True))
        columns |= {item.parameter.name: item.rule(self.draws.values) for item in quantities(self.problem)}
        alike, weights = self.problem.noise.name == noise.name, np.exp(self.draws.log_weights)
        return {
            name: summary(column, weights) for name, column in columns.items() if alike or name not in NOISE_SPECS
        }

    def court_pace(self) -> dict[str, Summary]:
        """Of the rating of each surface that can be rated."""
        rated, weights = pace_by_surface(self.problem, self.draws.values), np.exp(self.draws.log_weights)
        return {
            name: summary(rating, weights)
            for name, rating in rated.items()
            if np.sum(weights[np.isfinite(rating)]) >= COMPARED
        }

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
    """How each quantity of a fit depends on each choice; or why that is not known."""
    part, own = thinned_problem(problem, LOOKED_AT), None
    if len(problem.impacts) <= ROWS and problem.dimension <= DIMENSIONS:
        if posterior is None:
            optima = np.concatenate([_starts(problem, optimum) for optimum in point.optima[:DRAWN_ABOUT]])
            begun = [about(problem, at) for at in problem.to_coordinates(optima)]
            draws = importance_posterior(problem, begun, rng)
        else:
            draws = equal_draws(thinned(posterior, OWN_DRAWS))
        own = Fitted(problem, draws) if draws.settled else None
    compared = Compared(part, point, own, rng)
    base = own or compared.linear
    if base is None:
        return Assumptions((), {}, {}, sentences.NOTHING_DRAWN)
    # The fit itself is summarised by every draw, as its estimates are, not by those that are scored.
    whole = base if posterior is None else Fitted(problem, equal_draws(posterior.draws))
    own_summaries = whole.parameters(problem.noise), whole.court_pace()
    probes = base.draws.values[np.linspace(0, len(base.draws.values) - 1, PROBES).astype(np.int64)]
    changes = alternatives(part, problem.to_coordinates(probes))
    found = tuple(compared.fitted(own_summaries, change) for change in changes)
    return Assumptions(
        found,
        _spans(own_summaries[0], [(item, item.parameters) for item in found]),
        _spans(own_summaries[1], [(item, item.court_pace) for item in found]),
    )


def _linear(problem: Problem, optimum: FloatArray, rng: np.random.Generator) -> Fitted | None:
    """A posterior to first order about its maximum (free,), cut off where priors and model end; None where next to
    nothing is left.
    """
    there = about(problem, optimum)

    def draw(count: int) -> FloatArray:
        return np.asarray(optimum + rng.standard_normal((count, optimum.size)) @ there.factor.T)

    drawn, _share = within_bounds(problem, draw, NORMAL_DRAWS)
    possible = np.isfinite(log_posterior(problem, drawn))
    found = Fitted(problem, equal_draws(problem.to_values(drawn[possible])), there) if possible.any() else None
    return found if found is not None and found.draws.settled else None


def _linear_elpd(problem: Problem, there: StudentProposal) -> FloatArray:
    """Log density (impacts,) of each impact when it is left out, to first order about a maximum: without an impact it
    moves by its covariance times the slope g of the impact's log density, which falls by g'Cg.
    """
    steps = STEP * np.diag(problem.prior.width)
    around = np.concatenate([there.centre[None, :], there.centre + steps, there.centre - steps])
    columns = [observable.name for observable in problem.observables]
    _whole, scored = pointwise(problem, problem.to_values(around), columns)
    up, down = np.split(scored[1:], 2)
    # No slope where the model ends next to the maximum: the parameter stays.
    slopes = np.nan_to_num((up - down) / (2.0 * np.diag(steps)[:, None]))
    return np.asarray(scored[0] - np.sum((there.factor.T @ slopes) ** 2, axis=0))


def _on_whole(
    whole: Mapping[str, Summary], part: Mapping[str, Summary], other: Mapping[str, Summary]
) -> dict[str, Summary]:
    """An alternative's summaries to first order, on a `part` of the rows if they are many, scaled to the
    `whole`: as far from the fit itself as there, as much wider or narrower.
    """
    moved = {}
    for name, there in other.items():
        if name in whole and name in part:
            given, own = whole[name], part[name]
            share = given.sd / own.sd if own.sd > 0.0 else 0.0
            median = given.median + there.median - own.median
            ends = (median + share * (end - there.median) for end in (there.q025, there.q975))
            moved[name] = Summary(median, share * there.sd, *ends)
    return moved


@dataclass(frozen=True)
class Compared:
    """What alternatives are held against: a `problem` with its best values, and its `own` draws, None where there are
    none; else to first order. Like is held against like.
    """

    problem: Problem
    point: PointFit
    own: Fitted | None
    rng: np.random.Generator

    @cached_property
    def linear(self) -> Fitted | None:
        """The fit itself to first order."""
        optima = _optima(self.problem, self.point)
        return _linear(self.problem, optima[0], self.rng) if len(optima) else None

    @cached_property
    def own_scores(self) -> FloatArray | None:
        """Of the impacts by draws; None of few impacts, whose scores mean nothing."""
        return self._scores(self.own)

    @cached_property
    def linear_scores(self) -> FloatArray | None:
        """The same to first order."""
        return self._scores(self.linear)

    def _scores(self, fitted: Fitted | None) -> FloatArray | None:
        return None if fitted is None or len(self.problem.impacts) < FEW else fitted.elpd(self.rng)

    def fitted(self, whole: tuple[Mapping[str, Summary], Mapping[str, Summary]], change: Change) -> Alternative:
        """A single change, fitted quickly and scored beside the fit itself, whose parameters and court pace are
        `whole`; with few impacts no change is refused.
        """

        def without(reason: str, unsettled: bool = False) -> Alternative:
            return Alternative(change.name, change.instead_of, None, reason, {}, {}, {}, unsettled)

        problem = change.problem
        if problem is None:
            return without(change.reason)
        optima = _optima(problem, self.point)
        if not len(optima):
            return without(sentences.NO_OPTIMUM)
        found = None
        if self.own is not None:
            draws = importance_posterior(problem, [about(problem, at) for at in optima], self.rng)
            found = Fitted(problem, draws) if draws.settled else None
        drawn = found is not None
        found = found or _linear(problem, optima[0], self.rng)
        if found is None or (not drawn and self.linear is None):
            return without(sentences.NOT_SETTLED, unsettled=True)
        scored = self.own_scores if drawn else self.linear_scores
        difference, left = None, ""
        if scored is not None:
            gaps = found.elpd(self.rng) - scored
            known = np.isfinite(gaps)
            if known.sum() < FEW:
                return without(sentences.SCORES_NOT_SETTLED, unsettled=True)
            difference = elpd_difference(gaps[known], np.zeros(int(known.sum())))
            left = ", ".join(problem.table.ids[k] for k in np.flatnonzero(~known))
        noise = self.problem.noise
        parameters, paces = found.parameters(noise), found.court_pace()
        if not drawn and self.linear is not None:
            parameters = _on_whole(whole[0], self.linear.parameters(noise), parameters)
            paces = _on_whole(whole[1], self.linear.court_pace(), paces)
        return Alternative(
            change.name,
            change.instead_of,
            difference,
            sentences.WITHOUT.format(ids=left) if left else "",
            found.centre(),
            parameters,
            paces,
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
    """Every quantity of the fit over the alternatives that fit equally well and have it."""
    good = [(item, known) for item, known in others if item.as_good]
    return {
        name: span(summary, [(item.name, item.instead_of, known[name]) for item, known in good if name in known])
        for name, summary in own.items()
    }
