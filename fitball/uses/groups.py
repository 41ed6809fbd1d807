"""Fits as groups of a hierarchy: the draws of one quantity, its interim prior, its spread between
tables.

Every fit with a posterior is a group, whatever its data say of the quantity: where they limit it on
one side only, that is what the group says. Whether a group counted would else depend on the value
that is averaged.
"""

from __future__ import annotations

from typing import Annotated

import numpy as np

from fitball.base.prior_families import Prior
from fitball.base.priors import ParameterSpec, parse_prior
from fitball.base.values import FloatArray
from fitball.inference.density import log_posterior
from fitball.inference.fitted import Fitted
from fitball.inference.problem.levels import SPREAD_FREEDOM, usual_spread
from fitball.inference.sampling.importance import RELIABLE_K, fit_student, importance
from fitball.uses.hierarchy import GROUP_DRAWS, Group, Hierarchy, drawn_group

# Verdicts of what the data determine, if only under assumptions.
DETERMINED_VERDICTS = ("identified", "given", "conditional")
# Draws of the prior of a quantity, where its density is a kernel density of draws.
PRIOR_DRAWS = 4_000
# Sds of a new group by which draws may lie off the centre when they are drawn near the population:
# wide enough that the prior which is divided out has heavier tails than what it is divided from.
_REACH = 2.0
# Effective draws of a fit that is drawn near the population, over those that stand for it.
_EFFECTIVE = 2.5


def group_of(fit: Fitted, name: str) -> Group | None:
    """A parameter or derived quantity of a fit as a group, in its coordinate; None for one that is
    fixed, or that the fit does not have, and for a fit without a posterior.
    """
    estimates = {entry.name: entry for entry in fit.reported}
    if fit.posterior is None or name not in estimates or estimates[name].verdict == "fixed":
        return None
    quantity = fit.quantity(name)
    log = is_log(quantity.spec)
    coordinates = coordinate(quantity.rule(fit.draws.values), log)
    finite = coordinates[np.isfinite(coordinates)]
    if not finite.size:
        return None
    return drawn_group(finite, lambda places: _log_prior(fit, name, log, places))


def group_near(
    fit: Fitted,
    name: str,
    population: Hierarchy,
    rng: np.random.Generator,
) -> Group | None:
    """The group of a fit, drawn anew where the `population` lies: its posterior times a normal
    density about that, which is divided out as part of the interim prior. None where the weights of
    these draws are unreliable.

    So tables and population are sampled jointly: given the population, tables are independent.
    """
    quantity = fit.quantity(name)
    log = is_log(quantity.spec)
    problem = fit.problem
    centre = float(population.new.mean())
    reach = _REACH * float(population.new.std())

    def nearness(places: FloatArray) -> FloatArray:
        """Log density (draws,) of coordinates about the population, up to a constant."""
        return np.asarray(-0.5 * ((places - centre) / reach) ** 2)

    def places_of(q: FloatArray) -> FloatArray:
        """Coordinates (draws,) of the quantity at those of all parameters, (draws, free)."""
        return coordinate(quantity.rule(problem.values(q)), log)

    def log_density(q: FloatArray) -> FloatArray:
        """Log density (draws,) of the posterior near the population."""
        near = nearness(places_of(q))
        return np.where(np.isfinite(near), log_posterior(problem, q) + near, -np.inf)

    columns = [fit.draws.values[parameter] for parameter in problem.free]
    drawn = problem.prior.coordinate(np.column_stack(columns))
    proposals = (fit_student(drawn), fit_student(drawn, nearness(places_of(drawn))))
    begin = [proposal for proposal in proposals if proposal is not None]
    if not begin:
        return None
    q, log_weights, pareto_k = importance(log_density, begin, rng, _EFFECTIVE * GROUP_DRAWS)
    if not pareto_k <= RELIABLE_K:
        return None
    cumulative = np.exp(log_weights).cumsum()
    steps = (np.arange(GROUP_DRAWS) + 0.5) / GROUP_DRAWS
    chosen = np.searchsorted(cumulative / cumulative[-1], steps)
    return drawn_group(
        places_of(q[chosen]),
        lambda places: _log_prior(fit, name, log, places) + nearness(places),
    )


def is_log(spec: ParameterSpec) -> bool:
    """Whether the coordinate of a quantity is its logarithm, whatever prior it has in one fit."""
    return spec.logarithmic or (spec.prior != "" and parse_prior(spec).log)


def coordinate(
    values: Annotated[FloatArray, "draws"],
    log: bool,
) -> Annotated[FloatArray, "draws"]:
    """Values in the coordinate in which populations are normal: their logarithms if `log`."""
    return np.log(values) if log else values


def _log_prior(fit: Fitted, name: str, log: bool, places: FloatArray) -> FloatArray:
    """Log density (draws,) of the prior of a quantity at coordinates `places` (draws,): exact for a
    parameter, else by a kernel density of draws.
    """
    priors = {parameter.spec.name: parameter.prior for parameter in fit.problem.prior.parameters}
    prior = priors.get(name)
    if prior is not None and "[" not in name:
        values = np.exp(places) if log else places
        # From the coordinate of the prior to that of the quantity.
        change = (places if log else 0.0) - np.log(prior.stretch(values))
        return np.asarray(prior.log_density(prior.coordinate(values)) + change)
    from scipy.stats import gaussian_kde

    drawn = coordinate(fit.prior_draws(name, PRIOR_DRAWS), log)
    density = gaussian_kde(drawn[np.isfinite(drawn)])
    return np.asarray(density.logpdf(places))


def spread_prior(fit: Fitted, name: str) -> Prior:
    """The prior of the spread of a quantity between tables: as between the levels of a parameter of
    which nothing was published.
    """
    log = is_log(fit.quantity(name).spec)
    drawn = coordinate(fit.prior_draws(name, PRIOR_DRAWS), log)
    drawn = drawn[np.isfinite(drawn)]
    size = usual_spread(float(np.median(drawn)), float(drawn.std()), log)
    spec = ParameterSpec(
        f"{name}_spread",
        "",
        0.0,
        np.inf,
        f"half-t({size:.6g}, {SPREAD_FREEDOM})",
        "",
        "",
    )
    return parse_prior(spec)
