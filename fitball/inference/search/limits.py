"""Where a maximum may be in a limit of the model: a shell without mass, while all impacts grip.

There the tangential motion is that of one mass on a spring, whose stiffness sets how far it swings
during the contact: several values fit, as several frequencies fit a short record. Draws of the
prior seldom come so near to a bound, one in a thousand within a thousandth of the range.
"""

from __future__ import annotations

from typing import Annotated

import numpy as np

from fitball.base.values import FloatArray, IntArray
from fitball.inference.problem.joint_prior import JointPrior
from fitball.inference.problem.problem import COMMON_PARAMETERS, Problem, base_of
from fitball.inference.search.objective import Objective, descend

# The parameter that has this limit at its upper bound.
MASS_RATIO_NAME = "mass_ratio"
# The parameter of friction. Where all impacts grip, nothing depends on it and the density has no
# kinks.
FRICTION_NAME = "mu"
# Sds of the prior of friction above its peak at which nearly all impacts grip.
GRIPPING_SDS = 3.0
# Distances from the bound, as shares of the range: log-uniform between the rounding of a shell that
# has a mass, and what draws of the prior reach.
NEAREST = 1e-5
FARTHEST = 1e-1
# Draws in the limit whose posterior is evaluated.
SCREENED = 1_000
# The best of these that lie apart, which are fitted within the limit.
FITTED = 12
# How far they lie apart at least, in widths of the priors.
APART = 0.5
# Gain promised by a step from which fits within the limit end, and rounds at most: they show where
# to look further.
ROUGH_GAIN = 1.0
MOST_ROUNDS = 25
# Places from which is searched with all coordinates free.
MOST_PLACES = 4
# Width of the prior, in logarithms, from which the order of magnitude of a value is unknown.
UNKNOWN_MAGNITUDE = 1.0


def places_in_limits(
    problem: Problem,
    best: Annotated[FloatArray, "coordinates"],
    rng: np.random.Generator,
) -> Annotated[FloatArray, "places coordinates"]:
    """The places in the limit of a light shell and a firm grip from which a search may reach
    another maximum than the `best`; none of a model, or of data, without these parameters. Values
    of unknown magnitude are drawn from the prior, and all others are at first the best ones.
    """
    prior = problem.prior
    light = _named(problem, MASS_RATIO_NAME)
    if not light.size or not _named(problem, FRICTION_NAME).size:
        return best[None][:0]
    x = np.tile(best, (SCREENED, 1))
    unknown = _unknown(problem)
    x[:, unknown] = prior.draw(rng, SCREENED)[:, unknown]
    logs = rng.uniform(np.log(NEAREST), np.log(FARTHEST), (SCREENED, 1))
    x[:, light] = prior.high[light] - np.exp(logs) * (prior.high - prior.low)[light]
    x, friction = raise_friction(problem, x)
    cost = Objective(problem).cost(x)
    chosen = x[_apart(prior, x, cost)]
    held = np.tile(np.concatenate([light, friction]), (len(chosen), 1))
    fitted, cost, _ = descend(Objective(problem, held=held), chosen, ROUGH_GAIN, MOST_ROUNDS)
    order = np.argsort(cost, kind="stable")
    return np.asarray(fitted[order[:MOST_PLACES]])


def raise_friction(
    problem: Problem,
    x: Annotated[FloatArray, "searches coordinates"],
) -> tuple[Annotated[FloatArray, "searches coordinates"], Annotated[IntArray, "frictions"]]:
    """Coordinates with friction moved so high that nearly all impacts grip, and the indices of the
    coordinates of friction, one a level.
    """
    prior = problem.prior
    moved = x.copy()
    friction = _named(problem, FRICTION_NAME)
    grip = np.minimum(prior.location + GRIPPING_SDS * prior.width, prior.high)
    moved[:, friction] = grip[friction]
    return moved, friction


def _named(problem: Problem, name: str) -> IntArray:
    """The indices of the free coordinates of a parameter, one a level."""
    indices = [k for k, free in enumerate(problem.free) if base_of(free) == name]
    return np.array(indices, dtype=np.int64)


def _unknown(problem: Problem) -> IntArray:
    """The indices of the parameters of the model whose order of magnitude is unknown."""
    prior = problem.prior
    wide = ~prior.plain & (prior.width >= UNKNOWN_MAGNITUDE)
    indices = [k for k in np.flatnonzero(wide) if base_of(problem.free[k]) not in COMMON_PARAMETERS]
    return np.array(indices, dtype=np.int64)


def _apart(prior: JointPrior, x: FloatArray, cost: FloatArray) -> list[int]:
    """The rows of the lowest costs, at most FITTED, that lie apart."""
    chosen = list[int]()
    for k in np.argsort(cost, kind="stable"):
        if not np.isfinite(cost[k]) or len(chosen) == FITTED:
            break
        distance = np.max(np.abs(x[chosen] - x[k]) / prior.width, axis=1)
        if np.all(distance > APART):
            chosen.append(int(k))
    return chosen
