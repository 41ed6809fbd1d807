"""Which parameters the table says nothing of by itself, however narrow they are: those that only the priors of others
hold, because they can move together without a trace.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from fitball.inference.identifiability.fisher import UNINFORMED, inverse, prior_sds
from fitball.inference.likelihood.cells import prediction_slopes
from fitball.inference.likelihood.force import force_information
from fitball.inference.problem.parameters import NOISE_SPECS
from fitball.inference.problem.problem import Problem
from fitball.inference.problem.subsample import LOOKED_AT, thinned_problem
from fitball.values import FloatArray

# Draws over which the information is averaged, fewer with force records: what moves together at all of them does so
# by the model's equations.
LOOKS, RECORDED = 50, 4
# Share of what the table adds to the priors that it must add without those of the others: below it, nothing. By the
# equations it is 1e-7 and less, on Wang's and all simulated tables 0.9 and more for parameters that a table tells.
VANISHED = 0.01
# Correlation without priors from which two parameters count as moving together.
TOGETHER = 0.9


def traded(problem: Problem, coordinates: FloatArray) -> Mapping[str, tuple[str, ...]]:
    """Parameters of which the table tells nothing once the priors of all others are widened without end, each with
    those others that it moves with, from the mean information of the table, without what the scene knows, over
    `coordinates` (draws, free). How levels and biases scatter, and what was measured of the ball, stays.
    """
    part = thinned_problem(problem, LOOKED_AT)
    slopes = prediction_slopes(part, coordinates)
    informations = np.einsum("dkmi,dkmj->dij", slopes, slopes)
    if problem.force is not None:
        # Dear, and the same at every draw in what it can tell.
        recorded = [force_information(problem, problem.force, at) for at in coordinates[:RECORDED]]
        informations = informations[:RECORDED] + np.outer(problem.prior.width, problem.prior.width) * recorded
    informations = informations[np.isfinite(informations).all(axis=(1, 2))]
    fitted = np.array([parameter.name not in NOISE_SPECS for parameter in problem.free])
    if not len(informations):
        return {}
    sds = prior_sds(problem)
    kept = np.ix_(fitted, fitted)
    information = (informations.mean(axis=0) * np.outer(sds, sds))[kept]
    parameters = [parameter for parameter in problem.free if parameter.name not in NOISE_SPECS]
    apart = np.diag([1.0 if parameter.name in problem.known_apart else 0.0 for parameter in parameters])
    alone = inverse(information + apart, UNINFORMED**-4)
    variance = np.diag(alone)
    added = 1.0 - np.diag(inverse(information, 1.0))
    lost = 1.0 / (1.0 + variance) < VANISHED * added
    correlation = np.abs(alone) / np.sqrt(np.outer(variance, variance))
    return {
        parameter.name: tuple(
            other.name for j, other in enumerate(parameters) if j != k and lost[j] and correlation[k, j] > TOGETHER
        )
        for k, parameter in enumerate(parameters)
        if lost[k] and parameter.name not in problem.known_apart
    }
