"""The road: search, linearise, sample, search from the best draw, profile, judge, assemble."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from time import perf_counter

import numpy as np

from fitball.base.environment import threads
from fitball.base.errors import Note, enough_memory
from fitball.base.progress import Progress
from fitball.inference import schema
from fitball.inference.assemble import estimates, headline, notes_of_best_outside
from fitball.inference.effort import Effort
from fitball.inference.fitted import Fitted, draws_of, run_of
from fitball.inference.judgement.adequacy import adequacy
from fitball.inference.judgement.assumptions import alternatives, given
from fitball.inference.judgement.constants import constants
from fitball.inference.judgement.first_order import first_order, proposal
from fitball.inference.judgement.profile import profiles
from fitball.inference.judgement.verdict import judge, qualified
from fitball.inference.problem.problem import Problem
from fitball.inference.sampling.sample import sample
from fitball.inference.search.best_fit import best_fit
from fitball.inference.search.least_squares import least_squares
from fitball.models.model import Model

# By how much a draw may lie above the best values before these are searched for again from it.
_ABOVE = 0.01


def calibrate(
    problem: Problem,
    effort: Effort,
    progress: Progress,
    own: Model | None = None,
) -> Fitted:
    """Fit a problem. Raises FitError, MachineError (`memory`), KeyboardInterrupt."""
    with enough_memory(), threads(effort.cores):
        return _calibrate(problem, effort, progress, own)


def _calibrate(problem: Problem, effort: Effort, progress: Progress, own: Model | None) -> Fitted:
    seconds: dict[str, float] = {}

    @contextmanager
    def stage(name: str) -> Iterator[None]:
        progress(name, 0.0)
        start = perf_counter()
        yield
        seconds[name] = seconds.get(name, 0.0) + perf_counter() - start

    posterior = diagnostics = None
    status: schema.FitStatus = "point only"
    with stage("searching"):
        point = best_fit(problem, effort.stream("search"))
    if not effort.point_only:
        with stage("sampling"):
            begin = [proposal(problem, problem.coordinates(values)) for values in point.optima]
            posterior, diagnostics = sample(problem, begin, effort, progress)
            status = "converged" if diagnostics.converged else "not converged"
        with stage("searching"):
            point = _beside(problem, point, posterior, effort)
    with stage("judging"):
        first = first_order(problem, point)
        derived = problem.derived
        optima = np.stack([problem.coordinates(values) for values in point.optima])
        profiled, why = profiles(problem, optima)
        tested = adequacy(problem, point, first, derived)
    with stage("trying assumptions"):
        # The same numbers whatever the seed: verdicts rest on them.
        tried, fitted = alternatives(problem, point, Effort().stream("assumptions"))
        held = constants(problem, first, derived)
    with stage("judging"):
        # Half a degree of tilt where nothing is known of it moves values of most tables: no verdict
        # rests on that.
        names = {item.spec.name for item in problem.parameters}
        sure = tuple(constant for constant in held if constant.name != "tilt" or "tilt" in names)
        within = judge(problem, point, first, profiled, derived)
        judged = qualified(within, tested, given(tried, sure, fitted))
        squares = least_squares(problem, point)
        draws = draws_of(problem, point, posterior, effort)
        parameters, following = estimates(problem, draws, judged)
        reported = [*parameters.values(), *following.values()]
        notes = [*problem.table.notices, *problem.notes]
        if why:
            notes.append(Note("no-profiles", why))
        notes += notes_of_best_outside(reported)
    return Fitted(
        run=run_of(problem, effort),
        status=status,
        headline=headline(tested, reported),
        notes=tuple(notes),
        parameters=parameters,
        derived=following,
        point=point,
        least_squares=squares,
        posterior=posterior,
        diagnostics=diagnostics,
        profiles=profiled,
        adequacy=tested,
        alternatives=tried,
        constants=held,
        seconds=seconds,
        own=own,
    )


def _beside(
    problem: Problem,
    point: schema.PointFit,
    posterior: schema.Posterior,
    effort: Effort,
) -> schema.PointFit:
    """The best values searched for again from the best draw, where that lies above them in what
    searches raise.
    """
    values = posterior.values.reshape(-1, len(posterior.names))
    prior = problem.prior
    q = prior.coordinate(values)
    correction = prior.smooth.log_density(q) - prior.log_density(q)
    density = posterior.log_density.ravel() + correction
    place = int(density.argmax())
    if density[place] <= point.log_posterior[0] + _ABOVE:
        return point
    best = dict(zip(posterior.names, values[place].tolist(), strict=True))
    return best_fit(
        problem,
        effort.stream("search again"),
        [*point.optima, {**point.optima[0], **best}],
    )
