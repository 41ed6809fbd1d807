"""Which model contains which: one that does can fit no table worse, and if it seems to, its search has failed."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence

import numpy as np

from fitball.inference.comparison.results import ModelScore
from fitball.inference.likelihood.posterior import log_posterior
from fitball.inference.problem.problem import Problem
from fitball.models.kernels.contact import tied_inertia_split

# Log density that a search may leave unfound and be settled all the same.
SETTLED = 0.05
Values = Mapping[str, float]
# Closure, the option that contains and the one contained: the values that make the first into the second.
CLOSURES: Mapping[tuple[str, str, str], Callable[[Values], Values]] = {
    ("cor", "line", "mean"): lambda _values: {"cor_slope": 0.0},
    ("cor", "saturating", "mean"): lambda _values: {"cor_slope": 0.0},
    ("inertia", "table", "tied"): lambda values: {"inertia_split": float(tied_inertia_split(values["mass_ratio"]))},
}


def as_container(container: Problem, contained: Problem, values: Values) -> Values | None:
    """The `values` (all parameters by name) of the contained problem as values of the container, which then predicts
    the same; None where the one does not contain the other.
    """
    added = _added(container, contained, values)
    if added is None:
        return None
    complete = {**values, **added}
    free = {parameter.name: parameter for parameter in container.parameters}
    if not complete.keys() >= free.keys():
        return None
    for name, parameter in free.items():
        value, prior = complete[name], parameter.prior
        if parameter.fixed is not None and not math.isclose(parameter.fixed, value, rel_tol=1e-9):
            return None
        low, high = prior.support
        place = float(prior.coordinate(np.array(max(value, 0.0) if prior.log else value)))
        if parameter.free and not low <= place <= high:
            return None
    return {name: complete[name] for name in free}


def _added(container: Problem, contained: Problem, values: Values) -> Values | None:
    wide, narrow = container.model, contained.model
    more = set(wide.parameter_names) - set(narrow.parameter_names)
    if wide.absent_is_zero and narrow.absent_is_zero:
        alike = type(wide) is type(narrow) and wide.options == narrow.options
        contains = alike and set(narrow.parameter_names) < set(wide.parameter_names)
        return dict.fromkeys(more, 0.0) if contains else None
    if wide.options.keys() != narrow.options.keys() or not wide.options:
        return None
    added: dict[str, float] = {}
    for closure, option in wide.options.items():
        if option == narrow.options[closure]:
            continue
        known = CLOSURES.get((closure, option, narrow.options[closure]))
        if known is None:
            return None
        if closure == "inertia" and "mass_ratio" not in values:
            return None
        added |= known(values)
    return added


def settled_words(score: ModelScore, others: Sequence[str]) -> str:
    """That a model was searched again from what those it contains had found."""
    return (
        f"{score.name} contains {' and '.join(others)} and had fitted worse, which no maximum can: it was searched "
        f"again from theirs, and its log posterior is {score.fit.point.log_posterior:.2f} now"
    )


def alarm_words(name: str, others: Sequence[str]) -> str:
    """That a model fits worse than what it contains even so."""
    return (
        f"ALARM: {name} contains {' and '.join(others)} and fits worse even so: its maximum was not found, and "
        "nothing said of it here holds"
    )


def overtaken(score: ModelScore, others: Sequence[ModelScore]) -> dict[str, list[Values]]:
    """Models of `others` that `score`'s model contains and that fit better all the same, with the values from which
    its search has to begin anew.

    Either its maximum of the posterior lies below its own density at what they found, or its likelihood without
    priors has a lower maximum than theirs.
    """
    problem = score.fit.problem
    better = {}
    for other in others:
        fits = (other.fit.point.values, other.fit.least_squares.values)
        starts = [start for values in fits if (start := as_container(problem, other.fit.problem, values)) is not None]
        if other is not score and starts and _loses(score, other, starts):
            better[other.name] = starts
    return better


def _loses(score: ModelScore, other: ModelScore, starts: Sequence[Values]) -> bool:
    problem = score.fit.problem
    rows = np.array([[start[name] for name in problem.free_names] for start in starts])
    density = log_posterior(problem, problem.to_coordinates(rows))
    if np.any(density > score.fit.point.log_posterior + SETTLED):
        return True
    mine, theirs = score.criteria, other.criteria
    return mine is not None and theirs is not None and mine.log_likelihood < theirs.log_likelihood - SETTLED
