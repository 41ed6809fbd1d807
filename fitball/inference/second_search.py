"""The point fits once more from draws of the chains: a chain goes where no search began, and no point that is
published lies below a draw.
"""

from __future__ import annotations

import numpy as np

from fitball.inference.point.least_squares import deeper
from fitball.inference.point.maximum_posterior import higher_maximum
from fitball.inference.point.surface import SEARCHED
from fitball.inference.problem.problem import Problem
from fitball.inference.results.results import LeastSquares, PointFit
from fitball.inference.sampling.ensembles import Sampled
from fitball.values import FloatArray

# Draws that a search begins from; and the sds of all draws by which these lie apart.
BEGUN, APART = 4, 1.0
# Gain of log posterior worth a word: less is what a polish leaves, and moves nothing by a tenth of its sd.
NOTED = 0.01


def search_again(
    problem: Problem, squares: LeastSquares, point: PointFit, sampled: Sampled
) -> tuple[LeastSquares, PointFit, tuple[str, ...]]:
    """The point fits, searched again from the best draws of all steps where one of them lies above the point, and in
    words what came of it.
    """
    draws = sampled.chains.reshape(-1, sampled.chains.shape[-1])
    scores = sampled.log_posterior.ravel()
    # Each search costs as many evaluations as the table has rows.
    count = BEGUN if len(problem.impacts) <= SEARCHED else 1
    starts = _best_apart(draws, scores, point.log_posterior, count)
    if not starts.size:
        return squares, point, ()
    higher = higher_maximum(problem, point, problem.to_values(starts))
    if higher.log_posterior - point.log_posterior < NOTED:
        return squares, higher, ()
    after = deeper(problem, squares, [higher.values])
    words = (
        f"the first search for the maximum of the posterior ended at log posterior {point.log_posterior:.2f}, below "
        f"draws of the chains; searched again from the best of these it lies at {higher.log_posterior:.2f}, and "
        f"{_moves(problem, point, higher)}"
    )
    if after is not squares:
        words += f"; least squares fell from {squares.chi_square:.3g} to {after.chi_square:.3g}"
    if not sampled.converged:
        words += "; the ensembles, which began about the lower maximum, do not agree yet: let them run on"
    return after, higher, (words,)


def _best_apart(draws: FloatArray, scores: FloatArray, least: float, count: int) -> FloatArray:
    """At most `count` draws (found, free) above `least`, best first, none near one before it."""
    above = np.flatnonzero(scores > least)
    ranked = above[np.argsort(-scores[above], kind="stable")]
    spread = draws.std(axis=0)
    spread[spread <= 0.0] = 1.0
    chosen: list[int] = []
    while ranked.size and len(chosen) < count:
        chosen.append(int(ranked[0]))
        ranked = ranked[np.max(np.abs(draws[ranked] - draws[chosen[-1]]) / spread, axis=1) > APART]
    return draws[chosen]


def _moves(problem: Problem, before: PointFit, after: PointFit) -> str:
    """How the three parameters that moved most, in widths of their priors, did so."""
    ends = [np.array([[point.values[name] for name in problem.free_names]]) for point in (before, after)]
    way = np.abs(problem.to_coordinates(ends[1]) - problem.to_coordinates(ends[0]))[0]
    names = [problem.free_names[k] for k in np.argsort(-way / problem.prior.width, kind="stable")[:3]]
    return ", ".join(f"{name} goes from {before.values[name]:.3g} to {after.values[name]:.3g}" for name in names)
