"""A problem to first order about its best fit: the one linearisation.

Standard errors, proposals, residual tests, shifts of constants, traded parameters and verdicts are
algebra on it. K are the derivatives of all weighted residuals (whitened measurements, then contact
time and priors) in sds of priors, and U is an orthonormal basis of its columns. A refit takes U U'e
off deviations e.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Annotated, NamedTuple

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

# Share of the best-seen direction below which the measurements do not see one: far above 1e-9 of a
# slope, the error of its differences.
UNSEEN_SHARE = 1e-6
# Length of a parameter's unit vector within unseen directions from which the parameter is traded.
# Chosen by hand.
TRADED_LENGTH = 0.1


class FirstOrder(NamedTuple):
    """A linearisation of all weighted residuals about the best fit.

    - `residual`, in units of noise, is that of the measurement of `columns[column]` of the impact
      `rows`, column after column.
    - `whitening` makes deviations of an impact's columns, in SI, deviations of a measurement in
      units of noise.
    - `slopes` K, at the measurements and then of `others` (contact time, priors), are derivatives
      by the parameters `names`, which are those that are no noise; `root` times its transpose is
      their covariance. Both are in `sds` of priors, in coordinates.
    - `freedom` has the degrees of freedom left for each noise, `traded` the parameters with those
      they move with unnoticed; the `proposal` includes the noise.

    Above LONG_ROWS residual and slopes are of LONG_ROWS evenly spread ones, which are a `share` of
    all; `root` is of all, by a streamed QR. With Student's t a residual is the score over its sd,
    so that the same algebra holds.
    """

    columns: tuple[str, ...]
    column: Annotated[IntArray, "measurements"]
    rows: Annotated[IntArray, "measurements"]
    residual: Annotated[FloatArray, "measurements"]
    whitening: Annotated[FloatArray, "measurements columns"]
    names: tuple[str, ...]
    sds: Annotated[FloatArray, "parameters"]
    slopes: Annotated[FloatArray, "measurements_and_others parameters"]
    root: Annotated[FloatArray, "parameters parameters"]
    share: float
    freedom: Mapping[str, float]
    traded: Mapping[str, tuple[str, ...]]
    proposal: Student

    @property
    def basis(self) -> Annotated[FloatArray, "measurements parameters"]:
        """The orthonormal basis U, of it the rows of the measurements."""
        slopes = self.slopes[: self.residual.size]
        return np.asarray(slopes @ (self.root * self.share**-0.5))

    def direction(
        self,
        column: str,
        shape: Annotated[FloatArray, "impacts"],
    ) -> Annotated[FloatArray, "measurements"]:
        """A pattern over the impacts in one measured column, in SI, as deviations of all
        measurements in units of noise.
        """
        k = self.columns.index(column)
        return np.asarray(self.whitening[:, k] * shape[self.rows])

    def after_refit(self, direction: FloatArray) -> FloatArray:
        """What a refit leaves of deviations (measurements, ...), in units of noise."""
        basis = self.basis
        return np.asarray(direction - basis @ (basis.T @ direction))

    def moves(self, direction: FloatArray) -> FloatArray:
        """By how many `sds` of priors the coordinates (parameters, ...) move with deviations
        (measurements, ...).
        """
        root = self.root * self.share**-0.5
        return np.asarray(root @ (self.basis.T @ direction))

    def shifts(
        self,
        direction: FloatArray,
        along: Annotated[FloatArray, "quantities parameters"] | None = None,
    ) -> FloatArray:
        """By how many of their sds quantities (quantities, ...) move with deviations (measurements,
        ...); by zero where nothing moves them. Quantities have the slopes `along`; without these
        they are the parameters.
        """
        along = np.eye(len(self.names)) if along is None else along
        errors = np.linalg.norm(along @ self.root, axis=1)
        moved = (along @ self.moves(direction)).T
        nothing = np.zeros_like(moved)
        in_sds = np.divide(moved, errors, out=nothing, where=errors > 0.0)
        return np.asarray(in_sds.T)


class _MeasuredCells(NamedTuple):
    """The measured cells of several rows, column after column: number of the column and row,
    residual, whitening; slopes in coordinates (measurements, coordinates); the slope
    (coordinates,) of the rows' mean contact time.
    """

    column: IntArray
    row: IntArray
    residual: FloatArray
    whitening: FloatArray
    slopes: FloatArray
    time: FloatArray


def first_order(problem: Problem, point: PointFit) -> FirstOrder:
    """The linearisation of a problem at the best values, with the prior that searches have."""
    x = problem.coordinates(point.optima[0])[None]
    count = len(problem.rows.y)
    rows = evenly_spread(count, LONG_ROWS)
    cells_of_rows = _measured_cells(problem.on_rows(rows), x)
    fitted = np.flatnonzero([name not in problem.noises for name in problem.free])
    names = tuple(problem.free[k] for k in fitted)
    sds = problem.prior.width[fitted]
    curvature = _prior_curvature(problem, x)[np.ix_(fitted, fitted)]
    others = np.linalg.cholesky(curvature).T * sds
    time = np.zeros(len(problem.free))
    upper = _triangle(others)
    for block, impacts in _streamed(problem, x, rows, cells_of_rows):
        upper = _triangle(upper, block.slopes[:, fitted] * sds)
        time += block.time * (impacts / count)
    if problem.contact_time is not None:
        time_row = time[None, fitted] * sds / problem.contact_time[1]
        others = np.concatenate([time_row, others])
        upper = _triangle(upper, time_row)
    at_rows = cells_of_rows.slopes[:, fitted] * sds
    first = FirstOrder(
        columns=tuple(observable.column.name for observable in problem.observables),
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
    cells_of_rows: _MeasuredCells,
) -> Iterator[tuple[_MeasuredCells, int]]:
    """The measured cells of all impacts in blocks, each with its number of impacts. Where `rows`
    are all of them they come at once.
    """
    count = len(problem.rows.y)
    if len(rows) == count:
        yield cells_of_rows, count
        return
    for block in row_blocks(problem, 2 * len(problem.free) + 1):
        yield _measured_cells(block, x), len(block.rows.y)


def _triangle(*rows: FloatArray) -> FloatArray:
    """The R of the QR decomposition of several arrays (rows, parameters), one below the other."""
    return np.asarray(np.linalg.qr(np.concatenate(rows), mode="r"))


def proposal(problem: Problem, x: Annotated[FloatArray, "coordinates"]) -> Student:
    """Student's t distribution about a maximum at coordinates `x`, noise included, by the expected
    curvature of the posterior.
    """
    objective = Objective(problem)
    width = problem.prior.width
    at = _without_small_scatter(problem, x)[None]
    curvature = objective.linearised(at)[1][0] + np.diag(_flat_curvature(problem))
    scaled = width[:, None] * curvature * width
    return Student(x, width[:, None] * factor_of_inverse(scaled))


def factor_of_inverse(
    matrix: Annotated[FloatArray, "coordinates coordinates"],
) -> Annotated[FloatArray, "coordinates coordinates"]:
    """The lower Cholesky factor of the inverse of a positive definite matrix. From a condition of
    1e10 on the inverse itself often has none.
    """
    backwards = np.linalg.inv(np.linalg.cholesky(matrix[::-1, ::-1]))
    return np.asarray(backwards[::-1, ::-1].T)


def gradients(
    problem: Problem,
    x: Annotated[FloatArray, "coordinates"],
    derived: Sequence[Quantity],
) -> Annotated[FloatArray, "quantities coordinates"]:
    """The derivatives of derived quantities, in SI, by the coordinates at `x`."""

    def following(q: FloatArray) -> FloatArray:
        """The derived quantities (draws, quantities) at coordinates (draws, coordinates)."""
        values = problem.values(q)
        columns = np.array([quantity.rule(values) for quantity in derived])
        return columns.T.reshape(len(q), -1)

    prior = problem.prior
    step = SLOPE_STEP * prior.width
    _, rates = central(following, x[None], step, prior.low, prior.high)
    return np.asarray(rates[0].T)


def slopes_of_all(
    problem: Problem,
    first: FirstOrder,
    derived: Sequence[Quantity],
) -> Annotated[FloatArray, "quantities parameters"]:
    """The slopes of the parameters that are no noise, and then of the derived quantities, by these
    parameters in sds of priors.
    """
    fitted = [problem.free.index(name) for name in first.names]
    of_derived = gradients(problem, first.proposal.centre, derived)[:, fitted] * first.sds
    return np.concatenate([np.eye(len(fitted)), of_derived])


def _measured_cells(problem: Problem, x: FloatArray) -> _MeasuredCells:
    """The measured cells of a problem at coordinates `x` (1, coordinates)."""
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
    return _MeasuredCells(
        column,
        row,
        residual,
        inverse[row, column],
        gain[:, row, column].T,
        rate.time[0],
    )


def _without_small_scatter(problem: Problem, x: FloatArray) -> FloatArray:
    """The coordinates (coordinates,), with each scatter beyond stated errors moved away from zero.

    A small scatter has little information, which is that about its square, and that hides how far
    it may go. With stated sds s the square is known to sqrt(2/sum(s^-4)); half of its root is large
    enough.
    """
    moved = x.copy()
    weight = np.zeros(len(problem.observables))
    for block, mask in measured_blocks(problem, 1):
        inverse_fourth = np.exp(-4.0 * cells(block, x[None]).log_sd[0])
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
    """The curvature (coordinates, coordinates) of minus the log prior. A flat prior, which has
    none, is given that of its sd: without it what the data do not determine would have no end.
    """
    curvature = problem.prior.smooth.pull(x)[1][0]
    return np.asarray(curvature + np.diag(_flat_curvature(problem)))


def _flat_curvature(problem: Problem) -> FloatArray:
    """The curvature (coordinates,) that flat priors are given, that of their sds; else zero."""
    return np.where(problem.prior.flat, problem.prior.width**-2.0, 0.0)


def _traded(
    problem: Problem,
    names: tuple[str, ...],
    slopes: FloatArray,
) -> dict[str, tuple[str, ...]]:
    """The parameters that measurements, and what the scene measured of ball and camera, do not
    determine by themselves, each with those it moves with unnoticed. `slopes` (measurements,
    parameters) are those of `names`.
    """
    stated = {parameter.spec.name for parameter in problem.parameters if parameter.measured}
    rows_of_stated = np.eye(len(names))[[name in stated for name in names]]
    slopes = np.concatenate([slopes, rows_of_stated])
    size = np.linalg.norm(slopes, axis=0)
    moving = np.flatnonzero(size > UNSEEN_SHARE * size.max(initial=0.0))
    if not moving.size:
        return {}
    upper = np.linalg.qr(slopes[:, moving] / size[moving], mode="r")
    _, sizes, right = np.linalg.svd(upper, full_matrices=True)
    # Fewer rows than parameters see nothing of the directions beyond.
    sizes = np.pad(sizes, (0, moving.size - sizes.size))
    blind = right[sizes < UNSEEN_SHARE * sizes[0]]
    together = np.abs(blind.T @ blind) > TRADED_LENGTH**2
    lost = np.diag(together)
    moving_names = [names[k] for k in moving]
    traded = {}
    for k in np.flatnonzero(lost):
        partners = np.flatnonzero(lost & together[k])
        traded[moving_names[k]] = tuple(moving_names[i] for i in partners if i != k)
    return traded
