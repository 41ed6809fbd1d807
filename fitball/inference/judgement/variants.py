"""Fits of variants of a problem, quick ones, and how well they predict impacts left out."""

from __future__ import annotations

from typing import Annotated, NamedTuple

import numpy as np

from fitball.base.errors import FitError
from fitball.base.selection import evenly_spread
from fitball.base.values import FloatArray
from fitball.inference.density import cell_log_density, cell_slopes, log_posterior
from fitball.inference.judgement.first_order import proposal
from fitball.inference.learnt import learnt, with_offsets_of
from fitball.inference.problem.problem import Problem
from fitball.inference.sampling.importance import Student
from fitball.inference.search.objective import Objective, descend

# Impacts from which a difference of scores is used: of fewer its standard error is poorly known (of
# five to a third of itself). Chosen by hand.
LEAST_SCORED_IMPACTS = 6
# Standard errors by which a score is lower that is surely worse, or higher that is surely better.
WORSE_BY_ERRORS = 2.0
# Amount by which it is: on few observations the standard error is too small (Sivula et al. 2020).
WORSE_BY_SCORE = 4.0
# Gain promised by a step from which first searches end: they show where to look further.
ROUGH_GAIN = 1e-2
# Gain promised by a step from which last searches end: far below WORSE_BY_SCORE. By a tenth of it
# variants of five tables end 0.008 higher at most.
FINE_GAIN = 1e-3
# Rounds without such a gain of the best search after which all end: the best one counts alone, and
# others creep along kinks.
PATIENCE = 8
# Draws about the best of the first searches at which the density is looked at: some lie beyond the
# kinks that stop a search. How many is chosen by hand.
DRAWS_AROUND = 300
# The highest of these draws, from which is searched again. How many is chosen by hand.
SEARCHES_AGAIN = 3
# Gain in log density by such a round below which there is none after it, and rounds at most: along
# a wall, beyond which the model has no answer, each search gains a little.
GAIN_OF_ROUND = 0.05
MOST_ROUNDS = 8
# Rows of a long table, evenly spread, with which its maxima are looked for: enough to determine the
# usual parameters.
SEARCHED_ROWS = 100
# Maxima that are followed from these rows to all: the second may overtake the first.
FOLLOWED_MAXIMA = 2
# Draws that teach the density of a variant with uncertain incident states.
TEACHING_DRAWS = 150


class FittedVariant(NamedTuple):
    """A fitted variant of a problem: its maximum `best` (coordinates,), a proposal about that, and
    as `scores` the log predictive density (impacts,) of each impact from the others. `law` is the
    problem with a density that draws about the maximum taught, or the problem itself.
    """

    problem: Problem
    best: FloatArray
    about: Student
    scores: FloatArray
    law: Problem


def draws_about(
    problem: Problem, about: Student, rng: np.random.Generator, count: int
) -> FloatArray:
    """Draws (count, coordinates) about a maximum, moved to the bounds where they are beyond."""
    prior = problem.prior
    return np.clip(about.draw(rng, count), prior.low, prior.high)


def fit_variant(
    problem: Problem,
    starts: Annotated[FloatArray, "starts coordinates"],
    rng: np.random.Generator,
    base: FittedVariant | None = None,
) -> FittedVariant:
    """The best fit of a variant of the problem that has the fit `base`, or of a problem. Kinks of
    the density stop a search: after searches from `starts` others begin at the best of many draws
    about what these reach. Of a long table that is done with some of its rows.

    Raises:
        FitError: no search reaches parameters with an answer (`no-answer`).
    """
    count = len(problem.rows.y)
    long = count > 2 * SEARCHED_ROWS
    rows = evenly_spread(count, SEARCHED_ROWS if long else count)
    guess = problem if base is None else with_offsets_of(problem, base.law, base.best)
    first = guess.on_rows(rows)
    x, cost, _ = descend(Objective(first), starts, ROUGH_GAIN, patience=PATIENCE)
    if not np.isfinite(cost.min()):
        text = f"no search of {problem.forward.model.text} found parameters with an answer"
        raise FitError(text, "no-answer")
    law = problem
    for _ in range(MOST_ROUNDS):
        before = cost.min()
        best = x[np.argmin(cost)]
        around = draws_about(first, proposal(first, best), rng, DRAWS_AROUND)
        density = log_posterior(first, around)
        order = np.argsort(-density, kind="stable")
        law = learnt(problem, around[np.isfinite(density)][:TEACHING_DRAWS])
        again = np.vstack([best, around[order[:SEARCHES_AGAIN]]])
        first = law.on_rows(rows)
        x, cost, _ = descend(Objective(first), again, FINE_GAIN, patience=PATIENCE)
        if before - cost.min() < GAIN_OF_ROUND:
            break
    if long:
        highest = np.argsort(cost, kind="stable")[:FOLLOWED_MAXIMA]
        x, cost, _ = descend(Objective(law), x[highest], FINE_GAIN)
    best = x[np.argmin(cost)]
    if law is not problem:
        x, *_ = descend(Objective(problem), best[None], FINE_GAIN)
        best = x[0]
    about = proposal(problem, best)
    law = learnt(problem, draws_about(problem, about, rng, TEACHING_DRAWS))
    return FittedVariant(problem, best, about, leave_one_out_density(problem, about), law)


def leave_one_out_density(
    problem: Problem,
    about: Student,
) -> Annotated[FloatArray, "impacts"]:
    """The log predictive density of each impact from all others, to first order about a maximum.

    With slopes K of its residuals, gradient g of its log density and covariance C, without it the
    covariance is D = C + C K (1 - K'CK)^-1 K'C and the maximum moves by -D g. Over that normal
    distribution its density has the mean exp(-g'Dg/2) |1 - K'CK|^(1/2) of what it is at the maximum
    of all.
    """
    x = about.centre[None]
    noise = problem.forward.noise
    measured = np.isfinite(problem.rows.y)
    values = problem.values(x)
    cell, rate = cell_slopes(problem, x)
    residual, turn = noise.residual(cell.z, values)
    of_centre, of_scale = noise.information(values)
    rate_z = np.where(measured, rate.z[0], 0.0)
    rate_scale = np.where(measured, rate.log_sd[0], 0.0)
    gradient = -(rate_z * (residual * turn)[0] + rate_scale).sum(axis=2)
    pull = about.factor.T @ gradient
    # What a growing scale does to residuals is in its own information.
    centre = np.sqrt(of_centre[0]) * (rate_z + rate_scale * cell.z[0])
    scale = np.sqrt(of_scale[0]) * rate_scale
    weighted = np.concatenate([centre, scale], axis=2)
    weighted = np.tensordot(about.factor.T, weighted, 1)
    leverage = np.einsum("fik,fil->ikl", weighted, weighted)
    along = np.einsum("fik,fi->ik", weighted, pull)
    without = np.eye(along.shape[1]) - leverage
    further = np.linalg.solve(without, along[..., None])[..., 0]
    # g'Dg is g'Cg and what one impact less adds to it.
    square = (pull**2).sum(axis=0) + (along * further).sum(axis=1)
    fall = 0.5 * (square - np.linalg.slogdet(without)[1])
    density = cell_log_density(problem, cell, values)[0].sum(axis=1)
    return np.asarray(density - fall)


class ScoreGap(NamedTuple):
    """By how much a variant scores more than a fit, with standard `error`; None of few impacts.
    Whether it is surely `worse` or `better`.
    """

    score: float | None
    error: float
    worse: bool
    better: bool


def score_gap(base: FittedVariant, there: FittedVariant) -> ScoreGap:
    """The scores of a variant beside those of the fit `base` of the same rows."""
    gaps = there.scores - base.scores
    count = len(gaps)
    if count < LEAST_SCORED_IMPACTS:
        return ScoreGap(None, 0.0, worse=False, better=False)
    score = float(gaps.sum())
    error = float(np.sqrt(count) * np.std(gaps, ddof=1))
    sure = max(WORSE_BY_ERRORS * error, WORSE_BY_SCORE)
    return ScoreGap(score, error, worse=score < -sure, better=score > sure)
