"""Weighted draws of fitted variants, of which more can be asked for, and what they say of a
quantity with its Monte Carlo error.
"""

from __future__ import annotations

from typing import Annotated, NamedTuple

import numpy as np
from msgspec.structs import replace

from fitball.base.selection import systematic
from fitball.base.values import FloatArray
from fitball.inference.density import log_posterior
from fitball.inference.judgement.variants import FittedVariant
from fitball.inference.problem.problem import Problem
from fitball.inference.sampling.importance import (
    RELIABLE_K,
    effective_size,
    fit_mixture,
    pareto_smoothed,
)
from fitball.inference.sampling.target import adapted, target_of
from fitball.inference.schema import Summary
from fitball.inference.summary import QUANTILE_SHARES

# Share of more draws from the fitted mixture; the others are from the first proposal, whose
# tails are heavy.
FITTED_SHARE = 0.9
# More draws at a time at least.
LEAST_ADDED = 1000.0
# More draws at a time over those that seem to be missing: the effective size is an estimate.
ADDED_AT_ONCE = 1.1
# Draws at most, over the effective draws that are wanted: unequal weights lower the effective size.
MOST_DRAWS = 3.0
# Errors of first draws over what their weights say. These adapt the proposals, and draws that the
# proposals miss leave no sign: over six tables medians and ends of two streams differed by 1.4 to
# 2.2 times what weights said, those of draws from mixtures fitted before by 1.05 to 1.3 times.
FIRST_ERRORS = 1.7
# Pareto k up to which draws are reliable that are so many, by their weights. A single draw may
# raise k above RELIABLE_K; beyond this, streams disagree by many of their errors.
DOUBTFUL_K = 0.85
LEAST_SIZE = 300.0
# Draws of a learnt density at which the exact one is compared with it.
COMPARED_DRAWS = 300
# Share of these draws that is effective under weights by the exact density, below which a learnt
# density is not used: log densities then differ by a tenth on average. Pareto k says less: where
# all weights agree that well a few that are larger are no tail.
LEAST_SHARE = 0.99


class Drawn(NamedTuple):
    """Draws of a density, that of `law`: coordinates, log weights, which add up to one, and their
    Pareto k. Errors of what they say are `optimism` times what weights say. Where the density is
    learnt there are also draws of equal weight from it, `compared`, and their weights by the exact
    density.
    """

    law: Problem
    x: Annotated[FloatArray, "draws coordinates"]
    log_weights: Annotated[FloatArray, "draws"]
    k: float
    compared: Annotated[FloatArray, "compared coordinates"]
    exact_weights: Annotated[FloatArray, "compared"]
    optimism: float = FIRST_ERRORS

    @property
    def reliable(self) -> bool:
        """Whether means of the draws may be used: by Pareto k, which is itself known to a tenth."""
        size = effective_size(self.log_weights) if len(self.x) else 0.0
        return self.k <= RELIABLE_K or (self.k <= DOUBTFUL_K and size >= LEAST_SIZE)


def first_draws(variant: FittedVariant, rng: np.random.Generator, enough: float) -> Drawn:
    """Draws of a variant by adaptive importance sampling, until so many are effective or there are
    too many. Where the exact density differs from the learnt one the exact one is sampled.
    """
    exact = variant.problem
    drawn = _adaptive(variant, variant.law, rng, enough)
    if drawn.law is exact or not len(drawn.x):
        return drawn
    compared = drawn.x[systematic(np.exp(drawn.log_weights), COMPARED_DRAWS, rng.uniform())]
    log_ratios = log_posterior(exact, compared) - log_posterior(drawn.law, compared)
    if not _agrees(log_ratios):
        return _adaptive(variant, exact, rng, enough)
    exact_weights = np.exp(log_ratios - np.logaddexp.reduce(log_ratios))
    return drawn._replace(compared=compared, exact_weights=exact_weights)


def _adaptive(
    variant: FittedVariant,
    law: Problem,
    rng: np.random.Generator,
    enough: float,
) -> Drawn:
    """Draws of a variant from the density of `law`, with nothing to compare."""
    target = target_of(law)
    weighted, evaluated = adapted(target, target.begin([variant.about]), rng, enough)
    x = np.empty((0, len(law.free)))
    log_weights = weighted.log_weights
    if len(weighted.x):
        log_weights = pareto_smoothed(log_weights, 1.0)[0]
        x = target.complete(weighted.x, evaluated, rng)[0]
    return Drawn(law, x, log_weights, weighted.k, x[:0], log_weights[:0])


def more_draws(
    variant: FittedVariant,
    drawn: Drawn,
    rng: np.random.Generator,
    enough: float,
) -> Drawn:
    """Draws of a variant in place of fewer, from a mixture that is fitted to these, until so many
    are effective or there are MOST_DRAWS times as many.
    """
    target = target_of(drawn.law)
    places = systematic(np.exp(drawn.log_weights), len(drawn.x), rng.uniform())
    alike = target.sampled(drawn.x[places])
    (about,) = target.begin([variant.about])
    fitted = [(FITTED_SHARE * share, student) for share, student in fit_mixture(alike, rng)]
    proposals = [*fitted, (1.0 - sum(share for share, _ in fitted), about)]
    shares = [share for share, _ in proposals]
    x = alike[:0]
    evaluated = np.empty((0, target.numbers))
    log_ratios = drawn.log_weights[:0]
    wanted = LEAST_ADDED
    while wanted >= 1.0:
        counts = rng.multinomial(round(wanted), shares)
        new = np.concatenate(
            [student.draw(rng, n) for n, (_, student) in zip(counts, proposals, strict=True)]
        )
        mixed = [np.log(share) + student.log_density(new) for share, student in proposals]
        found = target.evaluate(new)
        ratios = found[:, 0] - np.logaddexp.reduce(mixed)
        possible = np.isfinite(ratios)
        x = np.concatenate([x, new[possible]])
        evaluated = np.concatenate([evaluated, found[possible]])
        log_ratios = np.concatenate([log_ratios, ratios[possible]])
        if not len(x):
            return drawn
        size = effective_size(log_ratios - np.logaddexp.reduce(log_ratios))
        missing = max(LEAST_ADDED, ADDED_AT_ONCE * (enough / size - 1.0) * len(x))
        room = MOST_DRAWS * enough - len(x)
        wanted = 0.0 if size >= enough else min(missing, room)
    log_weights, k = pareto_smoothed(log_ratios, 1.0)
    x = target.complete(x, evaluated, rng)[0]
    return drawn._replace(x=x, log_weights=log_weights, k=k, optimism=1.0)


def _agrees(log_ratios: FloatArray) -> bool:
    """Whether ratios of the exact and a learnt density at draws from the latter are so alike that
    weights correct what is left.
    """
    if not np.isfinite(log_ratios).all():
        return False
    log_weights = log_ratios - np.logaddexp.reduce(log_ratios)
    return effective_size(log_weights) >= LEAST_SHARE * len(log_ratios)


class Weighed(NamedTuple):
    """A summary of weighted draws of a quantity, with the Monte Carlo errors of its median, of the
    ends of the central 95 %, and of half of the central 68 %, in the unit of the quantity.
    """

    summary: Summary
    median: float
    q025: float
    q975: float
    half: float


def weighed(
    values: Annotated[FloatArray, "draws"],
    weights: Annotated[FloatArray, "draws"],
    point: float,
    optimism: float = 1.0,
) -> Weighed:
    """What weighted draws say of a quantity, beside its value at the best fit, with errors that are
    `optimism` times what weights say. A draw without an answer is left out; all is NaN where half
    of the weight or more has none.
    """
    answered = np.isfinite(values)
    share = weights[answered].sum()
    if not 2.0 * share > weights.sum():
        nothing = Summary(point, *[np.nan] * 6)
        return Weighed(nothing, np.nan, np.nan, np.nan, np.nan)
    values = values[answered]
    weights = weights[answered] / share
    shares = np.array(QUANTILE_SHARES)
    order = np.argsort(values, kind="stable")
    below = np.cumsum(weights[order]) - 0.5 * weights[order]
    quantiles = np.interp(shares, below, values[order])
    # The error of a share of weighted draws, to first order in that of their sum.
    beyond = (values <= quantiles[:, None]) - shares[:, None]
    error = optimism * np.sqrt(np.sum((weights * beyond) ** 2, axis=1))
    beside = np.interp(np.stack([shares - error, shares + error]), below, values[order])
    errors = 0.5 * (beside[1] - beside[0])
    mean = weights @ values
    sd = float(np.sqrt(weights @ (values - mean) ** 2))
    q025, q16, median, q84, q975 = quantiles.tolist()
    summary = Summary(point, median, sd, q025, q16, q84, q975)
    of_half = 0.5 * float(np.hypot(errors[1], errors[3]))
    return Weighed(summary, float(errors[2]), float(errors[0]), float(errors[4]), of_half)


def corrected(
    learnt: Weighed,
    compared: Annotated[FloatArray, "compared"],
    exact_weights: Annotated[FloatArray, "compared"],
) -> Weighed:
    """What the exact density says of a quantity: what the learnt one says, moved and widened as a
    few draws are by their exact weights. Errors of these draws are nearly the same with and without
    weights, and cancel.
    """
    answered = np.isfinite(compared)
    if not answered.any():
        return learnt
    values = compared[answered]
    weights = exact_weights[answered] / exact_weights[answered].sum()
    middle = values.mean()
    sd = values.std()
    exact_middle = weights @ values
    exact_sd = np.sqrt(weights @ (values - exact_middle) ** 2)
    wider = float(exact_sd / sd) if sd > 0.0 else 1.0
    summary = learnt.summary
    names = ("median", "q025", "q16", "q84", "q975")
    moved = {
        name: float(exact_middle + wider * (getattr(summary, name) - middle)) for name in names
    }
    return learnt._replace(summary=replace(summary, sd=wider * summary.sd, **moved))
