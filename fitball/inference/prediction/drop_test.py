"""Results of a drop test: restitution at the tested speeds, the rebound from 254 cm, and how balls differ beyond
noise.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtri

from fitball.data.columns import HEIGHTS
from fitball.data.heights import BALL_TYPES, DEFAULT_TYPE, DROP_HEIGHT
from fitball.data.labels import Role
from fitball.inference.prediction.posterior_predictive import with_noise
from fitball.inference.prediction.reach import calibrated_range
from fitball.inference.problem.parameters import Prior, parse_prior
from fitball.inference.problem.problem import Problem
from fitball.inference.problem.spreads import spread_prior
from fitball.inference.results.lab import (
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
from fitball.inference.results.quantiles import MOST_UNSOLVED, Spread, spread_of
from fitball.inference.results.results import PointFit, Posterior, thinned
from fitball.models.specs import SPECS
from fitball.models.types import STATUS_REASON, Status
from fitball.values import FloatArray, Impacts

# Repeated measurements of several balls, or at several places: their differences apart from measurement noise. `y = X
# beta + b[label] + noise`, where `b` and the noise are normal. Priors are flat in `beta` and in the logarithm of the
# noise's standard deviation; that between labels has the prior of a pooled parameter's spread. Given the ratio of the
# two, `beta` and `b` are known in closed form (a linear mixed model with one factor; Searle, Casella and McCulloch
# 1992, *Variance Components*, ch. 3); so would be the noise if the prior between labels were flat. The prior weighs
# the cells of a grid of ratios and of quantiles of that noise.

DRAWN = 8000
# Ratios of the two standard deviations, evenly spaced in their logarithm: beyond, nothing is left of either.
RATIOS = np.exp(np.linspace(np.log(1e-4), np.log(1e4), 800))
# Parts of equal probability of the noise.
PARTS = 100
# Below this share of the whole scatter repeats agree to the digits they are printed with.
LEAST_SCATTER = 1e-12


def lab_generator(seed: int) -> np.random.Generator:
    """The generator of the results of drop tests and courts, a stream of a run that nothing else draws from."""
    return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(13,)))


@dataclass(frozen=True)
class OneWay:
    """Draws: `coefficients` (draws, columns of the design), standard deviations `between` labels and `within` one,
    each (draws,), and how far each label lies from the others, `shifts` (draws, labels).
    """

    coefficients: FloatArray
    between: FloatArray
    within: FloatArray
    shifts: FloatArray

    @property
    def levels(self) -> FloatArray:
        """Each label (draws, labels), where the first column of the design is one."""
        return self.coefficients[:, :1] + self.shifts


def plain_mean(values: FloatArray, rng: np.random.Generator) -> tuple[FloatArray, FloatArray]:
    """Draws of mean and standard deviation, each (draws,), of independent `values` (at least three)."""
    count = values.size
    freedom = count - 1
    spread = np.sqrt(np.sum((values - values.mean()) ** 2) / rng.chisquare(freedom, DRAWN))
    return values.mean() + spread / np.sqrt(count) * rng.standard_normal(DRAWN), spread


def one_way(
    values: FloatArray, design: FloatArray, index: NDArray[np.int64], between: Prior, rng: np.random.Generator
) -> OneWay | str:
    """Draws for `values` (rows,) with `design` (rows, columns) and labels `index` (rows,), or why there are none;
    `between` is the prior of the standard deviation between labels, in the unit of the values.
    """
    labels = np.eye(int(index.max()) + 1)[index]
    rank = int(np.linalg.matrix_rank(np.hstack([design, labels])))
    shared = int(np.linalg.matrix_rank(design)) + labels.shape[1] - rank
    if labels.shape[1] - shared < 1:
        return "fewer than two of them"
    if values.size - rank < 2:
        return "too few repeats"
    beta: FloatArray = np.asarray(np.linalg.lstsq(design, values, rcond=None)[0], dtype=np.float64)
    rest = values - design @ beta
    pure = rest - _fitted(np.hstack([design, labels]), rest)
    if not pure @ pure > LEAST_SCATTER * (values @ values):
        return "all repeats are identical"
    return _draws(rest, beta, design, labels, between, rng)


def _fitted(matrix: FloatArray, values: FloatArray) -> FloatArray:
    return np.asarray(matrix @ np.linalg.lstsq(matrix, values, rcond=None)[0])


def _draws(
    rest: FloatArray,
    beta: FloatArray,
    design: FloatArray,
    labels: FloatArray,
    between: Prior,
    rng: np.random.Generator,
) -> OneWay:
    """Draws around the least-squares `beta`, which leaves `rest` (rows,)."""
    freedom = rest.size - design.shape[1] - 1
    count = labels.sum(axis=0)
    sums, totals = labels.T @ design, labels.T @ rest
    share = RATIOS[:, None] ** 2 / (1.0 + count * RATIOS[:, None] ** 2)
    information = design.T @ design - np.einsum("gm,mp,mq->gpq", share, sums, sums)
    right = design.T @ rest - np.einsum("gm,mp,m->gp", share, sums, totals)
    move = np.linalg.solve(information, right[..., None])[..., 0]
    square = rest @ rest - share @ totals**2 - np.einsum("gp,gp->g", right, move)
    density = (
        -0.5 * np.linalg.slogdet(information)[1]
        - 0.5 * np.log1p(count * RATIOS[:, None] ** 2).sum(axis=1)
        - 0.5 * freedom * np.log(square)
        + np.log(RATIOS)
    )
    noise = np.sqrt(square[:, None] / chdtri(freedom, (np.arange(PARTS) + 0.5) / PARTS))
    cells = (density[:, None] + between.log_density(RATIOS[:, None] * noise)).ravel()
    weight = np.cumsum(np.exp(cells - cells.max()))
    found = np.searchsorted(weight, weight[-1] * (np.arange(DRAWN) + rng.uniform()) / DRAWN)
    chosen, part = np.divmod(rng.permutation(np.minimum(found, cells.size - 1)), PARTS)
    within = np.sqrt(square[chosen] / chdtri(freedom, (part + rng.uniform(size=DRAWN)) / PARTS))
    roots = np.linalg.cholesky(np.linalg.inv(information))[chosen]
    moved = move[chosen] + within[:, None] * np.einsum(
        "dpq,dq->dp", roots, rng.standard_normal((DRAWN, design.shape[1]))
    )
    spread = within[:, None] * np.sqrt(share[chosen])
    shifts = share[chosen] * (totals - moved @ sums.T) + spread * rng.standard_normal((DRAWN, count.size))
    return OneWay(beta + moved, RATIOS[chosen] * within, within, shifts)


def chosen_spread(problem: Problem, quantity: str, column: str) -> Prior | None:
    """The prior of the spread of a quantity over the labels of a `column` where the fit has one: as pooled, or as
    chosen.
    """
    name = f"{quantity}_spread"
    if any((pooling.parameter, pooling.column) == (quantity, column) for pooling in problem.pooling):
        return next(item.prior for item in problem.parameters if item.name == name)
    return problem.spreads.get(name)


DRAWS = 4000
# Speeds closer to the next one than this share of themselves were meant to be the same.
SAME = 0.03
# More settings than this, or one that spreads further, are a range of speeds: its ends and its middle are told.
MOST_SPEEDS, WIDEST = 6, 0.15
BALLS = "ball"


# The restitution at a speed [m/s]: at the best values, then draws (none without a posterior).
Law = Callable[[float], FloatArray]


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
        return _none(problem, kind, "cor = measured takes the restitution of each impact from the table")
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


def _fitted_law(problem: Problem, point: PointFit, posterior: Posterior | None, speed: float) -> Law | str:
    """Restitution by the model; the reason where it has none at the landing `speed` [m/s]."""
    values = np.array([[point.values[name] for name in problem.free_names]])
    if posterior is not None:
        values = np.concatenate([values, thinned(posterior, DRAWS)])

    def at(speed: float) -> FloatArray:
        rebound = problem.rebound(values, _drop(speed))
        return np.asarray(np.where(rebound.status[:, 0] == 0, rebound.v_y2[:, 0] / speed, np.nan))

    unsolved = np.isnan(at(speed))
    if unsolved[0] or np.mean(unsolved) > MOST_UNSOLVED:
        status = int(problem.rebound(values, _drop(speed)).status.max())
        return f"the model cannot be evaluated there: {STATUS_REASON[Status(status)]}"
    return at


def spread_of_balls(tennis: bool) -> Prior:
    """The prior by default of the standard deviation of the restitution between balls."""
    spec = SPECS["cor_10"]
    return spread_prior(
        spec.name, Role.BALL, False, parse_prior(spec.name, spec.prior, spec.lower, spec.upper), tennis
    ).prior


def _balls(
    problem: Problem, known: NDArray[np.int64], cor: FloatArray, speed: float, rng: np.random.Generator
) -> tuple[OneWay | None, Variation | None]:
    """How balls differ beyond noise, where the table has them: the draws, and their summary."""
    labels = problem.table.labels.get(BALLS)
    if labels is None:
        return None, None
    names = tuple(dict.fromkeys(labels[k] for k in known))
    index = np.array([names.index(labels[k]) for k in known], dtype=np.int64)
    between = chosen_spread(problem, "cor_10", BALLS) or spread_of_balls(problem.scene.tennis)
    found = one_way(cor, _design(problem.table.impacts.v_y1[known], speed), index, between, rng)
    if isinstance(found, str):
        return None, Variation(BALLS, None, None, (), found)
    levels = tuple(
        Level(name, int(np.sum(index == k)), float(cor[index == k].mean()), spread_of(found.levels[:, k]))
        for k, name in enumerate(names)
    )
    return found, Variation(BALLS, spread_of(found.between), spread_of(found.within), levels, "", between.text)


def _design(speeds: FloatArray, speed: float) -> FloatArray:
    """A constant, and a line in speed from `speed` on where balls were dropped at several."""
    ones = np.ones(speeds.size)
    return np.stack([ones, speeds - speed] if len(_settings(speeds)) > 1 else [ones], axis=1)


def _law_of_balls(found: OneWay, fitted: Law, speeds: FloatArray, speed: float) -> Law:
    """Restitution of the mean ball: a line in speed where there are several; else what was found at the one speed,
    carried to others by the difference that the fit has between the two.
    """
    tested = float(speeds.mean())

    def at(v: float) -> FloatArray:
        if found.coefficients.shape[1] > 1:
            draws = found.coefficients @ np.array([1.0, v - speed])
        else:
            difference = fitted(v) - fitted(tested)
            draws = found.coefficients[:, 0] + np.resize(difference[1:] if difference.size > 1 else difference, DRAWN)
        return np.append(np.nanmedian(draws), draws)

    return at


def _spread(told: FloatArray) -> Spread:
    """Of a number at the best values and its draws."""
    return spread_of(told[1:] if told.size > 1 else None, float(told[0]))


def _tested(law: Law, speeds: FloatArray, cor: FloatArray, rows: NDArray[np.int64]) -> TestedSpeed:
    speed = float(speeds[rows].mean())
    scatter = float(cor[rows].std(ddof=1)) if rows.size > 1 else None
    return TestedSpeed(
        speed, float(speeds[rows].min()), float(speeds[rows].max()), rows.size, _spread(law(speed)),
        float(cor[rows].mean()), scatter,
    )  # fmt: skip


def _rebound(
    problem: Problem,
    law: Law,
    found: OneWay | None,
    kind: str,
    rng: np.random.Generator,
    posterior: Posterior | None,
) -> StandardRebound:
    speed = fall_speed(DROP_HEIGHT)
    k = drag(problem.model.ball)
    slower = fall_speed_in_air(DROP_HEIGHT, k)
    cor, thinner = law(speed), law(slower)
    height, air = rise_height(cor * speed), rise_height_in_air(thinner * slower, k)
    sampled = cor.size > 1
    ball = drop = None
    if sampled and found is not None:
        other = cor[1:] + found.between * rng.standard_normal(cor.size - 1)
        ball = rise_height(other * speed)
        drop = rise_height((other + found.within * rng.standard_normal(cor.size - 1)) * speed)
    elif posterior is not None:
        drop = rise_height(_one_drop(problem, posterior, speed, rng))
    told = (height[1:] if sampled else None, ball, drop)
    reach = calibrated_range(problem.table.impacts, _drop(speed), problem.model.ball.radius, False, ()).beyond["v_y1"]
    return StandardRebound(
        speed=speed,
        height=_spread(height),
        drop=spread_of(drop, float(height[0])),
        passing={
            name: Passing(*(None if heights is None else share_within(heights, name) for heights in told))
            for name in BALL_TYPES
        },
        with_air=_spread(air),
        passing_with_air=share_within(air[1:], kind) if sampled else None,
        air_share=launch_speed_in_air(float(height[0]), k) / slower / float(cor[0]) - 1.0,
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
