"""How large the numerical error of the rebounds is, beside the measurement error and the posterior width."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from fitball.inference.problem.observables import PREDICTED
from fitball.inference.problem.problem import Problem
from fitball.inference.results.fitted_model import FittedModel
from fitball.inference.results.results import BudgetLine, ErrorBudget, Golden, PointFit, Predictive
from fitball.models.registry import model
from fitball.models.two_mass_model import TwoMassModel
from fitball.models.types import Phase, Rebound, Status
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

    A two-mass ball is compared with an independent integration of the same motion, unless that would take forever.
    The other models are algebraic, and only rounding moves them: there the change is taken when each input moves by
    one unit in the last place.
    """
    chosen = model(fitted.model_name, ball=fitted.ball, tangential=fitted.tangential, **fitted.options)
    two_mass = isinstance(chosen, TwoMassModel) and fitted.tangential
    if isinstance(chosen, TwoMassModel) and two_mass and _integration_steps(chosen, golden) <= AFFORDED:
        error, reference = _against_oracle(chosen, golden), INDEPENDENT
    else:
        error, reference = _by_rounding(fitted, golden), STIFF if two_mass else ROUNDED
    widths = (
        {} if prediction is None else {item.name: item.mean_q84 - item.mean_q16 for item in prediction.observables}
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


def _against_oracle(chosen: TwoMassModel, golden: Golden) -> Mapping[str, FloatArray]:
    # Its imports take a quarter of a second, which only a calibration needs.
    from fitball.models.oracle.oracle import oracle_rebound

    exact = oracle_rebound(chosen.closures, chosen.ball, golden.parameters, golden.impacts)
    return _differences(golden.rebound, exact)


def _integration_steps(chosen: TwoMassModel, golden: Golden) -> float:
    """Steps of the independent integration for the impact that takes most: so many times its fastest pole's time."""
    from fitball.models.oracle.expm import STEPS_PER_POLE_TIME
    from fitball.models.oracle.oracle import DOUBLE
    from fitball.models.oracle.phases import Equations
    from fitball.models.oracle.setup import arrange

    most = 0.0
    for index in range(len(golden.impacts)):
        arranged = arrange(DOUBLE, chosen.closures, chosen.ball, golden.parameters, golden.impacts, index)
        if isinstance(arranged, Status):
            continue
        for phase in (Phase.SLIDE_FORWARD, Phase.GRIP):
            poles = np.linalg.eigvals(np.array(Equations(arranged).matrix(phase), dtype=np.float64))
            most = max(most, float(np.max(np.abs(poles))) * float(arranged.loaded) * STEPS_PER_POLE_TIME)
    return most


def _by_rounding(fitted: FittedModel, golden: Golden) -> Mapping[str, FloatArray]:
    given = golden.impacts
    base = fitted.rebound(given)
    values = np.repeat(fitted.point[None, :], fitted.point.size, axis=0)
    np.fill_diagonal(values, np.nextafter(fitted.point, np.inf))
    moved = [_differences(fitted.rebound(given, row[None, :]), base) for row in values]
    for name in ("v_x1", "v_y1", "omega_1"):
        other: Impacts = replace(given, **{name: np.nextafter(getattr(given, name), np.inf)})
        moved.append(_differences(fitted.rebound(other), base))
    return {name: np.sum([item[name] for item in moved], axis=0) for name in moved[0]}


def _differences(one: Rebound, other: Rebound) -> Mapping[str, FloatArray]:
    """Absolute differences of every column that can be measured, where both are known."""
    found = {}
    for name, predict in PREDICTED.items():
        gap = np.abs(predict(one) - predict(other))
        found[name] = gap[np.isfinite(gap)]
    return found
