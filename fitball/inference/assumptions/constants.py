"""What depends on a constant that the data hardly determine: mass, radius and moment of inertia of the ball, and
what a camera was held to.

To first order, from the draws of the fit itself. Of a constant that is held, the posterior mean of a quantity moves
by its covariance with the slope of the log density over that constant (Gustafson 1996, *Ann. Statist.* 24, 174); of
one that is free under a normal prior, by its covariance with the constant over the variance of that prior.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import replace

import numpy as np

from fitball.data.heights import ITF_LIMITS
from fitball.inference.identifiability.derived import quantities
from fitball.inference.identifiability.information import first_order_draws
from fitball.inference.likelihood.posterior import densities
from fitball.inference.prediction.court_pace import pace_by_surface
from fitball.inference.problem.build import as_if_filmed
from fitball.inference.problem.camera import CAMERA_SPECS, CLOCK, HEIGHT, SCALE, TILT
from fitball.inference.problem.problem import Problem
from fitball.inference.problem.subsample import LOOKED_AT, thinned_problem
from fitball.inference.results.assumptions import Constant
from fitball.inference.results.results import PointFit, Posterior, thinned
from fitball.models.registry import model
from fitball.models.specs import BALL_PARAMETERS
from fitball.values import Ball, FloatArray

# Draws from which covariances are taken, fewer where force was recorded: a correlation has a standard error of a
# thirtieth, or a twelfth.
DRAWS, RECORDED = 1000, 150
# Sds to each side that stand for the range of a constant.
REACH = 2.0
# Sd of I/(M R^2) of a tennis ball: the bifilar test (0.5625), a thick shell (0.56) and other measurements (0.55)
# agree within it.
INERTIA_SD = 0.015
# I/(M R^2) of round bodies, from the full sphere to the thin shell.
ROUND = (0.4, 2.0 / 3.0)
# Share of a range over which slopes are taken: no kink is passed, and rounding is far below.
STEP = 0.01
# Sds of its own, at a held constant, by which a value must move over the range of that constant to rest on it. At one
# sd to each side a 95 % interval holds 92 %.
MOVED = 1.0


# By how much a camera may be off that nobody looked at: half a degree of tilt, a ruler read to 1 %, a clock to 0.1 %,
# a court whose height was clicked to 3 mm.
CAMERA_REACH: Mapping[str, float] = {TILT: math.radians(0.5), SCALE: 0.01, CLOCK: 0.001, HEIGHT: 0.003}


def constants(
    problem: Problem, point: PointFit, posterior: Posterior | None, rng: np.random.Generator
) -> tuple[tuple[Constant, ...], Constant | None]:
    """The constants of ball and camera that move something, and what over which range; and what a tilt of the camera
    would move, None where something is known of that, or there is no motion along the court.
    """
    count = DRAWS if problem.force is None else RECORDED
    values = first_order_draws(problem, point, count, rng) if posterior is None else thinned(posterior, count)
    seen = () if problem.camera is None else tuple(problem.camera.names)
    found = (
        *(_free(problem, values, name) for name in (*BALL_PARAMETERS, *seen) if name in problem.free_names),
        *(_held(problem, values, *constant) for constant in _ranges(problem)),
    )
    tilt = None
    if problem.table.has_tangential and not problem.model.needs_cor and TILT not in map(_key, seen):
        reach = CAMERA_REACH[TILT]
        tilt = _held(problem, values, TILT, 0.0, (-reach, reach))
    return tuple(constant for constant in found if constant.parameters or constant.court_pace), tilt


def _key(name: str) -> str:
    """What a parameter of a session is."""
    return name.partition("[")[0]


def _ranges(problem: Problem) -> Iterator[tuple[str, float, tuple[float, float]]]:
    """Name, value, and range of each constant that is held: two of its sds where the scene states them, else the
    ITF's tolerance, or what shells allow; of a camera `CAMERA_REACH`.
    """
    scene = problem.scene
    held = {item.name: item.fixed for item in problem.parameters if item.fixed is not None}
    for name in BALL_PARAMETERS:
        key = name.removeprefix("ball_")
        value = held.get(name, float(getattr(scene.ball, key)))
        if name in problem.free_names:
            continue
        sd = scene.ball_sd.get(key, INERTIA_SD if key == "inertia_ratio" and scene.tennis else None)
        low, high = ROUND if key == "inertia_ratio" else ITF_LIMITS[key]
        if sd is not None:
            yield name, value, (value - REACH * sd, value + REACH * sd)
        # Of a ball of another kind nothing is known but what the scene states.
        elif low <= value <= high:
            yield name, value, (low, high)
    for name, value in held.items():
        if (reach := CAMERA_REACH.get(_key(name))) is not None:
            yield name, value, (value - reach, value + reach)


def _with(problem: Problem, name: str, value: float) -> Problem:
    """The problem of a ball or a camera whose constant `name` is another."""
    if any(item.name == name for item in problem.parameters):
        changed = tuple(replace(item, fixed=value) if item.name == name else item for item in problem.parameters)
        return replace(problem, parameters=changed)
    if name in CAMERA_SPECS:
        return as_if_filmed(problem, name, value)
    given, ball = problem.model, problem.model.ball
    known = {"ball_mass": ball.mass, "ball_radius": ball.radius, "inertia_ratio": ball.inertia_ratio, name: value}
    mass, radius, ratio = known.values()
    other = Ball(mass, radius, ratio * mass * radius**2)
    return replace(problem, model=model(given.name, ball=other, tangential=given.tangential, **given.options))


def _held(problem: Problem, values: FloatArray, name: str, value: float, ends: tuple[float, float]) -> Constant:
    step = STEP * (ends[1] - ends[0])
    sides = [_with(problem, name, at) for at in (value - step, value + step)]
    below, above = (_log_density(side, values) for side in sides)
    slope = (above - below) / (2.0 * step)
    # A draw that is impossible beside the fit's own constant tells no slope.
    kept = np.isfinite(slope)
    paces = [pace_by_surface(side, values[kept]) for side in sides]
    direct = {surface: (paces[1][surface] - paces[0][surface]) / (2.0 * step) for surface in paces[0]}
    reach = np.array(ends) - value
    return _constant(problem, values[kept], Constant(name, True, value, *ends, {}, {}), slope[kept], reach, direct)


def _free(problem: Problem, values: FloatArray, name: str) -> Constant:
    """A constant that is fitted, under a prior whose centre is as uncertain as its sd."""
    column = problem.free_names.index(name)
    prior = problem.free[column].prior
    reach = REACH * prior.variance**0.5 * np.array([-1.0, 1.0])
    own = Constant(name, False, prior.a, prior.a + float(reach[0]), prior.a + float(reach[1]), {}, {})
    return _constant(problem, values, own, values[:, column] / prior.variance, reach, {})


def _constant(
    problem: Problem,
    values: FloatArray,
    own: Constant,
    score: FloatArray,
    reach: FloatArray,
    direct: Mapping[str, FloatArray],
) -> Constant:
    """What depends on a constant, by draws `values` (draws, free) and their `score` (draws,): the covariance with it
    is what a quantity moves by for each unit of the constant, beside what that moves by itself (`direct`, draws).
    """
    score, far = score - score.mean(), float(np.abs(reach).max())
    known = dict(zip(problem.free_names, problem.to_coordinates(values).T, strict=True))
    priors = {item.name: item.prior for item in problem.free}
    for item in quantities(problem):
        known[item.parameter.name] = item.parameter.prior.coordinate(item.rule(values))
        priors[item.parameter.name] = item.parameter.prior
    rests = {}
    for name, column in known.items():
        told = np.isfinite(column)
        rate, left = float(np.mean(score[told] * column[told])), float(np.var(column[told]))
        if not own.held:
            # What is left of it where the constant is held: that is its own sd, to which a move is compared.
            left -= rate**2 / float(score.var())
        if name != own.name and far * abs(rate) > MOVED * max(left, 0.0) ** 0.5:
            moved = np.clip(np.median(column[told]) + reach * rate, *priors[name].ends)
            low, high = priors[name].value(moved)
            rests[name] = (float(low), float(high))
    found = {}
    for surface, rating in pace_by_surface(problem, values).items():
        told = np.isfinite(rating)
        if not np.any(told):
            continue
        rate = float(np.mean(score[told] * rating[told]))
        rate += float(np.nanmean(direct[surface])) if surface in direct else 0.0
        if far * abs(rate) > MOVED * float(np.std(rating[told])):
            low, high = np.median(rating[told]) + reach * rate
            found[surface] = (float(low), float(high))
    return replace(own, parameters=rests, court_pace=found)


def _log_density(problem: Problem, values: FloatArray) -> FloatArray:
    """Log density (draws,) of table and scene but for a constant, of a long table by a part of it; not finite where
    the model has no answer.
    """
    part = thinned_problem(problem, LOOKED_AT)
    found = densities(part, values)
    share = len(problem.impacts) / len(part.impacts)
    return np.where(found.possible, found.scene + share * found.likelihood, np.nan)
