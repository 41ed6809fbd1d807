"""Leave-one-impact-out predictive densities: by importance sampling, by an exact refit where that is unreliable."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp

from fitball.inference.comparison.cross_validation import refit
from fitball.inference.likelihood.posterior import pointwise
from fitball.inference.problem.problem import Problem
from fitball.inference.problem.subsample import withheld
from fitball.inference.results.results import Fit, Posterior, thinned
from fitball.inference.sampling.ensembles import Settings, sample
from fitball.inference.sampling.importance import smoothed_elpd
from fitball.values import FloatArray

# Above this shape of the fitted Pareto tail the importance sampling estimate is not to be trusted (Vehtari, Simpson,
# Gelman, Yao and Gabry 2024).
K_TRUSTED = 0.7
# Draws used, fewer on large tables so that draws times impacts fit into memory.
DRAWS = 8000
LEAST_DRAWS = 1000
ENTRIES = 4_000_000


@dataclass(frozen=True)
class LeaveOneOut:
    """Log predictive density of each left-out impact, `elpd` (impacts,); `pareto_k` (impacts,) of the importance
    sampling, `p_loo` the effective number of parameters; `refitted` impacts whose density comes from a refit, and
    `unsettled` those among them whose refit did not converge.
    """

    elpd: FloatArray
    pareto_k: FloatArray
    p_loo: float
    refitted: tuple[int, ...]
    unsettled: tuple[int, ...]

    @property
    def doubtful(self) -> tuple[int, ...]:
        """Impacts whose density rests on an importance sampling that is not to be trusted."""
        return tuple(int(k) for k in np.flatnonzero(self.pareto_k > K_TRUSTED) if int(k) not in self.refitted)

    @property
    def total(self) -> float:
        """Expected log predictive density of the whole table."""
        return float(self.elpd.sum())


def leave_one_out(
    problem: Problem, fit: Fit, posterior: Posterior, columns: Sequence[str], settings: Settings, exact: bool
) -> LeaveOneOut:
    """Score every impact by the measured `columns`; with `exact`, impacts of high Pareto k by a refit without them.

    Raises FitError as fits do.
    """
    count = len(problem.impacts)
    values = thinned(posterior, max(LEAST_DRAWS, min(DRAWS, ENTRIES // count)))
    whole, scored = pointwise(problem, values, columns)
    elpd, pareto_k = smoothed_elpd(whole, scored, _efficiency(fit, len(values)))
    average = logsumexp(scored, axis=0) - np.log(len(values))
    refitted, unsettled = [], []
    for row in np.flatnonzero(~(pareto_k <= K_TRUSTED)) if exact else []:
        elpd[row], settled = exact_elpd(problem, fit.point.optima, int(row), columns, settings)
        refitted.append(int(row))
        if not settled:
            unsettled.append(int(row))
    return LeaveOneOut(elpd, pareto_k, float(np.sum(average - elpd)), tuple(refitted), tuple(unsettled))


def exact_elpd(
    problem: Problem,
    optima: Sequence[Mapping[str, float]],
    row: int,
    columns: Sequence[str],
    settings: Settings,
) -> tuple[float, bool]:
    """Log density of the `columns` of one impact under the posterior without it, and whether that chain converged."""
    held = withheld(problem, np.array([row]))
    point = refit(held, optima)
    starts = np.array([[optimum[name] for name in problem.free_names] for optimum in point.optima])
    sampled = sample(held, problem.to_coordinates(starts), settings, None, False, lambda _progress: None)
    draws = sampled.kept.reshape(-1, problem.dimension)
    chosen = draws[np.linspace(0, len(draws) - 1, min(DRAWS, len(draws))).astype(np.int64)]
    _whole, scored = pointwise(problem, problem.to_values(chosen), columns)
    return float(logsumexp(scored[:, row]) - np.log(len(chosen))), sampled.converged


def _efficiency(fit: Fit, used: int) -> float:
    """Independent draws among those used, as a fraction; the mean over parameters, at most 1 (as ArviZ takes it)."""
    assert fit.diagnostics is not None
    sizes: NDArray[np.float64] = np.array(list(fit.diagnostics.ess_bulk.values()))
    return min(1.0, float(sizes.mean()) / used)
