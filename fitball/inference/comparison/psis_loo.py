"""Leave-one-impact-out predictive densities: by importance sampling, by an exact refit where that is unreliable."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp

from fitball.inference.comparison.held_maxima import free_values, held_maxima
from fitball.inference.identifiability.information import about
from fitball.inference.likelihood.posterior import pointwise
from fitball.inference.problem.problem import Problem
from fitball.inference.problem.subsample import withheld
from fitball.inference.results.results import TARGET_ESS, Fit, Posterior, thinned
from fitball.inference.sampling.ensembles import Settings, sample
from fitball.inference.sampling.importance import K_TRUSTED, equal_draws, refitted, smoothed_elpd
from fitball.values import FloatArray

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
    again = np.flatnonzero(~(pareto_k <= K_TRUSTED)) if exact else np.empty(0, dtype=np.int64)
    unsettled = []
    for row, optimum in zip(again, _optima_without(problem, fit, again), strict=True):
        elpd[row], settled = refitted_elpd(problem, values, whole[:, row], optimum, int(row), columns, settings)
        if not settled:
            unsettled.append(int(row))
    loss = float(np.sum(average - elpd))
    return LeaveOneOut(elpd, pareto_k, loss, tuple(again.tolist()), tuple(unsettled))


def _optima_without(problem: Problem, fit: Fit, rows: NDArray[np.int64]) -> FloatArray:
    """Coordinates (rows, free) of the maximum of the posterior without each of some impacts."""
    if not rows.size:
        return np.empty((0, problem.dimension))
    starts = free_values(problem, fit.point.optima)
    values, _cost = held_maxima(problem, [rows[k : k + 1] for k in range(rows.size)], [starts] * rows.size)
    return problem.to_coordinates(values)


def refitted_elpd(
    problem: Problem,
    values: FloatArray,
    likelihood: FloatArray,
    optimum: FloatArray,
    row: int,
    columns: Sequence[str],
    settings: Settings,
) -> tuple[float, bool]:
    """Log density of the `columns` of one impact under the posterior without it, and whether that settled.

    By `refitted`, begun from the draws (draws, free) of the whole, at which the log `likelihood` (draws,) of the
    impact is known, and about its own maximum (free,), in coordinates; where that does not settle, by a chain.
    """
    rng = np.random.default_rng(np.random.SeedSequence(settings.seed, spawn_key=(row,)))
    beside = [about(withheld(problem, np.array([row])), optimum)]
    found = refitted(problem, equal_draws(values), likelihood, row, columns, rng, TARGET_ESS, beside)
    if found is not None:
        return found.elpd, True
    return exact_elpd(problem, optimum, row, columns, settings)


def exact_elpd(
    problem: Problem, optimum: FloatArray, row: int, columns: Sequence[str], settings: Settings
) -> tuple[float, bool]:
    """As `refitted_elpd`, by a chain begun about the `optimum`; and whether that converged."""
    held = withheld(problem, np.array([row]))
    sampled = sample(held, optimum[None, :], settings, None, False, lambda _progress: None)
    draws = sampled.kept.reshape(-1, problem.dimension)
    chosen = draws[np.linspace(0, len(draws) - 1, min(DRAWS, len(draws))).astype(np.int64)]
    _whole, scored = pointwise(problem, problem.to_values(chosen), columns)
    return float(logsumexp(scored[:, row]) - np.log(len(chosen))), sampled.converged


def _efficiency(fit: Fit, used: int) -> float:
    """Independent draws among those used, as a fraction; the mean over parameters, at most 1 (as ArviZ takes it)."""
    assert fit.diagnostics is not None
    sizes: NDArray[np.float64] = np.array(list(fit.diagnostics.ess_bulk.values()))
    return min(1.0, float(sizes.mean()) / used)
