"""A problem to first order about its best fit: the one linearisation.

Standard errors, proposals, residual tests, shifts of constants, traded parameters and verdicts are
algebra on it. With K the derivatives of all weighted residuals (whitened measurements, then contact
time and priors) in sds of priors and U an orthonormal basis of its columns, a refit takes U U'e off
deviations e.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from fitball.base.selection import evenly_spread
from fitball.base.values import FloatArray, IntArray
from fitball.inference.density import (
    SLOPE_STEP,
    cell_factors,
    cell_slopes,
    cells,
    measured_blocks,
    row_blocks,
)
from fitball.inference.derived import Quantity
from fitball.inference.differences import central
from fitball.inference.effort import LONG_ROWS
from fitball.inference.problem.problem import Problem
from fitball.inference.sampling.importance import Student
from fitball.inference.schema import PointFit
from fitball.inference.search.objective import Objective

# Share of the best-seen direction below which the measurements do not see one: differences are good
# to 1e-9 of a slope.
UNSEEN = 1e-6
# Length of a parameter's unit vector within unseen directions from which it is among them: a
# hundredth of its square.
PART = 0.1


class FirstOrder(NamedTuple):
    """`residual` (measurements,) in units of noise, column after column: of the `columns[column]`,
    of impacts `rows`; `whitening` (measurements, columns) makes deviations of an impact's columns,
    in SI, one of it. `slopes` K (measurements + others, parameters) of `names` that are not noise;
    `root` (parameters, rank), whose square is their covariance; `freedom` left for each noise;
    `traded` parameters with those they move with unnoticed; a `proposal`, noise included. K and
    root are in `sds` (parameters,) of priors, in coordinates.

    Above LONG_ROWS residual and slopes are of LONG_ROWS evenly spread ones, each for `share` of
    all; `root` is of all, by a streamed QR. With Student's t a residual is the score over its sd,
    so that the same algebra holds.
    """

    columns: tuple[str, ...]
    column: IntArray
    rows: IntArray
    residual: FloatArray
    whitening: FloatArray
    names: tuple[str, ...]
    sds: FloatArray
    slopes: FloatArray
    root: FloatArray
    share: float
    freedom: Mapping[str, float]
    traded: Mapping[str, tuple[str, ...]]
    proposal: Student

    @property
    def basis(self) -> FloatArray:
        """U at the measurements (measurements, rank)."""
        slopes = self.slopes[: self.residual.size]
        return np.asarray(slopes @ (self.root * self.share**-0.5))

    def direction(self, column: str, shape: FloatArray) -> FloatArray:
        """A pattern (impacts,) in one measured column, in SI, as deviations (measurements,),
        whitened like them.
        """
        k = self.columns.index(column)
        return np.asarray(self.whitening[:, k] * shape[self.rows])

    def after_refit(self, direction: FloatArray) -> FloatArray:
        """What a refit leaves of deviations (measurements, ...)."""
        basis = self.basis
        return np.asarray(direction - basis @ (basis.T @ direction))

    def moves(self, direction: FloatArray) -> FloatArray:
        """How coordinates in `sds` (parameters, ...) move as deviations (measurements, ...) come
        in.
        """
        root = self.root * self.share**-0.5
        return np.asarray(root @ (self.basis.T @ direction))

    def shifts(self, direction: FloatArray, along: FloatArray | None = None) -> FloatArray:
        """By how many of their sds parameters, or what has slopes `along` (quantities, parameters),
        move (quantities, ...) as deviations (measurements, ...) come in; zero of what nothing
        moves.
        """
        along = np.eye(len(self.names)) if along is None else along
        errors = np.linalg.norm(along @ self.root, axis=1)
        moved = (along @ self.moves(direction)).T
        nothing = np.zeros_like(moved)
        in_sds = np.divide(moved, errors, out=nothing, where=errors > 0.0)
        return np.asarray(in_sds.T)


class _Measured(NamedTuple):
    """Of the cells of some rows, those measured, column after column; slopes in coordinates
    (measurements, free); the rate (free,) of their mean contact time.
    """

    column: IntArray
    row: IntArray
    residual: FloatArray
    whitening: FloatArray
    slopes: FloatArray
    time: FloatArray


def first_order(problem: Problem, point: PointFit) -> FirstOrder:
    """The linearisation at the best values, with the prior that searches have."""
    x = problem.coordinates(point.optima[0])[None]
    count = len(problem.rows.y)
    rows = evenly_spread(count, LONG_ROWS)
    cells_of_rows = _measured(problem.on_rows(rows), x)
    fitted = np.flatnonzero([name not in problem.noises for name in problem.free])
    names = tuple(problem.free[k] for k in fitted)
    sds = problem.prior.width[fitted]
    curvature = _prior_curvature(problem, x)[np.ix_(fitted, fitted)]
    others = np.linalg.cholesky(curvature).T * sds
    time = np.zeros(len(problem.free))
    upper = _triangle(others)
    for cells_of_part, part_count in _streamed(problem, x, rows, cells_of_rows):
        upper = _triangle(upper, cells_of_part.slopes[:, fitted] * sds)
        time += cells_of_part.time * (part_count / count)
    if problem.contact_time is not None:
        time_row = time[None, fitted] * sds / problem.contact_time[1]
        others = np.concatenate([time_row, others])
        upper = _triangle(upper, time_row)
    at_rows = cells_of_rows.slopes[:, fitted] * sds
    first = FirstOrder(
        columns=tuple(item.column.name for item in problem.observables),
        column=cells_of_rows.column,
        rows=rows[cells_of_rows.row],
        residual=cells_of_rows.residual,
        whitening=cells_of_rows.whitening,
        names=names,
        sds=sds,
        slopes=np.concatenate([at_rows, others]),
        root=np.asarray(np.linalg.inv(upper)),
        share=len(rows) / count,
        freedom={},
        traded=_traded(problem, names, at_rows),
        proposal=proposal(problem, x[0]),
    )
    counts = np.isfinite(problem.rows.y).sum(axis=0)
    leverage = np.sum(first.basis**2, axis=1)
    remaining = counts - np.bincount(first.column, leverage, len(counts))
    freedom = dict.fromkeys((observable.noise for observable in problem.observables), 0.0)
    for observable, column_freedom in zip(problem.observables, remaining, strict=True):
        freedom[observable.noise] += float(column_freedom)
    return first._replace(freedom=freedom)


def _streamed(
    problem: Problem,
    x: FloatArray,
    rows: IntArray,
    cells_of_rows: _Measured,
) -> Iterator[tuple[_Measured, int]]:
    """The cells of all impacts by parts, and how many impacts a part has; where `rows` are all of
    them, their cells at once.
    """
    count = len(problem.rows.y)
    if len(rows) == count:
        yield cells_of_rows, count
        return
    for part in row_blocks(problem, 2 * len(problem.free) + 1):
        yield _measured(part, x), len(part.rows.y)


def _triangle(*rows: FloatArray) -> FloatArray:
    """R of a QR of rows (rows, n) below each other."""
    return np.asarray(np.linalg.qr(np.concatenate(rows), mode="r"))


def proposal(problem: Problem, x: FloatArray) -> Student:
    """Student's t about a maximum at coordinates (free,), noise included: the expected curvature of
    the posterior.
    """
    objective = Objective(problem)
    width = problem.prior.width
    at = _off_zero(problem, x)[None]
    curvature = objective.linearised(at)[1][0] + np.diag(_flat(problem))
    scaled = width[:, None] * curvature * width
    return Student(x, width[:, None] * factor_of_inverse(scaled))


def factor_of_inverse(matrix: FloatArray) -> FloatArray:
    """Lower Cholesky factor of the inverse. From a condition of 1e10 on the inverse itself often
    has none.
    """
    backwards = np.linalg.inv(np.linalg.cholesky(matrix[::-1, ::-1]))
    return np.asarray(backwards[::-1, ::-1].T)


def gradients(problem: Problem, x: FloatArray, derived: Sequence[Quantity]) -> FloatArray:
    """Derivatives (quantities, free) of what follows from parameters at coordinates (free,)."""

    def following(q: FloatArray) -> FloatArray:
        values = problem.values(q)
        columns = np.array([quantity.rule(values) for quantity in derived])
        return columns.T.reshape(len(q), -1)

    prior = problem.prior
    step = SLOPE_STEP * prior.width
    _, rates = central(following, x[None], step, prior.low, prior.high)
    return np.asarray(rates[0].T)


def slopes_of_all(problem: Problem, first: FirstOrder, derived: Sequence[Quantity]) -> FloatArray:
    """Of parameters that are no noise, then of what follows from them (quantities, parameters), in
    sds of priors.
    """
    fitted = [problem.free.index(name) for name in first.names]
    of_derived = gradients(problem, first.proposal.centre, derived)[:, fitted] * first.sds
    return np.concatenate([np.eye(len(fitted)), of_derived])


def _measured(problem: Problem, x: FloatArray) -> _Measured:
    """The measured cells at coordinates (1, free)."""
    cell, rate = cell_slopes(problem, x)
    noise = problem.forward.noise
    values = problem.values(x)
    score, turn = noise.residual(cell.z[0], values)
    scale = np.sqrt(noise.information(values)[0][0])
    mask = np.isfinite(problem.rows.y)
    inverse = np.linalg.inv(cell_factors(problem, x)[0]) * scale
    mean = np.where(mask, rate.mean[0], 0.0)
    gain = np.einsum("icd,kid->kic", inverse, mean)
    column, row = np.nonzero(mask.T)
    residual = (score * turn / scale)[row, column]
    return _Measured(
        column,
        row,
        residual,
        inverse[row, column],
        gain[:, row, column].T,
        rate.time[0],
    )


def _off_zero(problem: Problem, x: FloatArray) -> FloatArray:
    """The coordinates (free,) without a scatter beyond stated errors so small that its information,
    which is that about its square, hides how far it may go: with `n` stated sds `s` the square is
    known to sqrt(2/sum(s^-4)), and half of its root is large enough.
    """
    moved = x.copy()
    weight = np.zeros(len(problem.observables))
    for part, mask in measured_blocks(problem, 1):
        inverse_fourth = np.exp(-4.0 * cells(part, x[None]).log_sd[0])
        weight += np.where(mask[0], inverse_fourth, 0.0).sum(axis=0)
    for observable, column_weight in zip(problem.observables, weight, strict=True):
        if not observable.stated or observable.noise not in problem.free:
            continue
        k = problem.free.index(observable.noise)
        # Of a column all of whose measurements are withheld nothing is known.
        if column_weight > 0.0 and problem.prior.plain[k]:
            moved[k] = max(moved[k], 0.5 * (2.0 / column_weight) ** 0.25)
    return moved


def _prior_curvature(problem: Problem, x: FloatArray) -> FloatArray:
    """Curvature (free, free) of minus the log prior; of a flat one, which has none, that of its sd:
    without it what the table does not see would have no end.
    """
    curvature = problem.prior.smooth.pull(x)[1][0]
    return np.asarray(curvature + np.diag(_flat(problem)))


def _flat(problem: Problem) -> FloatArray:
    """Curvature (free,) that flat priors are given, that of their sds; zero of others."""
    return np.where(problem.prior.flat, problem.prior.width**-2.0, 0.0)


def _traded(
    problem: Problem,
    names: tuple[str, ...],
    slopes: FloatArray,
) -> dict[str, tuple[str, ...]]:
    """The parameters that measurements, and what the scene measured of ball and camera, do not
    determine by themselves, each with those it moves with unnoticed.
    """
    stated = {item.spec.name for item in problem.parameters if item.measured}
    rows_of_stated = np.eye(len(names))[[name in stated for name in names]]
    slopes = np.concatenate([slopes, rows_of_stated])
    size = np.linalg.norm(slopes, axis=0)
    moving = np.flatnonzero(size > UNSEEN * size.max(initial=0.0))
    if not moving.size:
        return {}
    upper = np.linalg.qr(slopes[:, moving] / size[moving], mode="r")
    _, sizes, right = np.linalg.svd(upper, full_matrices=True)
    # Fewer rows than parameters see nothing of the directions beyond.
    sizes = np.pad(sizes, (0, moving.size - sizes.size))
    blind = right[sizes < UNSEEN * sizes[0]]
    together = np.abs(blind.T @ blind) > PART**2
    lost = np.diag(together)
    moving_names = [names[k] for k in moving]
    traded = {}
    for k in np.flatnonzero(lost):
        partners = np.flatnonzero(lost & together[k])
        traded[moving_names[k]] = tuple(moving_names[i] for i in partners if i != k)
    return traded
