"""Several fits that a table cannot tell apart: maxima of the likelihood that lie far apart for their width."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from fitball.inference.identifiability.posterior_verdict import plain
from fitball.inference.identifiability.profile import DROP_95
from fitball.inference.identifiability.profile_path import best_top, free_searches, standard_errors
from fitball.inference.point.surface import Surface, surface_of
from fitball.inference.problem.problem import Problem
from fitball.values import FloatArray

# Standard errors, the smaller ones of two fits, by which a parameter must differ between them: beside a peak a
# plateau, on which a parameter acts no more, is another fit; two places on one plateau or ridge are not.
APART = 3.0
# Places on the straight way between two maxima at which the likelihood is looked at, and the
# span of its logarithm below which both are places of one fit, whose likelihood is flat: no odds to speak of (1.1).
BETWEEN, FLAT = 15, 0.1
# Rows up to which several fits are looked for: of long tables the likelihood is close to normal.
ROWS = 300


@dataclass(frozen=True)
class SeveralFits:
    """What several fits say: `words` for a reader, and the parameters that are not noise that all of them `agree` on;
    nothing of either where there is one fit.
    """

    words: str
    agree: frozenset[str]


def several_fits(problem: Problem, optima: Sequence[Mapping[str, float]]) -> SeveralFits:
    """The fits that searches from `optima`, each all parameters by name in SI, lead to, the best first: those within
    a drop of 1.92 of the best that differ in something.
    """
    one = SeveralFits("", frozenset())
    if len(problem.impacts) > ROWS:
        return one
    objective = surface_of(problem)
    scene = problem.contact_time is not None
    starts = objective.from_values(np.array([[optimum[name] for name in problem.free_names] for optimum in optima]))
    top, others = best_top(objective, starts, scene)
    kept, errors, costs = [top.x], [_errors(objective, top.x, scene)], [top.cost]
    for x in others:
        cost = float(objective.cost(x[None, :], free_searches(objective, x[None, :], scene).given)[0])
        error = _errors(objective, x, scene)
        near = [
            np.all(np.abs(x - y) < APART * np.minimum(error, known)) for y, known in zip(kept, errors, strict=True)
        ]
        if cost - top.cost < DROP_95 and not any(near) and not _joined(objective, kept, x, scene):
            kept.append(x)
            errors.append(error)
            costs.append(cost)
    if len(kept) < 2:
        return one
    return _told(objective, np.array(kept), np.array(errors), np.array(costs) - top.cost, scene)


def _joined(objective: Surface, kept: Sequence[FloatArray], x: FloatArray, scene: bool) -> bool:
    """Whether the straight way from `x` to one of the fits `kept` is flat all along, as on a plateau."""
    shares = np.linspace(0.0, 1.0, BETWEEN)[:, None]
    for y in kept:
        way = x + shares * (y - x)
        cost = objective.cost(way, free_searches(objective, way, scene).given)
        if float(np.ptp(cost)) < FLAT:
            return True
    return False


def _errors(objective: Surface, x: FloatArray, scene: bool) -> FloatArray:
    return standard_errors(objective, x[None, :], scene)[objective.columns]


def _told(objective: Surface, x: FloatArray, errors: FloatArray, drops: FloatArray, scene: bool) -> SeveralFits:
    """What fits at `x` (fits, columns) say, with their standard errors and drops of the log likelihood."""
    apart = np.ptp(x, axis=0) > APART * errors.min(axis=0)
    names = [objective.problem.free[k].name for k in objective.columns]
    values = objective.values(x, free_searches(objective, x, scene).given)[:, objective.columns]
    units = [objective.problem.free[k].spec.unit for k in objective.columns]
    fits = []
    for row, drop in zip(values, drops, strict=True):
        told = ", ".join(
            f"{name} {plain(value, unit)}"
            for name, value, unit, differs in zip(names, row, units, apart, strict=True)
            if differs
        )
        fits.append(f"{told} (log likelihood {drop:.1f} below the best)" if drop > 0.0 else told)
    count = "Two" if len(fits) == 2 else str(len(fits))
    agree = frozenset(name for name, differs in zip(names, apart, strict=True) if not differs)
    same = f" They agree on {', '.join(name for name in names if name in agree)}." if agree else ""
    return SeveralFits(f"{count} fits describe the data: {'; or '.join(fits)}.{same}", agree)
