"""How large the numerical error of the rebounds is, beside the measurement error and the posterior width."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from fitball.inference.problem.problem import Problem
from fitball.inference.results.fitted_model import FittedModel
from fitball.inference.results.results import BudgetLine, ErrorBudget, Golden, PointFit, Predictive
from fitball.models.types import Rebound
from fitball.observables import OBSERVABLES
from fitball.values import FloatArray, Impacts

INDEPENDENT = "an independent integration (matrix exponentials, events by bisection)"
ROUNDED = "the same closed form with every input rounded the other way"
STIFF = f"{ROUNDED} (shell and core swing too fast for {INDEPENDENT})"
# Steps an impact, of some microseconds, up to which the independent integration is worth its time.
AFFORDED = 1e5


def error_budget(
    problem: Problem, fitted: FittedModel, point: PointFit, prediction: Predictive | None, golden: Golden
) -> ErrorBudget:
    """The budget of every measured column, at the golden impacts and the point estimate.

    A model with an oracle is compared with that independent integration of the same motion, unless it would take
    forever. The others are algebraic, and only rounding moves them: there the change is taken when each input moves
    by one unit in the last place.
    """
    oracle = fitted.model.oracle
    if oracle is not None and oracle.steps(golden.parameters, golden.impacts) <= AFFORDED:
        exact = oracle.rebound(golden.parameters, golden.impacts)
        error, reference = _differences(golden.rebound, exact), INDEPENDENT
    else:
        error, reference = _by_rounding(fitted, golden), ROUNDED if oracle is None else STIFF
    widths = (
        {}
        if prediction is None
        else {predicted.name: predicted.mean_q84 - predicted.mean_q16 for predicted in prediction.observables}
    )
    lines = {}
    for observable in problem.observables:
        sd = observable.sds(point.values, point.rebound)
        lines[observable.name] = BudgetLine(
            numerical=float(np.max(error[observable.name], initial=0.0)),
            measurement=float(np.median(sd)),
            posterior=0.5 * float(np.median(widths[observable.name])) if observable.name in widths else None,
        )
    return ErrorBudget(len(golden.impacts), reference, lines)


def _by_rounding(fitted: FittedModel, golden: Golden) -> Mapping[str, FloatArray]:
    given = golden.impacts
    base = fitted.rebound(given)
    values = np.repeat(fitted.point[None, :], fitted.point.size, axis=0)
    np.fill_diagonal(values, np.nextafter(fitted.point, np.inf))
    moved = [_differences(fitted.rebound(given, row[None, :]), base) for row in values]
    for name in ("v_x1", "v_y1", "omega_1"):
        other: Impacts = replace(given, **{name: np.nextafter(getattr(given, name), np.inf)})
        moved.append(_differences(fitted.rebound(other), base))
    return {name: np.sum([differences[name] for differences in moved], axis=0) for name in moved[0]}


def _differences(one: Rebound, other: Rebound) -> Mapping[str, FloatArray]:
    """Absolute differences of every column that can be measured; zero where one is beyond a bound, not known."""
    gaps = {name: np.abs(column.predict(one) - column.predict(other)) for name, column in OBSERVABLES.items()}
    return {name: np.where(np.isfinite(gap), gap, 0.0) for name, gap in gaps.items()}
