"""Stiff and sloppy directions of parameter space, in words (Gutenkunst et al. 2007).

Eigenvectors of the Fisher information in sds of the priors. An eigenvector as a combination of parameters is known to
one over the root of its eigenvalue; as a movement it is how parameters can go together unnoticed.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from fitball.inference.identifiability.fisher import UNINFORMED, fisher_information, inverse, prior_sds
from fitball.inference.problem.parameters import NOISE_SPECS, Parameter
from fitball.inference.problem.problem import Problem
from fitball.inference.results.evidence import Direction, Eigendirections
from fitball.values import FloatArray

# Components below this share of an eigenvector's length are left out of its words: together a sixteenth of its
# square.
NAMED = 0.25
# Loss by rounding exponents, as a ratio of standard errors, at which the rounded combination no longer stands for it.
FAITHFUL = 1.25


def eigendirections(problem: Problem, coordinates: FloatArray) -> Eigendirections:
    """Directions from stiff to sloppy of the parameters that are not noise, at `coordinates` (free,).

    Parameters so close to where the model ends that no derivative exists are held, and named.
    """
    informed = fisher_information(problem, coordinates, scene=True)
    alone = fisher_information(problem, coordinates, scene=False)
    fitted = [k for k, parameter in enumerate(problem.free) if parameter.name not in NOISE_SPECS]
    columns = [k for k in fitted if np.isfinite(informed[k, k])]
    parameters = [problem.free[k] for k in columns]
    block = np.ix_(columns, columns)
    informed, alone = informed[block], alone[block]
    sds = (prior_sds(problem) * problem.prior.width)[columns]
    return Eigendirections(
        directions=_directions(parameters, sds, informed),
        directions_without_scene=_directions(parameters, sds, alone),
        held=tuple(problem.free[k].name for k in fitted if k not in columns),
    )


def _directions(parameters: Sequence[Parameter], sds: FloatArray, information: FloatArray) -> tuple[Direction, ...]:
    covariance = _covariance(information)
    eigenvalues, vectors = np.linalg.eigh(information)
    directions = []
    for k in np.argsort(-eigenvalues, kind="stable"):
        words, known_to = combination(parameters, vectors[:, k], sds, covariance)
        components = {parameter.name: float(part) for parameter, part in zip(parameters, vectors[:, k], strict=True)}
        directions.append(Direction(components, words, known_to))
    return tuple(directions)


def _covariance(information: FloatArray) -> FloatArray:
    """Covariance in sds of the priors; directions the table does not see get a huge variance."""
    return inverse(information, 1.0 / (10.0 * UNINFORMED) ** 2)


def combination(
    parameters: Sequence[Parameter], vector: FloatArray, sds: FloatArray, covariance: FloatArray
) -> tuple[str, str]:
    """An eigenvector in words, and the standard error of what the words say.

    Logarithms become a product with simple exponents where rounding them costs little, values a sum in SI; a mixture
    of both is only listed, and counted in sds of the priors.
    """
    exact = math.sqrt(float(vector @ covariance @ vector))
    kept = np.abs(vector) >= NAMED
    main = int(np.argmax(np.abs(vector)))
    logs = np.array([parameter.prior.log for parameter in parameters])
    weights = np.where(kept, vector / sds, 0.0)
    weights = weights / weights[main]
    if np.all(logs[kept]):
        for grid in (1.0, 2.0, 10.0):
            rounded = np.round(grid * weights) / grid
            error = _error(rounded * sds, covariance)
            lost = np.any(kept & (rounded == 0.0))
            if (error <= FAITHFUL * exact * float(np.linalg.norm(rounded * sds)) and not lost) or grid > 2.0:
                return product(parameters, rounded), relative(error)
    if not np.any(logs[kept]):
        error = _error(weights * sds, covariance)
        unseen = error > UNINFORMED * float(np.linalg.norm(weights * sds))
        size = "unknown" if unseen else f"{error:.2g} {parameters[main].spec.unit}".rstrip()
        return _sum(parameters, weights, main), size
    order = [int(k) for k in np.argsort(-np.abs(vector)) if kept[k]]
    return "a mixture of " + _and([parameters[k].name for k in order]), (
        f"{exact:.2g} sd of the priors" if exact <= UNINFORMED else "unknown"
    )


def _error(weights: FloatArray, covariance: FloatArray) -> float:
    return math.sqrt(float(weights @ covariance @ weights))


def _sum(parameters: Sequence[Parameter], weights: FloatArray, main: int) -> str:
    """A sum such as `eps_10 + 4.1 eps_slope`, in SI."""
    words = parameters[main].name
    for k in np.argsort(-np.abs(weights), kind="stable"):
        if k != main and weights[k] != 0.0:
            words += f" {'+' if weights[k] > 0.0 else '-'} {abs(weights[k]):.2g} {parameters[k].name}"
    return words


def product(parameters: Sequence[Parameter], exponents: FloatArray) -> str:
    """A product of powers, such as `k_theta/k_y^0.5`."""

    def factors(sign: float) -> list[str]:
        powers = [(parameter.name, sign * power) for parameter, power in zip(parameters, exponents, strict=True)]
        return [name if abs(power - 1.0) < 1e-9 else f"{name}^{power:g}" for name, power in powers if power > 0.0]

    above, below = factors(1.0), factors(-1.0)
    head = " ".join(above) or "1"
    if not below:
        return head
    return f"{head}/({' '.join(below)})" if len(below) > 1 else f"{head}/{below[0]}"


def relative(error: float) -> str:
    """A standard error of a logarithm in words."""
    if error < 0.3:
        return f"{100.0 * error:.2g} %"
    # Beyond a hundred sds of any prior in use a factor has no meaning.
    return f"a factor of {math.exp(error):.2g}" if error < 10.0 else "unknown"


def _and(words: Sequence[str]) -> str:
    return words[0] if len(words) == 1 else ", ".join(words[:-1]) + " and " + words[-1]
