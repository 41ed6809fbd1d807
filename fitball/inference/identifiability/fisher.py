"""Fisher information of the table at the point estimate: what its measurements alone say, to first order; draws
of a posterior by it, where there are none of a sampler.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from fitball.inference.likelihood.cells import cells
from fitball.inference.likelihood.force import force_information
from fitball.inference.problem.problem import Problem
from fitball.inference.problem.subsample import LOOKED_AT, thinned_problem
from fitball.inference.results.evidence import InformationEvidence
from fitball.inference.results.results import PointFit
from fitball.inference.sampling.moves import StudentProposal
from fitball.values import FloatArray


def inverse(information: FloatArray, ridge: float) -> FloatArray:
    """Inverse (n, n) of a symmetric matrix without negative eigenvalues, `ridge` added to its diagonal.

    Eigenvalues that rounding left below zero count as zero. Rows that are not finite stand for parameters of which
    there is no derivative: the inverse is that of the others, with NaN in those rows and columns.
    """
    inverted = np.full(information.shape, np.nan)
    finite = np.flatnonzero(np.isfinite(np.diag(information)))
    if finite.size:
        eigenvalues, vectors = np.linalg.eigh(information[np.ix_(finite, finite)])
        inverted[np.ix_(finite, finite)] = (vectors / (np.maximum(eigenvalues, 0.0) + ridge)) @ vectors.T
    return inverted


# Optima of a fit about which its posterior is drawn.
DRAWN_ABOUT = 2
# Standard errors above this many sds of the prior are no knowledge at all.
UNINFORMED = 1e3
# A parameter that cannot move so far either way, in widths of its prior, is so close to where the model ends that its
# derivative says nothing of the table.
LEAST_ROOM = 1e-5


def fisher_information(problem: Problem, coordinates: FloatArray, *, scene: bool) -> FloatArray:
    """Expected information (free, free) of the measurements at `coordinates` (free,), in coordinates counted in sds
    of the priors; with `scene` the scene's contact time counts as a measurement.

    Where a spread depends on a parameter, twice the squared slope of its logarithm adds to that of the prediction: so
    it is with a fitted noise and with an angle, whose spread falls with the rebound speed. Uncertain incidence is a
    covariance of the columns of an impact, and what the noises of these tell is taken within it (see `cells`); that
    this covariance moves with the parameters too is left out. Of heavy tails it is what they tell of their scale and
    of their shape. Of a large table a part is looked at and counted for the whole. Rows and columns of a parameter
    that has no room to either side (LEAST_ROOM) are NaN.
    """
    whole, problem = problem, thinned_problem(problem, LOOKED_AT)
    share = len(whole.impacts) / len(problem.impacts)
    # Of columns with gaps other shares may be left.
    own = np.array([
        len(all_of.observed) / len(some.observed) / share
        for all_of, some in zip(whole.observables, problem.observables, strict=True)
    ])  # fmt: skip
    made, width = cells(problem, coordinates[None, :], slopes=True), problem.prior.width
    kinds = [parameter.name for parameter in problem.noise.parameters]
    sizes = {name: float(made.columns[name][0]) for name in kinds}
    weight = np.sqrt(own)[made.column]
    rows = made.slope[0] * weight[:, None] * width * np.sqrt(problem.noise.information(sizes))
    told = problem.noise.shape_information(sizes)
    by_cell = np.zeros((weight.size, 1 + len(kinds), width.size))
    by_cell[:, 0] = made.growth[0]
    for row, name in enumerate(kinds, start=1):
        if name in problem.free_names:
            k = problem.free_names.index(name)
            by_cell[:, row, k] = sizes[name] if problem.free[k].prior.log else 1.0
    by_cell *= weight[:, None, None] * width
    information = rows.T @ rows + np.einsum("cki,kl,clj->ij", by_cell, told, by_cell, optimize=True)
    if problem.incident is not None:
        below, above = np.tril_indices(own.size, -1)
        turn = (made.turn[0] * (own[below] * own[above])[:, None] ** 0.25 * width).reshape(-1, width.size)
        information += told[0, 0] * (turn.T @ turn)
    information *= share
    if whole.force is not None:
        information += force_information(whole, whole.force, coordinates) * np.outer(width, width)
    if scene and problem.contact_time is not None:
        row = made.pace[0] * width / problem.contact_time[1]
        information += np.outer(row, row)
    scale = prior_sds(problem)
    scaled: FloatArray = information * np.outer(scale, scale)
    ended = _without_room(problem, coordinates)
    scaled[ended], scaled[:, ended] = np.nan, np.nan
    return scaled


def _without_room(problem: Problem, coordinates: FloatArray) -> NDArray[np.bool_]:
    """Which free parameters the model cannot evaluate a step up nor a step down from `coordinates` (free,)."""
    steps = LEAST_ROOM * np.diag(problem.prior.width)
    around = np.concatenate([coordinates + steps, coordinates - steps])
    failed = np.any(problem.rebound(problem.to_values(around)).status, axis=1)
    return np.asarray(np.all(failed.reshape(2, -1), axis=0))


def prior_sds(problem: Problem) -> FloatArray:
    """Sds of the priors (free,) in their widths: 1 for a normal prior, the root of 1/12 for a uniform one."""
    return np.array([1.0 if parameter.prior.normal else 12.0**-0.5 for parameter in problem.free])


def information_evidence(problem: Problem, coordinates: FloatArray) -> dict[str, InformationEvidence]:
    """The information about the free parameters at `coordinates` (free,), but for those without a derivative."""
    with_scene = fisher_information(problem, coordinates, scene=True)
    without = fisher_information(problem, coordinates, scene=False)
    errors, errors_without = standard_errors(with_scene), standard_errors(without)
    # What the scene knows stands before the table, as in the contraction of a posterior.
    before, after = with_scene - without, with_scene
    shares = 1.0 - (1.0 - _contraction(after)) / (1.0 - _contraction(before))
    shares_without = _contraction(without)
    return {
        name: InformationEvidence(
            None if errors[k] > UNINFORMED else float(errors[k]),
            None if errors_without[k] > UNINFORMED else float(errors_without[k]),
            float(shares[k]),
            float(shares_without[k]),
        )
        for k, name in enumerate(problem.free_names)
        if np.isfinite(errors[k])
    }


def standard_errors(information: FloatArray) -> FloatArray:
    """Standard errors (free,) in sds of the priors; those of directions the table does not see are very large, and
    those of parameters without a derivative NaN.
    """
    # A millionth of a prior's sd to the minus two stands for nothing: errors reach a thousand sds of a prior.
    errors: FloatArray = np.sqrt(np.diag(inverse(information, 1e-2 / UNINFORMED**2)))
    return errors


def _contraction(information: FloatArray) -> FloatArray:
    """First-order contraction (free,) by measurements and priors; NaN without a derivative."""
    shares: FloatArray = 1.0 - np.diag(inverse(information, 1.0))
    return shares


def about(problem: Problem, optimum: FloatArray) -> StudentProposal:
    """The proposal by the information of table and priors at an optimum (free,)."""
    information = np.nan_to_num(fisher_information(problem, optimum, scene=True))
    width = problem.prior.width * prior_sds(problem)
    covariance = inverse(information, 1.0) * np.outer(width, width)
    return StudentProposal(optimum, np.asarray(np.linalg.cholesky(covariance), dtype=np.float64))


def first_order_draws(problem: Problem, point: PointFit, count: int, rng: np.random.Generator) -> FloatArray:
    """Free values (count, free) in SI of the normal distribution about a point that the information of table, scene
    and priors promises, within the bounds.
    """
    at = problem.to_coordinates(np.array([[point.values[name] for name in problem.free_names]]))[0]
    width = problem.prior.width * prior_sds(problem)
    information = np.nan_to_num(fisher_information(problem, at, scene=True))
    factor = np.linalg.cholesky(inverse(information, 1.0)) * width[:, None]
    draws = at + rng.standard_normal((count, at.size)) @ factor.T
    return problem.to_values(np.clip(draws, *problem.prior.limits))
