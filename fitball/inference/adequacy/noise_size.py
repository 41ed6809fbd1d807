"""How large is the noise that the residuals show, against what was stated, or what was expected?"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.special import chdtrc, ndtr

from fitball.data.scene import NO_SPIN_SD, NO_VELOCITY_SD
from fitball.inference.adequacy.refit import Refit
from fitball.inference.problem.measurement_noise import expected_prior
from fitball.inference.problem.parameters import FORCE_NOISE, SD_SPECS, Parameter
from fitball.inference.problem.priors import Prior
from fitball.inference.problem.problem import Problem
from fitball.inference.results.adequacy import FALSE_EXCEPT, FAR_FROM_STATED, NoiseCheck
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
            checks.append(_expected(known[name], columns, fitted, freedom, _is_assumed(problem, name)))
    if problem.force is not None:
        free = [parameter for parameter in problem.free if parameter.name in FORCE_NOISE]
        nodes = float(problem.force.nodes)
        checks += [_expected(item, ("force",), point.values[item.name], nodes, True) for item in free]
    return _holm(checks, share)


def _stated(
    name: str, columns: tuple[str, ...], unit: str, fitted: float, stated: float, freedom: float
) -> NoiseCheck:
    p = float(chdtrc(freedom, freedom * (fitted / stated) ** 2))
    return NoiseCheck(name, columns, unit, True, fitted, stated, freedom, fitted / stated, p, p, False)


def _is_assumed(problem: Problem, name: str) -> bool:
    """Whether the scene says nothing of what noise to expect, or a prior says so much that its width counts."""
    prior = next(parameter.prior for parameter in problem.parameters if parameter.name == name)
    if prior.text != expected_prior(name, problem.scene, problem.table):
        return True
    unit = SD_SPECS[name].unit
    silence = {"rad/s": NO_SPIN_SD, "m/s": NO_VELOCITY_SD, "rad": NO_VELOCITY_SD}.get(unit)
    return silence is None or silence in problem.notes


def _expected(
    parameter: Parameter, columns: tuple[str, ...], fitted: float, freedom: float, assumed: bool
) -> NoiseCheck:
    median = float(parameter.prior.quantile(np.array([0.5]))[0])
    p = _upper_tail(parameter.prior, fitted, freedom)
    name, unit = parameter.name, parameter.spec.unit
    return NoiseCheck(name, columns, unit, False, fitted, median, freedom, fitted / median, p, p, False, assumed)


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
        far = not checks[k].assumed and checks[k].ratio >= FAR_FROM_STATED
        adjusted[k] = replace(checks[k], adjusted=p, found=far or (p < FALSE_EXCEPT and checks[k].ratio >= WORSE))
    return tuple(adjusted)
