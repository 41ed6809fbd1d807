"""Measurements that lie farthest from their predictions."""

from __future__ import annotations

import numpy as np

from fitball.inference.adequacy.looks import standardised
from fitball.inference.adequacy.refit import Refit
from fitball.inference.problem.problem import Problem
from fitball.inference.results.adequacy import Misfit
from fitball.inference.results.results import PointFit
from fitball.values import FloatArray

# Misfits that are told, and columns' measurements that may be named.
TOLD = 5


def distances(fit: Refit) -> FloatArray:
    """Each measurement's distance from its prediction by all others, in sds of that prediction (measurements,)."""
    own: FloatArray = standardised(fit, fit.measured[None, :])[0]
    return own


def largest_misfits(problem: Problem, point: PointFit, fit: Refit) -> tuple[Misfit, ...]:
    """The largest, farthest first."""
    far = distances(fit)
    columns = problem.all_values(np.array([[point.values[name] for name in problem.free_names]]))
    told = []
    for k in np.argsort(-np.abs(far), kind="stable")[:TOLD]:
        column = int(np.searchsorted(fit.starts, k, side="right")) - 1
        own = int(k - fit.starts[column])
        observable = problem.observables[column]
        gap = problem.deviation(columns, observable, point.rebound)[0]
        measured = float(observable.observed[own])
        told.append(
            Misfit(
                problem.table.ids[fit.places[column][own]], observable.name, observable.column.unit, measured,
                measured - float(gap[own]), float(far[k]),
            )
        )  # fmt: skip
    return tuple(told)
