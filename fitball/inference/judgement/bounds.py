"""Best values on a hard bound of a prior, and what the data favour without it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from fitball.base.display_units import PLAIN
from fitball.base.errors import Note
from fitball.base.numbers import fixed
from fitball.base.text import listed
from fitball.base.values import FloatArray
from fitball.inference.derived import Quantity
from fitball.inference.judgement.first_order import FirstOrder, gradients
from fitball.inference.problem.problem import Problem
from fitball.inference.schema import PointFit
from fitball.inference.search.objective import Objective, descend

# Widths of the prior within which a value lies on a bound: searches keep bounds but for rounding.
ON_BOUND = 1e-6
# Sds by which a pattern of residuals, or a bound, moves a value that is conditional. Chosen by
# hand.
CONDITIONAL_SHIFT = 1.0


class AtBounds(NamedTuple):
    """Parameters whose best value lies on a hard bound of their prior, within the limits of the
    parameter itself: that bound, and the best value without it (both in SI, by name); `moves` has
    by how many of its sds each quantity then moves.
    """

    bound: Mapping[str, float]
    beyond: Mapping[str, float]
    moves: Mapping[str, float]

    def reason(self, name: str, prior: str) -> str:
        """Why the data do not determine a parameter on a bound of its `prior`; "" elsewhere."""
        if name not in self.bound:
            return ""
        beyond = PLAIN.number(self.beyond[name])
        return (
            f"Its best value lies on the bound {self.bound[name]:.4g} of its prior {prior}; "
            f"without that bound it is {beyond}."
        )

    def doubts(self) -> dict[str, str]:
        """For each quantity that the bounds move by more than an sd, a sentence that says so."""
        names = listed(self.bound)
        return {
            name: f"But the bound of the prior of {names} moves it by {fixed(by, 1)} of its sds."
            for name, by in self.moves.items()
            if by > CONDITIONAL_SHIFT and name not in self.bound
        }

    def notes(self, problem: Problem) -> Iterator[Note]:
        """A note (`at-bound`) for each parameter on a bound, with what to do."""
        priors = {parameter.spec.name: parameter.prior for parameter in problem.parameters}
        for name in self.bound:
            reason = self.reason(name, priors[name].text)
            remedy = "Look at the prior (`--prior`, or [prior] of the scene)."
            yield Note("at-bound", f"{name}: {reason[0].lower()}{reason[1:]} {remedy}")


NO_BOUNDS = AtBounds({}, {}, {})


def at_bounds(
    problem: Problem,
    point: PointFit,
    first: FirstOrder,
    derived: Sequence[Quantity],
) -> AtBounds:
    """The best values on bounds of priors, and what moves without these bounds. Limits of the
    parameter itself, such as zero friction, are no bounds of a prior.
    """
    prior = problem.prior
    x = problem.coordinates(point.optima[0])
    bounds = dict[str, float]()
    low, high = prior.low.copy(), prior.high.copy()
    for k, parameter in enumerate(prior.parameters):
        spec = parameter.spec
        least, largest = parameter.prior.limits
        near = ON_BOUND * prior.width[k]
        kind = parameter.prior.coordinate_kind
        with np.errstate(divide="ignore"):
            # A parameter that may be zero has a logarithm without lower end.
            limits = kind.of(np.clip([spec.lower, spec.upper], kind.lower, kind.upper))
        if least > spec.lower and x[k] - prior.low[k] <= near:
            bounds[spec.name] = least
            low[k] = limits[0]
        elif largest < spec.upper and prior.high[k] - x[k] <= near:
            bounds[spec.name] = largest
            high[k] = limits[1]
    if not bounds:
        return NO_BOUNDS
    opened = replace(problem, prior=replace(prior, low=low, high=high))
    reached, _, _ = descend(Objective(opened), x[None])
    values = problem.values(reached)
    return AtBounds(
        bounds,
        {name: float(values[name][0]) for name in bounds},
        _moves(problem, first, derived, np.stack([x, reached[0]])),
    )


def _moves(
    problem: Problem,
    first: FirstOrder,
    derived: Sequence[Quantity],
    ends: FloatArray,
) -> dict[str, float]:
    """By how many of its sds each quantity differs between two places `ends` (2, coordinates)."""
    values = problem.values(ends)
    following = gradients(problem, first.proposal.centre, derived)
    slopes = np.concatenate([np.eye(len(problem.free)), following])
    sds = np.linalg.norm(slopes @ first.proposal.factor, axis=1)
    columns = [*ends.T, *(quantity.rule(values) for quantity in derived)]
    away = np.abs(np.diff(np.stack(columns), axis=1)[:, 0])
    shifts = np.divide(away, sds, out=np.zeros_like(away), where=sds > 0.0)
    names = [*problem.free, *(quantity.spec.name for quantity in derived)]
    return dict(zip(names, shifts.tolist(), strict=True))
