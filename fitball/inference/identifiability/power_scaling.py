"""Sensitivity of the posterior to priors, scene and likelihood by power-scaling, with ArviZ's statistics.

Each part of the posterior density is raised to a power near one, the draws reweighted (Pareto-smoothed), and the
change of each marginal measured by the cumulative Jensen-Shannon distance per doubling of the power (Kallioinen,
Paananen, Buerkner and Vehtari 2023, Stat Comput 34, 57).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from fitball.inference.likelihood.posterior import Densities, densities
from fitball.inference.problem.problem import Problem
from fitball.inference.problem.subsample import LOOKED_AT, thinned_problem
from fitball.inference.results.evidence import PowerEvidence
from fitball.inference.results.results import Posterior, thinned
from fitball.inference.sampling.convergence import TAILS
from fitball.inference.sampling.importance import smoothed
from fitball.values import FloatArray

# The authors' threshold and powers.
SENSITIVE = 0.05
POWERS = (0.99, 1.01)
DRAWS = 4000

CONFLICT = "prior-data conflict"
WEAK = "strong prior / weak likelihood"


def power_evidence(problem: Problem, posterior: Posterior) -> dict[str, PowerEvidence]:
    """The evidence on every free parameter, in the coordinate of its prior, on a few thousand draws."""
    scored = replace(
        posterior, values=np.concatenate([posterior.values, posterior.log_posterior[..., None]], axis=-1)
    )
    values, score = np.split(thinned(scored, DRAWS), [-1], axis=1)
    coordinates = problem.to_coordinates(values)
    each = np.stack(
        [parameter.prior.log_density(coordinates[:, k]) for k, parameter in enumerate(problem.free)], axis=1
    )
    # Where a level lies among the others is the model's, not a prior: what is prior there is their spread.
    places = [pooling.place_name(label) for pooling in problem.pooling for label in pooling.labels]
    stated = np.where(np.isin(problem.free_names, places), 0.0, each)
    priors = sensitivities(coordinates, stated.sum(axis=1))
    density = _parts(problem, values, score[:, 0] - each.sum(axis=1))
    likelihood = sensitivities(coordinates, density.likelihood)
    scene = None
    if problem.contact_time is not None:
        scene = sensitivities(coordinates, density.scene)
    evidence = {}
    for k, name in enumerate(problem.free_names):
        evidence[name] = PowerEvidence(
            prior=float(priors[k]),
            own_prior=float(sensitivities(coordinates[:, k : k + 1], stated[:, k])[0]),
            scene=None if scene is None else float(scene[k]),
            likelihood=float(likelihood[k]),
            diagnosis=diagnosis(float(priors[k]), float(likelihood[k])),
        )
    return evidence


def _parts(problem: Problem, values: FloatArray, both: FloatArray) -> Densities:
    """Scene and likelihood at draws (draws, free); of a large table the likelihood is what the scene, told by a part
    of the impacts, leaves of `both` (draws,).
    """
    if len(problem.impacts) <= LOOKED_AT:
        return densities(problem, values)
    scene = densities(thinned_problem(problem, LOOKED_AT), values, measured=False)
    return replace(scene, likelihood=both - scene.scene)


def sensitivities(draws: FloatArray, log_density: FloatArray) -> FloatArray:
    """Power-scaling sensitivity (columns,) of each column of `draws` (draws, columns) to a part of the log density
    (draws,); zero for a part that is the same at every draw, which no power changes, and for a column that is, which
    no weights move. Draws may be tied, as those of a walker are that sat.
    """
    from fitball.inference.sampling.array_stats import array_stats

    if np.ptp(log_density) <= 0.0:
        return np.zeros(draws.shape[1])
    efficiency = float(array_stats.ess(log_density[None, :], method="tail", prob=TAILS)) / log_density.size
    lower, upper = (np.exp(smoothed((power - 1.0) * log_density, efficiency)[0])[None, :] for power in POWERS)
    sensitivity = np.zeros(draws.shape[1])
    for k in np.flatnonzero(np.ptp(draws, axis=0) > 0.0):
        column = draws[None, :, k]
        sensitivity[k] = array_stats.power_scale_sense(
            column, lower, upper, lower_alpha=POWERS[0], upper_alpha=POWERS[1]
        )
    return sensitivity


def diagnosis(prior: float, likelihood: float) -> str:
    """The authors' diagnosis in words, "" where there is none."""
    if prior < SENSITIVE:
        return ""
    return CONFLICT if likelihood >= SENSITIVE else WEAK
