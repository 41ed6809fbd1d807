"""Fisher information of the table at the point estimate: what its measurements alone say, to first order."""

from __future__ import annotations

import numpy as np

from fitball.inference.posterior import Problem
from fitball.values import FloatArray

# Step of the differences, in widths of the prior: small beside any posterior, large beside rounding.
STEP = 1e-5


def sensitivities(problem: Problem, coordinates: FloatArray) -> FloatArray:
    """Derivatives (measurements, free) of all predictions, in units of their noise, with respect to
    coordinates (free,) counted in widths of the priors.

    One-sided where the other side cannot be evaluated.
    """
    steps = STEP * np.diag(problem.prior.width)
    points = np.concatenate([coordinates[None, :], coordinates + steps, coordinates - steps])
    values = problem.to_values(points)
    rebound = problem.rebound(values)
    columns = problem.all_values(values)
    rows = []
    for channel in problem.channels:
        noise = columns[channel.noise][:1, None] if channel.noise is not None else 0.0
        rows.append(channel.predict(rebound) / channel.spread(noise, rebound)[:1])
    found = np.concatenate(rows, axis=1)
    count = problem.dimension
    middle, up, down = found[0], found[1 : 1 + count], found[1 + count :]
    forward, backward = (up - middle) / STEP, (middle - down) / STEP
    central = 0.5 * (forward + backward)
    one_sided = np.where(np.isfinite(forward), forward, backward)
    slopes: FloatArray = np.where(np.isfinite(central), central, one_sided)
    return slopes.T


def contraction_without_scene(problem: Problem, coordinates: FloatArray) -> FloatArray:
    """First-order contraction (free,) of each parameter by table and priors alone, without what the scene
    knows of the contact time.
    """
    slopes = sensitivities(problem, coordinates)
    # In widths of the prior a normal prior has unit precision, a uniform one that of its variance of 1/12.
    precision = np.array([1.0 if item.prior.normal else 12.0 for item in problem.free])
    covariance = np.linalg.inv(slopes.T @ slopes + np.diag(precision))
    shares: FloatArray = 1.0 - np.diag(covariance) * precision
    return shares
