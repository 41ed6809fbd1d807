"""What a drop test tells: restitution at the tested speeds, the rebound from 254 cm, balls apart from noise."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from fitball.data.columns import HEIGHTS
from fitball.data.heights import BALL_TYPES, DEFAULT_TYPE, DROP_HEIGHT
from fitball.inference.prediction.one_way import OneWay, one_way
from fitball.inference.prediction.posterior_predictive import with_noise
from fitball.inference.prediction.reach import calibrated_range
from fitball.inference.problem.problem import Problem
from fitball.inference.results.drop_test import (
    BallRebound,
    DropTest,
    Level,
    Passing,
    StandardRebound,
    TestedSpeed,
    Variation,
    drag,
    fall_speed,
    fall_speed_in_air,
    launch_speed_in_air,
    rise_height,
    rise_height_in_air,
    share_within,
)
from fitball.inference.results.quantiles import MOST_UNSOLVED, spread_of
from fitball.inference.results.results import PointFit, Posterior, thinned
from fitball.models.types import STATUS_REASON, Status
from fitball.values import FloatArray, Impacts

DRAWS = 4000
# Speeds closer to the next one than this share of themselves were meant to be the same.
SAME = 0.03
# More settings than this, or one that spreads further, are a range of speeds: its ends and its middle are told.
MOST_SPEEDS, WIDEST = 6, 0.15
BALLS = "ball"


@dataclass(frozen=True)
class _Law:
    """The restitution over speed: at the best values, and draws (None without a posterior)."""

    point: Callable[[float], float]
    draws: Callable[[float], FloatArray] | None


def drop_test(
    problem: Problem, point: PointFit, posterior: Posterior | None, rng: np.random.Generator
) -> DropTest | None:
    """The drop test of a table; None where balls were not dropped or their rebound was not measured."""
    table = problem.table
    # Where some rebounds are missing the impacts have no restitution as an input of a model.
    rebound = table.measurement("v_y2")
    measured = table.impacts.cor if rebound is None else rebound.values / table.impacts.v_y1
    if problem.model.tangential or np.any(table.impacts.v_x1 != 0.0) or measured is None:
        return None
    scene = problem.scene
    kind = scene.ball_type or DEFAULT_TYPE
    if problem.model.needs_cor:
        return _none(problem, kind, "closure cor = measured takes the restitution of each impact from the table")
    known = np.flatnonzero(np.isfinite(measured))
    if known.size == 0:
        return None
    # Another ball than a tennis ball is judged at no speed but those that were tested.
    speed = fall_speed(DROP_HEIGHT) if scene.tennis else float(np.median(table.impacts.v_y1[known]))
    found, variation = _balls(problem, known, measured[known], speed, rng)
    law = _fitted_law(problem, point, posterior, speed)
    if isinstance(law, str):
        return _none(problem, kind, law)
    if found is not None:
        law = _law_of_balls(found, law, table.impacts.v_y1[known], speed)
    settings = _settings(table.impacts.v_y1[known])
    # What one error of all landing speeds would be.
    sd = table.incident_sd.get("v_y1")
    return DropTest(
        speeds=tuple(_tested(law, table.impacts.v_y1[known], measured[known], rows) for rows in settings),
        rebound=_rebound(problem, law, found, kind, rng, posterior) if scene.tennis else None,
        ball_type=kind,
        type_stated=scene.ball_type is not None,
        balls_counted=found is not None,
        from_heights=any(set(notice.columns) == set(HEIGHTS) for notice in table.notices),
        variation=variation,
        balls=() if found is None or variation is None or not scene.tennis else _each(found, variation, kind),
        shared_error=None if sd is None else float(np.mean(measured[known] * sd[known] / table.impacts.v_y1[known])),
        temperature=scene.ball_temperature,
        missing="",
    )


def _none(problem: Problem, kind: str, why: str) -> DropTest:
    stated = problem.scene.ball_type is not None
    return DropTest((), None, kind, stated, False, False, None, (), None, problem.scene.ball_temperature, why)


def _settings(speeds: FloatArray) -> list[NDArray[np.int64]]:
    """Places of the impacts at each tested speed; of a range of speeds those nearest its ends and its middle."""
    order = np.argsort(speeds, kind="stable")
    gaps = np.flatnonzero(np.diff(speeds[order]) > SAME * speeds[order][:-1])
    groups = np.split(order, gaps + 1)
    if len(groups) <= MOST_SPEEDS and all(np.ptp(speeds[rows]) <= WIDEST * speeds[rows].min() for rows in groups):
        return groups
    ends = (speeds.min(), float(np.median(speeds)), speeds.max())
    near = [np.flatnonzero(np.abs(speeds - end) <= SAME * end) for end in ends]
    return [rows for rows in near if rows.size]


def _fitted_law(problem: Problem, point: PointFit, posterior: Posterior | None, speed: float) -> _Law | str:
    """Restitution as the model has it; the reason where it has none at the landing `speed` [m/s]."""
    best = np.array([[point.values[name] for name in problem.free_names]])
    values = None if posterior is None else thinned(posterior, DRAWS)

    def at(rows: FloatArray, speed: float) -> FloatArray:
        rebound = problem.rebound(rows, _drop(speed))
        solved = rebound.status[:, 0] == 0
        return np.asarray(np.where(solved, rebound.v_y2[:, 0] / speed, np.nan))

    for rows in (best, values):
        if rows is not None and np.mean(np.isnan(at(rows, speed))) > MOST_UNSOLVED:
            rebound = problem.rebound(rows, _drop(speed))
            return f"the model cannot be evaluated there: {STATUS_REASON[Status(int(rebound.status.max()))]}"
    return _Law(lambda v: float(at(best, v)[0]), None if values is None else lambda v: at(values, v))


def _balls(
    problem: Problem, known: NDArray[np.int64], cor: FloatArray, speed: float, rng: np.random.Generator
) -> tuple[OneWay | None, Variation | None]:
    """Balls apart from noise, where the table names them: the draws, and what is told of them."""
    labels = problem.table.labels.get(BALLS)
    if labels is None:
        return None, None
    names = tuple(dict.fromkeys(labels[k] for k in known))
    index = np.array([names.index(labels[k]) for k in known], dtype=np.int64)
    found = one_way(cor, _design(problem.table.impacts.v_y1[known], speed), index, rng)
    if isinstance(found, str):
        return None, Variation(BALLS, None, None, (), found)
    levels = tuple(
        Level(name, int(np.sum(index == k)), float(cor[index == k].mean()), spread_of(found.levels[:, k]))
        for k, name in enumerate(names)
    )
    return found, Variation(BALLS, spread_of(found.between), spread_of(found.within), levels, "")


def _design(speeds: FloatArray, speed: float) -> FloatArray:
    """A constant, and a line in speed from `speed` on where balls were dropped at several."""
    ones = np.ones(speeds.size)
    return np.stack([ones, speeds - speed] if len(_settings(speeds)) > 1 else [ones], axis=1)


def _law_of_balls(found: OneWay, fitted: _Law, speeds: FloatArray, speed: float) -> _Law:
    """Restitution of the mean ball: a line in speed where there are several; else what was found at the one speed,
    carried to others by the difference that the fit has between the two.
    """
    tested = float(speeds.mean())

    def draws(v: float) -> FloatArray:
        if found.coefficients.shape[1] > 1:
            return np.asarray(found.coefficients @ np.array([1.0, v - speed]))
        if fitted.draws is None:
            return np.asarray(found.coefficients[:, 0] + fitted.point(v) - fitted.point(tested))
        difference = fitted.draws(v) - fitted.draws(tested)
        return np.asarray(found.coefficients[:, 0] + np.resize(difference, found.within.size))

    return _Law(lambda v: float(np.nanmedian(draws(v))), draws)


def _tested(law: _Law, speeds: FloatArray, cor: FloatArray, rows: NDArray[np.int64]) -> TestedSpeed:
    speed = float(speeds[rows].mean())
    draws = None if law.draws is None else law.draws(speed)
    scatter = float(cor[rows].std(ddof=1)) if rows.size > 1 else None
    return TestedSpeed(
        speed, float(speeds[rows].min()), float(speeds[rows].max()), rows.size,
        spread_of(draws, law.point(speed)), float(cor[rows].mean()), scatter,
    )  # fmt: skip


def _rebound(
    problem: Problem,
    law: _Law,
    found: OneWay | None,
    kind: str,
    rng: np.random.Generator,
    posterior: Posterior | None,
) -> StandardRebound:
    speed = fall_speed(DROP_HEIGHT)
    k = drag(problem.model.ball)
    slower = fall_speed_in_air(DROP_HEIGHT, k)
    passing = dict.fromkeys(BALL_TYPES, Passing(None, None, None))
    mean = air = drop = None
    if law.draws is not None:
        cor = law.draws(speed)
        mean, air = rise_height(cor * speed), rise_height_in_air(law.draws(slower) * slower, k)
        ball = None
        if found is not None:
            other = cor + found.between * rng.standard_normal(cor.size)
            ball = rise_height(other * speed)
            drop = rise_height((other + found.within * rng.standard_normal(cor.size)) * speed)
        elif posterior is not None:
            drop = rise_height(_one_drop(problem, posterior, speed, rng))
        passing = {
            name: Passing(
                *(None if heights is None else share_within(heights, name) for heights in (mean, ball, drop))
            )
            for name in BALL_TYPES
        }
    at = law.point(speed)
    height = float(rise_height(np.array(at * speed)))
    reach = calibrated_range(problem.table.impacts, _drop(speed), problem.model.ball.radius, False, ()).beyond["v_y1"]
    return StandardRebound(
        speed=speed,
        height=spread_of(mean, height),
        drop=spread_of(drop, height),
        passing=passing,
        with_air=spread_of(air, float(rise_height_in_air(np.array(law.point(slower) * slower), k))),
        passing_with_air=None if air is None else share_within(air, kind),
        air_share=launch_speed_in_air(height, k) / slower / at - 1.0,
        beyond=float(reach[0]) if abs(reach[0]) > SAME * speed else 0.0,
    )


def _drop(speed: float) -> Impacts:
    """A ball that lands at this speed [m/s], (1,)."""
    return Impacts(np.zeros(1), np.array([speed]), np.zeros(1))


def _one_drop(problem: Problem, posterior: Posterior, speed: float, rng: np.random.Generator) -> FloatArray:
    """Rebound speed (draws,) of one more measured drop, balls and measurement together."""
    values = thinned(posterior, DRAWS)
    rebound = problem.rebound(values, _drop(speed))
    shown = next(item for item in problem.observables if item.column.velocity)
    # Where the table states the noise of each row, the new drop has that of a usual one.
    sd = None if shown.sd is None else np.array([float(np.median(shown.sd))])
    one = replace(shown, observed=np.zeros(1), sd=sd, rows=None)
    drop = with_noise(problem.noise, one, problem.all_values(values), rebound, rng)[2][:, 0]
    return np.asarray(np.where(rebound.status[:, 0] == 0, drop, np.nan))


def _each(found: OneWay, variation: Variation, kind: str) -> tuple[BallRebound, ...]:
    heights = rise_height(found.levels * fall_speed(DROP_HEIGHT))
    return tuple(
        BallRebound(level.label, level.impacts, spread_of(heights[:, k]), share_within(heights[:, k], kind))
        for k, level in enumerate(variation.levels)
    )
