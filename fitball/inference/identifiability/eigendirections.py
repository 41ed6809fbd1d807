"""Stiff and sloppy directions of parameter space, in words (Gutenkunst et al. 2007).

Eigenvectors of the Fisher information in sds of the priors. An eigenvector as a combination of parameters is known to
one over the root of its eigenvalue; as a movement it is how parameters can go together unnoticed.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence, Set

import numpy as np

from fitball.inference.identifiability.fisher import UNINFORMED, fisher_information, inverse, prior_sds
from fitball.inference.identifiability.products import (
    known_products,
    log_covariance,
    log_steps,
    monomial_error,
    positive,
)
from fitball.inference.problem.parameters import NOISE_SPECS, Parameter
from fitball.inference.problem.problem import Problem
from fitball.inference.results.evidence import Direction, Eigendirections
from fitball.inference.results.results import Posterior
from fitball.values import FloatArray

# Components below this share of an eigenvector's length are left out of its words: together a sixteenth of its
# square.
NAMED = 0.25
# Loss by rounding exponents, as a ratio of standard errors, at which the rounded combination no longer stands for it.
FAITHFUL = 1.25
# Standard errors, in sds of the prior, from which the table is said to leave a direction open, and a gain by the
# scene that makes it known through the scene.
OPEN_SDS, SCENE_GAIN = 1.0, 0.5
# Standard error, as a share of that of two parameters, from which a third beside them is told.
WITH_THIRD = 0.5


def eigendirections(problem: Problem, coordinates: FloatArray, posterior: Posterior | None = None) -> Eigendirections:
    """Directions from stiff to sloppy of the parameters that are not noise, at `coordinates` (free,); the sentences
    name the products that are known better than their factors, by the posterior where there is one.

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
    steps = log_steps(problem, coordinates, columns)
    told = _sentences(problem, parameters, sds, steps, alone, _covariance(informed), _covariance(alone))
    sentences = [*told, *_products(problem, log_covariance(problem, coordinates, posterior), told.values())]
    ends = [problem.free[k].name for k in fitted if k not in columns]
    if ends:
        sentences.append(
            f"the model ends next to the maximum in {_and(ends)}: there is no derivative, and what is said to first "
            f"order takes {_and(ends)} as fixed"
        )
    return Eigendirections(
        directions=_directions(parameters, sds, informed),
        directions_without_scene=_directions(parameters, sds, alone),
        sentences=tuple(sentences),
    )


def _products(problem: Problem, covariance: FloatArray, told: Collection[Set[str]]) -> list[str]:
    """The products that are known better than what they are made of, but for those of names that were `told`."""
    parameters = [parameter for parameter in problem.free if positive(parameter)]
    sentences = []
    for known in known_products(covariance):
        used = np.flatnonzero(known.exponents)
        if {parameters[k].name for k in used} in told:
            continue
        factors = [f"{parameters[k].name} to {relative(math.sqrt(covariance[k, k]))}" for k in used]
        sentences.append(
            f"{product(parameters, known.exponents)} is known to {relative(known.error)}, but {_and(factors)}"
        )
    return sentences


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


def _sentences(
    problem: Problem,
    parameters: Sequence[Parameter],
    sds: FloatArray,
    steps: FloatArray,
    alone: FloatArray,
    with_scene: FloatArray,
    without: FloatArray,
) -> dict[str, Set[str]]:
    """What can move unnoticed by the table, and what the scene makes of it, with the names of the parameters in it;
    `steps` are the changes of logarithms for one sd of a prior, NaN where there are none.
    """
    eigenvalues, vectors = np.linalg.eigh(alone)
    sentences: dict[str, Set[str]] = {}
    for k in range(eigenvalues.size):
        if eigenvalues[k] * OPEN_SDS**2 >= 1.0:
            break
        vector = vectors[:, k]
        kept = [int(j) for j in np.argsort(-np.abs(vector)) if abs(vector[j]) >= NAMED]
        before, after = _error(vector, without), _error(vector, with_scene)
        through = after < SCENE_GAIN * before and problem.contact_time is not None
        source = "only through the scene's contact time" if through else "only through the priors"
        named = {parameters[j].name for j in kept}
        if len(kept) == 1:
            sentences[f"{parameters[kept[0]].name} is known {source}"] = named
        elif len(kept) == 2 and all(parameters[j].prior.log for j in kept):
            sentences[_pair(parameters, sds, steps, without, vector, sorted(kept, reverse=True), source)] = named
        else:
            names = _and([parameters[j].name for j in kept])
            sentences[f"{names} can move together without a trace in the table; how far is known {source}"] = set()
    return sentences


def _pair(
    parameters: Sequence[Parameter],
    sds: FloatArray,
    steps: FloatArray,
    covariance: FloatArray,
    vector: FloatArray,
    kept: Sequence[int],
    source: str,
) -> str:
    """Two logarithms that move together: what stays as it is, alone or with a third, and how well that is known."""
    first, second = kept
    moved = vector * sds
    power = np.round(2.0 * moved[first] / moved[second]) / 2.0
    if power == 0.0:
        return f"{parameters[second].name} is known {source}"
    exponents = np.zeros(len(parameters))
    exponents[first], exponents[second] = 1.0, -power
    other = "product" if power > 0.0 else "ratio"
    exponents, error = _with_third(exponents, np.asarray(covariance * np.outer(steps, steps)))
    if np.count_nonzero(exponents) > 2:
        other += f" of {parameters[first].name} and {parameters[second].name}"
    size = relative(error)
    known = "is not known" if size == "unknown" else f"is known to {size}"
    return f"{product(parameters, exponents)} {known}, {'the' if ' of ' in other else 'their'} {other} {source}"


def _with_third(exponents: FloatArray, covariance: FloatArray) -> tuple[FloatArray, float]:
    """A monomial of two, or one with a third factor beside them if that is much better known; and its error."""
    least = monomial_error(exponents, covariance)
    best, best_error = exponents, WITH_THIRD * least
    for k in np.flatnonzero((exponents == 0.0) & np.isfinite(np.diag(covariance))):
        for power in (1.0, -1.0, 2.0, -2.0):
            tried = exponents.copy()
            tried[k] = power
            error = monomial_error(tried, covariance)
            if error < best_error:
                best, best_error = tried, error
    return best, least if best is exponents else best_error
