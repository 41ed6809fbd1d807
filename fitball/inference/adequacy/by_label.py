"""Do parameters differ between the surfaces, balls or groups that a column names? Each parameter is scored to first
order: how much better the residuals would be if it had a value of its own at every level.

With `S` the derivatives of the weighted residuals of a level's rows with respect to a parameter, less what a refit of
all others takes off, the score test is `S^T m`, its information `S^T S` (Rao 1948). The parameter that explains most
is taken first, then what explains most of the rest. Biases of groups explain everything that parameters do, at the
price of more numbers: parameters are found only where the Bayesian information criterion prefers them (Schwarz 1978).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import fdtrc

from fitball.data.labels import Labelled, grouping
from fitball.errors import FitballError
from fitball.inference.adequacy.refit import Refit, refit, slopes_of
from fitball.inference.point.point_fit import maxima
from fitball.inference.problem.build import build_problem
from fitball.inference.problem.parameters import NOISE_SPECS
from fitball.inference.problem.problem import Problem
from fitball.inference.problem.subsample import LOOKED_AT, thinned_problem
from fitball.inference.results.evidence import FALSE_FAILS, Difference
from fitball.inference.results.results import PointFit
from fitball.models.specs import BALL_PARAMETERS
from fitball.values import FloatArray

# A direction of which a refit of the others leaves less of the square is not seen.
LEFT = 1e-3
# The probability below which a difference is found: residual tests have their own chance of a false alarm.
SURE = FALSE_FAILS
# A gain that another explanation exceeds by less is as good: in a drop test at one speed biases are restitutions.
ROUNDING = 1e-6
# Standard errors of a 95 % interval.
TWO_SIDED = 1.959964
# Parameters of one column that may be found to differ, one after the other.
MOST = 3


@dataclass(frozen=True)
class Block:
    """What one parameter, or all biases, would change: derivatives (measurements, numbers) of weighted residuals."""

    name: str
    effect: FloatArray


def differences(problem: Problem, point: PointFit) -> tuple[Difference, ...]:
    """Every parameter that is one for all, scored by each label column whose levels it may differ between.

    Those that are `found` have `values` by level from a quick fit. Of a long table some rows are looked at.
    """
    part = thinned_problem(problem, LOOKED_AT)
    biased = None if problem.group_bias is None else problem.group_bias.column
    columns = [item for item in grouping(part.table) if item.column != biased]
    if not columns:
        return ()
    fit = refit(part, point)
    slopes = slopes_of(part, point)[: fit.measured.size]
    scored = [(item, list(_scored(part, fit, slopes, point, item))) for item in columns]
    count = sum(len(found) for _item, found in scored)
    return tuple(
        one
        for item, found in scored
        for one in _chosen(part, fit, slopes, point, item, [replace(one, p=min(1.0, one.p * count)) for one in found])
    )


def _names(problem: Problem, column: str) -> list[str]:
    """The free parameters that may differ between the levels of a column, and do not yet."""
    scatter = {name for item in problem.pooling for name in item.hidden}
    mine = {item.parameter for item in problem.pooling if item.column == column}
    return [
        name
        for name in problem.free_names
        if name not in {*NOISE_SPECS, *BALL_PARAMETERS, *scatter, *mine} and name in problem.model.specs
    ]


def _levels(problem: Problem, fit: Refit, item: Labelled) -> FloatArray:
    """Which measurements belong to each level but the first, (measurements, levels - 1)."""
    labels = np.array(problem.table.labels[item.column])[np.concatenate(fit.places)]
    return np.stack([labels == label for label in list(item.counts)[1:]], axis=1).astype(np.float64)


def _blocks(problem: Problem, fit: Refit, slopes: FloatArray, item: Labelled) -> list[Block]:
    inside = _levels(problem, fit, item)
    free = problem.free_names
    return [Block(name, slopes[:, [free.index(name)]] * inside) for name in _names(problem, item.column)]


def score_of(
    fit: Refit, block: Block, taken: Sequence[Block] = ()
) -> tuple[FloatArray, FloatArray, float, int] | None:
    """Shifts of the levels against the first, their covariance, by how much chi-square falls, and the number of
    directions; beside those that are `taken`. None where a refit leaves nothing of it.
    """

    def product(one: FloatArray, other: FloatArray) -> FloatArray:
        return np.asarray(one.T @ other - (fit.own.T @ one).T @ (fit.own.T @ other))

    effect, score = block.effect, block.effect.T @ fit.measured
    whole = np.sum(effect**2, axis=0)
    information = product(effect, effect)
    if taken:
        others = np.concatenate([item.effect for item in taken], axis=1)
        across, inverse = product(effect, others), np.linalg.pinv(product(others, others), hermitian=True)
        information = information - across @ inverse @ across.T
        score = score - across @ inverse @ (others.T @ fit.measured)
    if np.any(whole <= 0.0) or np.any(np.diag(information) < LEFT * whole):
        return None
    sizes, axes = np.linalg.eigh(information)
    kept = sizes > LEFT * sizes[-1]
    covariance = (axes[:, kept] / sizes[kept]) @ axes[:, kept].T
    shifts = covariance @ score
    return shifts, covariance, float(score @ shifts), int(kept.sum())


def probability(fit: Refit, gain: float, rank: int) -> float:
    """That of as large a fall of chi-square without any difference: Fisher's F, with the noise of the residuals."""
    freedom = float(fit.freedom.sum()) - rank
    if freedom < 1.0:
        return 1.0
    # Of the residuals themselves: a prior may hold the noise above them.
    whole = float(fit.measured @ fit.measured)
    left = max(whole - gain, ROUNDING * whole)
    return float(fdtrc(rank, freedom, gain / rank / (left / freedom)))


def _scored(
    problem: Problem, fit: Refit, slopes: FloatArray, point: PointFit, item: Labelled
) -> Iterator[Difference]:
    for block in _blocks(problem, fit, slopes, item):
        if (found := score_of(fit, block)) is not None:
            shifts, covariance, gain, rank = found
            yield _difference(problem, point, item, block.name, shifts, covariance, probability(fit, gain, rank))


def _difference(
    problem: Problem,
    point: PointFit,
    item: Labelled,
    name: str,
    shifts: FloatArray,
    covariance: FloatArray,
    p: float,
) -> Difference:
    """Between the levels that lie farthest apart."""
    parameter = next(one for one in problem.free if one.name == name)
    unit = point.values[name] if parameter.prior.log else 1.0
    whole, labels = np.concatenate([[0.0], shifts]), list(item.counts)
    wide = np.pad(covariance, ((1, 0), (1, 0)))
    low, high = int(np.argmin(whole)), int(np.argmax(whole))
    size = float(whole[high] - whole[low])
    error = float(np.sqrt(wide[low, low] + wide[high, high] - 2.0 * wide[low, high]))
    return Difference(
        name, item.column, labels[low], labels[high], parameter.spec.unit, unit * size, unit * error,
        unit * (size - TWO_SIDED * error), unit * (size + TWO_SIDED * error), p, found=False, fitted=False,
    )  # fmt: skip


def _chosen(
    problem: Problem, fit: Refit, slopes: FloatArray, point: PointFit, item: Labelled, scored: Sequence[Difference]
) -> list[Difference]:
    """The scores of a column, with those found that explain it: one after the other, each beside the others."""
    blocks = {block.name: block for block in _blocks(problem, fit, slopes, item)}
    sure = {one.parameter: one for one in scored if one.p < SURE}
    taken: list[Block] = []
    gains, ranks = 0.0, 0
    while sure.keys() - {block.name for block in taken} and len(taken) < MOST:
        tried = {
            name: found
            for name in sure
            if name not in {block.name for block in taken}
            if (found := score_of(fit, blocks[name], taken)) is not None
        }
        best = min(tried, key=lambda name: probability(fit, tried[name][2], tried[name][3]), default="")
        # Of parameters that explain the same, as value and slope of a line do at one speed, the first.
        alike = (name for name, item in tried.items() if item[2] >= (1.0 - ROUNDING) * tried[best][2])
        best = next(alike, best)
        if not best or probability(fit, tried[best][2], tried[best][3]) * len(scored) >= SURE:
            break
        taken.append(blocks[best])
        gains, ranks = gains + tried[best][2], ranks + tried[best][3]
    if not taken or not _preferred(problem, fit, item, gains, ranks):
        return list(scored)
    names = [block.name for block in taken]
    values = _quick_fit(problem, point, item, names, {name: score_of(fit, blocks[name]) for name in names})
    return [
        replace(one, found=True, values=values.get(one.parameter, {})) if one.parameter in names else one
        for one in scored
    ]


def _preferred(problem: Problem, fit: Refit, item: Labelled, gain: float, rank: int) -> bool:
    """Whether parameters explain what differs better than a bias of every column in every level does."""
    inside = _levels(problem, fit, item)
    columns = np.repeat(np.eye(len(fit.columns)), [places.size for places in fit.places], axis=0)
    effect = np.concatenate([inside * columns[:, [k]] for k in range(len(fit.columns))], axis=1)
    biases = score_of(fit, Block("biases", effect))
    penalty = np.log(len(problem.impacts))
    return biases is None or gain - rank * penalty >= biases[2] * (1.0 - ROUNDING) - biases[3] * penalty


def _quick_fit(
    problem: Problem,
    point: PointFit,
    item: Labelled,
    names: Sequence[str],
    scores: Mapping[str, tuple[FloatArray, FloatArray, float, int] | None],
) -> dict[str, dict[str, float]]:
    """The values of parameters at every level where they are fitted to each, by parameter and label; empty where
    that cannot be.
    """
    choices = replace(problem.choices, pool={**problem.choices.pool, **dict.fromkeys(names, item.column)})
    try:
        pooled = build_problem(problem.table, problem.scene, choices, problem.force)
    except FitballError:
        return {}
    start = dict(point.values)
    for pooling in pooled.pooling:
        score = scores.get(pooling.parameter)
        if pooling.column == item.column and score is not None:
            shifts = np.concatenate([[0.0], score[0]])
            away = shifts - shifts.mean()
            spread = float(np.sqrt(np.mean(away**2)))
            start[pooling.spread_name] = spread
            start |= {
                pooling.place_name(label): float(place)
                for label, place in zip(item.counts, away / spread, strict=True)
            }
    limits = pooled.prior.limits
    at = pooled.to_coordinates(np.array([[start[name] for name in pooled.free_names]]))
    best = max(maxima(pooled, pooled.to_values(np.clip(at, *limits))), key=lambda one: one.score)
    columns = pooled.all_values(pooled.to_values(best.coordinates[None, :]))
    return {
        pooling.parameter: {label: float(pooling.value(columns, label)[0]) for label in pooling.labels}
        for pooling in pooled.pooling
        if pooling.parameter in names
    }
