"""A fit in its stages: search, sample, search from the best draw, linearise, profile, judge."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from time import perf_counter

import numpy as np

from fitball.base.environment import threads
from fitball.base.errors import Note, enough_memory
from fitball.base.progress import Progress
from fitball.inference import schema
from fitball.inference.assemble import estimates, headline, notes_of_best_outside
from fitball.inference.effort import Effort
from fitball.inference.fitted import Fitted, draws_of, medians_of, run_of
from fitball.inference.judgement.adequacy import adequacy
from fitball.inference.judgement.assumptions import alternatives, what_values_rest_on
from fitball.inference.judgement.bounds import AtBounds, at_bounds
from fitball.inference.judgement.constants import constants
from fitball.inference.judgement.first_order import FirstOrder, first_order, proposal
from fitball.inference.judgement.profile import Profiled, profiles
from fitball.inference.judgement.verdict import judge, qualify
from fitball.inference.judgement.weights import outvoted
from fitball.inference.modes import (
    doubts_of,
    modes_of,
    notes_of,
    parts_of_posterior,
    with_mass_first,
)
from fitball.inference.problem.problem import Problem
from fitball.inference.sampling.parts import ONE_PART
from fitball.inference.sampling.sample import sample
from fitball.inference.search.best_fit import best_fit
from fitball.inference.search.least_squares import least_squares
from fitball.models.model import Model

# By how much the log posterior of a draw may exceed that of the best values. At more these are
# searched for again from the draw.
_MOST_ABOVE_BEST = 0.01


def calibrate(
    problem: Problem,
    effort: Effort,
    progress: Progress,
    user_model: Model | None = None,
) -> Fitted:
    """Fit a problem; `user_model` is its model if the user wrote that. `progress` gets each stage
    with the share of it that is done.

    Raises:
        FitError: the model has no answer (`no-answer`), or sampling cannot start (`no-start`).
        MachineError: there is too little memory (`memory`).
        KeyboardInterrupt: the user stopped the fit.
    """
    with enough_memory(), threads(effort.cores):
        return _calibrate(problem, effort, progress, user_model)


@contextmanager
def _stage(progress: Progress, seconds: dict[str, float], name: str) -> Iterator[None]:
    """Report the begin of a stage of that name, and add its duration [s] to `seconds`."""
    progress(name, 0.0)
    start = perf_counter()
    yield
    seconds[name] = seconds.get(name, 0.0) + perf_counter() - start


def _calibrate(
    problem: Problem,
    effort: Effort,
    progress: Progress,
    user_model: Model | None,
) -> Fitted:
    """The stages of a fit in turn, each of which is timed."""
    seconds: dict[str, float] = {}
    stage = partial(_stage, progress, seconds)
    with stage("searching"):
        point = best_fit(problem, effort.stream("search"))
    posterior = diagnostics = None
    parts = ONE_PART
    if not effort.point_only:
        with stage("sampling"):
            begin = [proposal(problem, problem.coordinates(values)) for values in point.optima]
            posterior, diagnostics = sample(problem, begin, effort, progress)
        with stage("searching"):
            point = _search_from_best_draw(problem, point, posterior, effort)
            parts = parts_of_posterior(problem, point, posterior, diagnostics)
            point = with_mass_first(problem, point, posterior, parts)
    with stage("judging"):
        first = first_order(problem, point)
        derived = problem.derived
        optima = np.stack([problem.coordinates(values) for values in point.optima])
        profiled = profiles(problem, optima)
        tested = adequacy(problem, point, first, derived)
        bounds = at_bounds(problem, point, first, derived)
        draws = draws_of(problem, point, posterior, effort)
        within = judge(problem, point, first, profiled, derived, bounds, medians_of(draws))
    with stage("trying assumptions"):
        tried, fitted = _tried(problem, point, first, profiled, bounds)
        held = constants(problem, first, derived)
    with stage("judging"):
        modes = modes_of(problem, point, posterior, diagnostics, draws, parts)
        rests = what_values_rest_on(tried, _sure(problem, held), fitted)
        doubts = bounds.doubts() | doubts_of(problem, modes)
        judged = qualify(within, tested, rests, doubts, outvoted(tried, fitted))
        squares = least_squares(problem, point)
        parameters, following = estimates(problem, draws, judged)
        reported = [*parameters.values(), *following.values()]
        more = [*notes_of(problem, modes), *bounds.notes(problem), *notes_of_best_outside(reported)]
    return Fitted(
        run=run_of(problem, effort),
        status=_status(diagnostics),
        headline=headline(tested, reported, modes),
        notes=(*problem.table.notices, *problem.notes, *_no_profiles(profiled.why), *more),
        parameters=parameters,
        derived=following,
        point=point,
        least_squares=squares,
        posterior=posterior,
        diagnostics=diagnostics,
        profiles=profiled.by_name,
        adequacy=tested,
        alternatives=tried,
        constants=held,
        seconds=seconds,
        modes=modes,
        own=user_model,
    )


def _tried(
    problem: Problem,
    point: schema.PointFit,
    first: FirstOrder,
    profiled: Profiled,
    bounds: AtBounds,
) -> tuple[tuple[schema.Alternative, ...], dict[str, schema.Summary]]:
    """The variants of a fit, and the summaries of the fit itself. Verdicts rest on them: their
    random numbers are the same whatever the seed, and no chain says where there are more.
    """
    by_profiles = judge(problem, point, first, profiled, problem.derived, bounds)
    return alternatives(problem, point, Effort().stream("assumptions"), by_profiles)


def _no_profiles(why: str) -> list[Note]:
    """The note (`no-profiles`) that there are none, with the reason; none where that is empty."""
    return [Note("no-profiles", why)] if why else []


def _status(diagnostics: schema.Diagnostics | None) -> schema.FitStatus:
    """Whether a fit has draws that converged."""
    if diagnostics is None:
        return "point only"
    return "converged" if diagnostics.converged else "not converged"


def _sure(problem: Problem, held: Sequence[schema.Constant]) -> tuple[schema.Constant, ...]:
    """The held constants on which verdicts may rest. Where the scene states no tilt, half a degree
    is tried, which moves values of most tables: no verdict rests on that.
    """
    names = {parameter.spec.name for parameter in problem.parameters}
    return tuple(constant for constant in held if constant.name != "tilt" or "tilt" in names)


def _search_from_best_draw(
    problem: Problem,
    point: schema.PointFit,
    posterior: schema.Posterior,
    effort: Effort,
) -> schema.PointFit:
    """The best values, searched for again from the best draw if that has a higher density than
    `point`. Densities are those of searches, with the smooth prior of levels.
    """
    values = posterior.values.reshape(-1, len(posterior.names))
    prior = problem.prior
    q = prior.coordinate(values)
    correction = prior.smooth.log_density(q) - prior.log_density(q)
    density = posterior.log_density.ravel() + correction
    highest = int(density.argmax())
    if density[highest] <= point.log_posterior[0] + _MOST_ABOVE_BEST:
        return point
    best = dict(zip(posterior.names, values[highest].tolist(), strict=True))
    return best_fit(
        problem,
        effort.stream("search again"),
        [*point.optima, {**point.optima[0], **best}],
    )
