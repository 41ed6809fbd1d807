"""All tests of the data, beside those of simulated data sets; of a long table these have fewer rows.

Each simulated data set costs as much as the data, and gives probabilities only, which hardly depend on the number of
rows. So where they would be longer than `MADE` measurements they are simulated at a part of the rows, evenly spread;
the data are tested whole. Statistics without a probability of their own, such as the correlation of neighbours, get
mean and sd of the shorter data sets, scaled by rows. The shape of the noise is tested in that part where it takes a
sum over draws, or where only simulated data sets give its probability.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from fitball.inference.adequacy.looks import DISTRIBUTED, KINDS, Look, Tables, distributions, looks_of, scored
from fitball.inference.adequacy.refit import EVERY, Pattern, Refit, pattern, refit, standard_deviates
from fitball.inference.likelihood.posterior import impact_terms
from fitball.inference.prediction.posterior_predictive import measurements
from fitball.inference.problem.parameters import NOISE_SPECS
from fitball.inference.problem.problem import Problem
from fitball.inference.problem.subsample import impacts_in_parts, part_of, thinned_rows
from fitball.inference.results.results import PointFit, Posterior, thinned
from fitball.inference.sampling.importance import K_TRUSTED, equal_draws, refitted, smoothed
from fitball.models.types import Rebound
from fitball.values import FloatArray

# Probability integral transforms of measurements that were left out: is each where the others predict it?

# Draws that stand for a posterior, and rows beyond which leaving one of them out changes nothing that could be seen.
DRAWS, LEFT_OUT = 1000, 400
# Effective draws of a refit: a share is then known to 0.04, less than one place among 15 that are looked at together.
REFIT_DRAWS = 200.0


def loo_pit(problem: Problem, posterior: Posterior, rng: np.random.Generator) -> FloatArray:
    """The share of the posterior without its impact that predicts less than each measurement, (columns, impacts), NaN
    where there is none.

    By Pareto smoothed importance sampling (Vehtari, Gelman and Gabry 2017; the weights are ArviZ's), each draw with a
    noise of its own; where its k is not to be trusted by a refit, if that settles.
    """
    values, leave_out = thinned(posterior, DRAWS), len(problem.impacts) <= LEFT_OUT
    parts = [_at_impacts(part, values, leave_out, rng) for _rows, part in impacts_in_parts(problem, len(values))]
    shares, whole, pareto_k = (np.concatenate(of, axis=-1) for of in zip(*parts, strict=True))
    columns = [observable.name for observable in problem.observables]
    for row in np.flatnonzero(~(pareto_k <= K_TRUSTED)).tolist():
        again = refitted(problem, equal_draws(values), whole[:, row], row, columns, rng, REFIT_DRAWS)
        if again is not None:
            alone, drawn = part_of(problem, np.array([row])), again.draws
            weights = np.exp(drawn.log_weights)[:, None]
            shares[:, row] = _shares(alone, drawn.values, alone.rebound(drawn.values), weights, rng)[:, 0]
    return shares


def _at_impacts(
    problem: Problem, values: FloatArray, leave_out: bool, rng: np.random.Generator
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """The shares by smoothed weights, the log likelihood (draws, impacts) of each impact, and the Pareto k (impacts,)
    of leaving it out; -inf where none is left out.
    """
    rebound = problem.rebound(values)
    whole = np.sum(list(impact_terms(problem, values, rebound).values()), axis=0)
    found = [smoothed(-one if leave_out else np.zeros(len(values)), 1.0) for one in whole.T]
    weights = np.exp(np.stack([own for own, _k in found], axis=1))
    return _shares(problem, values, rebound, weights, rng), whole, np.array([k for _own, k in found])


def _shares(
    problem: Problem, values: FloatArray, rebound: Rebound, weights: FloatArray, rng: np.random.Generator
) -> FloatArray:
    """The share of draws (draws, free) with `weights` (draws, impacts) that lie below each measurement."""
    shares = []
    for observable, _predicted, _spread, data in measurements(problem, problem.all_values(values), rebound, rng):
        below = (data < observable.observed) + 0.5 * (data == observable.observed)
        shares.append(np.where(np.isnan(observable.observed), np.nan, np.sum(weights * below, axis=0)))
    return np.stack(shares)


# Tables that the checks are held against, fewer of many rows, so that there are at most so many residuals.
MOST_TABLES, LEAST_TABLES, RESIDUALS = 1999, 399, 4_000_000
# Measurements of a made table, at most.
MADE = RESIDUALS // LEAST_TABLES


@dataclass(frozen=True)
class Looked:
    """What was seen: the checks, how many tables were made and of how many impacts, and the probabilities (columns,
    impacts) of measurements that were left out, None of a long table or without a posterior.
    """

    looks: Sequence[Look]
    tables: int
    impacts: int
    left_out: FloatArray | None


def look_at(
    problem: Problem,
    point: PointFit,
    posterior: Posterior | None,
    fit: Refit,
    found: Sequence[Pattern],
    rng: np.random.Generator,
) -> Looked:
    """Look at the residuals of `fit` for the patterns `found`, and for all else."""
    tables = max(LEAST_TABLES, min(MOST_TABLES, RESIDUALS // fit.measured.size))
    if fit.measured.size <= MADE:
        looks, left_out = _beside_made(problem, point, posterior, fit, found, tables, rng)
        return Looked(looks, tables, fit.impacts, left_out)
    rows = thinned_rows(problem, MADE // len(fit.columns))
    part = part_of(problem, rows)
    small = refit(part, point)
    beside, _ = _beside_made(part, point, posterior, small, _at_part(fit, small, rows, found), tables, rng)
    chances = {look.key: look for look in beside}
    looks = []
    for look in looks_of(problem, Tables(fit, fit.measured[None, :]), found):
        chance = chances.get(look.key)
        if chance is None or not (problem.noise.parameters and KINDS[look.kind].shaped):
            chance = _joined(look, chance, small.measured.size / fit.measured.size, tables, rng)
        looks.append(chance)
    return Looked([*looks, *(look for look in beside if look.kind == "loo-pit")], tables, small.impacts, None)


def _beside_made(
    problem: Problem,
    point: PointFit,
    posterior: Posterior | None,
    fit: Refit,
    found: Sequence[Pattern],
    count: int,
    rng: np.random.Generator,
) -> tuple[list[Look], FloatArray | None]:
    """The checks of a table and of `count` that the model makes at its rows."""
    sizes = {name: value for name, value in point.values.items() if name in NOISE_SPECS}
    made = fit.replicate(standard_deviates(problem, fit, sizes, count, rng))
    tables, left_out = Tables(fit, np.concatenate([fit.measured[None, :], made])), None
    if posterior is not None and fit.impacts >= DISTRIBUTED:
        left_out = loo_pit(problem, posterior, rng)
    looks = looks_of(problem, tables, found)
    return [*looks, *(distributions(tables, left_out) if looks else ())], left_out


def _at_part(fit: Refit, small: Refit, rows: NDArray[np.int64], found: Sequence[Pattern]) -> list[Pattern]:
    """The patterns at the impacts `rows`, but those that only others have."""
    kept = []
    for item in found:
        columns = range(len(fit.columns)) if item.column == EVERY else [item.column]
        places = [np.searchsorted(fit.places[k], rows[small.places[k]]) + fit.starts[k] for k in columns]
        shape = item.shape[np.concatenate(places) - fit.rows(item.column).start]
        own = pattern(small, item.column, item.kind, item.over, item.words, shape)
        kept += [] if own is None else [own]
    return kept


def _joined(look: Look, chance: Look | None, shorter: float, tables: int, rng: np.random.Generator) -> Look:
    """A check of the table, with the chances of made ones, whose rows are a share `shorter`."""
    if chance is None:
        # A pattern of too few impacts to be among those of made tables: its probability is right by itself.
        made, p, chances = np.zeros(tables), look.p, rng.uniform(size=tables)
    else:
        kind, made, p, chances = KINDS[look.kind], chance.seen[1:], look.p, chance.p[1:]
        if kind.scored:
            p = scored(look.seen, made, sides=1 if look.kind == "order" else 2, shorter=shorter)
        made = made * shorter**kind.falls
    return replace(look, seen=np.append(look.seen[:1], made), p=np.append(p[:1], chances))
