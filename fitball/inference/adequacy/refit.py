"""Residuals at the best fit, and those of tables that the fitted model makes, each refitted to first order.

With `K` the derivatives of all weighted residuals (measurements, what the scene knows, records, priors) and `U` an
orthonormal basis of its columns, a refit takes `U U^T e` off deviations `e`: what is left of standard ones has, over
the prior, exactly the covariance of the residuals of a linear model. So a check that is held against them does not
use the data twice (Robins, van der Vaart and Ventura 2000, JASA 95, 1143).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from fitball.inference.likelihood.residuals import IMPOSSIBLE, Weighting, differentiable, residual_slopes, residuals
from fitball.inference.problem.parameters import NOISE_SPECS
from fitball.inference.problem.problem import Problem
from fitball.inference.problem.subsample import whole_of_parts
from fitball.inference.results.results import PointFit
from fitball.values import FloatArray

# Step of the differences that stand for derivatives where there are none, in widths of the priors.
STEP = 1e-5
# The number of no column: of all together.
EVERY = -1
# What wear, warmth and the court change from impact to impact: friction and restitution.
WEARING = ("mu", "cor_10")
# The share by which friction is changed either way to see what it does: by so much balls that grip begin to slide.
FRICTION = 0.2
# The sd of a uniform density of width one.
UNIFORM_SD = 1.0 / np.sqrt(12.0)


@dataclass(frozen=True)
class Refit:
    """A best fit and its first order.

    `columns` names the measured columns, one after the other in `measured` (measurements,): residuals, measured less
    predicted, in units of the fitted noise; `places` says of each column at which of the `impacts` it was measured.
    `noise` (measurements,) numbers the noises of `noises`. `basis` (rows, rank) is `U`, its first rows those of the
    measurements; a change `c` of coefficients of the basis moves parameter `names[k]` by `reach[k] @ c` of its
    standard deviations. `effects` (measurements,) has what a small change of each parameter of `WEARING` does,
    `predicted` (measurements,) how large each prediction is among those of its column.
    """

    columns: tuple[str, ...]
    impacts: int
    places: tuple[NDArray[np.int64], ...]
    measured: FloatArray
    noises: tuple[str, ...]
    noise: NDArray[np.int64]
    basis: FloatArray
    names: tuple[str, ...]
    reach: FloatArray
    effects: Mapping[str, FloatArray]
    predicted: FloatArray

    @property
    def own(self) -> FloatArray:
        """The basis at the measurements, (measurements, rank)."""
        return self.basis[: self.measured.size]

    @cached_property
    def leverage(self) -> FloatArray:
        """How much of each deviation a refit takes off, (measurements,)."""
        return np.asarray(np.einsum("ij,ij->i", self.own, self.own))

    @cached_property
    def gram(self) -> FloatArray:
        """Products (rank, rank) of the basis at the measurements."""
        return np.asarray(self.own.T @ self.own)

    @cached_property
    def taken(self) -> FloatArray:
        """What the basis has of the residuals as measured, (rank,)."""
        return np.asarray(self.own.T @ self.measured)

    @cached_property
    def freedom(self) -> FloatArray:
        """Degrees of freedom that are left for each of the `noises`."""
        return np.asarray(np.bincount(self.noise, 1.0 - self.leverage, len(self.noises)), dtype=np.float64)

    @cached_property
    def starts(self) -> NDArray[np.int64]:
        """Where the measurements of each column begin, and where the last ends, (columns + 1,)."""
        return np.cumsum([0, *(places.size for places in self.places)])

    def rows(self, column: int) -> slice:
        """The measurements of a column; of all for `EVERY`."""
        if column == EVERY:
            return slice(0, self.measured.size)
        return slice(int(self.starts[column]), int(self.starts[column + 1]))

    def noise_of(self, column: int) -> int:
        """The number of the noise of a column."""
        return int(self.noise[self.starts[column]])

    def replicate(self, deviations: FloatArray) -> FloatArray:
        """Residuals (tables, measurements) of refitted tables with standard deviations (tables, rows)."""
        return deviations[:, : self.measured.size] - (deviations @ self.basis) @ self.own.T

    def scales(self, residual: FloatArray) -> FloatArray:
        """Sizes (tables, noises) of each noise, as residuals (tables, measurements) show it."""
        squares = np.stack([np.sum(residual[:, self.noise == g] ** 2, axis=1) for g in range(len(self.noises))], 1)
        scale: FloatArray = np.sqrt(squares / self.freedom)
        return scale


def refit(problem: Problem, point: PointFit) -> Refit:
    """The first order of a problem about its point estimate."""
    values = np.array([[point.values[name] for name in problem.free_names]])
    weighting = Weighting({name: point.values[name] for name in point.values if name in NOISE_SPECS}, penalised=True)
    count = len(problem.impacts)
    places = tuple(observable.places(count) for observable in problem.observables)
    sizes_of = [mine.size for mine in places]
    measured = -residuals(problem, values, weighting)[0, : sum(sizes_of)]
    kept = [k for k, parameter in enumerate(problem.free) if parameter.name not in NOISE_SPECS]
    width = np.array([p.prior.width * (1.0 if p.prior.normal else UNIFORM_SD) for p in problem.free])
    every = _slopes(problem, values, weighting)
    slopes = every[:, kept] * width[kept]
    # A uniform prior has no residual; without one a direction that the table hardly sees would count as fitted.
    flat = np.eye(len(kept))[[not problem.free[k].prior.normal for k in kept]]
    left, sizes, right = np.linalg.svd(np.concatenate([slopes, flat]), full_matrices=False)
    seen = sizes > 1e-9 * max(sizes.max(initial=0.0), 1.0)
    solved = right[seen].T / sizes[seen]
    errors = np.linalg.norm(solved, axis=1)
    noise_names = [o.noise or f"{o.name}_sd" for o in problem.observables]
    noises = tuple(dict.fromkeys(noise_names))
    return Refit(
        columns=tuple(o.name for o in problem.observables),
        impacts=count,
        places=places,
        measured=measured,
        noises=noises,
        noise=np.repeat([noises.index(name) for name in noise_names], sizes_of),
        basis=left[:, seen],
        names=tuple(problem.free_names[k] for k in kept),
        reach=solved / errors[:, None],
        predicted=_predicted_sizes(problem, values),
        effects=_effects(problem, values, weighting, every[: measured.size]),
    )


def _effects(problem: Problem, values: FloatArray, weighting: Weighting, slopes: FloatArray) -> dict[str, FloatArray]:
    """What changes of the parameters of `WEARING` do to the measurements (measurements,), of which `slopes`
    (measurements, free) are the derivatives.
    """
    names = problem.free_names
    effects = {name: slopes[:, names.index(name)] for name in WEARING if name in names}
    if "mu" in effects:
        ends = np.repeat(values, 2, axis=0)
        ends[:, names.index("mu")] *= 1.0 + FRICTION * np.array([-1.0, 1.0])
        low, high = residuals(problem, ends, weighting)[:, : len(slopes)]
        if max(np.abs(low).max(), np.abs(high).max()) < IMPOSSIBLE:
            effects["mu"] = high - low
    return effects


def _predicted_sizes(problem: Problem, values: FloatArray) -> FloatArray:
    """Sizes (measurements,) of what free values (1, free) predict, by column in units of their root mean square."""
    columns, rebound = problem.all_values(values), problem.rebound(values)
    sizes = [np.abs(o.observed - problem.deviation(columns, o, rebound)[0]) for o in problem.observables]
    return np.concatenate([size / np.sqrt(np.mean(size**2)) for size in sizes])


def _slopes(problem: Problem, values: FloatArray, weighting: Weighting) -> FloatArray:
    """Derivatives (rows, free) of all weighted residuals with respect to coordinates."""
    at = problem.to_coordinates(values)
    if differentiable(problem):
        return whole_of_parts(problem, lambda part: residual_slopes(part, at, weighting)[0])
    steps = np.diag(STEP * problem.prior.width)
    low, high = np.maximum(at - steps, _ends(problem, 0)), np.minimum(at + steps, _ends(problem, 1))
    ahead = residuals(problem, problem.to_values(high), weighting)
    behind = residuals(problem, problem.to_values(low), weighting)
    return np.asarray(((ahead - behind) / np.sum(high - low, axis=1)[:, None]).T)


def _ends(problem: Problem, side: int) -> FloatArray:
    return np.array([parameter.prior.support[side] for parameter in problem.free])


def standard_deviates(
    problem: Problem, fit: Refit, sizes: dict[str, float], tables: int, rng: np.random.Generator
) -> FloatArray:
    """Deviations (tables, rows) of as many tables as the model makes: those of the table's noise as its residuals
    count them, standard normal ones of all else that is known.
    """
    deviates = rng.standard_normal((tables, fit.basis.shape[0]))
    if problem.noise.parameters:
        own = {name: np.full(tables, value) for name, value in sizes.items()}
        drawn = problem.noise.draw(rng, (tables, fit.measured.size), own)
        deviates[:, : fit.measured.size] = problem.noise.residual(drawn, own)
    return deviates


def influence(fit: Refit, misfits: Sequence[FloatArray]) -> dict[str, float]:
    """By how many of its sds each parameter moves if a part of the residuals is taken out, of which the basis has one
    of `misfits` (rank,), at most.
    """
    if not misfits:
        return {}
    moves = np.abs(np.stack([fit.reach @ misfit for misfit in misfits])).max(axis=0)
    return dict(zip(fit.names, map(float, moves), strict=True))
