"""A problem to first order about its best fit: the one linearisation.

Standard errors, proposals, residual tests, shifts of constants, traded parameters and verdicts are
algebra on it. With K the derivatives of all weighted residuals (whitened measurements, then contact
time and priors) in sds of priors and U an orthonormal basis of its columns, a refit takes U U'e off
deviations e.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from fitball.base.selection import evenly_spread
from fitball.base.values import FloatArray, IntArray
from fitball.inference.density import STEP, cells, factors, measured, parts, slopes
from fitball.inference.derived import Quantity
from fitball.inference.differences import central
from fitball.inference.effort import LONG
from fitball.inference.problem.problem import Problem
from fitball.inference.sampling.importance import Student
from fitball.inference.schema import PointFit
from fitball.inference.search.objective import Objective

# Share of the best-seen direction below which the measurements do not see one: differences are good
# to 1e-9 of a slope; and the part of a unit vector in such directions from which a parameter is
# among them.
UNSEEN = 1e-6
PART = 0.1


class FirstOrder(NamedTuple):
    """`residual` (measurements,) in units of noise, column after column: of the `columns[column]`,
    of impacts `rows`; `whitening` (measurements, columns) makes deviations of an impact's columns,
    in SI, one of it. `slopes` K (measurements + others, parameters) of `names` that are not noise;
    `root` (parameters, rank), whose square is their covariance; `freedom` left for each noise;
    `traded` parameters with those they move with unnoticed; a `proposal`, noise included. K and
    root are in `sds` (parameters,) of priors, in coordinates.

    Above LONG rows residual and slopes are of LONG evenly spread ones, each for `share` of all;
    `root` is of all, by a streamed QR. With Student's t a residual is the score over its sd, so
    that the same algebra holds.
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
        return np.asarray(self.slopes[: self.residual.size] @ (self.root * self.share**-0.5))

    def direction(self, column: str, shape: FloatArray) -> FloatArray:
        """A pattern (impacts,) in one measured column, in SI, as deviations (measurements,),
        whitened like them.
        """
        return np.asarray(self.whitening[:, self.columns.index(column)] * shape[self.rows])

    def after_refit(self, direction: FloatArray) -> FloatArray:
        """What a refit leaves of deviations (measurements, ...)."""
        basis = self.basis
        return np.asarray(direction - basis @ (basis.T @ direction))

    def moves(self, direction: FloatArray) -> FloatArray:
        """How coordinates in `sds` (parameters, ...) move as deviations (measurements, ...) come
        in.
        """
        return np.asarray(self.root * self.share**-0.5 @ (self.basis.T @ direction))

    def shifts(self, direction: FloatArray, along: FloatArray | None = None) -> FloatArray:
        """By how many of their sds parameters, or what has slopes `along` (quantities, parameters),
        move (quantities, ...) as deviations (measurements, ...) come in; zero of what nothing
        moves.
        """
        along = np.eye(len(self.names)) if along is None else along
        errors = np.linalg.norm(along @ self.root, axis=1)
        moved = (along @ self.moves(direction)).T
        return np.asarray(np.divide(moved, errors, out=np.zeros_like(moved), where=errors > 0.0).T)


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
    kept = _kept(problem)
    whole = len(kept) == count
    share = len(kept) / count
    seen = _measured(problem.part(kept), x)
    fitted = np.flatnonzero([name not in problem.noises for name in problem.free])
    names = tuple(problem.free[k] for k in fitted)
    sds = problem.prior.width[fitted]
    known = np.linalg.cholesky(_known(problem, x)[np.ix_(fitted, fitted)]).T
    others = known * sds
    time = np.zeros(len(problem.free))
    upper = _triangle(others)
    for part in (problem,) if whole else parts(problem, 2 * len(problem.free) + 1):
        mine = seen if whole else _measured(part, x)
        upper = _triangle(upper, mine.slopes[:, fitted] * sds)
        time += mine.time * (len(part.rows.y) / count)
    if problem.contact_time is not None:
        others = np.concatenate([time[None, fitted] * sds / problem.contact_time[1], others])
        upper = _triangle(upper, others[:1])
    at_rows = seen.slopes[:, fitted] * sds
    first = FirstOrder(
        columns=tuple(item.column.name for item in problem.observables),
        column=seen.column,
        rows=kept[seen.row],
        residual=seen.residual,
        whitening=seen.whitening,
        names=names,
        sds=sds,
        slopes=np.concatenate([at_rows, others]),
        root=np.asarray(np.linalg.inv(upper)),
        share=share,
        freedom={},
        traded=_traded(problem, names, at_rows),
        proposal=proposal(problem, x[0]),
    )
    counts = np.isfinite(problem.rows.y).sum(axis=0)
    taken = np.bincount(first.column, np.sum(first.basis**2, axis=1), len(counts))
    freedom = dict.fromkeys((item.noise for item in problem.observables), 0.0)
    for item, left in zip(problem.observables, counts - taken, strict=True):
        freedom[item.noise] += float(left)
    return first._replace(freedom=freedom)


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
    return Student(x, width[:, None] * factor_of_inverse(width[:, None] * curvature * width))


def factor_of_inverse(matrix: FloatArray) -> FloatArray:
    """Lower Cholesky factor of the inverse. From a condition of 1e10 on the inverse itself often
    has none.
    """
    return np.asarray(np.linalg.inv(np.linalg.cholesky(matrix[::-1, ::-1]))[::-1, ::-1].T)


def gradients(problem: Problem, x: FloatArray, asked: Sequence[Quantity]) -> FloatArray:
    """Derivatives (quantities, free) of what follows from parameters at coordinates (free,)."""

    def values(q: FloatArray) -> FloatArray:
        known = problem.values(q)
        return np.array([one.rule(known) for one in asked]).T.reshape(len(q), -1)

    prior = problem.prior
    return np.asarray(central(values, x[None], STEP * prior.width, prior.low, prior.high)[1][0].T)


def slopes_of_all(problem: Problem, first: FirstOrder, derived: Sequence[Quantity]) -> FloatArray:
    """Of parameters that are no noise, then of what follows from them (quantities, parameters), in
    sds of priors.
    """
    fitted = [problem.free.index(name) for name in first.names]
    own = gradients(problem, first.proposal.centre, derived)[:, fitted] * first.sds
    return np.concatenate([np.eye(len(fitted)), own])


def _measured(problem: Problem, x: FloatArray) -> _Measured:
    made, rate = slopes(problem, x)
    noise = problem.forward.noise
    values = problem.values(x)
    score, turn = noise.residual(made.z[0], values)
    scale = np.sqrt(noise.information(values)[0][0])
    mask = np.isfinite(problem.rows.y)
    inverse = np.linalg.inv(factors(problem, x)[0]) * scale
    gain = np.einsum("icd,kid->kic", inverse, np.where(mask, rate.mean[0], 0.0))
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
    for part, mask in measured(problem, 1):
        weight += np.where(mask[0], np.exp(-4.0 * cells(part, x[None]).log_sd[0]), 0.0).sum(axis=0)
    for item, own in zip(problem.observables, weight, strict=True):
        k = problem.free.index(item.noise) if item.noise in problem.free else -1
        # Of a column all of whose measurements are withheld nothing is known.
        if item.stated and k >= 0 and own > 0.0 and problem.prior.plain[k]:
            moved[k] = max(moved[k], 0.5 * (2.0 / own) ** 0.25)
    return moved


def _kept(problem: Problem) -> IntArray:
    """Evenly spread rows, at most LONG."""
    return evenly_spread(len(problem.rows.y), LONG)


def _known(problem: Problem, x: FloatArray) -> FloatArray:
    """Curvature (free, free) of minus the log prior; of a flat one, which has none, that of its sd:
    without it what the table does not see would have no end.
    """
    return np.asarray(problem.prior.smooth.pull(x)[1][0] + np.diag(_flat(problem)))


def _flat(problem: Problem) -> FloatArray:
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
    slopes = np.concatenate([slopes, np.eye(len(names))[[name in stated for name in names]]])
    size = np.linalg.norm(slopes, axis=0)
    moving = np.flatnonzero(size > UNSEEN * size.max(initial=0.0))
    if not moving.size:
        return {}
    upper = np.linalg.qr(slopes[:, moving] / size[moving], mode="r")
    _, sizes, right = np.linalg.svd(upper, full_matrices=True)
    blind = right[np.pad(sizes, (0, moving.size - sizes.size)) < UNSEEN * sizes[0]]
    together = np.abs(blind.T @ blind) > PART**2
    lost = np.diag(together)
    moved = [names[k] for k in moving]
    return {
        one: tuple(moved[i] for i in np.flatnonzero(lost & together[k]) if i != k)
        for k, one in enumerate(moved)
        if lost[k]
    }
