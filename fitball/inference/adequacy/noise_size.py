"""How large is the noise that the residuals show, against what was stated, or what was expected?"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.special import chdtrc, ndtr

from fitball.inference.adequacy.refit import Refit
from fitball.inference.problem.parameters import FORCE_NOISE, Parameter
from fitball.inference.problem.priors import Prior
from fitball.inference.problem.problem import Problem
from fitball.inference.results.adequacy import FALSE_EXCEPT, NoiseCheck
from fitball.inference.results.results import PointFit

# From this multiple of what was stated or expected a noise is worth telling.
WORSE = 1.2


def noise_checks(problem: Problem, point: PointFit, fit: Refit, share: float) -> tuple[NoiseCheck, ...]:
    """Each noise against what was known of it, adjusted for their number (Holm 1979) times `share` families."""
    known = {parameter.name: parameter for parameter in problem.parameters}
    checks = []
    for number, name in enumerate(fit.noises):
        columns = tuple(column for k, column in enumerate(fit.columns) if fit.noise_of(k) == number)
        freedom = float(fit.freedom[number])
        if freedom < 1.0:
            continue
        scale = float(fit.scales(fit.measured[None, :])[0, number])
        if name not in known:
            checks.append(_stated(name, columns, "", scale, 1.0, freedom))
        elif known[name].fixed is not None:
            unit, size = known[name].spec.unit, point.values[name]
            checks.append(_stated(name, columns, unit, scale * size, size, freedom))
        else:
            # The residuals of heavy tails are not in units of their scale, which the fit has found.
            fitted = point.values[name] * (1.0 if problem.noise.parameters else scale)
            checks.append(_expected(known[name], columns, fitted, freedom))
    if problem.force is not None:
        free = [parameter for parameter in problem.free if parameter.name in FORCE_NOISE]
        nodes = float(problem.force.nodes)
        checks += [_expected(item, ("force",), point.values[item.name], nodes) for item in free]
    return _holm(checks, share)


def _stated(
    name: str, columns: tuple[str, ...], unit: str, fitted: float, stated: float, freedom: float
) -> NoiseCheck:
    p = float(chdtrc(freedom, freedom * (fitted / stated) ** 2))
    return NoiseCheck(name, columns, unit, True, fitted, stated, freedom, fitted / stated, p, p, False)


def _expected(parameter: Parameter, columns: tuple[str, ...], fitted: float, freedom: float) -> NoiseCheck:
    median = float(parameter.prior.quantile(np.array([0.5]))[0])
    p = _upper_tail(parameter.prior, fitted, freedom)
    name, unit = parameter.name, parameter.spec.unit
    return NoiseCheck(name, columns, unit, False, fitted, median, freedom, fitted / median, p, p, False)


def _upper_tail(prior: Prior, fitted: float, freedom: float) -> float:
    """Probability, before the table, of a noise that comes out as large with so many degrees of freedom."""
    at = float(prior.coordinate(np.array(fitted)))
    error = (1.0 if prior.log else fitted) / math.sqrt(2.0 * freedom)
    if prior.normal:
        return float(ndtr((prior.a - at) / math.hypot(prior.b, error)))
    low, high = prior.support
    # A uniform density knows no size that would be improbable but by its ends.
    return float(ndtr((high - at) / error)) if at > high else (high - max(at, low)) / (high - low)


def _holm(checks: Sequence[NoiseCheck], share: float) -> tuple[NoiseCheck, ...]:
    order = sorted(range(len(checks)), key=lambda k: checks[k].p)
    adjusted = list(checks)
    largest = 0.0
    for place, k in enumerate(order):
        largest = max(largest, min(1.0, (len(checks) - place) * checks[k].p))
        p = min(1.0, share * largest)
        adjusted[k] = replace(checks[k], adjusted=p, found=p < FALSE_EXCEPT and checks[k].ratio >= WORSE)
    return tuple(adjusted)
